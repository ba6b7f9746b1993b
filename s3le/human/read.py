"""One door for motion files: the suffix says what a file claims, its first bytes must agree."""

import gzip
import hashlib
import re
import zlib
from pathlib import Path

from s3le.errors import ClipError, ParameterError
from s3le.human.amc import cmu_rate, read_amc, read_asf
from s3le.human.bvh import read_bvh
from s3le.human.clip import Clip, Reading, clip_name
from s3le.human.deepmimic import read_deepmimic
from s3le.human.keypoints import gltf
from s3le.human.keypoints.folders import frames_of
from s3le.human.keypoints.how import How
from s3le.human.keypoints.read import read_keypoints
from s3le.human.keypoints.trc import SKIN
from s3le.human.keypoints.upright import FROM
from s3le.human.points_parquet import is_points, read_points
from s3le.human.text import no_file, read_bytes

SUFFIXES = (".amc", ".bvh", ".json", ".txt")  # each also with .gz; .asf goes with .amc
# Of estimators, as .json may be; and skeletons of scenes.
SCENES = (".glb", ".gltf", ".vrma")
KEYPOINTS = (".npz", ".npy", ".csv", ".trc", ".pkl", ".pickle", ".pt", ".pth", *SCENES)
_NO_MOTION = re.compile(r"shape\.npz|(male|female|neutral)_stagei\.npz")  # beside AMASS' motions
POINTS = ".parquet"  # of `s3le video`
READ = (*SUFFIXES, POINTS, *KEYPOINTS)
_FILM = "that is a video; estimate the joints first: s3le video {name} --out {stem}.parquet"
# What may be stated of formats that say the rest themselves.
_STATED = {
    ".amc": ("axes", "names"), ".bvh": ("axes", "names"), ".txt": ("axes",), ".json": ("axes",),
    POINTS: ("axes",),
}  # fmt: skip
_BLENDER = (
    'convert it to .glb, with Blender: blender -b --python-expr "import bpy; '
    "bpy.ops.wm.read_factory_settings(use_empty=True); {command}; "
    "bpy.ops.export_scene.gltf(filepath='{stem}.glb')\""
)
_USD = _BLENDER.replace(  # the importer leaves the rate as it was
    "{command}",
    "bpy.utils.expose_bundled_modules(); from pxr import Usd; "
    "bpy.ops.wm.usd_import(filepath='{name}'); "
    "bpy.context.scene.render.fps = round(Usd.Stage.Open('{name}').GetTimeCodesPerSecond())",
)
_MVNX = (
    "take its segments' places out: python -c \"import numpy as np, xml.etree.ElementTree as E; "
    "t = E.parse('{name}'); np.savez('{stem}.npz', "
    "joint_names=[s.get('label') for s in t.iterfind('.//{*}segment')], "
    "fps=float(next(t.iterfind('.//{*}subject')).get('frameRate')), "
    "joints=np.array([f.find('{*}position').text.split() for f in t.iterfind('.//{*}frame') "
    "if f.get('type') == 'normal'], float).reshape("
    "-1, len(list(t.iterfind('.//{*}segment'))), 3))\""
)
ROUTES = {  # formats that are not read, and the way round
    ".fbx": _BLENDER.replace("{command}", "bpy.ops.import_scene.fbx(filepath='{name}')"),
    ".blend": _BLENDER.replace("{command}", "bpy.ops.wm.open_mainfile(filepath='{name}')"),
    **dict.fromkeys((".usd", ".usda", ".usdc", ".usdz"), _USD),
    ".mvnx": _MVNX,
    ".c3d": SKIN,
    ".zip": "unpack it, and give the file or the folder in it",
    **dict.fromkeys((".mp4", ".mov", ".avi", ".mkv", ".webm"), _FILM),
}


def suffix_of(path: Path | str) -> str:
    """The suffix in lower case, the one before .gz where there is one."""
    return Path(Path(path).name.lower().removesuffix(".gz")).suffix


def read_clip(path: Path | str, fps: float | None = None, how: How | None = None) -> Clip:
    """Read a motion file of any format known here.

    Args:
        path: .amc with its .asf beside it, .bvh, or DeepMimic .txt or .json; or with .gz; .parquet
            of `s3le video`, in which frames may be NaN; or what s3le.human.keypoints.read takes:
            KEYPOINTS, .json, or a folder of frames.
        fps: frames per second [Hz], instead of the file's own; for .amc, which has none,
            instead of CMU's 120 (60 for the subjects of amc.CMU_60_HZ).
        how: what is known of keypoints; for other files nothing is to be known.

    Returns:
        Clip named after the file.

    Raises:
        ClipError: another suffix, content that is not what the suffix says, no skeleton or
            more than one for an .amc, or anything its reader refuses.
        ParameterError: fps is no sensible rate, or how is out of range or for another format.
    """
    path = Path(path)
    kind = suffix_of(path)
    how = (how or How()).check()
    if path.is_dir() and not frames_of(path):
        raise ClipError(
            f"{path}: is a folder, and holds no frames of FrankMocap or OpenPose; give its clips"
        )
    if path.exists() and not path.is_dir() and (why := no_file(path)):
        raise ClipError(f"{path}: {why}")
    if frames_of(path) or kind in KEYPOINTS or (kind == ".json" and _is_keypoints(path)):
        return read_keypoints(path, fps, how)
    given = [f"--{name}" for name, value in how._asdict().items() if value is not None]
    given = [name for name in given if name[2:] not in _STATED.get(kind, given)]
    if given and kind in _STATED:
        raise ParameterError(f"{path}: says itself what {', '.join(given)} would; leave it out")
    if kind == ".amc":
        rate = cmu_rate(clip_name(path)) if fps is None else fps
        names = how.names or {}
        return _restated(read_amc(path, read_asf(skeleton_of(path)), rate, names), "y-up", how)
    if kind == ".bvh":
        return read_bvh(path, fps, how=how)
    if kind in (".json", ".txt"):
        return _restated(read_deepmimic(path, fps), "y-up", how)
    if kind == POINTS:
        return _restated(read_points(path, fps), "z-up", how)
    if kind in ROUTES:
        own = path.name.replace("'", "")
        route = ROUTES[kind].replace("{name}", own).replace("{stem}", Path(own).stem)
        raise ClipError(f"{path}: {kind} is not read; {route}")
    raise ClipError(
        f"{path}: motion files end in {', '.join(READ)} (the first {len(SUFFIXES)} also with .gz); "
        "or give a folder of FrankMocap's or OpenPose's frames"
    )


def _restated(clip: Clip, own: str, how: How) -> Clip:
    """A clip whose file has other axes than `own`, as its format has them, where that is stated."""
    if how == How():
        return clip
    points = clip.points
    if how.axes not in (None, own):
        points = points @ FROM[own] @ FROM[how.axes].T
        points.setflags(write=False)
    return clip._replace(points=points, reading=Reading("the joints of its format", how, "m", ()))


def is_clip(path: Path | str) -> bool:
    """Whether a file in a folder is taken for a clip; robots' motions are Parquet files too."""
    path, kind = Path(path), suffix_of(path)
    if no_file(path):
        return False
    if kind in KEYPOINTS:
        return not _NO_MOTION.fullmatch(path.name)
    return kind in SUFFIXES or (kind == POINTS and is_points(path))


def _is_keypoints(path: Path) -> bool:
    """Whether a .json is no DeepMimic motion; one that cannot be read is none of either."""
    try:
        return path.is_file() and b'"Frames"' not in read_bytes(path)
    except ClipError:
        return False


def digest(path: Path | str) -> str:
    """SHA-256 of a clip: of its file, or of names and contents of a folder of frames.

    Raises:
        OSError: it cannot be read.
    """
    folder = frames_of(path)
    if folder is None:
        if Path(path).exists() and (why := no_file(path)):  # a pipe would be waited for
            raise OSError(f"{path}: {why}")
        return hashlib.sha256(Path(path).read_bytes()).hexdigest()
    whole = hashlib.sha256()
    for file in sorted(folder.iterdir()):
        if file.is_file():
            whole.update(file.name.encode() + b"\0" + hashlib.sha256(file.read_bytes()).digest())
    return whole.hexdigest()


def fingerprint(path: Path | str, own: str | None = None) -> str:
    """SHA-256 of all that a clip is read from: its own, and that of the files that it leans on.

    Args:
        path: the clip.
        own: its digest, where that is known.

    Raises:
        OSError: it cannot be read.
    """
    own = digest(path) if own is None else own
    others = [file for file in _beside(Path(path)) if not no_file(file)]
    if not others:
        return own
    held = [own, *(f"{file.name} {digest(file)}" for file in others)]
    return hashlib.sha256("\n".join(held).encode()).hexdigest()


def _beside(path: Path) -> list[Path]:
    """The skeleton of an .amc, the buffers of a scene."""
    kind = suffix_of(path)
    if kind in SCENES:
        return gltf.beside(path)
    try:
        return [skeleton_of(path)] if kind == ".amc" else []
    except ClipError:
        return []  # whoever reads it is told


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
    if no_file(path):  # a pipe would be waited for
        return b""
    try:
        with gzip.open(path) if path.suffix.lower() == ".gz" else path.open("rb") as stream:
            return stream.read(count)
    except (OSError, EOFError, zlib.error):
        return b""
