"""The steps of planning, each from values of the one before; what is heavy is loaded where it is used."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache
from typing import TYPE_CHECKING

from pbd.data import Calibration, HandPath, Keyframe
from pbd.errors import PlanError
from pbd.planning.options import PlanOptions, demonstrated
from pbd.pose import Array, Pose

if TYPE_CHECKING:
    from pbd.arm.model import ArmModel
    from pbd.arm.passage import Passage
    from pbd.arm.scene import CollisionScene
    from pbd.arm.timing import Move
    from pbd.arm.wish import Ways
    from pbd.calibration.demonstrated import DemonstratedMove

    Hand = Callable[[], Sequence[DemonstratedMove]]


def find_passage(
    scene: CollisionScene,
    T_base_tool: Sequence[Pose],
    keyframes: Sequence[Keyframe],
    options: PlanOptions,
    q_start: Array,
) -> Passage:
    """Say what is free, home and start first."""
    from pbd.arm.collision import describe, refuse_home
    from pbd.arm.passage import Passage

    if options.retreat or (options.approach and options.start is None):
        refuse_home(scene)
    passage = Passage(scene.arm, scene, T_base_tool, [keyframe.grip for keyframe in keyframes])
    if options.approach and (hit := scene.hit(q_start, passage.legs[0])) is not None:
        raise PlanError(
            f"at the arm's start: {describe(hit)}; move the arm, or correct the obstacles in the calibration",
            bodies=(hit.first, hit.second),
            value=hit.depth,
            p_base=hit.p_base,
        )
    return passage


def hand_between(
    path: HandPath | None,
    keyframes: Sequence[Keyframe],
    T_base_nav: Pose,
    calibration: Calibration,
    options: PlanOptions,
) -> Hand | None:
    """How the hand went from keyframe to keyframe, worked out only when somebody asks; None where nobody knows."""
    if path is None:
        return None

    @cache
    def hand() -> tuple[DemonstratedMove, ...]:
        from pbd.calibration.demonstrated import demonstrated_moves

        return demonstrated_moves(path, keyframes, T_base_nav, calibration, options.scale, options.orientation)

    return hand


def choose(
    arm: ArmModel,
    T_base_tool: Sequence[Pose],
    q_start: Array,
    hand: Hand | None,
    options: PlanOptions,
    passage: Passage | None,
) -> Ways:
    """Choose joints and ways; without a passage whatever is in the way."""
    from pbd.arm.ways import choose_ways
    from pbd.arm.wish import DEMO, LINE, STRAIGHT, Wish

    wish = Wish(
        T_base_tool,
        q_start,
        options.approach,
        arm.robot.home if options.retreat else None,
        {"keyframes": STRAIGHT, "line": LINE, "demo": DEMO}[options.path],
        hand and (lambda: [move.T_base_tool for move in hand()]),
        options.tolerance_m,
    )
    return choose_ways(arm, wish, passage)


def moves_of(chosen: Ways, keyframes: Sequence[Keyframe], hand: Hand | None, options: PlanOptions) -> list[Move]:
    """Say how each way is to be timed."""
    from pbd.arm.timing import APPROACH_SPEED, Move
    from pbd.arm.wish import DEMO, STRAIGHT

    moves = [Move(chosen.ways[0].q, share=APPROACH_SPEED)]
    for i, (way, demonstrated_s) in enumerate(zip(chosen.ways[1:], demonstrated(keyframes), strict=True)):
        least_s = demonstrated_s if options.time == "demo" else 0.0
        t = hand()[i].t if options.time == "demo" and way.kind == DEMO and hand else None
        moves.append(Move(way.q, curved=way.kind != STRAIGHT, t=t, least_s=least_s))
    return moves


def retreat_of(chosen: Ways) -> Move | None:
    """The way back home."""
    from pbd.arm.timing import APPROACH_SPEED, Move

    return None if chosen.back is None else Move(chosen.back, share=APPROACH_SPEED)
