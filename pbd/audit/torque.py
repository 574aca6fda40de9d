"""Torques that a motion needs: inverse dynamics of the whole URDF, with what the tool carries.

Method: the recursive Newton-Euler algorithm (Featherstone, 2008, chapter 5; pinocchio's rnea), with the URDF's masses.
Friction and the motors' own inertia are left out, because their values in URDFs are not reliable.
"""

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
import pinocchio as pin

from pbd.audit.arm import AuditArm, se3
from pbd.audit.contact import coordinates, joint_motion, time_grid
from pbd.audit.grasp import follow_object
from pbd.data import GraspedObject, JointTrajectory, Load
from pbd.io.urdf import read_urdf_xml
from pbd.pose import Array

GRID_S = 0.01
"""Spacing, s, of the times at which torques are computed, besides the trajectory's knots."""

MAX_GRID = 5_000
"""Largest number of these times, however slow the motion is."""

ROUNDING_SHARE = 0.01
"""Largest excess of a principal inertia over what a body can have, as a share of it, that rounding to two digits
explains."""

G = 9.81
"""Gravity, m/s2."""


@dataclass(frozen=True)
class Torque:
    """The largest share of a joint's torque limit that a motion needs.

    Attributes:
        share: needed share of the limit; above 1 the limit is exceeded.
        joint, t: name of the joint, and time (s).
        value, bound, unit: torque and limit in "N m", or "N" for a sliding joint.
        weightless: joints whose link has no mass in the URDF.
        impossible: links with an inertia that no body has.
    """

    share: float
    joint: str
    t: float
    value: float
    bound: float
    unit: str
    weightless: tuple[str, ...]
    impossible: tuple[str, ...]


def find_torque(arm: AuditArm, trajectory: JointTrajectory, load: Load, effort: Array, pace: float = 1.0) -> Torque:
    """Find the largest share of the limits `effort` (k,), N m, or N for a sliding joint; `pace`: see `torques`."""
    t = time_grid(trajectory, GRID_S, MAX_GRID)
    values = np.abs(torques(arm, trajectory, t, load, pace))
    i, joint = np.unravel_index(int(np.argmax(values / effort)), values.shape)
    model, joints = arm.model, [arm.model.getJointId(name) for name in arm.robot.joints]
    return Torque(
        share=float(values[i, joint] / effort[joint]),
        joint=arm.robot.joints[joint],
        t=float(t[i]),
        value=float(values[i, joint]),
        bound=float(effort[joint]),
        unit="N" if model.joints[joints[joint]].shortname().startswith("JointModelP") else "N m",
        weightless=tuple(model.names[each] for each in joints if not model.inertias[each].mass > 0.0),
        impossible=_impossible_inertias(arm),
    )


@lru_cache(maxsize=16)
def _impossible_inertias(arm: AuditArm) -> tuple[str, ...]:
    """Return the links that the arm moves whose largest principal inertia exceeds the sum of the other two.

    None of three that satisfy this inequality is negative.
    """
    found = []
    for link in read_urdf_xml(arm.robot.urdf).iterfind("link"):
        name, given = link.get("name", ""), link.find("inertial/inertia")
        if given is not None and arm.driven_ancestors(arm.link_on_joint(name)[0]):
            xx, xy, xz, yy, yz, zz = (float(given.attrib[key]) for key in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz"))
            principal = np.linalg.eigvalsh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
            if 2.0 * principal[2] - principal.sum() > ROUNDING_SHARE * np.abs(principal).max():
                found.append(name)
    return tuple(found)


def torques(arm: AuditArm, trajectory: JointTrajectory, t: Array, load: Load, pace: float = 1.0) -> Array:
    """Return the torques of the arm's joints (n, k), N m (N for a sliding joint), at times t (n,) s.

    Args:
        trajectory: the motion. The fingers follow it too, but count as at rest.
        load: what the tool carries.
        pace: speed of the motion relative to the trajectory's own; 0 holds the arm still at each time.
    """
    bare = arm.model.copy()
    bare.gravity.linear = arm.T_universe_base.rotation @ np.array([0.0, 0.0, -G])  # base has z up
    if load.mass:
        payload = pin.Inertia(load.mass, np.array(load.p_tool), np.zeros((3, 3)))
        bare.appendBodyToJoint(arm.tool_joint, payload, arm.T_joint_tool)
    models = [bare] * len(t)
    if load.grasped is not None and load.grasped.mass:
        for phase in follow_object(arm, trajectory, load.grasped, load.table):
            if phase.held:
                holding = bare.copy()
                T_joint_object = arm.T_joint_tool * se3(phase.pose)
                holding.appendBodyToJoint(arm.tool_joint, _inertia(load.grasped), T_joint_object)
                for i in np.flatnonzero((phase.start <= t) & (t <= phase.end)):
                    models[i] = holding
    data, gears = bare.createData(), arm.drive_matrix()
    _, qd, qdd, _ = joint_motion(trajectory, t)
    q = arm.configurations(coordinates(trajectory, t))
    v, a = pace * qd @ gears.T, pace**2 * qdd @ gears.T
    of_all = np.array([pin.rnea(model, data, *each) for model, *each in zip(models, q, v, a, strict=True)])
    return np.asarray(of_all @ gears)


def _inertia(grasped: GraspedObject) -> Any:
    """Return the inertia of an object of uniform density."""
    if grasped.shape == "box":
        return pin.Inertia.FromBox(grasped.mass, *grasped.size)
    radius = 0.5 * grasped.size[0]
    if grasped.shape == "sphere":
        return pin.Inertia.FromSphere(grasped.mass, radius)
    return pin.Inertia.FromCylinder(grasped.mass, radius, grasped.size[1])
