"""Which links may touch each other, and which pairs of them are not worth watching."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import pinocchio as pin

from pbd.arm.clearance import Clearance, Pairs
from pbd.arm.hand import THE_TOOL, arm_bodies, gripper_links
from pbd.arm.hulls import Body
from pbd.arm.model import ArmModel
from pbd.arm.motion_bounds import rates
from pbd.cache import recall, remember
from pbd.doors.xml import read_xml
from pbd.errors import RobotError
from pbd.pose import Array

VERSION = 3
"""Part of the cache's keys: raise it when the same robot would give other pairs."""

SAMPLES = 1000
"""Random configurations in which it is looked whether parts of two links touch; always the same ones."""

NEARLY_ALWAYS = 0.95
"""Parts that touch in at least this share of them are not watched: no arm is built so, it is their shapes that overlap.
The share is that of MoveIt's setup assistant; the bundled arms' parts touch in at most 0.3."""


@dataclass(frozen=True)
class Dropped:
    """Two links of which nobody watches whether they touch (or some parts of them), and why."""

    first: str
    second: str
    why: str


@lru_cache(maxsize=4)
def link_pairs(arm: ArmModel) -> tuple[Pairs, tuple[Dropped, ...]]:
    """Return the pairs (p, 2) of the arm's bodies that can touch, and the pairs of links that were dropped.

    Dropped are links next to each other (or with nothing solid between), those that the SRDF says are to be ignored,
    those that both belong to the gripper, and parts that touch in nearly all configurations. Bodies that no joint moves
    against each other are no pair at all.
    """
    bodies = arm_bodies(arm)
    pairs = np.stack(np.triu_indices(len(bodies), 1), axis=1)
    pairs = pairs[(rates(arm, bodies, pairs) > 0.0).any(axis=1)]
    names = [(bodies[a].name, bodies[b].name) for a, b in pairs]
    reasons = _reasons(arm, bodies, set(names))
    dropped = {Dropped(*links, reasons[links]) for links in names if links in reasons}
    pairs = pairs[[links not in reasons for links in names]]
    always, shares = _always_touching(arm, bodies, pairs)
    dropped |= {
        Dropped(bodies[a].name, bodies[b].name, _touch(share))
        for (a, b), share in zip(pairs[always], shares, strict=True)
    }
    in_order = sorted(dropped, key=lambda pair: (pair.why, pair.first, pair.second))
    return np.delete(pairs, always, axis=0), tuple(in_order)


def _touch(share: float) -> str:
    if share == 1.0:
        return "touch in every configuration"
    return f"touch in {round(share * SAMPLES)} of {SAMPLES} random configurations"


def samples(arm: ArmModel, count: int) -> Array:
    """Coordinates (count, k + 1) drawn uniformly between the limits (endless joints: of one turn), always the same."""
    lower, upper = np.maximum(arm.limits.lower, -2.0 * np.pi), np.minimum(arm.limits.upper, 2.0 * np.pi)
    return np.random.default_rng(0).uniform(np.append(lower, 0.0), np.append(upper, 1.0), (count, len(lower) + 1))


def _reasons(arm: ArmModel, bodies: Sequence[Body], links: Iterable[tuple[str, str]]) -> dict[tuple[str, str], str]:
    """Say which pairs of links are dropped by their names alone, and why."""
    gripper, solid = gripper_links(arm, bodies), frozenset(body.name for body in bodies)
    carrier = {link: _carrier(arm, link, solid) for link in solid - {THE_TOOL}}
    if THE_TOOL in solid:  # the gripper's links may touch it anyhow, so the next one counts
        carrier[THE_TOOL] = _carrier(arm, arm.robot.body, solid - gripper)
    ignored, reasons = _ignored(arm), {}
    for first, second in links:
        if first in gripper and second in gripper:
            reasons[first, second] = "both belong to the gripper"
        elif carrier[first] == second or carrier[second] == first:
            reasons[first, second] = "next to each other"
        elif frozenset((first, second)) in ignored:
            reasons[first, second] = ignored[frozenset((first, second))]
    return reasons


def _carrier(arm: ArmModel, link: str, solid: frozenset[str]) -> str | None:
    """Return the nearest link toward the root that has a body."""
    frames = arm.full.frames
    frame = frames[_frame(arm, link)]
    while frame.name != "universe":
        frame = frames[frame.parentFrame]
        if frame.type == pin.FrameType.BODY and frame.name in solid:
            return str(frame.name)
    return None


def _frame(arm: ArmModel, link: str) -> int:
    return int(arm.full.getFrameId(link, pin.FrameType.BODY))


def _ignored(arm: ArmModel) -> dict[frozenset[str], str]:
    """Read the SRDF's pairs of links that are to be ignored, each with its reason."""
    if arm.robot.srdf is None:
        return {}
    return {
        frozenset((entry.get("link1", ""), entry.get("link2", ""))): f"SRDF: {entry.get('reason', 'disabled')}"
        for entry in read_xml(arm.robot.srdf, RobotError).iterfind("disable_collisions")
    }


def _always_touching(arm: ArmModel, bodies: Sequence[Body], pairs: Pairs) -> tuple[list[int], list[float]]:
    """Rows of the pairs that touch in nearly all of SAMPLES configurations, and in what share of them."""
    key = _key(arm, bodies, pairs)
    if (kept := recall("pairs", key)) is None:
        found = Clearance(arm, bodies, pairs).always_touching(samples(arm, SAMPLES), NEARLY_ALWAYS)
        rows, shares = np.array(found, dtype=np.float64).reshape(-1, 2).T
        kept = {"always": rows.astype(np.int64), "shares": shares}
        remember("pairs", key, kept)
    return kept["always"].tolist(), kept["shares"].tolist()


def _key(arm: ArmModel, bodies: Sequence[Body], pairs: Pairs) -> str:
    """Hash all that the answer follows from: the URDF, the bodies, which joints move and how far."""
    key = hashlib.sha256(repr((VERSION, SAMPLES, NEARLY_ALWAYS, arm.robot.joints, arm.robot.base)).encode())
    arrays = [pairs, arm.limits.lower, arm.limits.upper]
    if gripper := arm.robot.gripper:
        key.update(repr(gripper.joints).encode())
        arrays += [gripper.open, gripper.closed]
    for body in bodies:
        key.update(repr((body.name, body.joint, body.shape, body.size, body.pad)).encode())
        arrays += [body.T_joint_body.p, body.T_joint_body.wxyz, body.points]
    key.update(arm.robot.urdf.read_bytes())
    for array in arrays:
        key.update(np.ascontiguousarray(array).tobytes())
    return key.hexdigest()
