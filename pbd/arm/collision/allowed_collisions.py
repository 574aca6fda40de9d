"""Which pairs of links are checked against each other, and which are not, and why (MoveIt's allowed collisions)."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import pinocchio as pin

from pbd.arm.collision.clearance import Clearance, Pairs
from pbd.arm.collision.geometry import Body
from pbd.arm.collision.motion_bounds import rates
from pbd.arm.gripper import THE_TOOL, arm_bodies, gripper_links
from pbd.arm.model import ArmModel
from pbd.io.xml import read_xml
from pbd.pose import Array

TRUSTED = ("Adjacent", "Never")
"""The SRDF's reasons that are believed. Others ("Default", "disabled") were made by hand or at one pose only."""

SAMPLES = 200
"""Random configurations, always the same ones, in which two bodies must touch to count as always touching."""

NEARLY_ALWAYS = 0.95
"""Bodies that touch in at least this share of the samples are not checked: their shapes overlap, which no arm's links
do. The share is that of MoveIt's setup assistant."""


@dataclass(frozen=True)
class Unchecked:
    """Two links that are not checked against each other (or some of their bodies aren't), and why."""

    first: str
    second: str
    why: str


@lru_cache(maxsize=4)
def link_pairs(arm: ArmModel) -> tuple[Pairs, tuple[Unchecked, ...]]:
    """Return the pairs (p, 2) of the arm's bodies that are checked, and those pairs of links that are not.

    Not checked are links next to each other (or with nothing solid between), those that the robot's TOML lets touch or
    the SRDF says are adjacent or never meet, those that both belong to the gripper, and bodies that touch in nearly all
    configurations. Bodies that no joint moves against each other are in neither list.
    """
    bodies = arm_bodies(arm)
    pairs = np.stack(np.triu_indices(len(bodies), 1), axis=1)
    pairs = pairs[(rates(arm, bodies, pairs) > 0.0).any(axis=1)]
    names = [(bodies[a].name, bodies[b].name) for a, b in pairs]
    reasons = _reasons(arm, bodies, set(names))
    unchecked = {Unchecked(*links, reasons[links]) for links in names if links in reasons}
    pairs = pairs[[links not in reasons for links in names]]
    always = Clearance(arm, bodies, pairs).always_touching(samples(arm, SAMPLES), NEARLY_ALWAYS)
    for row, often in always.items():
        first, second = (bodies[i].name for i in pairs[row])
        where = "every configuration" if often == SAMPLES else f"{often} of {SAMPLES} random configurations"
        unchecked.add(Unchecked(first, second, f"touch in {where}"))
    in_order = sorted(unchecked, key=lambda pair: (pair.why, pair.first, pair.second))
    return np.delete(pairs, list(always), axis=0), tuple(in_order)


def samples(arm: ArmModel, count: int) -> Array:
    """Coordinates (count, k + 1) drawn uniformly between the limits (endless joints: of one turn), always the same."""
    lower, upper = np.maximum(arm.limits.lower, -2.0 * np.pi), np.minimum(arm.limits.upper, 2.0 * np.pi)
    return np.random.default_rng(0).uniform(np.append(lower, 0.0), np.append(upper, 1.0), (count, len(lower) + 1))


def _reasons(arm: ArmModel, bodies: Sequence[Body], links: Iterable[tuple[str, str]]) -> dict[tuple[str, str], str]:
    """Return why pairs of links are left out, for those that are by their names alone."""
    gripper, solid = gripper_links(arm, bodies), frozenset(body.name for body in bodies)
    carrier = {link: _carrier(arm, link, solid) for link in solid - {THE_TOOL}}
    if THE_TOOL in solid:  # the gripper's links are left out anyway: take the next one
        carrier[THE_TOOL] = _carrier(arm, arm.robot.body, solid - gripper)
    trusted, reasons = _trusted(arm), {}
    for first, second in links:
        if first in gripper and second in gripper:
            reasons[first, second] = "both belong to the gripper"
        elif carrier[first] == second or carrier[second] == first:
            reasons[first, second] = "next to each other"
        elif frozenset((first, second)) in trusted:
            reasons[first, second] = trusted[frozenset((first, second))]
    return reasons


def _carrier(arm: ArmModel, link: str, solid: frozenset[str]) -> str | None:
    """Return the nearest link toward the root that has a body."""
    frames = arm.full.frames
    frame = frames[arm.full.getFrameId(link, pin.FrameType.BODY)]
    while frame.name != "universe":
        frame = frames[frame.parentFrame]
        if frame.type == pin.FrameType.BODY and frame.name in solid:
            return str(frame.name)
    return None


def _trusted(arm: ArmModel) -> dict[frozenset[str], str]:
    """Pairs of links that the robot's TOML lets touch, or the SRDF says are adjacent or never meet, and why."""
    entries = [] if arm.robot.srdf is None else read_xml(arm.robot.srdf).iterfind("disable_collisions")
    return dict.fromkeys(map(frozenset, arm.robot.may_touch), "may_touch in the robot's TOML") | {
        frozenset((entry.get("link1", ""), entry.get("link2", ""))): f"SRDF: {entry.get('reason')}"
        for entry in entries
        if entry.get("reason") in TRUSTED
    }
