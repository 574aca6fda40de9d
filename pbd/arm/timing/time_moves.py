"""When the arm is where: moves from keyframe to keyframe, each from rest to rest, as fast as the limits allow.

A move is straight in joint space (ptp.py) or follows a curve (path_smoothing.py); at a keyframe the arm stands still.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pbd.arm.model import ArmModel
from pbd.arm.timing.piecewise_cubic import PiecewiseCubic
from pbd.arm.timing.ptp import ptp_move
from pbd.data import JointLimits, JointTrajectory
from pbd.errors import PlanError, warn
from pbd.pose import Array

APPROACH_SPEED = 0.5
"""The way from home to the first keyframe and the way back take this share of the limits."""

LONGEST_S = 3600.0
"""Longest motion, s: at 1 kHz it takes about 1 GB."""


@dataclass(frozen=True, eq=False)
class Move:
    """How the arm goes on from where it is.

    Attributes:
        q: (n, k) rad, where it goes: the last is where it comes to rest.
        curved: follow a smooth curve through all of them; else go straight from each to the next, at rest in each.
        t: (n + 1,) s, when a demonstration passed where the arm is and each of these: a curve isn't taken faster.
        least_s: the move takes at least so long.
        share: of the limits.
        near: how near it keeps to a curve, as `curved_move` takes it.
    """

    q: Array
    curved: bool = False
    t: Array | None = None
    least_s: float = 0.0
    share: float = 1.0
    near: float = 1.0

    def pieces(self, q_start: Array, limits: JointLimits, speed: float) -> PiecewiseCubic:
        """Time it, from joints (k,), at a share of the limits that multiplies its own."""
        if self.curved:
            from pbd.arm.timing.path_smoothing import curved_move  # scipy takes its time to load

            waypoints = np.vstack((q_start, self.q))
            return curved_move(waypoints, limits, speed * self.share, self.t, self.near).lasting(self.least_s)
        parts, before = [], q_start
        for q in self.q:
            parts.append(ptp_move(before, q, limits, speed * self.share))
            before = q
        return PiecewiseCubic.join(parts).lasting(self.least_s)


def time_moves(
    arm: ArmModel,
    q_start: Array,
    moves: Sequence[Move],
    dwells: Sequence[float],
    grips: Sequence[bool | None],
    *,
    retreat: Move | None = None,
    speed: float = 1.0,
) -> tuple[JointTrajectory, Array]:
    """Time a motion through keyframes, at rest in each; with it how long (n,) s each move to a keyframe takes.

    The gripper starts open and moves while the arm stands still: where it opens or closes, the arm stays for at least
    its stroke.

    Args:
        q_start: (k,) rad, where the arm is.
        moves: n, each to the next keyframe.
        dwells: (n,) s to stay at each keyframe.
        grips: (n,) True where the gripper closes, False where it opens, None where nothing changes.
        speed: a factor on the velocity, acceleration and jerk limits alike.

    Raises:
        PlanError: nothing moves at all, or for hours.
    """
    gripper, q, t, parts = arm.robot.gripper, q_start, 0.0, list[PiecewiseCubic]()

    def add(pieces: PiecewiseCubic) -> float:
        parts.append(pieces)
        # Added up as the knots are, to the last bit.
        return float(np.append(t, pieces.durations).cumsum()[-1])

    gripper_t, opening, begun, ended = [0.0], [1.0], [], []
    for i, (move, dwell, closes) in enumerate(zip(moves, dwells, grips, strict=True)):
        begun.append(t)
        t, q = add(move.pieces(q, arm.limits, speed)), move.q[-1]
        ended.append(t)
        wanted = opening[-1] if closes is None else float(not closes)
        if wanted != opening[-1] and gripper is None:
            warn(f"{arm.robot.name} has no gripper: the grip at keyframe {i} is ignored; add a [gripper] in its TOML")
        elif wanted != opening[-1] and gripper is not None:
            gripper_t += [t, t + gripper.stroke_s]
            opening += [opening[-1], wanted]
            dwell = max(dwell, gripper.stroke_s)
        t = add(PiecewiseCubic.hold(q, dwell))
    if t == 0.0:
        raise PlanError(
            "nothing moves: the arm already stands at every keyframe; demonstrate a motion with two different stops"
        )
    if retreat is not None:
        t = add(retreat.pieces(q, arm.limits, speed))
    if not t <= LONGEST_S:
        message = f"the motion would take {t / 3600.0:.3g} hours, at most {LONGEST_S / 3600.0:g} can be planned"
        raise PlanError(f"{message}; give a higher --speed, or shorter stays", value=t, bound=LONGEST_S)
    pieces = PiecewiseCubic.join(parts)
    trajectory = JointTrajectory(
        joint_names=arm.robot.joints,
        knots=np.append(0.0, np.cumsum(pieces.durations)),
        coefficients=pieces.coefficients,
        gripper_t=np.array(gripper_t),
        gripper_opening=np.array(opening),
        keyframe_t=np.array(ended),
        keyframe_q=np.array([move.q[-1] for move in moves]),
    )
    return trajectory, np.subtract(ended, begun)
