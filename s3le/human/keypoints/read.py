"""Joints that an estimator placed, from any file that holds them, as a clip.

What the file does not say is looked for in the data and told (Clip.reading): which list of joints
it is, where up is, how far the camera is tilted, the unit, the rate. A frame of which a joint is
missing or was hardly seen has no numbers; who follows the clip leaves it out.
"""

from pathlib import Path

import numpy as np

from s3le.errors import ClipError, ParameterError
from s3le.human.clip import Clip, Reading, make_clip
from s3le.human.keypoints import clocks, picture, tensors, upright
from s3le.human.keypoints.folders import frames_of, read_frames
from s3le.human.keypoints.found import Found, find
from s3le.human.keypoints.gltf import read_gltf
from s3le.human.keypoints.how import CONFIDENCE, How
from s3le.human.keypoints.layouts import LAYOUTS, Layout, by_names, for_size, pick
from s3le.human.keypoints.trc import read_trc
from s3le.human.keypoints.written import read_csv, read_json
from s3le.human.text import MAX_BYTES, listed, looks_like, no_file, read_bytes, refusal
from s3le.inert import pickles
from s3le.store import npz

SCENES = (".glb", ".gltf", ".vrma")
LARGEST = 64 * 2**20  # [bytes] of a pickle


def read_keypoints(path: Path | str, fps: float | None = None, how: How | None = None) -> Clip:
    """Read the joints of one person from a file or folder of an estimator.

    Args:
        path: .npz, .npy, .pkl, .pt, .csv, .trc, .json, .glb, .gltf, .vrma, or a folder with a file
            a frame.
        fps: frames per second [Hz], instead of the file's own.
        how: what the person knows; see How.

    Returns:
        Clip in metres, z up; frames that cannot be used are NaN. Its reading says how the file
        was understood.

    Raises:
        ClipError: the file is damaged, holds no 3D joints of one person, or leaves open which
            joint is which or where up is.
        ParameterError: fps or how is out of range.
    """
    path = Path(path)
    how = (how or How()).check()
    if how.animation is not None and not path.name.lower().removesuffix(".gz").endswith(SCENES):
        raise ParameterError(f"{path}: holds no animations to choose from; leave --animation out")
    try:
        found = _read(path, how)
    except RecursionError:
        raise refusal(path, None, "holds lists within lists without end") from None
    joints = found.joints
    if not len(joints):
        raise refusal(path, None, "no frames")
    with np.errstate(invalid="ignore"):
        joints = np.where(np.abs(joints) < 1e12, joints, np.nan)  # so that no square overflows
    if not np.isfinite(joints).all(axis=2).any():
        raise refusal(path, None, f"not one of {len(joints)} frames has a joint that is known")
    name, layout, told = _layout(path, found, how, joints)
    points = pick(joints, layout.points)
    told += _hide(points, layout, found.confidence, how)
    seen = np.isfinite(points).all(axis=(1, 2))
    if not seen.any():
        raise refusal(path, None, f"not one of {len(points)} frames has all joints{_why(found)}")
    how = how._replace(axes=how.axes or found.axes)
    made = upright.stand(str(path), joints, layout, points, how)
    if found.axes is None:  # a format that says its axes says metres, too
        picture.refuse(path, joints, points, made.axes, made.unit)
    rate, points, words = clocks.rate(path, made.points, found.clock, fps)
    told = [*found.told, *told, *made.told, *words]
    clip = make_clip(path, rate, points, gaps=True)
    person = how.person if found.person is None else found.person
    kept = How(name, made.axes, made.pitch, person, how.confidence, how.animation, how.names)
    return clip._replace(reading=Reading(found.what, kept, made.unit, tuple(told)))


def _read(path: Path, how: How) -> Found:
    """The joints in a file, by its kind."""
    if path.is_dir():
        if frames_of(path) is None:
            raise refusal(path, None, "is a folder without frames of FrankMocap or OpenPose; give "
                          "the file in it")  # fmt: skip
        return read_frames(path, how)
    name = path.name.lower()
    kind = Path(name.removesuffix(".gz")).suffix
    if why := no_file(path):
        raise refusal(path, None, why)
    if kind == ".csv":
        return find(path, read_csv(path), how)
    if kind == ".json":
        return find(path, read_json(path), how)
    if kind == ".trc":
        return read_trc(path, how.names)
    if kind in SCENES:
        return read_gltf(path, how)
    if kind in (".pkl", ".pickle"):
        data = read_bytes(path, LARGEST)
        if not data:
            raise refusal(path, None, "looks like an empty file, not a pickle")
        return find(path, pickles.load(path, tensors.unpacked(path, data)), how)
    if kind in (".pt", ".pth"):
        return find(path, tensors.load_torch(path), how)
    if name.endswith(".gz"):
        raise refusal(path, None, "unpack it first (gunzip)")
    with path.open("rb") as stream:
        head = stream.read(4096)
    if not head.startswith(b"PK" if kind == ".npz" else b"\x93NUMPY"):
        want = "an archive" if kind == ".npz" else "an array"
        raise refusal(path, None, f"looks like {looks_like(head)}, not {want} of numpy's")
    if kind == ".npy":
        pickled = npz.pickled(path, ClipError, LARGEST)
        if pickled is not None:  # as TRAM's, of a dict with tensors
            return find(path, pickles.load(path, pickled, objects=True), how)
        return find(path, npz.read_npy(path, ClipError, MAX_BYTES), how)
    closed: list[str] = []
    tree = npz.read_npz(path, ClipError, MAX_BYTES, closed)
    try:
        return find(path, tree, how)
    except ClipError as refused:
        if not closed:
            raise
        raise ClipError(
            f"{refused}; of its arrays {listed(closed)} stay closed, which are pickled and could "
            "run any program: save their numbers as arrays"
        ) from None


def _layout(
    path: Path, found: Found, how: How, joints: np.ndarray
) -> tuple[str | None, Layout, list[str]]:
    """Which joint is which: as said, as named, or as only one list of joints can be."""
    count = joints.shape[1]
    if how.layout is not None:
        layout = LAYOUTS[how.layout]
        if count not in layout.sizes:
            sizes = ", ".join(map(str, layout.sizes))
            raise refusal(path, None, f"{count} joints, {how.layout} has {sizes}")
        return how.layout, _believed(path, joints, layout, how.layout), []
    if found.by_name is not None:
        return None, _believed(path, joints, found.by_name, "its names"), ["joints by their names"]
    if found.names is not None:
        named = by_names(found.names, how.names)
        if named.missing:
            raise refusal(
                path, None, f"no joint for {listed(named.missing)}; there: {listed(found.names)}; "
                "say which is which: --names MAP",
            )  # fmt: skip
        return None, _believed(path, joints, named.layout, "its names"), ["joints by their names"]
    if found.layout is not None and count in (*LAYOUTS[found.layout].sizes, 22):
        return found.layout, _believed(path, joints, LAYOUTS[found.layout], found.layout), []
    if how.names:
        raise ParameterError(f"{path}: --names: its joints have no names; say --layout")
    able = for_size(count)
    if not able:
        known = ", ".join(f"{n} {'/'.join(map(str, one.sizes))}" for n, one in LAYOUTS.items())
        raise refusal(path, None, f"{count} joints a frame; known are {known}, or named joints")
    why = {name: upright.looks_human(pick(joints, one.points)) for name, one in able.items()}
    fit = [name for name, words in why.items() if not words]
    if len(fit) != 1:
        words = "; ".join(f"as {n}: {w or 'may be'}" for n, w in why.items())
        more = f"{count} joints that {'several' if fit else 'no'} layouts explain ({words})"
        raise refusal(path, None, f"{more}; if you know: --layout {' or '.join(able)}")
    return fit[0], able[fit[0]], [f"layout {fit[0]}, by {count} joints"]


def _believed(path: Path, joints: np.ndarray, layout: Layout, name: str) -> Layout:
    if why := upright.looks_human(pick(joints, layout.points)):
        raise refusal(path, None, f"by {name} the joints are no body: {why}")
    return layout


def _hide(points: np.ndarray, layout: Layout, confidence: np.ndarray | None, how: How) -> list[str]:
    """Make NaN of frames in which a joint was hardly seen."""
    if confidence is None:
        return []
    least = CONFIDENCE if how.confidence is None else how.confidence
    used = sorted({joint for own in layout.points for joint in own})
    with np.errstate(invalid="ignore"):
        poor = ~(confidence[:, used] >= least).all(axis=1)
    new = poor & np.isfinite(points).all(axis=(1, 2))
    points[poor] = np.nan
    return [f"{new.sum()} frames with a joint below confidence {least:g}"] if new.any() else []


def _why(found: Found) -> str:
    return "" if found.confidence is None else f" seen with confidence {CONFIDENCE:g} or as asked"
