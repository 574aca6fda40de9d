"""PTP: straight moves in joint space, from rest to rest, as fast as the limits allow.

A move is one degree of freedom for ruckig, the distance along the line, under the limits that its joints leave it. So
the line is straight (with one degree of freedom per joint it often isn't), and ruckig's cubic pieces are the joints'
pieces but for a factor. Ruckig's own waypoints are never used: they would ask a service on the net.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from ruckig import InputParameter, Ruckig, Trajectory

from pbd.arm.timing.piecewise_cubic import WITHIN, PiecewiseCubic
from pbd.data import JointLimits
from pbd.pose import Array

LEAST_S = 1e-3
"""Shortest move, s: one period of a fast controller. A move of 1e-9 rad would end in microseconds, in which no
controller can interpolate: the positions' last digits would become jerk."""


def ptp_move(q_start: Array, q_end: Array, limits: JointLimits, factor: float) -> PiecewiseCubic:
    """Time a move from q (k,) to q (k,).

    Args:
        q_start, q_end: rad.
        factor: a share of the velocity, acceleration and jerk limits.
    """
    way = q_end - q_start
    length = float(np.abs(way).max())
    if length == 0.0:
        return PiecewiseCubic(np.empty(0), np.empty((0, 4, len(way))))
    way = way / length
    profile = _profile(length, np.abs(way), limits, factor)
    durations = np.array(profile.t)
    # Seven phases; the states are one more, the last being the end.
    s, v, a, j = (np.array(values)[: len(durations), None] for values in (profile.p, profile.v, profile.a, profile.j))
    coefficients = np.stack((q_start + s * way, v * way, a / 2.0 * way, j / 6.0 * way), axis=1)
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
