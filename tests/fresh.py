"""A fresh process of this checkout."""

import os
import subprocess
import sys

from command import ROOT


def python(code, **env):
    """A fresh process of this checkout."""
    return subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=300,
        env=os.environ | {"PYTHONPATH": str(ROOT)} | env,
    )  # fmt: skip
