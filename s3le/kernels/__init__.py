"""Compiled, batched kinematics, distances and constrained solves; the only door to numba.

Nothing here certifies a pose: results are checked by s3le.robot.certificate before they are kept.
The proof of a path between two poses is here (segment); s3le.safety.judge is its second opinion.
"""
