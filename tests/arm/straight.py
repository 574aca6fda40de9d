"""Motions of straight moves, for tests."""

from __future__ import annotations

from collections.abc import Sequence

from pbd.arm.model import ArmModel
from pbd.arm.timing.time_moves import APPROACH_SPEED, Move, time_moves
from pbd.data import JointTrajectory
from pbd.pose import Array


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
    """Time straight moves through keyframes (n, k), with an approach from `q_start` (k,): see `time_moves`."""
    moves = [Move(q[None]) for q in q_keyframes]
    if approach:
        moves[0] = Move(q_keyframes[:1], share=APPROACH_SPEED)
    return time_moves(arm, q_start if approach else q_keyframes[0], moves, dwells, grips, speed=speed)[0]
