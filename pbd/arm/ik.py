"""Inverse kinematics: Levenberg-Marquardt with active joint limits, from the given joints and then from many seeds.

The error is e = log6(T_target^-1 T), 6 numbers in which 1 rad counts as 1 m; what is made small is |e|^2.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin

from pbd.arm.model import ArmModel, configuration, to_se3
from pbd.arm.reach import reach_map
from pbd.pose import Array, Pose

TOLERANCE_M = 1e-5
TOLERANCE_RAD = 1e-5
SOLVED = TOLERANCE_M**2
"""Of |e|^2, which is at most this only where both tolerances are met."""

SEEDS = 80
"""How many sampled configurations are tried before a pose is called out of reach: the nearest to it."""

_MOST_STEPS = 100
_MOST_TURN = 1.0  # rad (or m) that a joint may move in one step
_MOST_DAMPING = 1e4  # beyond it no step lowers |e|^2 any more
_SLOW = 0.49  # a step that leaves more than this of |e|^2 (70 % of |e|) is a slow one


@dataclass(frozen=True, eq=False)
class IkResult:
    """The joints that bring the tool to a pose, or else the nearest to it that was found.

    Attributes:
        q: (k,) rad, within the limits.
        position_error_m, rotation_error_rad: what is left between the tool and the pose, by forward kinematics.
    """

    q: Array
    position_error_m: float
    rotation_error_rad: float

    @property
    def reached(self) -> bool:
        """Whether both errors are within tolerance."""
        return self.position_error_m <= TOLERANCE_M and self.rotation_error_rad <= TOLERANCE_RAD


def solve(arm: ArmModel, T_base_tool: Pose, q_seed: Array) -> IkResult:
    """Find joints for a tool pose; the same question gets the same answer each time.

    Args:
        arm: the arm.
        T_base_tool: the tool's pose in base.
        q_seed: (k,) rad, tried first; then the sampled configurations nearest to the pose.

    Returns:
        The first solution, or, where `reached` is false, the joints with the smallest |e| that were found.
    """
    nearest, least = q_seed, np.inf
    for seed in _seeds(arm, T_base_tool, q_seed):
        q, square = descend(arm, T_base_tool, seed)
        if square < least:
            nearest, least = q, square
        if square < SOLVED:
            break
    # At the edge of what can be reached the steps are small ones, and a seed that was given up may yet arrive.
    q, _ = descend(arm, T_base_tool, nearest, patience=_MOST_STEPS)
    return check(arm, T_base_tool, q)


def check(arm: ArmModel, T_base_tool: Pose, q: Array) -> IkResult:
    """Say how far the tool is from a pose at joints q (k,), by forward kinematics."""
    return IkResult(q, *T_base_tool.distance(arm.forward(q)))


def descend(arm: ArmModel, T_base_tool: Pose, q_seed: Array, patience: int = 6) -> tuple[Array, float]:
    """Follow one seed (k,) down to the nearest minimum of |e|^2.

    After `patience` slow steps in a row it is given up.

    Returns:
        The joints, within limits, and |e|^2 there: they are a solution where it is below SOLVED.
    """
    lower, upper = arm.limits.lower, arm.limits.upper
    target = arm.T_base_universe.inverse() * to_se3(T_base_tool)
    q = np.minimum(np.maximum(q_seed, lower), upper)
    offset, e, J = _look(arm, target, q)
    square, damping, slow_steps = float(e.dot(e)), 1e-2, 0
    for _ in range(_MOST_STEPS):
        if square < SOLVED or slow_steps == patience:
            break
        J = pin.Jlog6(offset) @ J
        gradient = e @ J
        # A joint at a bound that wants to go beyond it is left out of this step.
        held = ((q == lower) & (gradient > 0)) | ((q == upper) & (gradient < 0))
        if held.any():
            J[:, held], gradient[held] = 0.0, 0.0
        JtJ = J.T @ J
        while True:
            H = JtJ.copy()
            H.ravel()[:: len(q) + 1] += damping * square + 1e-12
            step = np.linalg.solve(H, gradient)
            step *= _MOST_TURN / max(_MOST_TURN, step.max(), -step.min())
            q_next = np.minimum(np.maximum(q - step, lower), upper)
            offset_next, e_next, J_next = _look(arm, target, q_next)
            square_next = float(e_next.dot(e_next))
            if square_next < square:
                break
            damping *= 10.0
            if damping * square > _MOST_DAMPING:
                return q, square
        damping = max(1e-6, damping * 0.2)
        slow_steps = slow_steps + 1 if square_next > _SLOW * square else 0
        q, square, offset, e, J = q_next, square_next, offset_next, e_next, J_next
    return q, square


def _seeds(arm: ArmModel, T_base_tool: Pose, q_seed: Array) -> Iterator[Array]:
    yield q_seed
    yield from reach_map(arm).nearest(T_base_tool, SEEDS)


def _look(arm: ArmModel, target: Any, q: Array) -> tuple[Any, Array, Array]:
    """Return T_target_tool, its log6 and the tool's Jacobian in its own frame."""
    pin.computeJointJacobians(arm.model, arm.data, configuration(arm.model, q))
    offset = target.actInv(pin.updateFramePlacement(arm.model, arm.data, arm.tool_id))
    J = pin.getFrameJacobian(arm.model, arm.data, arm.tool_id, pin.ReferenceFrame.LOCAL)
    return offset, pin.log6(offset).np, J
