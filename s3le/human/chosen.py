"""Which motion files are meant by paths that people give: files, or folders of them."""

from collections import Counter
from pathlib import Path

from s3le.errors import ParameterError
from s3le.human.clip import clip_name
from s3le.human.keypoints.folders import frames_of, is_frame
from s3le.human.read import READ, is_clip


def chosen(given: list[Path]) -> list[Path]:
    """The files that are meant; each must have a name of its own, for its results take it.

    Args:
        given: motion files, folders of frames, or folders of motion files.

    Raises:
        ParameterError: a folder holds no motion, or two files bear one name.
    """
    paths = []
    for path in given:
        inside = sorted(p for p in path.glob("*") if is_clip(p) or frames_of(p))
        others = [p for p in inside if not is_frame(p)]
        frames = frames_of(path)
        if frames == path and others:
            raise ParameterError(
                f"{path}: holds frames of one clip and other clips, as {others[0].name}; part them"
            )
        if frames == path or (frames and others == [frames]):
            paths.append(path)
            continue
        if path.is_dir() and not inside:
            known = ", ".join(READ)
            raise ParameterError(f"{path}: is a folder with no motion files in it ({known})")
        paths += inside if path.is_dir() else [path]
    counts = Counter(clip_name(path) for path in paths)
    for name, count in counts.items():
        if count > 1:
            raise ParameterError(f"{count} clips are called '{name}'; write them to two folders")
    return paths
