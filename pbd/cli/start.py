"""--from: where the arm is."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pbd.data import Robot
    from pbd.view.units import Units


def start_joints(given: str, robot: Robot, units: Units) -> tuple[float, ...]:
    """Read --from: in rad (and m) unless --units says otherwise."""
    from pbd.files.joints import read_joints
    from pbd.planning import arm_of
    from pbd.view.units import ANGLES, LENGTHS

    angle = units.angle if "angle" in units.asked else "rad"
    length = units.length if "length" in units.asked else "m"
    if (angle, length) == ("rad", "m"):
        return read_joints(given, robot.joints)
    turns = arm_of(robot).turns
    per_si = [ANGLES[angle][0] if turn else LENGTHS[length][0] for turn in turns]
    unit = f"{angle} (joints that slide: {length})" if not all(turns) else angle
    return read_joints(given, robot.joints, unit, per_si)
