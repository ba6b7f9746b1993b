"""A step of LeRobot's processor pipeline that guards a robot's actions.

    pip install s3le lerobot

    from lerobot.processor import RobotProcessorPipeline
    pipeline = RobotProcessorPipeline(steps=[..., GuardStep("g1", fps=30)], ...)

It stands behind the policy and in front of the robot. Joints of the action, such as
`left_elbow_joint.pos`, come out certified; its other entries, a gripper's say, come out as they
came. Where the observation holds the joints too, they are compared with where the robot should
be: a robot that is elsewhere is not driven on, and StateError is raised.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from s3le.guard import Guard

try:
    from lerobot.processor import ProcessorStepRegistry, RobotActionProcessorStep
except ImportError:  # so that the step can be tried without it

    class RobotActionProcessorStep:
        """What LeRobot's own does with an action that is a dict."""

        def __call__(self, transition: dict[str, Any]) -> dict[str, Any]:
            """The transition with another action."""
            self._current_transition = dict(transition)
            action = self.action(dict(transition["action"]))
            self._current_transition["action"] = action
            return self._current_transition

        @property
        def transition(self) -> dict[str, Any]:
            """The one that is being worked on."""
            return self._current_transition

    def register(step: type) -> type:
        """Nothing to be registered in."""
        return step
else:
    register = ProcessorStepRegistry.register("s3le_guard")


@register
@dataclass
class GuardStep(RobotActionProcessorStep):
    """Replaces an action's joints by the nearest certified ones."""

    robot: str = "g1"  # name, robot file or folder
    fps: float = 30.0  # actions per second
    degrees: bool = False  # the action's unit, LeRobot's own for many arms
    ending: str = ".pos"  # of the action's names, behind those of joints

    def __post_init__(self) -> None:
        """Load the robot; compiles the first time on a machine."""
        self.guard = Guard.load(self.robot)
        self.reason = ""  # of the last action
        self.reset()

    def action(self, action: dict[str, Any]) -> dict[str, Any]:
        """The same action, its joints certified.

        Raises:
            ParameterError: a joint of the robot is missing, or is no number.
            StateError: the robot is measured too far from where it should be.
        """
        measured = self._joints(self.transition.get("observation") or {})
        if self._begins:
            self.guard.start(measured)
            self._begins = False
        made = self.guard.step(self._joints(action) or {}, 1.0 / self.fps, measured)
        self.reason = made.reason
        for name, angle in zip(self.guard.robot.joint_names, made.q, strict=True):
            action[name + self.ending] = float(np.rad2deg(angle) if self.degrees else angle)
        return action

    def reset(self) -> None:
        """A new episode: the robot stands where the next observation says, else at its anchor."""
        self._begins = True

    def get_config(self) -> dict[str, Any]:
        """What makes the same step again."""
        return {"robot": self.robot, "fps": self.fps, "degrees": self.degrees,
                "ending": self.ending}  # fmt: skip

    def transform_features(self, features: dict) -> dict:
        """Names and shapes stay."""
        return features

    def _joints(self, values: dict[str, Any]) -> dict[str, float] | None:
        """The robot's joints in a dict [rad]; None: none of them is there."""
        names = [n for n in self.guard.robot.joint_names if n + self.ending in values]
        found = {name: float(values[name + self.ending]) for name in names}
        if self.degrees:
            found = {name: float(np.deg2rad(angle)) for name, angle in found.items()}
        return found or None
