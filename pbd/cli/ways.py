"""What the commands say of a plan's ways: for people and for programs."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from pbd.cli.options import say

if TYPE_CHECKING:
    from pbd.planning import Plan


def tell_ways(plan: Plan) -> None:
    """Say where the arm leaves the way that was asked for, or the tool the straight line."""
    for i, way in enumerate(plan.ways):
        if (hit := way.avoided) is not None:
            say(f"the move to keyframe {i} makes a detour: on the straight move {hit.first} would touch {hit.second}")
    worst = max(range(len(plan.ways)), key=lambda i: plan.ways[i].off_line_m)
    off_cm = 100.0 * plan.ways[worst].off_line_m
    if off_cm >= 1.0:
        say(
            f"between keyframes {worst - 1} and {worst} the tool strays {off_cm:.1f} cm from a straight line; "
            "--path line or --path-tolerance 0.01 keeps it straight"
        )


def ways_json(plan: Plan) -> list[dict[str, Any]]:
    """How the arm comes to each keyframe after the first."""
    ways = enumerate(plan.ways[1:], start=1)
    return [{"keyframe": i, "kind": way.kind, "off_line_m": way.off_line_m} for i, way in ways]


def touching_json(plan: Plan) -> dict[str, Any] | None:
    """What touches, where that was allowed."""
    if plan.touching is None:
        return None
    found = plan.touching.found
    return {
        "bodies": [found.hit.first, found.hit.second],
        "depth_m": found.hit.depth,
        "keyframe": found.keyframe,
        "t_s": [found.t, found.parted_t],
    }
