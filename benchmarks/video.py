"""From a plain video to a certified robot, and the picture of it in reports/video.

    python benchmarks/video.py VIDEO [--pitch 20] [--roll 13.4] [--credit "..."]

The figure is the paper's: frames of the video, the skeletons estimated in them, the robot's
poses. Without --pitch it is estimated. --credit is what the caption says of whose video it is.
"""

from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from s3le.human.skeletons import read_frames
from s3le.retarget.stream import Retargeter
from s3le.show import motions, rows, strip
from s3le.show.camera import Camera
from s3le.show.human import LEFT, MIDDLE, RIGHT
from s3le.store import documents
from s3le.video import convert, process
from s3le.video.decode import Video
from s3le.video.estimator import JOINTS

_AT = {name: i for i, name in enumerate(JOINTS)}
_LINES = [
    (f"{s}_{a}", f"{s}_{b}", colour)
    for s, colour in (("r", RIGHT), ("l", LEFT))
    for a, b in (("shoulder", "elbow"), ("elbow", "hand"))
] + [
    ("r_shoulder", "l_shoulder", MIDDLE),
    ("r_hip", "l_hip", MIDDLE),
    ("r_shoulder", "r_hip", MIDDLE),
    ("l_shoulder", "l_hip", MIDDLE),
]
_ROOM, _HEAD = 1.08, 0.1  # of the crop around all that the body does


def main(
    path: Annotated[Path, typer.Argument(help="video")],
    folder: Annotated[Path, typer.Option(help="exported retargeter")] = Path("data/retargeter"),
    out: Annotated[Path, typer.Option(help="folder of the picture")] = Path("reports/video"),
    moments: Annotated[int, typer.Option(help="columns")] = 8,
    pitch: Annotated[float | None, typer.Option(help="of the camera [deg]")] = None,
    roll: Annotated[float, typer.Option(help="of the camera [deg]")] = 0.0,
    camera: Annotated[float, typer.Option(help="the figures are seen from there [deg]")] = 22.0,
    credit: Annotated[str, typer.Option(help="whose video it is")] = "",
) -> None:
    """Make the figure and say its numbers."""
    with process.Process(process.interpreter()) as estimator:
        looked = convert.look(path, estimator)
    made = convert.skeletons(looked, convert.Choices(pitch=pitch, roll=roll), path)
    clip = out / f"{path.stem}.parquet"
    convert.write(made, clip)
    retargeter = Retargeter.load(folder)
    robot = retargeter.robot
    try:
        frames = read_frames(clip, robot.neck)
    finally:
        clip.unlink()
    done = clip.convert(retargeter, frames)
    summary = done.summary

    known = np.flatnonzero(made.status == "seen")
    pick = known[np.linspace(0, len(known) - 1, moments).round().astype(int)]
    times = made.time[pick]
    seen = np.abs(looked.time[:, None] - times).argmin(axis=0)
    human = motions.Human(path.stem, frames.time, frames.x)
    shown = motions.of(done.motion, path, robot)
    told = rows.robot(shown, times, 0, False)
    note = [f"{c * 1e3:.1f} mm" for c in told.clearance]
    name = robot.name
    target = out / "figure.png"
    strip.draw(
        target,
        times,
        [
            rows.human(human, times)._replace(label="estimated skeleton"),
            told.row._replace(note=note, label=f"{name}, certified"),
        ],
        f"From a plain video: {path.name}",
        camera=Camera(camera, 14.0),
        fine=2,
        width=1400,
        photos=_photos(path, looked, seen),
    )
    about = made.about
    numbers = {
        "video": about["video"],
        "video_sha256": about["video_sha256"],
        "estimator": about["estimator"],
        "frames": about["frames"],
        "fps": about["mean_fps"],
        "frames_with_person": about["frames_with_person"],
        "rows_known": int(np.isin(made.status, ("seen", "filled")).sum()),
        "camera_pitch_deg": round(about["choices"]["pitch"], 2),
        "camera_roll_deg": roll,
        "robot": name,
        "poses": summary["rows"]["written"],
        "to_human": summary["to_human"]["mean"],
        "clearance_m": summary["clearance_m"]["least"],
        "certified_poses": summary["certified"]["poses"],
        "certified_paths": summary["certified"]["paths"],
    }
    caption = (
        f"Frames of {path.name} with the upper body that {about['estimator']} sees in them; the "
        f"skeletons estimated, facing forward; {name} following them, every pose and every path "
        f"between two poses certified (below each pose: least distance between two bodies). Mean "
        f"cosine distance of robot to skeleton {numbers['to_human']:.4f}."
        + (f" {credit.rstrip('.')}." if credit else "")
    )
    documents.write_json(
        {"title": "From a plain video", "caption": caption, "numbers": numbers},
        out / "figure.json",
    )
    print(f"{target}: {target.stat().st_size} bytes; {numbers}")


def _photos(path: Path, looked: convert.Looked, seen: np.ndarray) -> strip.Photos:
    """The frames, cropped to where the body is in any of them."""
    size = np.array([looked.about["width"], looked.about["height"]])
    found = looked.joints[np.isfinite(looked.joints).all(axis=(1, 2)), :, 4:] * size
    low, high = found.min(axis=(0, 1)), found.max(axis=(0, 1))
    low[1] -= _HEAD * (high - low)[1]  # the upper body's joints end at the shoulders
    middle, half = (low + high) / 2.0, _ROOM * (high - low) / 2.0
    x0, y0 = np.maximum(middle - half, 0).astype(int)
    x1, y1 = np.minimum(middle + half, size).astype(int)
    wanted = dict.fromkeys(seen.tolist())
    for i, picture in enumerate(Video(path).pictures()):
        if i in wanted:
            wanted[i] = picture.rgb[y0:y1, x0:x1]
    place = looked.joints[seen][:, :, 4:] * size - [x0, y0]
    lines = np.stack([place[:, [_AT[a], _AT[b]]] for a, b, _ in _LINES], axis=1)
    colours = [colour for *_, colour in _LINES]
    return strip.Photos("video", [wanted[i] for i in seen.tolist()], lines, colours)


if __name__ == "__main__":
    typer.run(main)
