"""What a motion asks of the motors: inverse dynamics of the whole URDF, with what the tool carries.

The recursive Newton-Euler algorithm (Featherstone, 2008, chapter 5; pinocchio's rnea), with the masses that the URDF
gives. It leaves out friction and the motors' own inertia, of which URDFs say nothing that could be relied on.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin

from pbd.audit.arm import AuditArm, se3
from pbd.audit.contact import coordinates
from pbd.audit.grasp import follow_object
from pbd.data import GraspedObject, JointTrajectory, Load
from pbd.pose import Array

GRID_S = 0.01
"""Torques are worked out at the knots, between which the jerk is constant, and so often between, s."""

MOST_GRID = 5_000
"""No more instants than these between the knots, however slow the motion is."""

G = 9.81
"""Gravity, m/s2."""


@dataclass(frozen=True)
class Torque:
    """Where a motion takes the largest share of a joint's torque limit.

    Attributes:
        share: of the limit.
        joint, t: its name, and when (s).
        value, bound: N m, and N where it slides, as `unit` says.
        weightless: joints that move something to which the URDF gives no mass.
    """

    share: float
    joint: str
    t: float
    value: float
    bound: float
    unit: str
    weightless: tuple[str, ...]


def find_torque(arm: AuditArm, trajectory: JointTrajectory, load: Load, effort: Array, pace: float = 1.0) -> Torque:
    """Find the largest share of the limits `effort` (k,); `pace` as in `torques`."""
    even = np.linspace(0.0, trajectory.duration, min(int(trajectory.duration / GRID_S) + 2, MOST_GRID))
    t = np.union1d(even, trajectory.knots)
    values = np.abs(torques(arm, trajectory, t, load, pace))
    i, joint = np.unravel_index(int(np.argmax(values / effort)), values.shape)
    name = arm.robot.joints[joint]
    model, joints = arm.model, [arm.model.getJointId(each) for each in arm.robot.joints]
    return Torque(
        share=float(values[i, joint] / effort[joint]),
        joint=name,
        t=float(t[i]),
        value=float(values[i, joint]),
        bound=float(effort[joint]),
        unit="N" if model.joints[joints[joint]].shortname().startswith("JointModelP") else "N m",
        weightless=tuple(model.names[each] for each in joints if not model.inertias[each].mass > 0.0),
    )


def torques(arm: AuditArm, trajectory: JointTrajectory, t: Array, load: Load, pace: float = 1.0) -> Array:
    """Work out what the arm's joints have to give, (n, k) N m, at instants t (n,).

    Args:
        trajectory: the motion; fingers are where it has them, at rest.
        pace: how fast it goes through the motion: 0 holds still at each instant.
    """
    bare = arm.model.copy()
    bare.gravity.linear = arm.T_universe_base.rotation @ np.array([0.0, 0.0, -G])  # base has z up
    if load.mass:
        _add(bare, arm.tool_joint, arm.T_joint_tool, pin.Inertia(load.mass, np.array(load.p_tool), np.zeros((3, 3))))
    models = [bare] * len(t)
    if load.grasped is not None and load.grasped.mass:
        for stay in follow_object(arm, trajectory, load.grasped, load.table):
            if stay.held:
                holding = bare.copy()
                _add(holding, arm.tool_joint, arm.T_joint_tool * se3(stay.pose), _inertia(load.grasped))
                for i in np.flatnonzero((stay.start <= t) & (t <= stay.end)):
                    models[i] = holding
    data = bare.createData()
    samples, driven = trajectory.at(t), [bare.joints[bare.getJointId(name)].idx_v for name in arm.robot.joints]
    q = arm.configurations(coordinates(trajectory, t))
    v, a = np.zeros((2, len(t), bare.nv))
    v[:, driven], a[:, driven] = pace * samples.qd, pace**2 * samples.qdd
    return np.array([pin.rnea(model, data, *each) for model, *each in zip(models, q, v, a, strict=True)])[:, driven]


def _add(model: Any, joint: int, T_joint_body: Any, inertia: Any) -> None:
    model.inertias[joint] = model.inertias[joint] + T_joint_body.act(inertia)


def _inertia(thing: GraspedObject) -> Any:
    """Spread the mass evenly."""
    if thing.shape == "box":
        return pin.Inertia.FromBox(thing.mass, *thing.size)
    radius = 0.5 * thing.size[0]
    if thing.shape == "sphere":
        return pin.Inertia.FromSphere(thing.mass, radius)
    return pin.Inertia.FromCylinder(thing.mass, radius, thing.size[1])
