"""A ROS 2 JointTrajectory in, the nearest certified one out.

    pip install "s3le[ros]"
    python examples/ros2_trajectory.py --robot g1

`guarded` takes and gives trajectory_msgs/msg/JointTrajectory and reads nothing but its fields, so
it works on messages of rclpy as on those of rosbags, which need no ROS. In a node:

    from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint
    out = guarded(guard, message, JointTrajectory, JointTrajectoryPoint, Duration)
"""

import argparse
from collections import Counter
from functools import partial

import numpy as np

from s3le import Guard
from s3le.errors import ParameterError

LONGEST = 10.0  # [s] that a robot gets to come to where a trajectory ends


def guarded(guard: Guard, message, trajectory, point, duration, rate: float = 100.0):
    """The certified trajectory that is nearest to a message's, from where the guard's robot is.

    Args:
        guard: of the robot; it moves on to the end of what comes out.
        message: a JointTrajectory. Joints that the robot holds may be among its own; they stay
            where the robot holds them and are left out.
        trajectory, point, duration: what makes the three kinds of message, from keywords.
        rate: points per second of what comes out [Hz].

    Returns:
        (the message, the reasons of its points)

    Raises:
        ParameterError: a joint is missing or unknown, or an angle is none; see Guard.step. Or there
            is no point, or their times do not rise.
    """
    names, own = list(message.joint_names), guard.robot.joint_names
    given = np.array([list(p.positions) for p in message.points])  # (m, joints)
    ends = np.array([p.time_from_start.sec + 1e-9 * p.time_from_start.nanosec
                     for p in message.points])  # fmt: skip
    if not len(ends) or not (np.diff(ends) > 0.0).all() or ends[0] < 0.0:
        raise ParameterError("a trajectory needs points whose times rise from 0 s")
    start = dict(zip(own, guard.q, strict=True))
    times = np.arange(1, max(int(np.ceil(ends[-1] * rate)), 1) + 1) / rate
    # Between its points a trajectory is straight; before its first one it comes from where we are.
    wanted = {}
    for column, name in zip(given.T, names, strict=True):
        here = start.get(name, column[0])
        at, angles = (ends, column) if ends[0] <= 0.0 else (np.r_[0.0, ends], np.r_[here, column])
        wanted[name] = np.interp(times, at, angles)
    rows = guard.chunk(wanted, 1.0 / rate, advance=True)
    q, v, reasons = list(rows.q), list(rows.v), list(rows.reason)
    goal = {name: angles[-1] for name, angles in wanted.items()}
    for _ in range(int(LONGEST * rate)):
        if not guard.v.any():
            break  # it is there, or as near as it gets
        made = guard.step(goal, 1.0 / rate)
        q.append(made.q)
        v.append(made.v)
        reasons.append(made.reason)
    points = []
    for k in range(len(q)):
        sec, nanosec = divmod(round((k + 1) * 1e9 / rate), 10**9)
        points.append(
            point(
                positions=q[k], velocities=v[k], accelerations=np.zeros(0), effort=np.zeros(0),
                time_from_start=duration(sec=sec, nanosec=nanosec),
            )
        )  # fmt: skip
    return trajectory(header=message.header, joint_names=own, points=points), reasons


def main() -> None:
    """Send both hands through the body, over the wire format, and say what came of it."""
    from rosbags.typesys import Stores, get_typestore

    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--robot", default="g1")
    robot = parser.parse_args().robot

    store = get_typestore(Stores.ROS2_HUMBLE)
    kinds = {name.rpartition("/")[2]: kind for name, kind in store.types.items()}
    trajectory, point, duration = (
        partial(kinds[name]) for name in ("JointTrajectory", "JointTrajectoryPoint", "Duration")
    )
    header = kinds["Header"](stamp=kinds["Time"](sec=0, nanosec=0), frame_id="")
    guard = Guard.load(robot)
    inwards = guard.q
    for i, name in enumerate(guard.robot.joint_names):
        if "shoulder_roll" in name or "ShLat" in name:
            inwards[i] = guard.robot.lower[i] if guard.q[i] > 0.0 else guard.robot.upper[i]
    empty = np.zeros(0)
    asked = trajectory(
        header=header, joint_names=guard.robot.joint_names,
        points=[
            point(positions=q, velocities=empty, accelerations=empty, effort=empty,
                  time_from_start=duration(sec=sec, nanosec=0))
            for sec, q in ((1, inwards), (2, guard.q))
        ],
    )  # fmt: skip
    name = "trajectory_msgs/msg/JointTrajectory"
    message = store.deserialize_cdr(bytes(store.serialize_cdr(asked, name)), name)
    made, reasons = guarded(guard, message, trajectory, point, duration)
    sent = bytes(store.serialize_cdr(made, name))
    print(f"{len(message.points)} points in, {len(made.points)} out, {len(sent)} bytes")
    for reason, count in Counter(reasons).most_common():
        print(f"{count:6} {reason}")


if __name__ == "__main__":
    main()
