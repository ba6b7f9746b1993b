"""The joints in what an estimator's file holds, whatever its keys are called.

Keys are those of the estimators' own files and of common dumps of them. What is found is named,
so that a person can see it; several candidates, or none, refuse the file and list its keys.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from s3le.human.keypoints import clocks, layouts, people, rotations
from s3le.human.keypoints.clocks import Clock, key
from s3le.human.keypoints.how import How
from s3le.human.keypoints.people import LIFT, WHOLE, choose
from s3le.human.keypoints.values import SEEN, numbers, turned
from s3le.human.text import listed, refusal

PLACES = (  # keys of joints' places, without _ and -; the first that is there
    "world", "worldlandmarks", "poseworldlandmarks", "joints3d", "smpljoints", "kp3d",
    "keypoints3d", "pose3d", "poses3d", "posekeypoints3d", "jointpositions", "positions",
    "joints", "keypoints", "skeleton", "skeletons", "landmarks", "xyz", "coordinates",
    "poselandmarks", "normalizedlandmarks",
)  # fmt: skip
_CONFIDENCE = (
    *SEEN, "visibilities", "scores", "confidences", "kpscore", "keypointscores",
    "jointconfidence", "jointconfidences", "confidencelevel", "confidencelevels",
)  # fmt: skip
_FRAMES = ("frames", "data", "results", "sequence", "instanceinfo", "predictions")
_WORLDS = (  # keys of dicts of which one is the person's motion; the world's before a camera's
    "smplparamsglobal", "smplxworld", "smplworld", "smplparamsincam", "smplxcam", "smplcam",
    "smplparams", "smplxparams", "predsmplparams",
)  # fmt: skip
_NAMES = ("jointnames", "names", "keypointnames", "landmarknames")
_NUMBERS = ("frameids", *people.FRAME, "frames")  # of frames, one a row


class Found(NamedTuple):
    """The joints of one person, in the file's own axes and unit."""

    joints: np.ndarray  # (n, j, 3), NaN where unknown
    names: tuple[str, ...] | None
    confidence: np.ndarray | None  # (n, j)
    clock: Clock
    what: str  # for people
    layout: str | None = None  # known from the key
    person: int | None = None
    axes: str | None = None  # known from the format
    told: tuple[str, ...] = ()  # what was assumed
    by_name: layouts.Layout | None = None  # of these joints, where they were chosen by name


def find(path: Path | str, tree: Any, how: How) -> Found:
    """The joints of one person in what a file holds.

    Args:
        path: for messages.
        tree: arrays, lists and dicts.
        how: which person.

    Raises:
        ClipError: no joints, more than one candidate, only 2D, several persons and none chosen.
    """
    if (name := people.list_of(tree)) is not None:
        rows, person = people.of_frames(path, tree, name, how)
        return find(path, rows, how._replace(person=None))._replace(person=person)
    tree = turned(tree)
    if not isinstance(tree, Mapping):
        return _of_array(path, tree, "its array", how)
    keys = {key(name): name for name in tree}
    for name in _FRAMES:
        inner = tree.get(keys.get(name))
        count = isinstance(inner, list) and any(isinstance(v, (int, float)) for v in inner)
        if isinstance(inner, (list, Mapping)) and not count and not _places(keys):
            return _with(path, find(path, inner, how), tree, keys)
    if "people" in keys and not isinstance(tree[keys["people"]], Mapping):
        return _people(path, tree, how)
    for name in ("persondata", "people"):
        if name in keys:
            tree = tree[keys[name]]
            if not isinstance(tree, Mapping):
                raise refusal(path, None, f"its '{keys[name]}' is no dict of persons")
            keys = {key(name): name for name in tree}
            break
    if people.is_phalp(tree):
        shown, person = people.of_phalp(path, tree, how)
        return find(path, shown, how._replace(person=None))._replace(person=person)
    if (
        keys
        and all(WHOLE.fullmatch(name) for name in keys)
        and all(isinstance(value, (Mapping, list)) for value in tree.values())
    ):
        person, chosen = choose(path, sorted(tree, key=lambda k: int(key(k))), how)
        return find(path, tree[chosen], how._replace(person=None))._replace(person=person)
    for name in _WORLDS:
        inner = turned(tree.get(keys.get(name)))
        if isinstance(inner, Mapping) and not _places(keys):
            found = _with(path, find(path, inner, how), tree, keys)
            return found._replace(what=f"{found.what} of '{keys[name]}'")
    return _of_keys(path, tree, keys, how)


def _of_keys(path: Path | str, tree: Mapping, keys: dict[str, Any], how: How) -> Found:
    base: Found | None
    found = _places(keys)
    if found:
        taken = keys[found]
        inner = turned(tree[taken])
        if isinstance(inner, Mapping):
            base = find(path, dict(inner), how)
        else:
            image_only = "trackids" in keys or "centerconfs" in keys
            base = _of_array(path, inner, f"'{taken}'", how, persons_first=image_only)
        for name in _CONFIDENCE:
            if base.confidence is None and name in keys:
                confidence = numbers(path, tree[keys[name]], f"'{keys[name]}'")
                if confidence is not None and confidence.shape == base.joints.shape[:2]:
                    base = base._replace(confidence=confidence)
    else:
        base = _posed(path, tree, keys, how) or _named(path, tree, how)
        if base is None:
            base = _only(path, tree, how)
    return _with(path, base, tree, keys)


def _with(path: Path | str, base: Found, tree: Mapping, keys: dict[str, Any]) -> Found:
    """With what else the dict says: names of the joints, the clock, which frames the rows are."""
    for name in _NAMES:
        given = tree.get(keys.get(name))
        given = given.tolist() if isinstance(given, np.ndarray) else given
        if isinstance(given, list) and len(given) == base.joints.shape[1] and base.names is None:
            if all(isinstance(word, str) for word in given):
                base = base._replace(names=tuple(given))
    meta = tree.get(keys.get("metainfo"))
    if base.names is None and isinstance(meta, Mapping):  # mmpose's
        given = meta.get("keypoint_id2name")
        given = [str(word) for word in given.values()] if isinstance(given, Mapping) else []
        if len(given) == base.joints.shape[1] and not layouts.by_names(given).missing:
            base = base._replace(names=tuple(given))
    count = len(base.joints)
    base = base._replace(clock=base.clock.or_else(clocks.find(path, tree, count)))
    for name in _NUMBERS:
        given = tree.get(keys.get(name))
        table = None if given is None else numbers(path, given, f"'{keys[name]}'")
        rows = people.gaps(path, table, count)
        if rows is not None and base.clock.time is None:
            return _spread(base, rows, keys[name])
    return base


def _spread(base: Found, rows: np.ndarray, name: str) -> Found:
    """Frames at their own rows, unknown ones between them."""
    whole = int(rows[-1]) + 1

    def at(values: np.ndarray) -> np.ndarray:
        made = np.full((whole, *values.shape[1:]), np.nan)
        made[rows] = values
        return made

    told = f"{whole - len(rows)} frames are left out between others, by '{name}'"
    return base._replace(
        joints=at(base.joints),
        confidence=None if base.confidence is None else at(base.confidence),
        told=(*base.told, told),
    )


def _places(keys: Mapping[str, Any]) -> str | None:
    return next((name for name in PLACES if name in keys), None)


def _of_array(
    path: Path | str, value: Any, what: str, how: How, persons_first: bool = False
) -> Found:
    """Joints of an array: frames, persons where there are, joints, x y z and confidence."""
    array = numbers(path, value, what)
    if array is None:
        raise refusal(path, None, f"{what} holds no joints: {_shape(value)}")
    person = None
    if array.ndim == 1:
        array = array[None]
    if array.ndim == 2 and array.shape[1] in (2, 3, 4, 5) and array.shape[0] in layouts.SIZES:
        array = array[None]  # joints of one frame
    if array.ndim == 2 and (posed := rotations.flat(path, array)) is not None:
        return _of_posed(posed)
    if array.ndim == 2:
        array = _split(path, array, what, how)
    if array.ndim == 3 and array.shape[2] > 5:  # persons, frames, all numbers of a frame
        flat = array.reshape(-1, array.shape[2])
        array = _split(path, flat, what, how).reshape(*array.shape[:2], -1, 3).swapaxes(0, 1)
    if persons_first and array.ndim == 3:
        array = array[None]
    if array.ndim == 4:
        person, at = choose(path, list(range(array.shape[1])), how)
        array = array[:, at]
    if array.ndim != 3 or not len(array) or array.shape[2] not in (2, 3, 4, 5):
        raise refusal(
            path, None,
            f"{what} is of shape {array.shape}, wanted (frames, joints, 3), with a fourth number "
            "where there is confidence",
        )  # fmt: skip
    if array.shape[2] == 2:
        raise refusal(path, None, f"{what} is 2D, {array.shape}; {LIFT}")
    refuse_flat(path, array, what)
    confidence = array[..., 3] if array.shape[2] > 3 else None
    return Found(array[..., :3], None, confidence, Clock(), what, None, person)


def _split(path: Path | str, array: np.ndarray, what: str, how: How) -> np.ndarray:
    """Rows of numbers as joints, where their count leaves one way only."""
    sizes = layouts.SIZES if how.layout is None else layouts.LAYOUTS[how.layout].sizes
    ways = [(n, k) for n in sizes for k in (3, 4) if n * k == array.shape[1]]
    if len(ways) != 1:
        known = ", ".join(map(str, sizes))
        raise refusal(
            path, None,
            f"{what} has {array.shape[1]} numbers a frame, wanted 3 or 4 for each of {known} "
            "joints; with --layout, of that layout's" + " (several fit)" * (len(ways) > 1),
        )  # fmt: skip
    return array.reshape(len(array), *ways[0])


def refuse_flat(path: Path | str, array: np.ndarray, what: str) -> None:
    """Refuse what looks like x, y and confidence, or has no depth, (n, j, at least 3).

    Raises:
        ClipError: so it looks.
    """
    seen = array[np.isfinite(array).all(axis=2)]
    if not len(seen):
        raise refusal(path, None, f"{what} has no joint that is known")
    x, y, z = seen[:, 0], seen[:, 1], seen[:, 2]
    third_is_share = z.min() >= 0.0 and z.max() <= 1.0
    wide = max(np.ptp(x), np.ptp(y))
    inside = min(x.min(), y.min()) >= 0.0 and max(x.max(), y.max()) <= 1.0
    if len(seen) > 1 and (np.ptp(z) == 0.0 or (third_is_share and (wide > 20.0 or inside))):
        raise refusal(path, None, f"{what} looks like 2D with confidence; {LIFT}")


def _posed(path: Path | str, tree: Mapping, keys: Mapping[str, Any], how: How) -> Found | None:
    """Joints of SMPL's rotations, where a file has them."""
    posed = rotations.posed(path, tree, keys, lambda there: choose(path, there, how))
    return None if posed is None else _of_posed(posed)


def _of_posed(posed: rotations.Posed) -> Found:
    return Found(
        posed.joints, None, None, Clock(), posed.what, "smpl", posed.person, None, posed.told
    )


def _named(path: Path | str, tree: Mapping, how: How) -> Found | None:
    """Joints that each have a key of their own."""
    names = [key for key in tree if isinstance(key, str)]
    named = layouts.by_names(names, how.names)
    if named.missing:
        return None
    used = named.used()
    places = {}
    for j in used:
        table = numbers(path, tree[names[j]], f"joint {names[j]!r}")
        if table is None or table.ndim > 2 or table.shape[-1] not in (2, 3, 4, 5):
            return None
        places[names[j]] = np.atleast_2d(table)
    shapes = {table.shape for table in places.values()}
    if len(shapes) != 1:
        raise refusal(path, None, f"joints of unequal shapes: {listed(map(str, sorted(shapes)))}")
    array = np.stack(list(places.values()), axis=1)
    if array.shape[2] == 2:
        raise refusal(path, None, f"its joints are 2D; {LIFT}")
    refuse_flat(path, array, "its joints")
    confidence = array[..., 3] if array.shape[2] > 3 else None
    layout = named.among(used).layout
    return Found(array[..., :3], tuple(places), confidence, Clock(), "named joints", by_name=layout)


def _only(path: Path | str, tree: Mapping, how: How) -> Found:
    """The only array that can be joints."""
    able = []
    for name, value in tree.items():
        array = numbers(path, value, f"'{name}'") if isinstance(value, np.ndarray) else None
        if array is not None and array.ndim in (3, 4) and array.shape[-1] in (3, 4):
            if array.shape[-2] in layouts.SIZES or how.layout:
                able.append((name, array))
    if len(able) == 1:
        return _of_array(path, able[0][1], f"'{able[0][0]}'", how)
    keys = ", ".join(f"{str(name)[:40]} {_shape(value)}" for name, value in list(tree.items())[:40])
    flat = any("2d" in key(name) for name in tree)
    why = "more than one array that may be joints" if able else "no joints that are known here"
    raise refusal(
        path, None,
        f"holds {why} ({keys})" + (f"; of 2D keypoints: {LIFT}" if flat else "")
        + f"; call them one of {', '.join(PLACES[:3])}, joints, keypoints3d, or say which of named "
        "joints is which: --names MAP",
    )  # fmt: skip


def _shape(value: Any) -> str:
    if isinstance(value, np.ndarray):
        return str(value.shape)
    return f"{len(value)} values" if isinstance(value, (list, Mapping)) else type(value).__name__


def _people(path: Path | str, tree: Mapping, how: How) -> Found:
    """OpenPose's JSON, of one frame, or of several that were put one after the other."""
    given = tree["people"]
    several = isinstance(given, list) and given and all(isinstance(p, list) for p in given)
    return openpose(path, given if several else [given], how)


def openpose(path: Path | str, frames: list[Any], how: How) -> Found:
    """Frames of OpenPose, each a list of people; null for a frame that is not there.

    Raises:
        ClipError: 2D only, several people and none chosen, or damage.
    """
    rows: list[Any] = []
    most = max((len(p) for p in frames if isinstance(p, list)), default=0)
    if not most:
        raise refusal(path, None, "nobody is in any of its frames")
    person, at = choose(path, list(range(most)), how)
    for there in frames:
        one = there[at] if isinstance(there, list) and len(there) > at else None
        given = one.get("pose_keypoints_3d") if isinstance(one, Mapping) else None
        if isinstance(one, Mapping) and not given:
            flat = len(one.get("pose_keypoints_2d") or ())
            if flat:
                why = f"its pose_keypoints_3d are empty, pose_keypoints_2d are not; {LIFT}"
                raise refusal(path, None, why)
        rows.append(given or None)
    if not any(rows):
        raise refusal(path, None, "no frame has pose_keypoints_3d")
    table = numbers(path, rows, "pose_keypoints_3d")
    if table is None or table.ndim != 2 or table.shape[1] % 4:
        raise refusal(path, None, "pose_keypoints_3d must be x, y, z and confidence of each joint")
    array = table.reshape(len(rows), -1, 4)
    return Found(array[..., :3], None, array[..., 3], Clock(), "pose_keypoints_3d", None, person)
