"""Where an arm's tool is, and how it moves, by pinocchio and quickly: for the thousands of looks of a descent."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import NamedTuple

import pinocchio as pin

from pbd.arm.model import ArmModel
from pbd.pose import Array, Pose


class Target(NamedTuple):
    """A tool pose in base: p (3,) m, R (3, 3)."""

    p: Array
    R: Array


def target(T_base_tool: Pose) -> Target:
    """Write a pose as descents take it, in a few microseconds."""
    w, x, y, z = T_base_tool.wxyz.tolist()
    return Target(T_base_tool.p.copy(), pin.Quaternion(w, x, y, z).toRotationMatrix())


def in_universe(arm: ArmModel, target: Target) -> Target:
    """Turn a pose in base into one in pinocchio's world."""
    T_universe_base = arm.T_base_universe.inverse()
    R = T_universe_base.rotation
    return Target(R @ target.p + T_universe_base.translation, R @ target.R)


@lru_cache(maxsize=4)
def tool_in_universe(arm: ArmModel) -> Callable[[Array], tuple[Array, Array, Array]]:
    """Return what finds the tool at joints (k,): p (3,), R (3, 3) and its Jacobian (6, k), in pinocchio's world.

    p and R are pinocchio's own and hold until it looks again.
    """
    model, data, tool_id, axes = arm.model, arm.data, arm.tool_id, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
    configuration = arm.configuration

    def tool(q: Array) -> tuple[Array, Array, Array]:
        J = pin.computeFrameJacobian(model, data, configuration(q), tool_id, axes).reshape(6, -1)
        placement = data.oMf[tool_id]
        return placement.translation, placement.rotation, J

    return tool
