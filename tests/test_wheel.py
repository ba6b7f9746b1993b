"""The wheel alone, in an empty folder, with everything missing that is an extra."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from command import ROOT, waving
from handmade import write

from s3le.kernels import compiled


@pytest.mark.wide
@pytest.mark.slow
def test_the_wheel_alone_makes_a_motion_without_torch_dvc_or_a_checkout(tmp_path):
    """Unpacked into an empty folder, with everything missing that is an extra."""
    source = tmp_path / "source"
    shutil.copytree(
        ROOT, source, ignore=shutil.ignore_patterns(".*", "data", "reports", "build", "*.egg-info")
    )
    subprocess.run(
        [sys.executable, "-m", "pip", "wheel", "-q", "--no-deps", "--no-build-isolation",
         "-w", tmp_path, source], check=True,
    )  # fmt: skip
    (wheel,) = tmp_path.glob("*.whl")
    assert wheel.name == "s3le-0.2.0-py3-none-any.whl" and wheel.stat().st_size < 10 * 2**20
    installed = tmp_path / "installed"
    shutil.unpack_archive(wheel, installed, "zip")
    assert {path.name for path in installed.iterdir()} == {"s3le", "s3le-0.2.0.dist-info"}
    needs = (installed / "s3le-0.2.0.dist-info" / "METADATA").read_text(encoding="utf-8")
    base = [line for line in needs.splitlines()
            if line.startswith("Requires-Dist") and "extra ==" not in line]  # fmt: skip
    assert base and not any(name in " ".join(base) for name in ("torch", "dvc", "ray", "viser"))
    missing = tmp_path / "missing"
    missing.mkdir()
    for name in ("torch", "dvc", "psutil", "ray", "viser", "av", "mujoco", "pipeline"):
        (missing / f"{name}.py").write_text(f"raise ModuleNotFoundError('no {name} here')\n")
    here = tmp_path / "empty"
    here.mkdir()
    write(here / "walk.bvh", waving())
    env = os.environ | {
        "PYTHONPATH": f"{missing}:{installed}", "XDG_CACHE_HOME": str(tmp_path / "cache"),
        "NUMBA_CACHE_DIR": str(compiled.place()),  # benchmarks/first_motion.py compiles anew
    }  # fmt: skip

    def s3le_says(*words):
        return subprocess.run(
            [sys.executable, "-m", "s3le.cli", *words], cwd=here, env=env, check=True,
            capture_output=True, text=True,
        ).stdout  # fmt: skip

    listed = json.loads(s3le_says("robot", "list", "--json"))
    assert {str(installed / "s3le/robots")} == {str(Path(robot["file"]).parent) for robot in listed}
    said = s3le_says("retarget", "walk.bvh", "--out", "motions")
    assert "20,000 stored poses" in said and "certified" in said
    assert "CERTIFIED" in s3le_says("audit", "motions/walk.parquet")
    (kept,) = (tmp_path / "cache" / "s3le" / "poses").glob("coman-*")
    assert sum(p.stat().st_size for p in kept.rglob("*") if p.is_file()) < 10 * 2**20
