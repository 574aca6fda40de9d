"""The input of an exporter."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from pbd.data import HandPath, JointTrajectory, Keyframe, Robot, Samples
from pbd.errors import PbdError
from pbd.files.exporters import FORMATS, Format
from pbd.pose import Array, Pose


@dataclass(frozen=True, eq=False)
class Source:
    """What a motion was made from, for formats that contain more than joints.

    Attributes:
        T_base_nav: nav in the robot's base.
        tool: joints (m, k) -> the tool's positions (m, 3), m, and wxyz (m, 4) in base.
        links: joints (k,) and the gripper's opening (1 open, 0 closed) -> link -> its parent and its pose in it.
        audit: raises a PlanError if a motion misses a keyframe or would touch something.
        draw: writes the replay's scene at instants (n,) s as GLB.
    """

    name: str
    keyframes: Sequence[Keyframe]
    hand: HandPath
    T_base_nav: Pose
    tool: Callable[[Array], tuple[Array, Array]]
    links: Callable[[Array, float], dict[str, tuple[str, Pose]]]
    audit: Callable[[JointTrajectory], None]
    draw: Callable[[Array, Path], None]


@dataclass(frozen=True, eq=False)
class ExportRequest:
    """One motion to be written in one format.

    Attributes:
        suffix: the file name's suffix, in lower case.
        rate_hz: samples a second; None: the format's default.
        dense: urscript only: samples at the controller's period instead of keyframes.
        task: lerobot only: the task's description; "": the demonstration's name.
    """

    format_name: str
    trajectory: JointTrajectory
    robot: Robot
    suffix: str
    rate_hz: float | None = None
    dense: bool = False
    made_from: Source | None = None
    task: str = ""

    @property
    def format(self) -> Format:
        """The format."""
        return FORMATS[self.format_name]

    def sampled(self) -> Samples:
        """Sample the motion at the given rate, or the format's default."""
        rate_hz = self.rate_hz or self.format.default_hz
        assert rate_hz
        return self.trajectory.sample(rate_hz)

    @property
    def source(self) -> Source:
        """What the motion was made from; PbdError: it is not known."""
        if self.made_from is None:
            what = (
                f"{self.format_name} needs what the motion was made from: plan with pbd.planning.plan_path, and give "
                "its plan.trajectory and source=pbd.planning.source_of(plan)"
            )
            raise PbdError(what, value=self.format_name)
        return self.made_from
