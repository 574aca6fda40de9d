"""The [gripper] of robots/NAME.toml."""

from collections.abc import Mapping, Sequence

import numpy as np

from pbd.data import Gripper
from pbd.errors import listed
from pbd.files.urdf_tree import ACTUATED, Urdf, UrdfJoint
from pbd.io.toml import Section

MIMIC_TOLERANCE = 1e-3
"""Largest difference, rad or m, of a joint's position from where the joint that it mimics puts it."""


def read_gripper(section: Section, urdf: Urdf, chain: Sequence[UrdfJoint]) -> Gripper:
    """Read the [gripper] of a robot whose arm has the moving joints `chain`; its followers are among its joints."""
    names = section.texts("joints")
    known = [joint.name for joint in urdf.joints.values() if joint.kind in ACTUATED]
    if unknown := [name for name in names if name not in known]:
        section.fail("joints", f"names {unknown[0]!r}, which is not a movable joint; the URDF has {listed(known)}")
    if twice := next((name for name in names if names.count(name) > 1), None):
        section.fail("joints", f"names {twice!r} twice")
    if carrier := next((joint.name for joint in chain if joint.name in names), None):
        section.fail(
            "joints", f"names {carrier!r}, which moves the tool's body", "set body to a link before that joint"
        )
    positions = {key: dict(zip(names, section.numbers(key, names), strict=True)) for key in ("open", "closed")}
    _check_mimicking_fingers(section, urdf, positions)
    for follower, mimic in urdf.followers(names).items():
        for at in positions.values():
            at[follower] = mimic.multiplier * at[mimic.leader] + mimic.offset
    joints = [urdf.joints[name] for name in positions["open"]]
    for key, at in positions.items():
        check_range(section, key, joints, list(at.values()))
    opened, closed = (np.array(list(at.values())) for at in positions.values())
    stroke_s = section.number("stroke_s", positive=True)
    for joint, speed in zip(joints, np.abs(opened - closed) / stroke_s, strict=True):
        if 0.0 < joint.velocity < speed:  # 0 in a URDF means unknown
            what = f"moves {joint.name} at {speed:g}, above the URDF's own {joint.velocity:g}"
            section.fail("stroke_s", what, "make it longer, or correct the URDF")
    mimics = tuple(joint.name for joint in joints if joint.mimic)
    return Gripper(tuple(positions["open"]), opened, closed, stroke_s, mimics)


def _check_mimicking_fingers(section: Section, urdf: Urdf, positions: Mapping[str, Mapping[str, float]]) -> None:
    """Refuse a finger that mimics a joint that is not named, or that is not where the joint that it mimics puts it."""
    names = positions["open"]
    for name in names:
        mimic = urdf.followers([other for other in names if other != name]).get(name)
        named = urdf.joints[name].mimic
        if mimic is None and named is not None:
            section.fail("joints", f"names {name!r}, which mimics {named.leader!r}", f"name {named.leader!r} instead")
        for key, at in positions.items():
            if mimic is not None:
                wanted = mimic.multiplier * at[mimic.leader] + mimic.offset
                if abs(at[name] - wanted) > MIMIC_TOLERANCE:
                    what = f"puts {name} at {at[name]:g}, but it mimics {mimic.leader}, which puts it at {wanted:g}"
                    section.fail(key, what)


def check_range(section: Section, key: str, joints: Sequence[UrdfJoint], positions: Sequence[float]) -> None:
    """Refuse positions outside the joints' limits."""
    for joint, position in zip(joints, positions, strict=True):
        if not joint.lower <= position <= joint.upper and not joint.unlimited_mimic:
            what = f"puts {joint.name} at {position:g}, outside {joint.lower:g}..{joint.upper:g}"
            mimics = joint.mimic and f"correct it, or the joint's <limit> or its <mimic> of {joint.mimic.leader}"
            section.fail(key, what, mimics or "correct it")
