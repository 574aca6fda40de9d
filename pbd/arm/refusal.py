"""Messages if no motion is found, or only one with a drawback: the moves tried, and the one that came closest."""

from collections.abc import Collection
from dataclasses import dataclass

from pbd.arm.collision.clearance import CLOSE_M, MARGIN_M
from pbd.arm.collision.scene import Hit
from pbd.arm.ladder_state import MoveState
from pbd.arm.motion_request import DEMO, DETOUR, LINE, STRAIGHT, Motion
from pbd.data.world import TABLE
from pbd.errors import PlanError, amount, warn

UNREACHABLE, COLLISION, CANNOT_FOLLOW = "unreachable", "collision", "cannot follow"
"""Reasons of a refusal: a keyframe is out of reach; something is in the way; the arm can't follow the path asked
for."""

_KIND_NAMES = {STRAIGHT: "Straight in joint space", LINE: "Straight line of the tool", DEMO: "Demonstrated path"}


@dataclass(frozen=True, eq=False)
class Refusal:
    """Why there is no motion: UNREACHABLE, COLLISION or CANNOT_FOLLOW, and the error that says so."""

    why: str
    error: PlanError


def refuse_pose(i: int, tried: int, hit: Hit, obstacles: Collection[str]) -> Refusal:
    """Refuse keyframe i, where the arm touches something in each of the `tried` configurations."""
    return _collision(i, f"arm pose at keyframe {i} among {tried} tried: {hit}", STRAIGHT, hit, obstacles)


def refuse_move(
    i: int, move: MoveState, infeasible_kind: str | None, obstacles: Collection[str], *, no_ompl: bool = False
) -> Refusal:
    """Refuse the move to keyframe i; the message names the shallowest hit.

    `infeasible_kind`: LINE or DEMO, if the arm can't follow that path even without obstacles; else None. `no_ompl`: no
    detour was searched for, since OMPL is not installed.
    """
    if not (hits := move.hits):
        path = "the demonstrated path" if infeasible_kind == DEMO else "the straight line"
        error = PlanError(
            f"the arm can't follow {path} from keyframe {i - 1} to keyframe {i}: it would have to flip its elbow or "
            "wrist on the way, or exceed its joint limits or reach; move the dock",
            keyframe=i,
            kind=infeasible_kind,
        )
        return Refusal(CANNOT_FOLLOW, error)
    closest = max(hits, key=lambda kind: hits[kind].distance)
    attempts = [
        f"{_KIND_NAMES[kind]}{' (closest)' if len(hits) > 1 and kind == closest else ''}: {hit}"
        for kind, hit in hits.items()
    ]
    if infeasible_kind is not None:
        attempts.append(f"{_KIND_NAMES[infeasible_kind]}: the arm can't follow it")
    where = f"from keyframe {i - 1} to keyframe {i}" if i > 0 else "to keyframe 0"
    pairs = f"{move.barred_pairs} pairs of arm poses" if move.barred_pairs > 1 else "1 pair of arm poses"
    search = f", and no detour found in {amount(move.detour_checks, 'check')}" if move.detour_checks else ""
    search = ", and no detour was searched for: the package ompl is not installed" if no_ompl else search
    what = f"motion {where} among {pairs}{search}. {'. '.join(attempts)}"
    return _collision(i, what, closest, hits[closest], obstacles)


def warn_about_motion(motion: Motion, retreat_hit: Hit | None) -> None:
    """Warn of detours, and of a retreat that is left out."""
    moves = [*motion.segments, motion.retreat] if motion.retreat else motion.segments
    for i, move in enumerate(moves):
        if move.kind == DETOUR and move.avoided is not None:
            where = f"between keyframes {i - 1} and {i}" if i > 0 else "on its way to keyframe 0"
            where = "on its way back" if i == len(motion.q) else where
            warn(f"{where} the arm goes around {move.avoided.second}: --no-detour forbids that")
    if retreat_hit is not None:
        message = f"no collision-free way back from the last keyframe was found ({retreat_hit})"
        warn(f"{message}: the motion ends there")


def warn_of_closeness(error: PlanError) -> None:
    """Warn that the motion comes nearer to something than MARGIN_M; `error`: what barred the motion at that margin."""
    bodies = error.fields["bodies"]
    assert isinstance(bodies, tuple)
    warn(
        f"the only motion found keeps a clearance of {1e3 * CLOSE_M:g} mm instead of {1e3 * MARGIN_M:g} mm, for "
        f"example between {bodies[0]} and {bodies[1]}: check where the obstacles are"
    )


def _collision(i: int, what: str, kind: str, hit: Hit, obstacles: Collection[str]) -> Refusal:
    advice = "raise the keyframe or the dock"
    if hit.second != TABLE:
        other = "the obstacle" if hit.second in obstacles else "hold the sensor at another angle"
        advice = f"move the dock or {other}"
    error = PlanError(
        f"no collision-free {what}; {advice}",
        keyframe=i,
        **hit.fields,
        closest=kind,
    )
    return Refusal(COLLISION, error)
