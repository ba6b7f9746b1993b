"""A file that says which joint of a motion is which: YAML or JSON, our point -> its name there.

Points are those of skeleton.POINTS and rigs.MORE; what the file leaves out is looked up as ever.
"""

from pathlib import Path

from s3le.errors import ParameterError
from s3le.human import rigs
from s3le.store import yaml

WANTED = "a joint's name for each of our points, as r_elbow: RightForeArm"


def read_names(path: Path | str) -> dict[str, str]:
    """Read a map for How.names.

    Args:
        path: .yaml or .json, of one mapping.

    Raises:
        ParameterError: no such file, no such mapping, or a key that is none of our points.
    """
    try:
        tree, _ = yaml.mapping(Path(path), WANTED, ParameterError)
        rigs.check_given(tree)
    except FileNotFoundError:
        raise ParameterError(f"{path}: no such file; wanted {WANTED}") from None
    except ParameterError as refused:
        words = str(refused)
        raise ParameterError(words if words.startswith(str(path)) else f"{path}: {words}") from None
    if not tree:
        raise ParameterError(f"{path}: empty; wanted {WANTED}")
    return dict(tree)
