"""What is written of a retargeted clip: which files, which joints, which base, for which tools."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

from s3le.errors import ParameterError
from s3le.human.clip import clip_name
from s3le.motion import files, layouts, root, whole
from s3le.motion.root import Root
from s3le.motion.whole import Whole
from s3le.retarget.clip import Result
from s3le.robot.robot import Robot
from s3le.safety import audit, paths
from s3le.store import documents, sidecar

TABLE = "retarget.parquet"  # what became of each clip; see s3le.retarget.clips


class Shape(NamedTuple):
    """What all clips' files have in common."""

    suffixes: list[str]
    full: bool  # every joint of the URDF, held ones included
    tools: list[str]  # of layouts.SUFFIX
    whole: Whole | None  # None: neither is asked for
    base: Root | None

    def about(self) -> dict[str, Any]:
        """What of it can change a file, as JSON; the robot apart."""
        base = None if self.base is None else [self.base.height, self.base.because]
        return {"files": self.suffixes, "full": self.full, "for": self.tools, "base": base}

    def files(self, name: str) -> list[str]:
        """Names of the files of a clip, without its summary."""
        ends = [*self.suffixes, *(layouts.SUFFIX[tool] for tool in self.tools)]
        ends += [f"{end}.json" for end in ends if end.endswith(".csv")]
        return [name + end for end in ends]


def shape(
    robot: Robot,
    *,
    csv: bool = False,
    npz: bool = False,
    full: bool = False,
    tools: Sequence[str] = (),
    root_height: float | None = None,
) -> Shape:
    """Decide what is written; refuses what no clip could be written with.

    Args:
        robot: whose motions.
        csv, npz: write these beside the Parquet.
        full: a column for every joint of the URDF.
        tools: also write what these read.
        root_height: of the base link in the tools' files [m]; None: the robot stands on the ground.

    Raises:
        ParameterError: an unknown tool, a height without a tool, or beyond what a robot can be.
        RobotError: a joint that is held stands outside its range.
    """
    tools = sorted(set(map(str, tools)))
    if unknown := set(tools) - set(layouts.SUFFIX):
        raise ParameterError(
            f"no tool '{min(unknown)}'; there are: {', '.join(sorted(layouts.SUFFIX))}"
        )
    if root_height is not None and not tools:
        raise ParameterError("--root-height is of the files that --for writes; give --for too")
    return Shape(
        [".parquet", *[".csv"] * csv, *[".npz"] * npz],
        full,
        tools,
        whole.joints(robot) if full or tools else None,
        root.find(robot, root_height) if tools else None,
    )


def refuse_overlap(paths: list[Path], out: Path, shape: Shape, others: Path | None = None) -> None:
    """Refuse clips whose files would be one another's, as those of `a` and `a.gmr`, or a clip.

    Args:
        paths: the clips.
        out: folder of the results.
        shape: what is written.
        others: the motion of joints that others move, which no result may replace either.

    Raises:
        ParameterError: two results, or a result and a clip, would be one file.
    """
    writer: dict[str, Path] = {}
    given = {path.resolve(): f"{path} is a clip" for path in paths}
    if others is not None:
        given[others.resolve()] = f"{others} is read"
    if which := given.get((out / TABLE).resolve()):
        raise ParameterError(f"{which}, and would be replaced by the table; "
                             "give another folder as --out")  # fmt: skip
    for path in paths:
        for name in (*shape.files(clip_name(path)), summary_of(clip_name(path))):
            if name == TABLE:
                raise ParameterError(f"{path}: {TABLE} is the name of the table; rename the clip")
            if which := given.get((out / name).resolve()):
                raise ParameterError(f"{which}, and would be replaced by a result of that name; "
                                     " give another folder as --out")  # fmt: skip
            if (other := writer.setdefault(name, path)) is not path:
                raise ParameterError(f"{other} and {path} would both become {name}; write them "
                                     "to two folders")  # fmt: skip


def summary_of(name: str) -> str:
    """Name of a clip's summary."""
    return f"{name}.json"


def write(
    result: Result,
    robot: Robot,
    out: Path,
    shape: Shape,
    about: Mapping[str, Any] | None = None,
) -> Result:
    """Write a clip's motion and summary into a folder, each whole or not at all.

    The summary is taken away first and written last: it speaks of files that lie there.

    Args:
        result: what became of the clip.
        robot: whose motion it is.
        out: folder.
        shape: what is written.
        about: further words for the summary.

    Returns:
        The result, its summary with what was said of the joints and with a hash of each file.

    Raises:
        TrajectoryError, OSError: a file cannot be written.
    """
    written, summary, complete = result.motion, result.summary, None
    name = written.name
    joints = shape.whole
    if joints is not None:
        joints = whole.moved(joints, written.joints)
        complete = whole.complete(written, robot, joints)
        written = complete if shape.full else written
        summary = summary | {"whole": whole.tree(joints)}
    (out / summary_of(name)).unlink(missing_ok=True)
    for suffix in shape.suffixes:
        files.write(written, out / f"{name}{suffix}")
    if shape.tools and result.motion.v is not None and complete is not None:
        complete = replace(
            complete, about={**complete.about, "straight_rows": _straight(result, robot)}
        )
    for tool in shape.tools:
        to = out / f"{name}{layouts.SUFFIX[tool]}"
        assert complete is not None and joints is not None and shape.base is not None
        numbered = whole.numbered(complete, joints)
        layouts.write(numbered, shape.base, summary["rate"], tool, to)
    held = {file: sidecar.digest(out / file) for file in shape.files(name)}
    summary = {**summary, **(about or {}), sidecar.OUTPUT: held}
    documents.write_json(summary, out / summary_of(name))
    return Result(result.motion, summary)


def _straight(result: Result, robot: Robot) -> dict[str, Any]:
    """Whether a motion's rows hold too if joints move straight between them, as tools take them."""
    between = result.summary["certificate"]["margin_between_m"]
    status = paths.certify(robot, result.motion.q, between).status
    return audit.straight_rows(int((status != paths.CERTIFIED).sum()))
