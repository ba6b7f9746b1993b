"""One door for motion files: the suffix says what a file claims, its first bytes must agree."""

import gzip
import zlib
from pathlib import Path

from s3le.errors import ClipError
from s3le.mocap.amc import cmu_rate, read_amc, read_asf
from s3le.mocap.bvh import read_bvh
from s3le.mocap.clip import Clip, clip_name
from s3le.mocap.deepmimic import read_deepmimic
from s3le.mocap.points_parquet import is_points, read_points

SUFFIXES = (".amc", ".bvh", ".json", ".txt")  # each also with .gz; .asf goes with .amc
POINTS = ".parquet"  # of `s3le video`


def suffix_of(path: Path | str) -> str:
    """The suffix in lower case, the one before .gz where there is one."""
    return Path(Path(path).name.lower().removesuffix(".gz")).suffix


def read_clip(path: Path | str, fps: float | None = None) -> Clip:
    """Read a motion file of any format known here.

    Args:
        path: .amc with its .asf beside it, .bvh, or DeepMimic .txt or .json; or with .gz;
            or .parquet of `s3le video`, in which frames may be NaN.
        fps: frames per second [Hz], instead of the file's own; for .amc, which has none,
            instead of CMU's 120 (60 for the subjects of amc.CMU_60_HZ).

    Returns:
        Clip named after the file.

    Raises:
        ClipError: another suffix, content that is not what the suffix says, no skeleton or
            more than one for an .amc, or anything its reader refuses.
        ParameterError: fps is no sensible rate.
    """
    path = Path(path)
    kind = suffix_of(path)
    if kind == ".amc":
        rate = cmu_rate(clip_name(path)) if fps is None else fps
        return read_amc(path, read_asf(skeleton_of(path)), rate)
    if kind == ".bvh":
        return read_bvh(path, fps)
    if kind in (".json", ".txt"):
        return read_deepmimic(path, fps)
    if kind == POINTS:
        return read_points(path, fps)
    raise ClipError(
        f"{path}: motion files end in {', '.join(SUFFIXES)} (or these and .gz), or {POINTS}"
    )


def is_clip(path: Path | str) -> bool:
    """Whether a file in a folder is taken for a clip; robots' motions are Parquet files too."""
    kind = suffix_of(path)
    return kind in SUFFIXES or (kind == POINTS and is_points(path))


def skeleton_of(path: Path | str) -> Path:
    """The skeleton file of an .amc: SS.asf for SS_TT.amc, or the only .asf in the folder.

    Raises:
        ClipError: there is none, or there are several and none is named like that.
    """
    path = Path(path)
    beside = sorted(p for p in path.parent.glob("*") if suffix_of(p) == ".asf")
    subject = clip_name(path).rpartition("_")[0]
    named = [p for p in beside if clip_name(p) == subject]
    if len(named or beside) >= 1 and (named or len(beside) == 1):
        return (named or beside)[0]
    seen = ", ".join(p.name for p in beside) if beside else "none"
    raise ClipError(f"{path}: needs its skeleton {subject or 'SS'}.asf beside it; there: {seen}")


def first_bytes(path: Path | str, count: int = 4096) -> bytes:
    """The beginning of a file, decompressed where its name ends in .gz; empty if unreadable."""
    path = Path(path)
    try:
        with gzip.open(path) if path.suffix.lower() == ".gz" else path.open("rb") as stream:
            return stream.read(count)
    except (OSError, EOFError, zlib.error):
        return b""
