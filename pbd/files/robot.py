"""robots/NAME.toml -> Robot. Every key is described in robots/panda.toml.

Nothing heavy is imported: limits and names come from the URDF as plain XML.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from contextlib import suppress
from difflib import get_close_matches
from pathlib import Path

import numpy as np

from pbd.data import Calibration, Gripper, JointLimits, Robot
from pbd.doors.meshes import mesh_places
from pbd.errors import LISTED, RobotError, listed, printable
from pbd.files.calibration import FARTHEST_M, FULL_TURN_DEG, read_pose
from pbd.files.library import find
from pbd.files.toml import Section, read_toml
from pbd.files.urdf import Urdf, UrdfJoint, read_poses, read_urdf
from pbd.paths import is_file
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
        RobotError: a key is missing, unknown or of the wrong kind; a file, a mesh or a name in it isn't there; a limit
            is missing, not above zero or above the URDF's; home lies outside the limits.
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
    package_dirs = _package_dirs(path, urdf.path, share)
    _check_meshes(urdf, package_dirs)
    srdf = _find(model, "srdf", share) if "srdf" in model else None
    poses = {} if srdf is None else read_poses(srdf)
    base, body = _link(model, "base", urdf), _link(model, "body", urdf)
    tool = model.section("T_body_tool")
    rpy_deg = tool.numbers("rpy_deg", 3, within=FULL_TURN_DEG)
    license_ = model.text("license") if "license" in model else ""
    T_body_tool = Pose.from_rpy(tool.numbers("xyz", 3, within=FARTHEST_M), np.deg2rad(rpy_deg))
    chain = _movable(urdf, base, body)

    gripper = _gripper(top.section("gripper"), urdf) if "gripper" in top else None
    arm = top.section("arm")
    joints = _arm_joints(arm, chain, gripper)
    limits = _limits(top.section("limits"), urdf, joints)
    home = _home(arm, joints, poses, limits)
    dock = _dock(top.section("dock"), name) if "dock" in top else None
    top.done()
    return Robot(
        name=name,
        description=description,
        urdf=urdf.path,
        srdf=srdf,
        package_dirs=package_dirs,
        base=base,
        body=body,
        T_body_tool=T_body_tool,
        joints=tuple(joint.name for joint in joints),
        home=home,
        gripper=gripper,
        limits=limits,
        dock=dock,
        notes=notes,
        license=license_,
    )


def _example_robot_data() -> Path | None:
    """Find the share folder that holds example-robot-data, which is a package without a module to ask."""
    for entry in sys.path:
        share = Path(entry) / "cmeel.prefix" / "share"
        if (share / "example-robot-data" / "robots").is_dir():
            return share
    return None


def _find(model: Section, key: str, share: Path | None) -> Path:
    wanted = Path(model.text(key))
    with suppress(RuntimeError):  # there is no such user
        wanted = wanted.expanduser()
    folders = [model.path.parent] + ([share / "example-robot-data" / "robots"] if share else [])
    found = next((folder / wanted for folder in folders if is_file(folder / wanted)), None)
    if found is None:
        model.fail(key, f"names {str(wanted)!r}, which is neither in {' nor in '.join(map(str, folders))}")
    return found.resolve()


def _package_dirs(toml: Path, urdf: Path, share: Path | None) -> tuple[Path, ...]:
    """Say where package:// may lead: a ROS package is a folder above the URDF (PACKAGE/urdf/arm.urdf), or share."""
    folders = [*urdf.parents[:3], toml.resolve().parent] + ([share] if share else [])
    return tuple(dict.fromkeys(folders))


def _check_meshes(urdf: Urdf, package_dirs: Sequence[Path]) -> None:
    for link, address in urdf.meshes:
        places = mesh_places(address, urdf.path, package_dirs)
        if not any(map(is_file, places)):
            raise RobotError(
                f"{urdf.path}: the mesh {printable(address)!r} of link {link!r} is missing: there is no"
                f" {', nor '.join(map(str, places))}; put it there, or correct its address",
                path=urdf.path,
                link=link,
            )


def _link(model: Section, key: str, urdf: Urdf) -> str:
    """The name of a link; one that isn't there is refused with those that are most like it."""
    name = model.text(key)
    if name not in urdf.links:
        near = get_close_matches(name, urdf.links, n=5) if len(urdf.links) > LISTED else ()
        what = f"is wrong: {urdf.path} has no link {printable(name)!r}"
        model.fail(key, what, f"set {key} to one of {listed(near or urdf.links)}")
    return name


def _movable(urdf: Urdf, base: str, body: str) -> list[UrdfJoint]:
    """The joints between base and body that move; all of them must be ones that an arm can have."""
    movable = [joint for joint in urdf.chain(base, body) if joint.kind != "fixed"]
    for joint in movable:
        what = f"mimics {joint.mimic.joint!r}" if joint.mimic else f"is {joint.kind}"
        if not joint.actuated:
            raise RobotError(
                f"{urdf.path}: joint {joint.name!r}, between {base!r} and {body!r}, {what}, which pbd does not support "
                "in an arm; choose another base or body, or change the joint",
                path=urdf.path,
                joint=joint.name,
            )
    return movable


def _arm_joints(arm: Section, chain: Sequence[UrdfJoint], gripper: Gripper | None) -> list[UrdfJoint]:
    movable = [joint for joint in chain if gripper is None or joint.name not in gripper.joints]
    names = [joint.name for joint in movable]
    wanted = arm.texts("joints") if "joints" in arm else tuple(names)
    if not wanted or list(wanted) != [name for name in names if name in wanted]:
        arm.fail("joints", f"must be some of {listed(names)}, in that order (base to tool), got {listed(wanted)}")
    for joint in movable:
        if joint.name not in wanted and not joint.lower <= 0.0 <= joint.upper:
            arm.fail("joints", f"leaves out {joint.name}, which is then locked at 0, outside its limits", "name it too")
    return [joint for joint in movable if joint.name in wanted]


def _gripper(section: Section, urdf: Urdf) -> Gripper:
    names = section.texts("joints")
    known = [joint.name for joint in urdf.joints.values() if joint.kind != "fixed"]
    for name in names:
        if name not in known:
            section.fail("joints", f"names {name!r}, which is not a movable joint; the URDF has {listed(known)}")
    joints = [urdf.joints[name] for name in names]
    positions = {}
    for key in ("open", "closed"):
        positions[key] = np.array(section.numbers(key, len(joints)))
        _check_range(section, key, joints, positions[key])
    for joint in urdf.joints.values():
        if joint.mimic and joint.mimic.joint in names and joint.name not in names:
            leader = names.index(joint.mimic.joint)
            names += (joint.name,)
            for key, own in positions.items():
                positions[key] = np.append(own, joint.mimic.multiplier * own[leader] + joint.mimic.offset)
    return Gripper(names, positions["open"], positions["closed"], section.number("stroke_s", positive=True))


def _limits(section: Section, urdf: Urdf, joints: Sequence[UrdfJoint]) -> JointLimits:
    if bad := [joint for joint in joints if not joint.lower < joint.upper]:
        raise RobotError(
            f"{urdf.path}: joint {bad[0].name!r} has no room to move: lower {bad[0].lower:g}, upper {bad[0].upper:g};"
            " correct its <limit>",
            path=urdf.path,
            joint=bad[0].name,
        )
    values, sources = {}, {"position": "the URDF"}
    general = section.text("source") if "source" in section else None
    for key in ("velocity", "acceleration", "jerk"):
        if key == "velocity" and key not in section:
            values[key], sources[key] = _urdf_velocity(section, joints), "the URDF"
            continue
        values[key] = section.numbers(key, len(joints), positive=True)
        own = section.text(f"{key}_source") if f"{key}_source" in section else general
        sources[key] = own or section.text("source")
    for joint, velocity in zip(joints, values["velocity"], strict=True):
        if velocity > joint.velocity > 0.0:  # a URDF's 0 says nothing
            what = f"gives {joint.name} {velocity:g}, above the URDF's own {joint.velocity:g}"
            section.fail("velocity", what, "lower it, or correct the URDF")
    said = dict.fromkeys(source for key, source in sources.items() if key != "position")
    return JointLimits(
        lower=np.array([joint.lower for joint in joints]),
        upper=np.array([joint.upper for joint in joints]),
        velocity=np.array(values["velocity"]),
        acceleration=np.array(values["acceleration"]),
        jerk=np.array(values["jerk"]),
        source=next(iter(said)) if len(said) == 1 else "; ".join(f"{key}: {sources[key]}" for key in values),
        sources=sources,
    )


def _urdf_velocity(section: Section, joints: Sequence[UrdfJoint]) -> tuple[float, ...]:
    if bad := [joint.name for joint in joints if not 0.0 < joint.velocity < np.inf]:
        section.fail("velocity", f"is missing and the URDF sets no limit above zero for {listed(bad)}", "add it")
    return tuple(joint.velocity for joint in joints)


def _home(
    arm: Section, joints: Sequence[UrdfJoint], poses: Mapping[str, Mapping[str, float]], limits: JointLimits
) -> Array:
    if "home_pose" in arm and "home" in arm:
        arm.fail("home_pose", "is given together with home", next_step="remove one of them")
    if "home_pose" in arm:
        key = "home_pose"
        wanted = arm.text(key)
        if wanted not in poses:
            arm.fail(key, f"names {wanted!r}, which is not in the SRDF; its poses are {listed(poses)}")
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
