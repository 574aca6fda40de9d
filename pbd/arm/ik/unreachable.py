"""Find out why an arm can't reach a pose: the distance beyond its reach, and the joints at their limits."""

from dataclasses import dataclass

import numpy as np

from pbd.arm.ik.levenberg_marquardt import Residual
from pbd.arm.ik.partial_pose import TOLERANCE_M, nearest_position
from pbd.arm.ik.solver import IkResult, solve
from pbd.arm.ik.starts import starts_of
from pbd.arm.model import ArmModel, to_se3
from pbd.errors import PlanError, in_mm_or_cm
from pbd.pose import Array, Pose

_STARTS = 2  # sampled seeds for the position alone
_RISE_M, _STEEP = 0.01, 0.7  # the nearest pose is higher or lower by more than this, m, and as a share of its distance
_SHARE = 0.1  # a joint at its limit is named if its gradient exceeds this share of the largest


@dataclass(frozen=True)
class Unreached:
    """Why an arm can't reach a pose.

    Attributes:
        beyond_m: distance from the pose's position to the nearest that the tool reaches in any rotation; 0: it is
            reached.
        outside: the position is too far from the arm, rather than too near to it.
        limits: the joints that would have to exceed a limit, each with "lower" or "upper".
    """

    beyond_m: float
    outside: bool
    limits: tuple[tuple[str, str], ...]

    def __str__(self) -> str:
        """Complete a sentence about the pose that ends with "which is"."""
        at = " and ".join(f"{joint} at its {side} limit" for joint, side in self.limits)
        if self.beyond_m == 0.0:
            return f"reachable, but not with the tool at this angle{f' ({at})' if at else ''}"
        off = "beyond the arm's reach" if self.outside else "from the nearest place that the tool reaches"
        where = f"{in_mm_or_cm(self.beyond_m)} {off}"
        return f"{where}, with {at}" if at else where


def find_reason(arm: ArmModel, T_base_tool: Pose, nearest: IkResult) -> Unreached:
    """Find out why the arm stays short of a pose; `nearest`: what `solve` found."""
    goal = to_se3(T_base_tool)
    residual = Residual(arm, goal)
    q_least, beyond = nearest.q, np.inf
    for q_seed in (nearest.q, *starts_of(arm).at(T_base_tool.p, _STARTS)):
        q = nearest_position(arm, goal, q_seed)
        off = float(np.linalg.norm(T_base_tool.p - arm.forward(q).p))
        if off < beyond:
            q_least, beyond = q, off
        if beyond <= TOLERANCE_M:
            return Unreached(0.0, False, _limits(arm, nearest.q, *residual(nearest.q)))
    e, J = residual(q_least)
    arm.forward(q_least)
    p_shoulder = arm.data.oMi[min(2, arm.model.njoints - 1)].translation  # of the second joint
    from_shoulder = T_base_tool.p + e[:3] - p_shoulder
    return Unreached(beyond, float(from_shoulder @ e[:3]) < 0.0, _limits(arm, q_least, e[:3], J[:3]))


def out_of_reach(arm: ArmModel, keyframe: int, pose: Pose, q_seed: Array) -> PlanError:
    """Make the error that explains why a keyframe can't be reached.

    Fields: keyframe (from 0), value and bound (m), rotation (rad), nearest (the pose that is reached), beyond (m; 0 if
    only the rotation can't be reached), joints (those at their limits).
    """
    nearest = solve(arm, pose, q_seed)
    reason = find_reason(arm, pose, nearest)
    (x, y, z), reached = pose.p, arm.forward(nearest.q)
    rise = float(reached.p[2] - z)
    steep = abs(rise) > max(_RISE_M, _STEEP * nearest.position_error_m)
    height = "" if not steep else " higher" if rise > 0.0 else " lower"
    return PlanError(
        f"keyframe {keyframe} is out of reach: the tool stays {in_mm_or_cm(nearest.position_error_m)} and "
        f"{np.rad2deg(nearest.rotation_error_rad):.1f} degrees from its pose at ({x:.3f}, {y:.3f}, {z:.3f}) m, which is"
        f" {reason}; move the dock{height}",
        keyframe=keyframe,
        value=nearest.position_error_m,
        bound=TOLERANCE_M,
        rotation=nearest.rotation_error_rad,
        nearest=reached,
        beyond=reason.beyond_m,
        joints=tuple(joint for joint, _ in reason.limits),
    )


def _limits(arm: ArmModel, q: Array, e: Array, J: Array) -> tuple[tuple[str, str], ...]:
    """Return the joints that the gradient of |e|^2 pushes against their limits, largest gradient first."""
    push = -e @ J
    at_lower, at_upper = (q == arm.limits.lower) & (push < 0.0), (q == arm.limits.upper) & (push > 0.0)
    push = np.abs(push) * (at_lower | at_upper)
    order = [i for i in np.argsort(-push) if push[i] > _SHARE * push.max()]
    return tuple((arm.robot.joints[i], "lower" if at_lower[i] else "upper") for i in order)
