"""robots/NAME.toml -> Robot. Every key is described in robots/panda.toml.

No robot library is imported: limits and names come from the URDF's XML.
"""

import os
import shlex
import sys
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from difflib import get_close_matches
from pathlib import Path

import numpy as np

from pbd.data import Calibration, Gripper, JointLimits, Robot, ServoUnits
from pbd.data.world import IN_METRES, REACH_M, beyond_reach
from pbd.errors import MOST_LISTED, RobotError, listed, printable, warn
from pbd.files.calibration import read_pose
from pbd.files.find_by_name import find
from pbd.files.robot_gripper import MIMIC_TOLERANCE, check_range, read_gripper
from pbd.files.urdf_tree import ACTUATED, Urdf, UrdfJoint, read_named_poses, read_urdf
from pbd.io.atomic import is_file
from pbd.io.meshes import mesh_places
from pbd.io.toml import SMALLEST_POSITIVE, Section, read_toml
from pbd.pose import Array

WIDEST_RANGES = {
    "revolute": (10.0 * np.pi, "turns", "rad", "degrees", "make the joint continuous"),
    "prismatic": (REACH_M, "metres", "m", "mm", "give it some"),
}
"""Kind of joint -> the widest range of its limits, rad or m, without a doubt about their unit, and words for a warning.
The bundled arms turn by up to 4 pi, and none slides."""


def load_robot(name: str | Path) -> Robot:
    """Load a robot by name (./robots, then the bundled ones) or path.

    Raises:
        RobotError: none has that name (the valid names are listed), or as `read_robot`.
    """
    return read_robot(find("robots", name, RobotError))


def read_robot(path: Path, *, draft: bool = False) -> Robot:
    """Read a robot's TOML file.

    Relative `urdf` and `srdf` paths are looked up beside the file, then among example-robot-data's robots.

    Args:
        draft: home and dock may be missing or wrong. Home is then the middle of the limits, and of the dock only the
            table's height is read.

    Raises:
        RobotError: a key is missing, unknown or of the wrong type; a file, a mesh, a link or a joint doesn't exist; a
            limit is missing, not above zero, or above the URDF's; home is outside the limits.
    """
    if path.suffix.lower() in (".urdf", ".xacro"):
        raise RobotError.at(path, "a URDF needs a TOML beside it: docs/robots.md, 'Add an arm'")
    top = read_toml(path, RobotError)
    top.require_format()
    name, description, notes = top.text("name"), top.text("description"), top.texts("notes", ())
    if "/" in name:
        top.fail("name", "must have no slash: files are named after it")

    model, shares = top.section("model"), _example_robot_data()
    urdf = read_urdf(_find(model, "urdf", shares))
    # A ROS package is a folder above the URDF (PACKAGE/urdf/arm.urdf), beside the TOML, or one of example-robot-data's.
    package_dirs = tuple(dict.fromkeys([*urdf.path.parents[:3], path.resolve().parent, *shares]))
    _check_meshes(urdf, package_dirs)
    srdf = _find(model, "srdf", shares) if "srdf" in model else None
    base, body = _link(model, "base", urdf), _link(model, "body", urdf)
    T_body_tool, license_ = read_pose(model.section("T_body_tool"), "xyz"), model.text("license", "")
    chain = _movable(urdf, base, body)

    fingers, dock, servos, arm = (top.section(name, None) for name in ("gripper", "dock", "servos", "arm"))
    if arm is None and not draft:
        top.fail("arm", "is missing", f"add it, as `pbd robots --suggest {shlex.quote(str(path))}` proposes it")
    gripper = None if fingers is None else read_gripper(fingers, urdf, chain)
    joints = chain if arm is None else _arm_joints(arm, chain)
    joints = [urdf.with_followers(joint.name) for joint in joints]
    limited = top.section("limits")
    limits = _limits(limited, urdf, joints)
    poses = {} if srdf is None else read_named_poses(srdf)
    mimic_joints = urdf.followers([joint.name for joint in joints])
    moved = {*mimic_joints, *(joint.name for joint in joints), *(gripper.joints if gripper else ())}
    if not draft:
        _warn_of_unmoved(urdf, moved)
    may_touch = () if arm is None else arm.pairs("may_touch")
    if arm is not None and (unknown := [link for pair in may_touch for link in pair if link not in urdf.links]):
        arm.fail("may_touch", f"names {unknown[0]!r}, which is no link of the URDF")
    robot = Robot(
        name=name,
        description=description,
        urdf=urdf.path,
        srdf=srdf,
        package_dirs=package_dirs,
        base=base,
        body=body,
        T_body_tool=T_body_tool,
        joints=tuple(joint.name for joint in joints),
        home=_middle(limits) if arm is None or draft else _home(arm, joints, poses),
        gripper=gripper,
        limits=limits,
        dock=None if dock is None else _dock(dock, name, draft),
        notes=notes,
        license=license_,
        servos=None if servos is None else _servos(servos, len(joints), gripper),
        may_touch=may_touch,
        mimic_joints=tuple(mimic_joints.values()),
        payload_kg=limited.number("payload_kg", None, positive=True),
        payload_source=limited.text("payload_source") if "payload_kg" in limited else "",
        file=path,
    )
    if not draft:
        top.refuse_unread()
    return robot


def _example_robot_data() -> list[Path]:
    """Find the share folder that contains example-robot-data, a package without a Python module; empty: none does."""
    shares = (Path(entry) / "cmeel.prefix" / "share" for entry in sys.path)
    return [share for share in shares if (share / "example-robot-data" / "robots").is_dir()][:1]


def _find(model: Section, key: str, shares: Sequence[Path]) -> Path:
    """Return the path of a file that the TOML names; refuse it if it is neither beside the TOML nor in the shares."""
    wanted = os.path.expanduser(model.text(key))  # noqa: PTH111 (pathlib's raises where there is no such user)
    folders = [model.path.parent, *(share / "example-robot-data" / "robots" for share in shares)]
    found = next((folder / wanted for folder in folders if is_file(folder / wanted)), None)
    if found is None:
        model.fail(key, f"names '{printable(wanted)}', which is neither in {' nor in '.join(map(str, folders))}")
    return found.resolve()


def _check_meshes(urdf: Urdf, package_dirs: Sequence[Path]) -> None:
    """Refuse a missing mesh that collision checks need; warn of the others."""
    undrawn = []
    for link, address, only_shows in urdf.meshes:
        places = mesh_places(address, urdf.path, package_dirs)
        if any(map(is_file, places)):
            continue
        if only_shows:
            undrawn.append(address)
        else:
            what = f"the mesh {printable(address)!r} of link {link!r} is missing: there is no"
            what = f"{what} {', nor '.join(map(str, places))}; put it there, or correct its address"
            raise RobotError.at(urdf.path, what, link=link)
    if undrawn:
        what = f"{urdf.path}: visual meshes are missing: {listed(dict.fromkeys(undrawn))}; their links are drawn by"
        warn(f"{what} their collision shapes; put them there, or correct their addresses")


def _link(model: Section, key: str, urdf: Urdf) -> str:
    """Return a link's name; refuse an unknown one, and list the most similar links."""
    name = model.text(key)
    if name not in urdf.links:
        near = get_close_matches(name, urdf.links, n=5) if len(urdf.links) > MOST_LISTED else ()
        what = f"is wrong: {urdf.path} has no link {printable(name)!r}"
        model.fail(key, what, f"set {key} to one of {listed(near or urdf.links)}")
    return name


def _movable(urdf: Urdf, base: str, body: str) -> list[UrdfJoint]:
    """Return the moving joints between base and body; refuse none, types that an arm can't have, and places in mm."""
    chain = urdf.chain(base, body)
    for joint in chain:
        if far := beyond_reach(joint.xyz):
            what = f"the <origin> of joint {joint.name!r} has {far}; {IN_METRES}"
            raise RobotError.at(urdf.path, what, joint=joint.name, bound=REACH_M)
    movable = [joint for joint in chain if joint.kind != "fixed"]
    if not movable:
        raise RobotError.at(urdf.path, f"no joint moves between {base!r} and {body!r}; choose another base or body")
    for joint in movable:
        if joint.mimic or joint.kind not in ACTUATED:
            what = f"mimics {joint.mimic.leader!r}" if joint.mimic else f"is {joint.kind}"
            what = f"joint {joint.name!r}, between {base!r} and {body!r}, {what}, which pbd does not support in an arm"
            what = f"{what}; choose another base or body, or change the joint"
            raise RobotError.at(urdf.path, what, joint=joint.name)
    return movable


def _arm_joints(arm: Section, movable: Sequence[UrdfJoint]) -> list[UrdfJoint]:
    names = tuple(joint.name for joint in movable)
    wanted = arm.texts("joints", names)
    if not wanted or list(wanted) != [name for name in names if name in wanted]:
        arm.fail("joints", f"must be some of {listed(names)}, in that order (base to tool), got {listed(wanted)}")
    for joint in movable:
        if joint.name not in wanted and not joint.lower <= 0.0 <= joint.upper:
            arm.fail("joints", f"leaves out {joint.name}, which is then locked at 0, outside its limits", "name it too")
    return [joint for joint in movable if joint.name in wanted]


def _warn_of_unmoved(urdf: Urdf, moved: Collection[str]) -> None:
    """Warn of joints that nothing moves where 0, at which they are taken to stand, is wrong."""
    unmoved = [joint for name, joint in urdf.joints.items() if name not in moved and joint.kind in ACTUATED]
    mimics = urdf.followers([joint.name for joint in unmoved if joint.mimic is None])
    wrong = []
    for joint in unmoved:
        mimic = mimics.get(joint.name)
        if mimic is not None and abs(mimic.offset) > MIMIC_TOLERANCE:
            wrong.append(f"{joint.name} (mimics {mimic.leader}, which puts it at {mimic.offset:g})")
        elif not joint.lower <= 0.0 <= joint.upper and not joint.unlimited_mimic:
            wrong.append(f"{joint.name} ({joint.lower:g}..{joint.upper:g})")
    if wrong:
        what = f"{urdf.path}: joints that neither [arm] nor [gripper] moves are taken to stand at 0, which is wrong for"
        warn(f"{what} {listed(wrong)}; make each a fixed joint where it stands, or name what moves it")


def _servos(section: Section, k: int, gripper: Gripper | None) -> ServoUnits:
    if gripper is None or len(gripper.joints) != 1:
        section.fail("gripper", "needs a [gripper] with one joint", "add it, or remove [servos]")
    closed, opened = section.numbers("gripper", 2)
    if closed == opened:
        section.fail("gripper", f"is {closed:g} both closed and open")
    sign = section.numbers("sign", k)
    if any(each not in (1.0, -1.0) for each in sign):
        section.fail("sign", f"must be 1 or -1 for each joint, got {', '.join(f'{each:g}' for each in sign)}")
    return ServoUnits(
        robot_type=section.text("robot_type"),
        zero=np.array(section.numbers("zero", k)),
        sign=np.array(sign),
        gripper=np.array([closed, opened]),
        source=section.text("source"),
    )


def _check_travel(urdf: Urdf, joints: Sequence[UrdfJoint]) -> None:
    """Refuse a joint that has no room to move; warn of a range so wide that its unit is in doubt."""
    for joint in joints:
        if not joint.lower < joint.upper:
            what = f"joint {joint.name!r} has no room to move: lower {joint.lower:g}, upper {joint.upper:g}"
            fix = "correct its <limit> or <safety_controller>, or that of what mimics it"
            raise RobotError.at(urdf.path, f"{what}; {fix}", joint=joint.name)
    for kind, (widest, many, unit, mistaken, fix) in WIDEST_RANGES.items():
        if wide := [joint for joint in joints if joint.kind == kind and joint.upper - joint.lower > widest]:
            what = f"limits of many {many}: {listed(f'{j.name} {j.lower:g}..{j.upper:g} {unit}' for j in wide)}"
            warn(f"{urdf.path}: {what}; if these are {mistaken}, correct the <limit>; if there are none, {fix}")


def _limits(section: Section, urdf: Urdf, joints: Sequence[UrdfJoint]) -> JointLimits:
    _check_travel(urdf, joints)
    values = {"velocity": tuple(joint.velocity for joint in joints)}
    sources = dict.fromkeys(("position", "velocity"), "the URDF")
    general = section.text("source", "")
    unknown = [each.name for each in joints if not SMALLEST_POSITIVE <= each.velocity < np.inf]
    if "velocity" not in section and unknown:
        section.fail("velocity", f"is missing and the URDF sets no limit above zero for {listed(unknown)}", "add it")
    for key in ("velocity", "acceleration", "jerk", "effort"):
        if key in section or key in ("acceleration", "jerk"):  # the URDF's effort is often a placeholder
            values[key] = section.numbers(key, [joint.name for joint in joints], positive=True)
            sources[key] = section.text(f"{key}_source", general) or section.text("source")
    for joint, velocity in zip(joints, values["velocity"], strict=True):
        if velocity > joint.velocity > 0.0:  # 0 in a URDF means unknown
            what = f"gives {joint.name} {velocity:g}, above the URDF's own {joint.velocity:g}"
            section.fail("velocity", what, "lower it, or correct the URDF")
    distinct = {sources[key] for key in values}
    return JointLimits(
        lower=np.array([joint.lower for joint in joints]),
        upper=np.array([joint.upper for joint in joints]),
        **{key: np.array(value) for key, value in values.items()},
        source=distinct.pop() if len(distinct) == 1 else "; ".join(f"{key}: {sources[key]}" for key in values),
        sources=sources,
    )


def _home(arm: Section, joints: Sequence[UrdfJoint], poses: Mapping[str, Mapping[str, float]]) -> Array:
    if "home_pose" in arm and "home" in arm:
        arm.fail("home_pose", "is given together with home", next_step="remove one of them")
    if "home_pose" in arm:
        key, wanted = "home_pose", arm.text("home_pose")
        if wanted not in poses:
            arm.fail(key, f"names {wanted!r}, which is not in the SRDF; its poses are {listed(poses)}")
        if missing := [joint.name for joint in joints if joint.name not in poses[wanted]]:
            arm.fail(key, f"{wanted!r} says nothing of {listed(missing)}", next_step="give home as a list instead")
        home = [poses[wanted][joint.name] for joint in joints]
    else:
        key, home = "home", list(arm.numbers("home", [joint.name for joint in joints]))
    check_range(arm, key, joints, home)
    return np.array(home)


def _dock(section: Section, robot: str, draft: bool) -> Calibration:
    table = Calibration(robot, table_height=section.length("table_height"))
    if draft:
        return table
    any_attitude, scale = section.flag("any_attitude", False), section.number("scale", 1.0, positive=True)
    return replace(table, T_base_dock=read_pose(section), any_attitude=any_attitude, scale=scale, robots=(robot,))


def _middle(limits: JointLimits) -> Array:
    """Return the middle of each joint's limits; 0 for an endless joint, whose limits are infinite."""
    with np.errstate(invalid="ignore"):
        return np.nan_to_num(0.5 * (limits.lower + limits.upper))
