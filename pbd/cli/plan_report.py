"""Describes a plan's moves, torques and contacts, for people and as JSON."""

import math
from dataclasses import asdict, replace
from typing import Any

from pbd import __version__
from pbd.calibration.dock import dock_tilt
from pbd.cli.console import working
from pbd.data import Load
from pbd.files.find_by_name import origin
from pbd.planning import Plan, PlanOptions, can_plan
from pbd.planning.options import dwells
from pbd.planning.result import hand_deviations, place_remark, robot_remark, size_remark, table_remark

STRAY_M = 0.01
"""Smallest distance of the tool from a straight line, m, that is reported."""

REACH_CURVES = 0.1
"""Share of a reach's length by which people leave the straight line unawares (Atkeson and Hollerbach, 1985)."""

ASKED_REST_S = 2.0
"""s: the longest rest that a person is asked for, the first one. A longer stay is part of the task."""


def remarks(plan: Plan, calibration: str | None) -> list[str]:
    """Return the remarks on a plan: its place, size, table, torques, curved moves, how far the tool strays."""
    found = whole_motion_remarks(plan, calibration)
    for i, move in enumerate(plan.segments):
        if (hit := move.avoided) is not None and move.kind != "detour":  # planning reports detours
            how = "as the hand went" if move.kind == "demo" else "along a line"
            found.append(
                f"the move to keyframe {i} goes {how}: on the straight move {hit.first} would touch {hit.second}"
            )
        elif move.wide is not None and move.kind == "line":
            found.append(
                f"the move to keyframe {i} is made as a line: straight in joint space the tool would {move.wide}"
            )
    worst = max(range(len(plan.segments)), key=lambda i: plan.segments[i].off_line_m)
    off_m = plan.segments[worst].off_line_m
    if off_m < STRAY_M or plan.options.tolerance_m is not None or plan.segments[worst].wide is not None:
        return found  # planning reports a wide move
    if any(move.kind == "detour" for move in plan.segments[1:]):
        how = "--path-tolerance would forbid the way around"
    else:
        with working("trying a straight line"):
            straight = can_plan(plan, replace(plan.options, tolerance_m=STRAY_M))
        can = f"--path-tolerance {STRAY_M} keeps it straight"
        how = can if straight else f"{plan.robot.name} can't keep it straight from this dock"
    strays = f"the tool strays {100.0 * off_m:.1f} cm from a straight line"
    return [*found, f"between keyframes {worst - 1} and {worst} {strays}; {how}"]


def unfollowed(plan: Plan) -> list[str]:
    """Return the warnings about what the hand did and the arm does not: ways round, turns, a long stay."""
    return [*_lost_ways(plan), *_lost_stays(plan)]


def _lost_ways(plan: Plan) -> list[str]:
    """Return on which move the hand left the direct way most, if there are any on which the arm does not follow it."""
    left = [
        (hand.turns, hand.turn_rad if hand.turns else hand.off_line_m, i, hand)
        for i, hand in enumerate(hand_deviations(plan), start=1)
        if (hand.turns or hand.off_line_m > STRAY_M + REACH_CURVES * hand.line_m) and plan.segments[i].kind != "demo"
    ]
    if not left:
        return []
    turns, _, worst, hand = max(left)
    with working("trying the hand's path"):
        follows = can_plan(plan, replace(plan.options, path="demo", tolerance_m=None))
    how = "only --path demo follows the hand" if follows else f"{plan.robot.name} can't follow the hand from this dock"
    turned = f"turned by {math.degrees(hand.turn_rad):.0f} degrees instead of {math.degrees(hand.direct_rad):.0f}"
    did = turned if turns else f"left the straight line by {100.0 * hand.off_line_m:.1f} cm"
    return [f"between keyframes {worst - 1} and {worst} the hand {did}; {how}"]


def _lost_stays(plan: Plan) -> list[str]:
    """Return the longest stay of the hand on the way, if it was meant and the arm's is shorter."""
    arm_s, inner = dwells(plan.keyframes, plan.options), range(1, len(plan.keyframes) - 1)
    longest = max(inner, key=lambda i: plan.keyframes[i].dwell_s, default=0)
    hand_s = plan.keyframes[longest].dwell_s
    if longest == 0 or hand_s <= max(ASKED_REST_S, arm_s[longest]):
        return []
    keeps = f"--dwell {math.ceil(hand_s)} keeps all stays, dwell_s in keyframes.toml this one"
    return [f"the hand stayed {hand_s:.1f} s at keyframe {longest}, the arm {arm_s[longest]:.1f} s; {keeps}"]


def whole_motion_remarks(plan: Plan, calibration: str | None) -> list[str]:
    """Return the remarks on the motion as a whole: the robot's file, its place, size, table, torques."""
    placed = place_remark(plan.robot, plan.calibration, calibration)
    size = size_remark(plan.robot, plan.calibration, plan.options.scale)
    found = robot_remark(plan.robot), placed, size, table_remark(plan.calibration), torque_remark(plan)
    return list(filter(None, found))


def torque_remark(plan: Plan) -> str:
    """Return how much of the torque limits the motion uses, and with which load."""
    torque, thing = plan.report.torque, plan.grasped
    if torque is None:
        return f"torques are not checked: {plan.robot.name} has no `effort` in its [limits]"
    carried = str(Load(plan.options.payload, grasped=thing)) or "nothing"
    unknown = f"; what the {thing.shape} weighs isn't known (mass_kg in demo.toml)" if thing and not thing.mass else ""
    return f"torques: at most {100.0 * torque.share:.0f} % of the limit ({torque.joint}), carrying {carried}{unknown}"


def plan_json(plan: Plan, calibration: str | None, demo: str | None) -> dict[str, Any]:
    """Return what every command that plans says of the plan; `calibration` and `demo` as the command was given them."""
    dock, tilt_deg = plan.calibration.T_base_dock, None
    if dock is not None and not plan.calibration.any_attitude:
        tilt_deg = math.degrees(dock_tilt(dock, plan.keyframes[0].T_nav_sensor.wxyz))
    return {
        "demo": plan.name,
        "robot": plan.robot.name,
        "duration_s": plan.trajectory.duration,
        "scale": plan.scale,
        "dock_tilt_deg": tilt_deg,
        "made_from": _made_from(plan, calibration, demo),
    }


def _made_from(plan: Plan, calibration: str | None, demo: str | None) -> dict[str, Any]:
    """Return pbd's version, the files, and the options that differ from their defaults, in their own units."""
    robot, folder = plan.robot, plan.tracked[1].folder
    own = "default" if robot.dock is None else f"{robot.name}'s own dock"
    usual = asdict(PlanOptions())
    if plan.tracked[1].keyframes is not None:
        usual["dwell_s"] = math.inf
    return {
        "pbd": __version__,
        "robot": robot.file and origin("robots", robot.file),
        "calibration": calibration or own,
        "demo": origin("demos", folder) if folder else demo,
        "options": {name: value for name, value in asdict(plan.options).items() if value != usual[name]},
    }


def moves_json(plan: Plan) -> list[dict[str, Any]]:
    """Return how the arm moves to each keyframe after the first; detours to the first one and back home (null) too."""
    moves = enumerate([*plan.segments, plan.retreat] if plan.retreat else plan.segments)
    return [
        {"keyframe": i if i < len(plan.segments) else None, "kind": move.kind, "off_line_m": move.off_line_m}
        for i, move in moves
        if 0 < i < len(plan.segments) or move.kind == "detour"
    ]


def touching_json(plan: Plan) -> dict[str, Any] | None:
    """Return the first contact, if --allow-collision was given and there is one."""
    if plan.touching is None:
        return None
    found = plan.touching.hits[0]
    return {
        "bodies": [found.hit.first, found.hit.second],
        "depth_m": found.hit.depth,
        "keyframe": found.keyframe,
        "t_s": [found.t, found.parted_t],
    }
