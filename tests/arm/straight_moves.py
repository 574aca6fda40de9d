"""Joints at keyframes, and motions of straight moves, for tests."""

from collections.abc import Sequence

from pbd.arm.ladder_building import build_ladder
from pbd.arm.ladder_graph import Barred
from pbd.arm.model import ArmModel
from pbd.arm.timing.time_moves import APPROACH_SPEED, Move, time_moves
from pbd.data import JointTrajectory
from pbd.pose import Array, Pose


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


def solve_path(arm: ArmModel, T_base_tool: Sequence[Pose], q_start: Array) -> Array:
    """Find joints (n, k) that reach n tool poses with little joint travel from `q_start` (k,) on, without collisions.

    Raises:
        PlanError: a keyframe can't be reached; see `out_of_reach` for its fields.
    """
    ladder = build_ladder(arm, T_base_tool, q_start, None, mend_after=1)
    path = ladder.shortest()
    return ladder.joints([] if isinstance(path, Barred) else path)[1:]
