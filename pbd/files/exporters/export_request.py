"""What a format is written from."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from pbd.data import HandPath, JointTrajectory, Keyframe, Robot, Samples
from pbd.errors import PbdError
from pbd.files.exporters import FORMATS, Format
from pbd.pose import Array, Pose


@dataclass(frozen=True, eq=False)
class Source:
    """What a motion was made from, for the formats that tell more than joints.

    Attributes:
        keyframes: n, as the trajectory has them.
        tool: gives the tool's positions (m, 3) in m and wxyz (m, 4) in base, at joints (m, k).
        links: gives each link's parent and its pose there, at joints (k,) and an opening (1 open, 0 closed).
        audit: refuses a motion made of a file's points that misses a keyframe, or would touch something.
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
    """One file to be written: of a robot's motion, in one of FORMATS.

    Attributes:
        suffix: of the file's name, in lower case.
        rate_hz: samples a second; None: as the format has it.
        dense: samples at the controller's period, where the format has keyframes.
        task: what it does, in words, where a format has that; its name where nobody said.
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
        """What is known of it."""
        return FORMATS[self.format_name]

    def sampled(self) -> Samples:
        """The motion at the rate that was asked for, or the format's usual one."""
        rate_hz = self.rate_hz or self.format.usual_hz
        assert rate_hz
        return self.trajectory.sample(rate_hz)

    @property
    def source(self) -> Source:
        """What the motion was made from; PbdError: nobody said."""
        if self.made_from is None:
            what = f"{self.format_name} tells what the motion was made from; give source=pbd.planning.source_of(...)"
            raise PbdError(what, value=self.format_name)
        return self.made_from
