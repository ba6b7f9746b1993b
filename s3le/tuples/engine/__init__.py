"""Rows made in shards: by many workers, on one machine or several, resumable, never stale.

The engine knows nothing of robots. It is given a task (engine/task.py says what that is) and a
number of rows; it keeps each finished shard under a hash of everything that can change its bytes.
"""
