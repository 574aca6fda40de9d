"""Coordinates x of an arm, its joints and then the gripper's opening, along a path and as pinocchio takes them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from pbd.arm.model import ArmModel
from pbd.pose import Array

Places = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class JointPath:
    """A path as nodes so close that no pair of bodies moves by more than STEP_M against each other in between.

    Attributes:
        t: (n,) s, or the share of a straight move.
        x: (n, k + 1) coordinates (motion_bounds.py); between nodes each goes up, goes down or stands still.
    """

    t: Array
    x: Array


def configurations(arm: ArmModel, x: Array) -> Array:
    """Return pinocchio's configurations (n, nq) of the whole model at coordinates (n, k + 1); see `ArmModel.full_q`.

    Raises:
        ValueError: a coordinate isn't finite.
    """
    if not np.isfinite(x).all():
        raise ValueError("joints and opening must be finite")
    home, driven, slope, at_zero, plain, turns = _layout(arm)
    values = at_zero + slope * x[:, driven]
    q = np.repeat(home[None], len(x), axis=0)
    q[:, plain[0]] = values[:, plain[1]]
    if len(turns[0]):  # continuous: cosine and sine
        q[:, turns[0]], q[:, turns[0] + 1] = np.cos(values[:, turns[1]]), np.sin(values[:, turns[1]])
    return q


@lru_cache(maxsize=4)
def _layout(arm: ArmModel) -> tuple[Array, Places, Array, Array, Places, Places]:
    """What `configurations` needs: home, and for each driven joint its column of x, and how its value follows from it;
    and of joints of one number, then of endless ones, where they are in pinocchio's configuration and among those."""
    full, robot = arm.full, arm.robot
    count, names = len(robot.joints), list(robot.joints)
    driven, slope, at_zero = list(range(count)), [1.0] * count, [0.0] * count
    if gripper := robot.gripper:
        names += gripper.joints
        driven += [count] * len(gripper.joints)
        slope += (gripper.open - gripper.closed).tolist()
        at_zero += gripper.closed.tolist()
    joints = [full.joints[full.getJointId(name)] for name in names]
    at = [
        np.array([(joint.idx_q, i) for i, joint in enumerate(joints) if (joint.nq == 1) == plain], dtype=np.int64)
        for plain in (True, False)
    ]
    plain, turns = (each.reshape(-1, 2).T for each in at)
    return arm.full_q(robot.home, 1.0), np.array(driven), np.array(slope), np.array(at_zero), plain, turns
