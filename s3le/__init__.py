"""S3LE: human motion to humanoid motion, every returned pose certified feasible.

What people use is handed out at its first use, so that importing a room costs that room alone.

    from s3le import Robot, read_clip, retarget_clip, retargeter_for
    made = retarget_clip("walk.bvh", retargeter_for(Robot.load("coman")))
"""

import os
from importlib import import_module

__version__ = "0.2.0"
_HOME = {  # name -> the module that defines it
    "Guard": "s3le.guard.guard",
    "Retargeter": "s3le.retarget.stream",
    "Robot": "s3le.robot.robot",
    "audit": "s3le.safety.audit",
    "read_clip": "s3le.human.read",
    "retarget_clip": "s3le.retarget.clip",
    "retargeter_for": "s3le.retarget.stored",
}
__all__ = ["Guard", "Retargeter", "Robot", "__version__", "audit", "read_clip", "retarget_clip",
           "retargeter_for"]  # fmt: skip

# Threads of torch and numba that wait for each other by spinning take three times as long when
# anything else runs on the machine. Read when their libraries load, so set here, before they do;
# neither the count of threads nor any bit of a result depends on them.
for _name, _value in (
    ("OMP_WAIT_POLICY", "passive"), ("KMP_BLOCKTIME", "0"), ("GOMP_SPINCOUNT", "0"),
):  # fmt: skip
    os.environ.setdefault(_name, _value)


def __getattr__(name: str) -> object:
    """What is asked for, from the module that defines it."""
    if name not in _HOME:
        raise AttributeError(f"module 's3le' has no attribute {name!r}")
    found = getattr(import_module(_HOME[name]), name)
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    """Names, those not yet loaded included."""
    return sorted({*globals(), *_HOME})
