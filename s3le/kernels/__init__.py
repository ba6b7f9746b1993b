"""Compiled, batched kinematics, distances and constrained solves; the only door to numba.

Nothing here certifies anything: results are checked by s3le.robot.certificate before they are kept.
"""
