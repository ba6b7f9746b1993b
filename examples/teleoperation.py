"""Teleoperation at 250 Hz: a leader's joints in, certified commands out, deadlines counted.

    python examples/teleoperation.py --robot g1 --seconds 10

The leader is made up: arms that swing through the body, a jump now and then, a frame that is lost.
So are the encoders. In a real loop `leader` reads the leader arm, `measured` the robot's encoders,
and the command goes to the motors.
"""

import argparse
import gc
import time
from collections import Counter

import numpy as np

from s3le import Guard
from s3le.errors import ParameterError, StateError


def leader(guard: Guard, rng: np.random.Generator):
    """Joint angles that somebody might ask for, by time [s]; NaN where a frame was lost."""
    low, high = guard.robot.lower, guard.robot.upper
    rate, phase = rng.uniform(0.1, 0.5, len(low)), rng.uniform(0.0, 2.0 * np.pi, len(low))

    def at(t: float) -> np.ndarray:
        q = 0.5 * (low + high) + 0.6 * (high - low) * np.sin(2.0 * np.pi * rate * t + phase)
        if t % 3.0 < 0.2:
            q = np.roll(q, 1)  # a jump
        return np.full_like(q, np.nan) if rng.uniform() < 0.002 else q

    return at


def main() -> None:
    """Run the loop and say how it went."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--robot", default="g1")
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--rate", type=float, default=250.0, help="[Hz]")
    given = parser.parse_args()

    rng, dt = np.random.default_rng(0), 1.0 / given.rate
    guard = Guard.load(given.robot)  # compiles kernels the first time on a machine
    wanted = leader(guard, rng)
    count = max(int(given.seconds * given.rate), 1)
    took, late, uncertified, lost, reasons = np.zeros(count), 0, 0, 0, Counter()
    came = guard.q
    gc.collect()
    gc.freeze()  # nothing made so far is looked through again
    begin = time.perf_counter()
    for k in range(count):
        measured = came + rng.normal(0.0, 0.002, len(came))  # a step behind, and noisy
        came = guard.q
        start = time.perf_counter()
        try:
            step = guard.step(wanted(k * dt), dt, measured)
        except ParameterError:  # a frame that is no pose: brake until there is one
            lost += 1
            step = guard.step(None, dt)
        except StateError as refusal:  # the robot is not where it should be; the stop is latched
            print(refusal)
            step = guard.step(None, dt)
        took[k] = time.perf_counter() - start
        uncertified += not step.certified
        reasons[" ".join(step.reason.split()[:2])] += 1
        # Here step.q goes to the motors.
        spare = begin + (k + 1) * dt - time.perf_counter()
        if spare < 0.0:
            late += 1
        else:
            time.sleep(spare)
    print(
        f"{count} steps at {given.rate:g} Hz, {late} missed deadlines, {lost} frames lost, "
        f"{uncertified} not certified"
    )
    print(
        f"a step took {np.median(took) * 1e3:.2f} ms in the median, {np.max(took) * 1e3:.2f} most"
    )
    for reason, times in reasons.most_common():
        print(f"{times:6} {reason}")


if __name__ == "__main__":
    main()
