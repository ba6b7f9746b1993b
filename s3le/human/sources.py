"""Where clips come from: a demo inside a package, CMU's database, or a folder of one's own.

Every source answers with files on disk, split into train, test and, for some, heldout; what
it left out is listed, never dropped silently. Nothing is read as motion here: see `read`.
"""

import hashlib
import importlib.util
import os
import shlex
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Callable
from difflib import get_close_matches
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from s3le.errors import ClipError, FetchError, ParameterError
from s3le.human import fetch
from s3le.human import manifest as manifests
from s3le.human.clip import clip_name
from s3le.human.keypoints.folders import is_frame
from s3le.human.manifest import SPLITS
from s3le.human.read import READ, first_bytes, is_clip, suffix_of
from s3le.human.text import MAX_BYTES, looks_like, read_bytes
from s3le.store.atomic import replace

CMU_BASE = "http://mocap.cs.cmu.edu"
WHEEL = "pybullet==3.2.7"
WHEEL_SHA256 = "5d858abf7c12a21ef3ed351cf81dac1b5e486ec25c9ab59bfc84beb89034edff"
_IN_WHEEL = "pybullet_data/data/motions/humanoid3d_{}.txt"
_PLATFORM = (
    "--python-version 3.11 --implementation cp --abi cp311 "
    "--platform manylinux_2_17_x86_64 --platform manylinux2014_x86_64"
)


class Source(NamedTuple):
    """One clip: its name, its split, its file, its rate [Hz] (None: the file's), what it is."""

    clip: str
    split: str
    path: Path
    fps: float | None
    description: str


class Sources(NamedTuple):
    """What a source has.

    Attributes:
        clips: in the order of the manifest, or sorted by split and name.
        left_out: one sentence for each trial or file that was asked for or found and is not
            among them.
    """

    clips: list[Source]
    left_out: list[str]


def demo(
    manifest: Path,
    cache: Path,
    download: Callable[[Path], Path] | None = None,
    wheel_sha256: str = WHEEL_SHA256,
) -> Sources:
    """DeepMimic's clips, taken out of pybullet's wheel, which is not installed.

    The wheel (103 MB) is fetched with the user's own pip and its configuration, once, and
    deleted; only the text files listed stay in the cache.

    Args:
        manifest: CSV with clip, split, sha256, description.
        cache: folder of the text files; made where it is missing.
        download: puts the wheel into a folder and returns its path; pip_wheel if None.
        wheel_sha256: what the wheel must be.

    Raises:
        FetchError: the wheel cannot be had, or it or a file in it is not the one listed.
        ClipError: the manifest is not as described.
    """
    rows = manifests.manifest(manifest, ("clip", "split", "sha256", "description"))
    paths = {row["clip"]: Path(cache) / f"{row['clip']}.txt" for row in rows}

    def intact(row: dict[str, str]) -> bool:
        path = paths[row["clip"]]
        return path.is_file() and fetch.sha256(path) == row["sha256"]

    if not all(map(intact, rows)):
        Path(cache).mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=cache) as scratch:
            wheel = (download or pip_wheel)(Path(scratch))
            if (seen := fetch.sha256(wheel)) != wheel_sha256:
                raise FetchError(f"{wheel.name}: sha256 is {seen}, wanted {wheel_sha256}")
            for row in rows:
                _extract(wheel, row, paths[row["clip"]])
    return Sources(
        [Source(r["clip"], r["split"], paths[r["clip"]], None, r["description"]) for r in rows], []
    )


def pip_wheel(folder: Path) -> Path:
    """Download pybullet's wheel with this interpreter's pip; PIP_ARGS in the environment adds.

    Raises:
        FetchError: there is no pip here, or it fails.
    """
    if importlib.util.find_spec("pip") is None:
        raise FetchError(f"{sys.executable} has no pip to download {WHEEL}; python -m ensurepip")
    command = [sys.executable, "-m", "pip", "download", WHEEL, "--no-deps"]
    command += ["--only-binary=:all:", *_PLATFORM.split(), "-d", str(folder)]
    command += shlex.split(os.environ.get("PIP_ARGS", ""))
    status = subprocess.run(command, check=False).returncode
    wheels = sorted(folder.glob("*.whl"))
    if status or len(wheels) != 1:
        raise FetchError(
            f"pip download {WHEEL} ended with status {status}; configure pip's package index, "
            "or put its options into PIP_ARGS (a wheel at hand: --no-index --find-links FOLDER)"
        )
    return wheels[0]


def _extract(wheel: Path, row: dict[str, str], target: Path) -> None:
    member = _IN_WHEEL.format(row["clip"])
    try:
        with zipfile.ZipFile(wheel) as archive, archive.open(member) as stream:
            data = stream.read(MAX_BYTES)
    except (KeyError, zipfile.BadZipFile, OSError) as error:
        raise FetchError(f"{wheel.name}: {member}: {error}") from None
    if (seen := hashlib.sha256(data).hexdigest()) != row["sha256"]:
        raise FetchError(f"{wheel.name}: {member}: sha256 is {seen}, wanted {row['sha256']}")
    replace(target, lambda part: part.write_bytes(data))


def cmu(
    manifest: Path,
    cache: Path,
    base: str | Path = CMU_BASE,
    *,
    missing: str = "refuse",
    splits: tuple[str, ...] = SPLITS,
    tries: int = 4,
    timeout: float = 30.0,
) -> Sources:
    """Trials of CMU's motion capture database, each .amc beside its subject's .asf.

    Args:
        manifest: CSV with trial, description, fps, split, sha256, asf_sha256; checksums are
            of the uncompressed files, empty where unknown. A last column, identity, may say of a
            trial that another list stands for whether that is certain or inferred.
        cache: folder for what comes over the network, laid out as SS/SS_TT.amc; a local base
            is read where it is.
        base: address or folder; files lie below at subjects/SS/SS_TT.amc, in a folder also
            at SS/SS_TT.amc, either also with .gz.
        missing: "refuse" when a trial cannot be had, or "skip" it and list it in left_out.
        splits: take only these.
        tries: requests for each file before giving up.
        timeout: of a connection and of every read [s].

    Raises:
        FetchError: names the trials that cannot be had, why, and what to do; with "skip"
            only when none can be had.
        ClipError: the manifest is not as described.
        ParameterError: missing is neither "refuse" nor "skip", or splits has another name.
    """
    if missing not in ("refuse", "skip"):
        raise ParameterError(f"missing must be refuse or skip, got {missing!r}")
    if odd := set(splits) - set(SPLITS):
        raise ParameterError(f"splits must be among {SPLITS}, got {sorted(odd)}")
    columns = ("trial", "description", "fps", "split", "sha256", "asf_sha256")
    listed = manifests.manifest(manifest, columns, ("identity",))
    rows = [row for row in listed if row["split"] in splits]
    remote = str(base).startswith(("http://", "https://"))
    patience: dict[str, Any] = {"tries": tries, "timeout": timeout}
    found, lost, gone = [], {}, ""
    for row in rows:
        trial, subject = row["trial"], row["trial"].partition("_")[0]
        wanted = ((f"{subject}.asf", row["asf_sha256"]), (f"{trial}.amc", row["sha256"]))
        try:
            for name, digest in wanted:
                path = (
                    _remote(str(base), Path(cache), subject, name, digest, patience, gone)
                    if remote
                    else _local(Path(base), subject, name, digest)
                )
        except fetch.UnreachableError as error:
            lost[trial] = gone = str(error)  # do not knock again for every other trial
        except FetchError as error:
            lost[trial] = str(error)
        else:
            fps = manifests.rate(manifest, trial, row["fps"])
            found.append(Source(trial, row["split"], path, fps, row["description"]))
    if lost and (missing == "refuse" or not found):
        first = next(iter(lost.values()))
        raise FetchError(
            f"{len(lost)} of {len(rows)} trials cannot be had: {', '.join(lost)}; first: {first}; "
            f"run again to go on from {cache}, or name a folder with subjects/SS/SS_TT.amc in "
            "clips_mirror, or set clips_missing: skip"
        )
    return Sources(found, [f"{trial}: {why}" for trial, why in lost.items()])


def _local(base: Path, subject: str, name: str, digest: str) -> Path:
    for folder in (base / "subjects" / subject, base / subject):
        for path in (folder / name, folder / f"{name}.gz"):
            if path.is_file():
                if wrong := _wrong(path, name, digest):
                    raise FetchError(f"{path}: {wrong}")
                return path
    raise FetchError(f"no {name} or {name}.gz in {base}, at subjects/{subject}/ or {subject}/")


def _remote(
    base: str,
    cache: Path,
    subject: str,
    name: str,
    digest: str,
    patience: dict[str, Any],
    gone: str,
) -> Path:
    """The file in the cache, fetched unless it is there; gone says that no server answers."""
    places = [cache / subject / name, cache / subject / f"{name}.gz"]
    for path in places:
        if path.is_file() and not _wrong(path, name, digest):
            return path
    if gone:
        raise fetch.UnreachableError(gone)
    for path in places:
        packed = path.suffix == ".gz"
        try:
            fetch.download(
                f"{base.rstrip('/')}/subjects/{subject}/{path.name}",
                path,
                partial(_wrong, name=name, digest=digest, packed=packed),
                **patience,
            )
        except fetch.NotThereError:
            if packed:
                raise
        else:
            return path
    raise AssertionError("the last place returns or raises")


def _wrong(path: Path, name: str, digest: str, packed: bool | None = None) -> str:
    """What keeps a file on disk from being the one listed; empty when nothing does."""
    try:
        data = read_bytes(path, packed=packed)
    except ClipError as error:
        return str(error)
    seen, wanted = looks_like(data[:4096]), f"{name[-3:].upper()} text"
    if seen != wanted:
        return f"looks like {seen}, not {wanted}"
    if digest and (got := hashlib.sha256(data).hexdigest()) != digest:
        return f"sha256 is {got}, wanted {digest}"
    return ""


def folder(path: Path) -> Sources:
    """One's own clips: whatever `read_clip` reads below train/ and test/, and heldout/ if there.

    A clip is called after its path below its split, without suffixes; a folder of frames is one
    clip. An optional fps.csv beside the splits, with clip and fps, gives rates that override the
    files' own.

    Args:
        path: the folder that holds the splits.

    Raises:
        ClipError: no such folder, a split without clips, two files of one clip name (also
            across splits, which would test on what was trained on), or a faulty fps.csv.
    """
    path = Path(path)
    if not path.is_dir():
        raise ClipError(f"{path}: no such folder; it should hold train/ and test/")
    rates = {}
    if (table := path / "fps.csv").is_file():
        rates = {
            row["clip"]: manifests.rate(table, row["clip"], row["fps"])
            for row in manifests.table(table, ("clip", "fps"))
        }
    clips: dict[str, Source] = {}
    ignored = []
    for split in SPLITS:
        if split == "heldout" and not (path / split).is_dir():
            continue
        count = len(clips)
        for file in _files(path / split):
            if not file.is_dir() and not (is_clip(file) and _is_motion(file)):
                if suffix_of(file) != ".asf":  # a companion, not a clip
                    ignored.append(f"{file.relative_to(path)}: not a motion file")
                continue
            below = file.relative_to(path / split)
            name = (below.parent / clip_name(file)).as_posix()
            if name in clips:
                raise ClipError(f"{file}: {name} is also {clips[name].path}; rename one")
            clips[name] = Source(name, split, file, rates.get(name), "")
        if len(clips) == count:
            want = ", ".join(READ)
            raise ClipError(f"{path / split}: no motion file ({want}) in this folder")
    for name in sorted(rates.keys() - clips.keys()):
        hint = "".join(f"; did you mean {n}?" for n in get_close_matches(name, clips, n=1))
        raise ClipError(f"{table}: no clip is called {name!r}{hint}")
    return Sources(list(clips.values()), ignored)


def _files(top: Path) -> list[Path]:
    """Every file below a folder, and every folder of frames in place of these, sorted by path."""
    found = []
    for here, _, names in os.walk(top):
        frames = [name for name in names if is_frame(name)]
        found += [Path(here)] if frames else []
        found += [Path(here) / name for name in set(names) - set(frames)]
    return sorted(found, key=lambda file: file.relative_to(top).parts)


def _is_motion(file: Path) -> bool:
    """False for a .txt or .json that is no JSON, such as a readme."""
    return suffix_of(file) not in (".txt", ".json") or looks_like(first_bytes(file)) == "JSON text"
