"""Point-to-point (PTP) moves: straight in joint space, from rest to rest, as fast as the limits allow.

Ruckig plans one degree of freedom, the distance along the line, so that all joints keep their limits. With one degree
of freedom per joint, the move would often not be straight. A joint's cubic pieces are ruckig's, times a factor.
Ruckig's waypoints are not used, since they call a web service.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from ruckig import InputParameter, Ruckig, Trajectory

from pbd.arm.timing.piecewise_cubic import WITHIN, PiecewiseCubic
from pbd.data import JointLimits
from pbd.pose import Array

LEAST_S = 1e-3
"""Shortest duration of a move, s: one period of a fast controller. A move of 1e-9 rad would otherwise take
microseconds, and in a receiver's interpolation the rounding errors of positions would become jerk."""


def ptp_move(q_start: Array, q_end: Array, limits: JointLimits, factor: float) -> PiecewiseCubic:
    """Time a straight move in joint space.

    Args:
        q_start, q_end: (k,) rad.
        factor: share of the velocity, acceleration and jerk limits.
    """
    dq = q_end - q_start
    length = float(np.abs(dq).max())
    if length == 0.0:
        return PiecewiseCubic(np.empty(0), np.empty((0, 4, len(dq))))
    direction = dq / length
    profile = _profile(length, np.abs(direction), limits, factor)
    durations = np.array(profile.t)
    # Seven phases begin at the first seven of eight states; the last state is the end.
    s, v, a, j = (np.array(values)[: len(durations), None] for values in (profile.p, profile.v, profile.a, profile.j))
    coefficients = np.stack((q_start + s * direction, v * direction, a / 2.0 * direction, j / 6.0 * direction), axis=1)
    return PiecewiseCubic.of(durations, coefficients).lasting(LEAST_S)


def _profile(length: float, share: Array, limits: JointLimits, factor: float) -> Any:
    moving = share > 0.0
    wanted = InputParameter(1)
    wanted.current_position, wanted.target_position = [0.0], [length]
    wanted.max_velocity = [WITHIN * factor * float((limits.velocity[moving] / share[moving]).min())]
    wanted.max_acceleration = [WITHIN * factor * float((limits.acceleration[moving] / share[moving]).min())]
    wanted.max_jerk = [WITHIN * factor * float((limits.jerk[moving] / share[moving]).min())]
    trajectory = Trajectory(1)
    Ruckig(1).calculate(wanted, trajectory)
    return trajectory.profiles[0][0]
