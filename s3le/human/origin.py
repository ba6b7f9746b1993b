"""Which clip a motion was made from, as its file says it."""

import os
from pathlib import Path

from s3le.human.read import digest

CLIP, CLIP_HASH = "clip_file", "clip_sha256"  # keys of what a motion says about itself


def about_clip(clip: Path, out: Path) -> dict[str, str]:
    """What a motion file in folder out says of the clip that it was made from."""
    return {
        CLIP: Path(os.path.relpath(clip, out)).as_posix(),  # so that both can move together
        CLIP_HASH: digest(clip),
    }
