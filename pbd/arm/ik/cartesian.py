"""Cartesian inverse kinematics: continuous joints along a path of the tool, between given joints at both ends.

The seed of each pose is drawn toward the straight line between the joints at both ends, so a redundant arm spreads its
self-motion evenly. If a joint moves far between two poses, poses in between are solved: they tell a fast wrist motion
from a leap to another branch.
"""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from pbd.arm.ik.levenberg_marquardt import EXACT, Residual
from pbd.arm.ik.partial_pose import is_partial, is_redundant, refine_partial
from pbd.arm.model import ArmModel, to_se3
from pbd.arm.tool_deviation import off_line
from pbd.pose import Array, Pose, matrix_log, quat_slerp

SPACING_M, SPACING_RAD = 0.005, np.radians(2.0)
"""Largest distance and rotation between neighbouring poses on a line."""

LEAP_RAD = 0.1
"""Largest joint motion between neighbouring poses that is not checked for a leap, rad."""

OFF_M, OFF_RAD = 5e-4, 2e-3
"""Largest distance and rotation of the tool from its path, on the curve through the joints: half a millimetre, and the
rotation that moves a point 25 cm away by as much."""

_HALVINGS = 10  # how often the distance of two poses is halved to keep the tool on its path
_LEAP_STEPS = 8  # steps into which two poses are divided to check for a leap
_LEAST_POSES = 8  # smallest number of poses on a line
_STEPS = 12  # largest number of Newton steps for a pose
_RIDGE = 1e-10 * np.eye(6)  # keeps the normal equations solvable where the arm is singular


def line(T_start: Pose, T_end: Pose) -> tuple[Pose, ...]:
    """Return poses on a straight line, with constant speed and constant rotation about one axis."""
    distance, angle = T_start.distance(T_end)
    count = max(_LEAST_POSES, int(np.ceil(max(distance / SPACING_M, angle / SPACING_RAD))) + 1)
    return _interpolate(T_start, T_end, count)


def _interpolate(T_start: Pose, T_end: Pose, count: int) -> tuple[Pose, ...]:
    share = np.linspace(0.0, 1.0, count)
    p = T_start.p + share[:, None] * (T_end.p - T_start.p)
    wxyz = quat_slerp(T_start.wxyz, T_end.wxyz, share)
    return (T_start, *(Pose(p[i], wxyz[i]) for i in range(1, count - 1)), T_end)


def follow(arm: ArmModel, T_base_tool: Sequence[Pose], q_start: Array, q_end: Array) -> Array | None:
    """Find continuous joints (n, k) for n closely spaced tool poses, from q_start (k,) to q_end (k,).

    Return None if the arm can't follow: a pose is out of reach or limits, or the arm would leap to another branch.
    """
    q, last = np.empty((len(T_base_tool), len(q_start))), len(T_base_tool) - 1
    q[0], q[last] = q_start, q_end
    step, redundant = (q_end - q_start) / last, is_redundant(arm)
    for i in range(1, last):
        # A redundant arm's seed is drawn toward the line between the ends; another arm's keeps its offset from it.
        kept = (last - i) / (last - i + 1) if redundant else 1.0
        seed = q_start + i * step + kept * (q[i - 1] - q_start - (i - 1) * step)
        found = refine(arm, T_base_tool[i], seed)
        if found is None:
            return None
        q[i] = found
    leaps = np.flatnonzero(np.abs(np.diff(q, axis=0)).max(axis=1) > LEAP_RAD).tolist()
    if any(_leaps(arm, T_base_tool[i], T_base_tool[i + 1], q[i], q[i + 1]) for i in leaps):
        return None
    return q


def _leaps(arm: ArmModel, T_before: Pose, T_after: Pose, q_before: Array, q_after: Array) -> bool:
    """Whether a joint makes more than half of its motion within one of the _LEAP_STEPS steps."""
    path = [q_before]
    for i, pose in enumerate(_interpolate(T_before, T_after, _LEAP_STEPS + 1)[1:-1], start=1):
        found = refine(arm, pose, q_before + i / _LEAP_STEPS * (q_after - q_before))
        if found is None:
            return True
        path.append(found)
    steps = np.abs(np.diff([*path, q_after], axis=0)).max(axis=1)
    return bool(steps.max() > 0.5 * np.abs(q_after - q_before).max())


def keep_on_path(arm: ArmModel, T_base_tool: Sequence[Pose], q: Array) -> Array:
    """Solve poses between n tool poses where the curve through their joints q (n, k) leads the tool off their path.

    Return the joints of all poses.
    """
    rows = [*zip(T_base_tool, q, strict=True)]
    for _ in range(_HALVINGS):
        gaps = _off_path(arm, np.array([joints for _, joints in rows]))
        for i, j in reversed(gaps):
            (T_before, q_before), (T_after, q_after) = rows[i], rows[j]
            _, pose, _ = _interpolate(T_before, T_after, 3)
            if (found := refine(arm, pose, 0.5 * (q_before + q_after))) is not None:
                rows.insert(j, (pose, found))
        if not gaps:
            break
    return np.array([joints for _, joints in rows])


def _off_path(arm: ArmModel, q: Array) -> list[tuple[int, int]]:
    """Return the neighbours among joints q (n, k) between which the curve leaves the direct path of the tool."""
    from pbd.arm.timing.path_smoothing import Curve  # scipy loads slowly

    curve = Curve.through(q, arm.limits, np.arange(float(len(q))))
    if curve is None or curve.t is None:
        return []
    s = curve.s[:-1, None] + np.linspace(0.0, 1.0, 5) * np.diff(curve.s)[:, None]
    p, R = arm.forward_many(np.clip(curve.q(s), arm.limits.lower, arm.limits.upper).reshape(-1, q.shape[1]))
    p, R = p.reshape(*s.shape, 3), R.reshape(*s.shape, 3, 3)
    turns = matrix_log(R[:, :1].swapaxes(2, 3) @ R) * (not is_partial(arm))  # such an arm turns as it must
    off = off_line(np.concatenate((p / OFF_M, turns / OFF_RAD), axis=2)) > 1.0
    return [gap for gap, wide in zip(pairwise(curve.t.astype(int).tolist()), off, strict=True) if wide]


def refine(arm: ArmModel, pose: Pose, q_seed: Array) -> Array | None:
    """Refine joints (k,) that nearly reach a pose; None if that fails or exceeds the limits."""
    goal = to_se3(pose)
    if is_partial(arm):
        found = refine_partial(arm, goal, q_seed)
        return found.q if found.reached else None
    q, residual = q_seed, Residual(arm, goal)
    for _ in range(_STEPS):
        e, J = residual(q)
        if e @ e < EXACT**2:
            inside = (q >= arm.limits.lower).all() and (q <= arm.limits.upper).all()
            return q if inside else None
        q = q - J.T @ np.linalg.solve(J @ J.T + _RIDGE, e)
    return None
