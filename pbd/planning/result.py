"""The result of planning, and warnings about it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from pbd.calibration.demonstrated_path import samples_of_move
from pbd.calibration.tool_poses import KeyframesInBase
from pbd.data import Calibration, Demonstration, GraspedObject, HandPath, JointTrajectory, Keyframe, Robot
from pbd.data.one_line_repr import brief
from pbd.errors import PlanError, amount, warn
from pbd.files.find_by_name import hides_bundled
from pbd.planning.options import PlanOptions
from pbd.pose import Array, Pose, quat_rotate, quat_to_matrix

if TYPE_CHECKING:
    from pbd.arm.collision.motion_check import MotionHit
    from pbd.arm.collision.scene import CollisionScene
    from pbd.arm.motion_request import Segment
    from pbd.arm.tool_deviation import ToolDeviation
    from pbd.audit.audit import AuditReport

STRETCHED_RATIO = 1.02
"""Ratio to the hand's time above which a move counts as stretched."""
STRETCHED_S = 0.02
"""Excess over the hand's time, s, that a stretched move must also have."""


@dataclass(frozen=True, eq=False)
class Stretch:
    """A move to a keyframe that takes longer than the hand took: both durations, s."""

    keyframe: int
    demonstrated_s: float
    planned_s: float


@dataclass(frozen=True, eq=False)
class Touching:
    """The error that describes the first hit of a motion, and all hits sorted by their beginning."""

    error: PlanError
    hits: tuple[MotionHit, ...]


@dataclass(frozen=True, eq=False)
class Plan:
    """A motion that has passed the audit, and the data from which it was made.

    Attributes:
        keyframes, calibration, robot, grasped, options: as `plan_keyframes` was given them.
        hand_path: the hand's path between the keyframes; None: unknown.
        placed: the keyframes in base, with the calibration that known places corrected.
        T_base_tool: the tool's required pose at each keyframe.
        off_rad: (n, 2) errors of an arm with too few joints: of the approach axis, and of the rotation about it.
        segments: the moves to the keyframes.
        trajectory: the motion.
        report: the results of the audit.
        stretched: with time "demo", moves that take longer than the hand did.
        touching: the contacts of the motion, if they were allowed; None: there are none.
        retreat: the move home at the end; None: there is none.
    """

    keyframes: tuple[Keyframe, ...]
    calibration: Calibration
    robot: Robot
    hand_path: HandPath | None
    grasped: GraspedObject | None
    options: PlanOptions
    placed: KeyframesInBase
    T_base_tool: tuple[Pose, ...]
    off_rad: Array
    segments: tuple[Segment, ...]
    trajectory: JointTrajectory
    report: AuditReport
    stretched: tuple[Stretch, ...] = ()
    touching: Touching | None = None
    retreat: Segment | None = None

    @property
    def tracked(self) -> tuple[HandPath, Demonstration]:
        """The hand's path and the demonstration; PlanError if only keyframes are known."""
        if self.hand_path is None or self.hand_path.tracking is None:
            raise PlanError("these keyframes come without their demonstration; track one with pbd.track")
        return self.hand_path, self.hand_path.tracking.demo

    @property
    def name(self) -> str:
        """The demonstration's name; "motion" if it is unknown."""
        tracking = self.hand_path and self.hand_path.tracking
        return tracking.demo.recording.info.name if tracking else "motion"

    @property
    def scale(self) -> float:
        """The factor on the hand's positions: the calibration's own times that of the options."""
        return self.placed.scale * self.placed.calibration.scale

    def __repr__(self) -> str:
        touches = "" if self.touching is None else "touches something"
        return brief(self, repr(self.trajectory), touches)


def hand_deviations(plan: Plan) -> list[ToolDeviation]:
    """Measure how the hand went to each keyframe but the first, whatever the arm does; none if it is unknown."""
    from pbd.arm.tool_deviation import SAMPLES, path_deviations

    if plan.hand_path is None:
        return []
    found, mount = [], plan.placed.calibration.T_sensor_tool
    fixed = plan.options.orientation == "fixed"
    for before, after in pairwise(plan.keyframes):
        t, p, wxyz = samples_of_move(plan.hand_path, before, after)
        at = np.linspace(0, len(t) - 1, SAMPLES).round().astype(int)
        p, wxyz = plan.scale * p[at], wxyz[at]
        if fixed:
            wxyz = np.tile(wxyz[:1], (SAMPLES, 1))
        found += path_deviations((p + quat_rotate(wxyz, mount.p))[None], quat_to_matrix(wxyz)[None])
    return found


def robot_remark(robot: Robot) -> str:
    """Return that a robot's file, of the working folder, is used in place of a bundled one; "" if it isn't."""
    hides = robot.file is not None and hides_bundled("robots", robot.file)
    return f"{robot.file} hides the bundled robot of that name" if hides else ""


def place_remark(robot: Robot, calibration: Calibration, named: str | None) -> str:
    """Return where in base the motion starts if no calibration was `named`; "" if one was."""
    dock = calibration.T_base_dock
    if dock is None or named:
        return ""
    at = ", ".join(f"{x + 0.0:.3f}" for x in dock.p.tolist())
    whose = "the default dock" if robot.dock is None else f"{robot.name}'s own dock"
    return f"the hand starts at {whose}, ({at}) m in base; for yours give --calibration NAME"


def table_remark(calibration: Calibration) -> str:
    """Return where the table is that the motion was checked against; "" without one, of which planning warns."""
    z = calibration.table_height
    return "" if z is None else f"checked against a table whose top is at {z + 0.0:.3f} m in base (table_height)"


def size_remark(robot: Robot, calibration: Calibration, chosen: float) -> str:
    """Return at which size the motion is played, and why (a --scale was `chosen`); "" if it is the hand's."""
    own = calibration.scale
    if (scale := own * chosen) == 1.0:
        return ""
    dock = f"{robot.name}'s own dock" if calibration is robot.dock else calibration.name
    causes = [f"scale {own:g} of {dock}"] if own != 1.0 else []
    causes += [f"--scale {chosen:g}"] if chosen != 1.0 else []
    return f"played at {scale:g} {'of' if scale < 1.0 else 'times'} its size ({', '.join(causes)})"


def find_touching(scene: CollisionScene, trajectory: JointTrajectory) -> Touching | None:
    """Return what a motion touches; None if it is free."""
    from pbd.arm.collision.motion_check import all_hits, collision_error

    hits = all_hits(scene, trajectory)
    return Touching(collision_error(scene, trajectory, hits[0]), hits) if hits else None


def find_stretched(took_s: Array, durations_s: Sequence[float], speed: float) -> tuple[Stretch, ...]:
    """Find the moves that take longer than the hand did, and warn of them.

    Args:
        took_s: (n,) durations of the moves, with the approach.
        durations_s: (n - 1,) the hand's durations.
        speed: the share of the joints' limits that a person asked for.
    """
    both = zip(durations_s, took_s[1:].tolist(), strict=True)
    found = [
        Stretch(i, hand_s, arm_s)
        for i, (hand_s, arm_s) in enumerate(both, start=1)
        if arm_s > max(STRETCHED_RATIO * hand_s, hand_s + STRETCHED_S)
    ]
    if found:
        moves = [
            f"{each.planned_s:.2f} s instead of {each.demonstrated_s:.2f} s to keyframe {each.keyframe}"
            for each in sorted(found, key=lambda each: each.demonstrated_s / each.planned_s)[:3]
        ]
        rest = f", and {len(found) - 3} more" if len(found) > 3 else ""
        are, faster = "is" if len(found) == 1 else "are", "give a higher --speed, " if speed < 1.0 else ""
        warn(
            f"{len(found)} of {amount(len(durations_s), 'move')} {are} slower than the hand's, to keep the "
            f"joint limits: {', '.join(moves)}{rest}; for the hand's own time {faster}"
            "demonstrate it slower, or try a smaller --scale"
        )
    return tuple(found)
