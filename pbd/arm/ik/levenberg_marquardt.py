"""Levenberg-Marquardt with joint limits: a descent from a seed to a nearby minimum of |e|^2.

e = (p - p_target, log3(R R_target^T)), in m and rad; 1 rad counts as 1 m. A step dq solves
(J^T J + mu |e|^2 S^2) dq = J^T e, with the joints' travel scale S: so a slow lift moves least. If the step lowers
|e|^2 it is accepted and mu decreases, else mu increases. Joints at a limit that it would exceed are held.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from pbd.arm.model import ArmModel
from pbd.data import JointLimits
from pbd.lapack import lapack
from pbd.pose import Array

_dposv = lapack().dposv

SOLVED = 0.999e-5**2
"""Threshold of |e|^2: below it the tool is within 1e-5 m and 1e-5 rad. 0.999 allows for rounding."""
MOST_STEPS = 100
"""Largest number of steps of a descent."""
MOST_TURN = 1.0
"""Largest motion of a joint in one step, rad or m."""
DAMPING, LEAST_DAMPING, MOST_DAMPING = 1e-2, 1e-6, 1e4
"""Initial and smallest mu; largest damping mu |e|^2: the descent ends if no step up to it lowers |e|^2."""
RIDGE = 1e-12
"""Keeps the normal equations solvable where the arm is singular."""
EXACT = 1e-9
"""|e| (m, rad) below which a solution is exact but for rounding, and a descent ends."""
SLOW = 0.49
"""A step is slow if it leaves more than this share of |e|^2 (70 % of |e|)."""
STALLED = 1.0 - 1e-6
"""A step that leaves more than this share of |e|^2 is the last."""

PATIENCE = 4
"""Number of successive slow steps after which a seed is given up."""


class StopRule(NamedTuple):
    """When a descent ends.

    Attributes:
        patience: number of successive slow steps after which it ends.
        steps: largest number of steps.
        stalled: a step that leaves more than this share of |e|^2 is the last.
        still: it ends with a step in which no joint would move by this much, rad.
    """

    patience: int = MOST_STEPS
    steps: int = MOST_STEPS
    stalled: float = STALLED
    still: float = 0.0


def descend_each(
    arm: ArmModel, target: pin.SE3, q_seeds: Array, *, patience: int = PATIENCE, all_seeds: bool = False
) -> tuple[Array, Array]:
    """Descend from one seed after the other until one reaches the target.

    Args:
        arm, target: the arm, and the tool's pose in base.
        q_seeds: (m, k) rad.
        patience: number of successive slow steps after which a seed is given up.
        all_seeds: descend from all seeds.

    Returns:
        The joints (n, k), within limits, at which the n descents ended, and |e|^2 (n,) at them. Those below SOLVED are
        solutions; without `all_seeds`, only the last can be one.
    """
    residual, rule, ended = Residual(arm, target), StopRule(patience), list[tuple[Array, float]]()
    for seed in q_seeds:
        ended.append(descend(residual, arm.limits, seed, rule, arm.travel_scale))
        if ended[-1][1] < SOLVED and not all_seeds:
            break
    return np.array([q for q, _ in ended]), np.array([square for _, square in ended])


class Residual:
    """The residual e and its Jacobian at given joints, without the derivative of log3.

    That derivative does not change J^T e, since log3(R R_target^T) is its eigenvector. At e = 0 it is the identity.
    """

    def __init__(self, arm: ArmModel, target: pin.SE3) -> None:
        self.tool, self.p, self.R_inverse = arm.tool_with_jacobian, target.translation.copy(), target.rotation.T.copy()

    def __call__(self, q: Array) -> tuple[Array, Array]:
        """Return e (6,) and J (6, k) at joints (k,)."""
        p, R, J = self.tool(q)
        e = np.empty(6)
        e[:3] = p
        e[:3] -= self.p
        e[3:] = pin.log3(R @ self.R_inverse)
        return e, J


def descend(
    residual: Callable[[Array], tuple[Array, Array]],
    limits: JointLimits,
    q_seed: Array,
    rule: StopRule,
    travel_scale: Array | float = 1.0,
) -> tuple[Array, float]:
    """Minimize the square of a residual, starting from a seed (k,).

    Args:
        residual: returns e (m,) and its Jacobian (m, k) at joints (k,).
        limits: of the joints.
        q_seed: (k,) rad; it is clipped to the limits.
        rule: when the descent ends.
        travel_scale: (k,) see ArmModel.

    Returns:
        The joints, within the limits, and |e|^2 there.
    """
    lower, upper = limits.lower, limits.upper
    q = np.minimum(np.maximum(q_seed, lower), upper)
    e, J = residual(q)
    square, square_before, damping, slow_steps = float(e.dot(e)), np.inf, DAMPING, 0
    stiffness = travel_scale * travel_scale
    H = np.empty((len(q), len(q)))
    diagonal = H.ravel()[:: len(q) + 1]
    at_a_limit = bool(((q == lower) | (q == upper)).any())
    for _ in range(rule.steps):
        if square < EXACT**2 or slow_steps == rule.patience or square > rule.stalled * square_before:
            break
        gradient = e @ J
        if at_a_limit:
            held = ((q == lower) & (gradient > 0.0)) | ((q == upper) & (gradient < 0.0))
            J[:, held], gradient[held] = 0.0, 0.0
        np.dot(J.T, J, out=H)
        ridge = damping * square + RIDGE
        diagonal += ridge * stiffness
        while True:
            step = _dposv(H, gradient)[1]
            if step.dot(step) > MOST_TURN**2:
                step *= MOST_TURN / max(MOST_TURN, step.max(), -step.min())
            if rule.still and np.abs(step).max() < rule.still:
                return q, square
            free = q - step
            q_next = np.minimum(np.maximum(free, lower), upper)
            e_next, J_next = residual(q_next)
            square_next = float(e_next.dot(e_next))
            if square_next < square:
                break
            damping *= 10.0
            if damping * square > MOST_DAMPING:
                return q, square
            diagonal += (damping * square + RIDGE - ridge) * stiffness
            ridge = damping * square + RIDGE
        at_a_limit = at_a_limit or free.tobytes() != q_next.tobytes()
        damping = max(LEAST_DAMPING, 0.2 * damping)
        slow_steps = slow_steps + 1 if square_next > SLOW * square else 0
        q, square, square_before, e, J = q_next, square_next, square, e_next, J_next
    return q, square
