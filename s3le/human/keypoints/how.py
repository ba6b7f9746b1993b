"""How keypoints are to be read where a file does not say: which joint is which, which way is up."""

from collections.abc import Mapping
from math import isfinite
from typing import Any, NamedTuple

from s3le.errors import ParameterError
from s3le.human import rigs
from s3le.human.keypoints.layouts import LAYOUTS

AXES = ("camera", "y-up", "z-up", "y-up-left", "z-up-left")
LEFT_HANDED = AXES[3:]  # Unity's and Unreal's
STEEPEST = 89.0  # [deg] of a camera's tilt
CONFIDENCE = 0.1  # a joint seen with less is not used; hidden arms have some, absent ones none
_PREFIX = "clip_read_"  # of the keys of a motion file


class How(NamedTuple):
    """What a person says about a file of keypoints; None: look at the data, and say what it was.

    Attributes:
        layout: one of layouts.LAYOUTS.
        axes: one of AXES; camera is x right, y down, z away; y-up-left is x right, y up, z forward,
            z-up-left x forward, y right, z up.
        pitch: how far the camera looks down [deg]; up is negative. For camera axes only.
        person: which of several, as numbered by the file.
        confidence: least confidence of the joints of a frame that is used, in [0, 1].
        animation: which of a scene's animations, by its name or its number from 0.
        names: what the file calls our joints, by point, of rigs.POINTS and rigs.MORE.
    """

    layout: str | None = None
    axes: str | None = None
    pitch: float | None = None
    person: int | None = None
    confidence: float | None = None
    animation: str | None = None
    names: Mapping[str, str] | None = None

    def check(self) -> "How":
        """Itself.

        Raises:
            ParameterError: a value out of its range.
        """
        if self.layout is not None and self.layout not in LAYOUTS:
            raise ParameterError(f"--layout {self.layout}: wanted one of {', '.join(LAYOUTS)}")
        if self.axes is not None and self.axes not in AXES:
            raise ParameterError(f"--axes {self.axes}: wanted one of {', '.join(AXES)}")
        if self.pitch is not None and not abs(self.pitch) <= STEEPEST:
            raise ParameterError(
                f"--pitch must be from -{STEEPEST:g} to {STEEPEST:g} degrees, got {self.pitch!r}"
            )
        if self.pitch is not None and self.axes not in (None, "camera"):
            raise ParameterError(f"--pitch is a camera's; with --axes {self.axes} there is none")
        if self.confidence is not None and not 0.0 <= self.confidence <= 1.0:
            raise ParameterError(f"--confidence must be from 0 to 1, got {self.confidence!r}")
        if self.names is not None:
            rigs.check_given(self.names)
        return self

    def about(self) -> dict[str, Any]:
        """As words for a motion file, so that who looks at it later reads the clip alike."""
        return {f"{_PREFIX}{k}": v for k, v in self._asdict().items() if v is not None}


def recorded(about: Mapping[str, Any]) -> How:
    """What a motion file says of how its clip was read; what makes no sense is left out."""
    how = How()
    for name in How._fields:
        value: Any = about.get(f"{_PREFIX}{name}")
        try:
            if name in ("pitch", "confidence", "person"):
                value = float(value)
                value = value if isfinite(value) else None
                value = int(value) if name == "person" and value is not None else value
            if name == "animation" and value is not None and not isinstance(value, str):
                continue
            if name == "names" and not isinstance(value, Mapping):
                value = None
            how = how._replace(**{name: value}).check()
        except (TypeError, ValueError, ParameterError):
            how = how._replace(**{name: None})
    return how
