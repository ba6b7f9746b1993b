"""The project on a tiny configuration in a folder of its own, and how tests run things there.

Clips are made here, so nothing is fetched: the paths of a run are what is tested, not its numbers.
"""

import math
import os
import shutil
import subprocess
import sys
from pathlib import Path

import handmade
from dag import ROOT
from PIL import Image
from ruamel.yaml import YAML

from s3le.store import cache

TINY = {
    "skeletons": {"domain_rows": 300},
    "pair": {"rows": 30},
    "sample": {"rows": 300},
    "poses": {"rows": 100},
    "coverage": {"rows": 200},
    "truth": {"starts": 2},
    "train": {"hidden": 16, "latent": 6, "history_every": 2},
    "s3le": {"steps": 4, "batch": 16, "batch_pairs": 8, "batch_domain": 16},
    "lwl2": {"steps": 4, "batch_pairs": 8, "batch_domain": 16},
    "ale": {"steps": 4, "batch_pairs": 8, "batch_domain": 16},
    "synthetic": {"seeds": 2, "points": 60, "steps": 3, "batch": 8, "hidden": 8, "grid": 5},
    "report": {"strip_frames": 2},
}
STAGES = 33
CHANGED = (".dvc", "data", "reports", "dvc.lock", "params.yaml")  # by a run
RECORDS = ("reports/latency.json",)  # of reports/, what a run reads


def swing(path: Path, phase: float, frames: int) -> None:
    """A human of DeepMimic's who swings both arms and bends the elbows."""
    rows = []
    for k in range(frames):
        t = phase + 2 * math.pi * k / frames
        half = 0.5 * math.sin(t)
        right = [math.cos(half), math.sin(half), 0.0, 0.0]
        left = [math.cos(half), 0.0, 0.0, math.sin(half)]
        elbow = 0.8 + 0.6 * math.cos(t)
        rows.append({25: right, 29: [elbow], 39: left, 43: [elbow]})
    handmade.write(path, handmade.deepmimic(*rows))


def environment(folder: Path) -> dict[str, str]:
    return os.environ | {
        "PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}",
        "PYTHONPATH": str(folder),  # this folder's code, whatever is installed
        # Copies of this project have its kernels: what one of them compiles serves all.
        "NUMBA_CACHE_DIR": os.environ.get("NUMBA_CACHE_DIR") or str(cache.folder()),
        "DVC_NO_ANALYTICS": "1",
        "GIT_AUTHOR_NAME": "t", "GIT_AUTHOR_EMAIL": "t@t",
        "GIT_COMMITTER_NAME": "t", "GIT_COMMITTER_EMAIL": "t@t",
    }  # fmt: skip


def shell(folder: Path, *command: str) -> subprocess.CompletedProcess:
    return subprocess.run(
        command, cwd=folder, env=environment(folder), capture_output=True, text=True, check=False
    )


def good(folder: Path, *command: str) -> str:
    done = shell(folder, *command)
    assert done.returncode == 0, f"{command}\n{done.stdout[-3000:]}\n{done.stderr[-3000:]}"
    return done.stdout + done.stderr


def mend(folder: Path, said: str) -> None:
    """What docs/engine.md says to do where dvc was killed while it wrote a file of its own."""
    if "Unable to read RWLock-file" in said:
        (folder / ".dvc" / "tmp" / "rwlock").unlink()
    else:
        assert "dvc.lock' validation failed" in said, said
        good(folder, "git", "checkout", "-q", "dvc.lock")


def after_kills(folder: Path, *command: str) -> str:
    """A command that must do, once what the last kill left of dvc's own files is put right."""
    done = shell(folder, *command)
    if done.returncode:
        mend(folder, done.stderr)
        return good(folder, *command)
    return done.stdout + done.stderr


def ran(output: str) -> set[str]:
    marks = [line for line in output.splitlines() if line.startswith("Running stage '")]
    return {line.split("'")[1] for line in marks}


def set_params(folder: Path, tree: dict) -> None:
    yaml = YAML()
    path = folder / "params.yaml"
    params = yaml.load(path)
    for key, value in tree.items():
        if isinstance(value, dict):
            params[key].update(value)
        else:
            params[key] = value
    yaml.dump(params, path)


def put(source: Path, target: Path) -> None:
    """Make what a run changes in one project what it is in another."""
    for name in CHANGED:
        old, new = target / name, source / name
        shutil.rmtree(old) if old.is_dir() else old.unlink(missing_ok=True)
        shutil.copytree(new, old) if new.is_dir() else shutil.copy2(new, old)


def make(folder: Path) -> None:
    """A copy of the project after one whole run, committed."""
    listed = subprocess.run(
        ["git", "ls-files", "-co", "--exclude-standard"],
        cwd=ROOT, capture_output=True, text=True, check=True,
    ).stdout.split("\n")  # fmt: skip
    for name in filter(None, listed):
        made = name.startswith(("reports/", "tests/")) and name not in RECORDS
        if not made and name != "dvc.lock":
            if (ROOT / name).is_file():
                (folder / name).parent.mkdir(parents=True, exist_ok=True)
                shutil.copyfile(ROOT / name, folder / name)
    clips = folder / "data" / "clips" / "mine"
    for k, split in enumerate(("train", "train", "test", "test")):
        swing(clips / split / f"swing_{k}.txt", 0.7 * k, 12 + k)
    set_params(folder, TINY | {"clips": "mine"})
    video = folder / "reports" / "video"
    video.mkdir(parents=True)
    Image.new("RGB", (40, 30), "white").save(video / "figure.png")
    (video / "figure.json").write_text('{"title": "a video", "caption": "white."}')
    good(folder, "git", "init", "-q")
    output = good(folder, sys.executable, str(Path(__file__).with_name("forked.py")), "repro")
    assert len(ran(output)) == STAGES
    good(folder, "git", "add", "-A")
    good(folder, "git", "commit", "-qm", "first run")
