"""The pairs of links that are checked against each other, and why others are not (MoveIt: allowed collisions)."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from pbd.arm.collision.clearance import Clearance, Pairs
from pbd.arm.collision.geometry import Body
from pbd.arm.collision.motion_bounds import moving_pairs
from pbd.arm.gripper import arm_bodies, gripper_links
from pbd.arm.link_frames import link_tree
from pbd.arm.model import ArmModel
from pbd.data.world import THE_TOOL
from pbd.io.urdf import read_xml
from pbd.pose import Array

CONFIGURATIONS = 200
"""Number of random configurations, with a fixed seed, that decide whether two bodies nearly always touch."""

NEARLY_ALWAYS = 0.95
"""Bodies that touch in at least this share of these are not checked: their shapes overlap, but the links
themselves cannot. MoveIt's setup assistant uses the same share."""


@dataclass(frozen=True)
class Unchecked:
    """Two links of which at least some bodies are not checked against each other, and why."""

    first: str
    second: str
    why: str


@lru_cache(maxsize=16)
def link_pairs(arm: ArmModel) -> tuple[Pairs, tuple[Unchecked, ...]]:
    """Return the pairs (p, 2) of the arm's bodies that are checked, and the pairs of links that are not.

    Not checked are: neighbouring links, also with links without a body between them; pairs in `may_touch` of the
    robot's TOML; pairs that the SRDF calls adjacent or says never meet; two links of the gripper; and bodies that touch
    in nearly all configurations. Bodies that no joint moves relative to each other are in neither list.
    """
    bodies = arm_bodies(arm)
    pairs = moving_pairs(arm, bodies, np.stack(np.triu_indices(len(bodies), 1), axis=1))
    names = [(bodies[a].name, bodies[b].name) for a, b in pairs]
    reasons = _reasons(arm, bodies, set(names))
    unchecked = {Unchecked(*links, reasons[links]) for links in names if links in reasons}
    pairs = pairs[[links not in reasons for links in names]]
    x = sample_coordinates(arm)
    always = Clearance(arm, bodies, pairs).always_touching(x, NEARLY_ALWAYS)
    for row, often in always.items():
        first, second = (bodies[i].name for i in pairs[row])
        share = "every configuration" if often == len(x) else f"{often} of {len(x)} random configurations"
        unchecked.add(Unchecked(first, second, f"touch in {share}"))
    in_order = sorted(unchecked, key=lambda pair: (pair.why, pair.first, pair.second))
    return np.delete(pairs, list(always), axis=0), tuple(in_order)


def sample_coordinates(arm: ArmModel, count: int = CONFIGURATIONS) -> Array:
    """Draw coordinates (count, k + 1) uniformly within the limits, at most a turn (or 2 pi m) to either side of zero or
    of the limit that is nearest to zero, with a fixed seed."""
    lower, upper = arm.limits.lower, arm.limits.upper
    middle, turn = np.clip(0.0, lower, upper), 2.0 * np.pi
    lower, upper = np.maximum(lower, middle - turn), np.minimum(upper, middle + turn)
    return np.random.default_rng(0).uniform(np.append(lower, 0.0), np.append(upper, 1.0), (count, len(lower) + 1))


def _reasons(arm: ArmModel, bodies: Sequence[Body], links: Iterable[tuple[str, str]]) -> dict[tuple[str, str], str]:
    """Return the reason for each pair of links that is left out because of its names alone."""
    gripper, solid = gripper_links(arm, bodies), frozenset(body.name for body in bodies)
    parents = {link: parent for link, _, parent, _ in link_tree(arm)}
    parents[THE_TOOL] = arm.robot.body
    carrier = {link: _carrier(parents, link, solid) for link in solid}
    trusted, reasons = _trusted(arm), {}
    for first, second in links:
        if first in gripper and second in gripper:
            reasons[first, second] = "both belong to the gripper"
        elif carrier[first] == second or carrier[second] == first:
            reasons[first, second] = "next to each other"
        elif frozenset((first, second)) in trusted:
            reasons[first, second] = trusted[frozenset((first, second))]
    return reasons


def _carrier(parents: Mapping[str, str], link: str, solid: frozenset[str]) -> str | None:
    """Return the nearest link toward the root that has a body."""
    above = parents.get(link)
    while above is not None and above not in solid:
        above = parents.get(above)
    return above


def _trusted(arm: ArmModel) -> dict[frozenset[str], str]:
    """Return the pairs of links that the robot's TOML or a trusted entry of the SRDF lets touch, and the reason.

    Entries with another reason ("Default", "disabled") were set by hand or found at one pose only.
    """
    entries = [] if arm.robot.srdf is None else read_xml(arm.robot.srdf).iterfind("disable_collisions")
    return dict.fromkeys(map(frozenset, arm.robot.may_touch), "may_touch in the robot's TOML") | {
        frozenset((entry.get("link1", ""), entry.get("link2", ""))): f"SRDF: {entry.get('reason')}"
        for entry in entries
        if entry.get("reason") in ("Adjacent", "Never")
    }
