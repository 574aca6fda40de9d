"""When the arm is where: straight moves in joint space from keyframe to keyframe, as fast as the limits allow.

Each move is one degree of freedom for ruckig, the distance along the line, under the limits that its joints leave it.
So the line is straight (with one degree of freedom per joint it often isn't), and ruckig's cubic pieces are the joints'
pieces but for a factor. Ruckig's own waypoints are never used: they would ask a service on the net.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence

import numpy as np
from ruckig import InputParameter, Ruckig, Trajectory

from pbd.arm.model import ArmModel
from pbd.data import JointLimits, JointTrajectory
from pbd.errors import PbdWarning, PlanError
from pbd.pose import Array

APPROACH_SPEED = 0.5
"""The approach from home uses this share of the limits."""

WITHIN = 1.0 - 1e-9
"""Rounding stays within the limits too."""

_NO_TIME = 1e-12  # s: a piece shorter than this is none (ruckig gives phases that aren't needed no time)


def time_keyframes(
    arm: ArmModel,
    q_keyframes: Array,
    dwells: Sequence[float],
    grips: Sequence[bool | None],
    q_start: Array,
    *,
    speed: float = 1.0,
    approach: bool = True,
) -> JointTrajectory:
    """Time a motion through keyframes, at rest in each.

    The gripper starts open and moves while the arm stands still: where it opens or closes, the arm stays for at least
    its stroke.

    Args:
        arm: the arm, for its limits and its gripper.
        q_keyframes: (n, k) rad.
        dwells: (n,) s to stay at each keyframe.
        grips: (n,) True where the gripper closes, False where it opens, None where nothing changes.
        q_start: (k,) rad, where the arm comes from, at APPROACH_SPEED.
        speed: above 0, at most 1: a factor on the velocity, acceleration and jerk limits alike.
        approach: False to begin at the first keyframe.

    Raises:
        PlanError: speed is out of range, or nothing moves at all.
    """
    if not 0.0 < speed <= 1.0:
        raise PlanError(f"speed must be above 0 and at most 1, got {speed:g}; give such a one", value=speed, bound=1.0)
    gripper, joints = arm.robot.gripper, len(arm.robot.joints)
    pieces = _Pieces(q_start if approach else q_keyframes[0])
    gripper_t, opening, reached = [0.0], [1.0], []
    for i, (q, dwell, closes) in enumerate(zip(q_keyframes, dwells, grips, strict=True)):
        factor = speed * APPROACH_SPEED if i == 0 else speed
        pieces.move(q, arm.limits, factor)
        reached.append(pieces.t)
        wanted = opening[-1] if closes is None else float(not closes)
        if wanted != opening[-1] and gripper is None:
            message = f"{arm.robot.name} has no gripper: what the hand gripped at keyframe {i} is left out"
            warnings.warn(f"{message}; give it one in its TOML", PbdWarning, stacklevel=2)
        elif wanted != opening[-1] and gripper is not None:
            gripper_t += [pieces.t, pieces.t + gripper.stroke_s]
            opening += [opening[-1], wanted]
            dwell = max(dwell, gripper.stroke_s)
        pieces.hold(dwell)
    if not pieces.durations:
        raise PlanError("nothing moves: all keyframes are where the arm starts; demonstrate a motion with two stops")
    return JointTrajectory(
        joint_names=arm.robot.joints,
        knots=np.concatenate(((0.0,), np.cumsum(pieces.durations))),
        coefficients=np.array(pieces.coefficients).reshape(-1, 4, joints),
        gripper_t=np.array(gripper_t),
        gripper_opening=np.array(opening),
        keyframe_t=np.array(reached),
        keyframe_q=q_keyframes,
    )


class _Pieces:
    """Cubic pieces in the making: where the arm is (q, at rest) and since when (t)."""

    def __init__(self, q: Array) -> None:
        self.q = q
        self.durations: list[float] = []
        self.coefficients: list[Array] = []

    @property
    def t(self) -> float:
        # Added up as the knots are, to the last bit.
        return float(np.sum(self.durations))

    def hold(self, duration: float) -> None:
        zero = np.zeros_like(self.q)
        self._add(duration, self.q, zero, zero, zero)

    def move(self, q: Array, limits: JointLimits, factor: float) -> None:
        way = q - self.q
        length = float(np.abs(way).max())
        if length == 0.0:
            return
        way /= length
        for duration, s, v, a, j in _profile(length, way, limits, factor):
            self._add(duration, self.q + s * way, v * way, a * way, j * way)
        self.q = q

    def _add(self, duration: float, q: Array, v: Array, a: Array, j: Array) -> None:
        if duration < _NO_TIME:
            return
        self.durations.append(duration)
        self.coefficients.append(np.stack((q, v, a / 2.0, j / 6.0)))


def _profile(length: float, way: Array, limits: JointLimits, factor: float) -> list[tuple[float, ...]]:
    """Time a move of `length` along `way` (k,), rest to rest: pieces of duration, and s, v, a, j where they begin."""
    share = np.abs(way)
    moving = share > 0.0
    wanted = InputParameter(1)
    wanted.current_position, wanted.target_position = [0.0], [length]
    wanted.max_velocity = [WITHIN * factor * float((limits.velocity[moving] / share[moving]).min())]
    wanted.max_acceleration = [WITHIN * factor * float((limits.acceleration[moving] / share[moving]).min())]
    wanted.max_jerk = [WITHIN * factor * float((limits.jerk[moving] / share[moving]).min())]
    trajectory = Trajectory(1)
    Ruckig(1).calculate(wanted, trajectory)
    profile = trajectory.profiles[0][0]
    # Seven phases; the states are one more, the last being the end.
    return list(zip(profile.t, profile.p, profile.v, profile.a, profile.j, strict=False))
