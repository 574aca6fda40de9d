"""robots/NAME.toml -> Robot. Every key is described in robots/panda.toml.

Nothing heavy is imported: limits and names come from the URDF as plain XML.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from pbd.data import Calibration, Gripper, JointLimits, Robot
from pbd.errors import RobotError
from pbd.files.calibration import read_pose
from pbd.files.library import find
from pbd.files.toml import Section, read_toml
from pbd.files.urdf import Urdf, UrdfJoint, listed, read_poses, read_urdf
from pbd.pose import Array, Pose

FORMAT = 1


def load_robot(name: str) -> Robot:
    """Load a robot by name (./robots, then the bundled ones) or path.

    Raises:
        RobotError: nothing of that name (the valid ones are listed), or as `read_robot`.
    """
    return read_robot(find("robots", name, ".toml", RobotError))


def read_robot(path: Path) -> Robot:
    """Read a robot's description.

    Relative `urdf` and `srdf` paths are looked up beside the TOML file, then among example-robot-data's robots.

    Raises:
        RobotError: a key is missing, unknown or of the wrong kind; a file or a name in it isn't there; a limit is
            missing or not above zero; home lies outside the limits.
    """
    top = read_toml(path, RobotError)
    if top.number("format") != FORMAT:
        top.fail("format", f"must be {FORMAT}, the only format that this version reads")
    name = top.text("name")
    description = top.text("description")
    notes = top.texts("notes") if "notes" in top else ()

    model = top.section("model")
    share = _example_robot_data()
    urdf = read_urdf(_find(model, "urdf", share))
    srdf = _find(model, "srdf", share) if "srdf" in model else None
    base, body = model.text("base"), model.text("body")
    tool = model.section("T_body_tool")
    T_body_tool = Pose.from_rpy(tool.numbers("xyz", 3), np.deg2rad(tool.numbers("rpy_deg", 3)))
    chain = [joint for joint in urdf.chain(base, body) if joint.actuated]

    gripper = _gripper(top.section("gripper"), urdf) if "gripper" in top else None
    arm = top.section("arm")
    joints = _arm_joints(arm, chain, gripper)
    limits = _limits(top.section("limits"), joints)
    home = _home(arm, joints, srdf, limits)
    dock = _dock(top.section("dock"), name) if "dock" in top else None
    top.done()
    return Robot(
        name=name,
        description=description,
        urdf=urdf.path,
        srdf=srdf,
        package_dirs=_package_dirs(path, urdf.path, share),
        base=base,
        body=body,
        T_body_tool=T_body_tool,
        joints=tuple(joint.name for joint in joints),
        home=home,
        gripper=gripper,
        limits=limits,
        dock=dock,
        notes=notes,
    )


def _example_robot_data() -> Path | None:
    """Find the share folder that holds example-robot-data, which is a package without a module to ask."""
    for entry in sys.path:
        share = Path(entry) / "cmeel.prefix" / "share"
        if (share / "example-robot-data" / "robots").is_dir():
            return share
    return None


def _find(model: Section, key: str, share: Path | None) -> Path:
    wanted = Path(model.text(key)).expanduser()
    folders = [model.path.parent] + ([share / "example-robot-data" / "robots"] if share else [])
    found = next((folder / wanted for folder in folders if (folder / wanted).is_file()), None)
    if found is None:
        model.fail(key, f"names {str(wanted)!r}, which is neither in {' nor in '.join(map(str, folders))}")
    return found.resolve()


def _package_dirs(toml: Path, urdf: Path, share: Path | None) -> tuple[Path, ...]:
    """Say where package:// may lead: a ROS package is a folder above the URDF (PACKAGE/urdf/arm.urdf), or share."""
    folders = [*urdf.parents[:3], toml.resolve().parent] + ([share] if share else [])
    return tuple(dict.fromkeys(folders))


def _arm_joints(arm: Section, chain: Sequence[UrdfJoint], gripper: Gripper | None) -> list[UrdfJoint]:
    movable = [joint for joint in chain if gripper is None or joint.name not in gripper.joints]
    names = [joint.name for joint in movable]
    wanted = arm.texts("joints") if "joints" in arm else tuple(names)
    if not wanted or list(wanted) != [name for name in names if name in wanted]:
        arm.fail("joints", f"must be some of {listed(names)}, in that order (base to tool), got {listed(wanted)}")
    return [joint for joint in movable if joint.name in wanted]


def _gripper(section: Section, urdf: Urdf) -> Gripper:
    names = section.texts("joints")
    known = [joint.name for joint in urdf.joints.values() if joint.kind != "fixed"]
    for name in names:
        if name not in known:
            section.fail("joints", f"names {name!r}, which is no joint that moves; the URDF has {listed(known)}")
    joints = [urdf.joints[name] for name in names]
    positions = {}
    for key in ("open", "closed"):
        positions[key] = np.array(section.numbers(key, len(joints)))
        _check_range(section, key, joints, positions[key])
    return Gripper(names, positions["open"], positions["closed"], section.number("stroke_s", positive=True))


def _limits(section: Section, joints: Sequence[UrdfJoint]) -> JointLimits:
    source, k = section.text("source"), len(joints)
    if "velocity" in section:
        velocity = section.numbers("velocity", k, positive=True)
    else:
        velocity = tuple(joint.velocity for joint in joints)
        if bad := [j.name for j in joints if not 0.0 < j.velocity < np.inf]:
            section.fail("velocity", f"is missing and the URDF sets no limit above zero for {listed(bad)}", "add it")
    return JointLimits(
        lower=np.array([joint.lower for joint in joints]),
        upper=np.array([joint.upper for joint in joints]),
        velocity=np.array(velocity),
        acceleration=np.array(section.numbers("acceleration", k, positive=True)),
        jerk=np.array(section.numbers("jerk", k, positive=True)),
        source=source,
    )


def _home(arm: Section, joints: Sequence[UrdfJoint], srdf: Path | None, limits: JointLimits) -> Array:
    if "home_pose" in arm and "home" in arm:
        arm.fail("home_pose", "stands beside home, which says the same", next_step="remove one of them")
    if "home_pose" in arm:
        key, poses = "home_pose", read_poses(srdf) if srdf else {}
        wanted = arm.text(key)
        if wanted not in poses:
            arm.fail(key, f"names {wanted!r}, which the SRDF hasn't; its poses are {listed(poses)}")
        if missing := [joint.name for joint in joints if joint.name not in poses[wanted]]:
            arm.fail(key, f"{wanted!r} says nothing of {listed(missing)}", next_step="give home as a list instead")
        home = np.array([poses[wanted][joint.name] for joint in joints])
    else:
        key, home = "home", np.array(arm.numbers("home", len(joints)))
    _check_range(arm, key, joints, home)
    return home


def _dock(section: Section, robot: str) -> Calibration:
    return Calibration(
        name=f"{robot}'s own dock",
        T_base_dock=read_pose(section),
        any_attitude=section.flag("any_attitude") if "any_attitude" in section else False,
        table_height=section.number("table_height") if "table_height" in section else None,
        scale=section.number("scale", positive=True) if "scale" in section else 1.0,
        robots=(robot,),
    )


def _check_range(section: Section, key: str, joints: Sequence[UrdfJoint], positions: Array) -> None:
    for joint, position in zip(joints, positions, strict=True):
        if not joint.lower <= position <= joint.upper:
            section.fail(key, f"puts {joint.name} at {position:g}, outside {joint.lower:g}..{joint.upper:g}")
