"""The gyro tells a turn later than the accelerometer does; the moves between the stops tell by how much."""

from __future__ import annotations

import numpy as np

from pbd.data import Stop
from pbd.pose import Array, quat_exp, quat_multiply, quat_rotate
from pbd.tracking.integration import integral_of_means
from pbd.tracking.legs import Legs, inside
from pbd.tracking.rest import Rest

LAG_S, LAG_SIGMA_S = 1.0e-3, 0.7e-3
"""Before a recording tells: the filter of a MEMS gyro delays more than that of the accelerometer beside it, 1.0 ms in
an MPU-9250 whatever the bandwidth, nothing in an MPU-6050 (tables of DLPF_CFG in InvenSense's register maps)."""

MOST_LAG_S = 5.0e-3
"""What would be more than this is no lag."""

REWEIGHTED = 3
"""How often moves that don't agree with the others (clipped, shaken) are given less weight."""

_TINY = np.finfo(np.float64).tiny


def advance(wxyz_nav_sensor: Array, rate: Array, lag_s: float) -> Array:
    """Attitude (n, 4) as it will be `lag_s` later, turning at `rate` (n, 3) rad/s in the sensor's axes."""
    return quat_multiply(wxyz_nav_sensor, quat_exp(lag_s * rate))


def lag_acceleration(wxyz_nav_sensor: Array, rate: Array, specific_force: Array) -> Array:
    """How the acceleration in nav changes with each second of lag: (n, 3) m/s3.

    Turned by an attitude that comes late, gravity looks like motion wherever the sensor turns.
    """
    w, f = rate.T, specific_force.T
    turning = np.column_stack((w[1] * f[2] - w[2] * f[1], w[2] * f[0] - w[0] * f[2], w[0] * f[1] - w[1] * f[0]))
    return quat_rotate(wxyz_nav_sensor, turning)


def find_lag(t: Array, a_nav: Array, by_lag: Array, stops: tuple[Stop, ...], rest: Rest, legs: Legs) -> float:
    """Find the gyro's lag, s, from the velocities left over at the ends of the moves (closures).

    A move that turns by an angle A leaves about g A lag; over several moves of different turns that stands out of what
    the sensor's noise and tilt leave. The most probable lag, given LAG_S and LAG_SIGMA_S.

    Args:
        t: (n,) s.
        a_nav: (n, 3) m/s2, with LAG_S taken out.
        by_lag: (n, 3) m/s3, `lag_acceleration`.
        stops: in order.
        rest: for gravity and the sensor's noise.
        legs: between the stops.
    """
    if len(stops) < 2:
        return LAG_S
    # From inside the one stop to inside the other: at its very edge a hand still creeps.
    still = [inside(stop, t) for stop in stops]
    start, end = np.array([rows.stop - 1 for rows in still[:-1]]), np.array([rows.start for rows in still[1:]])
    left, per_lag = (v[end] - v[start] for v in (integral_of_means(t, a) for a in (a_nav, by_lag)))
    duration = t[end] - t[start]
    white = rest.acc_rms**2 * duration * float(np.median(np.diff(t))) / 3.0
    # What a gyro that wanders leaves of a velocity that is held at both ends, and what shaken stops hide.
    wander = (rest.gravity * duration) ** 2 * legs.gyro / 12.0 + legs.speed[:-1] ** 2 + legs.speed[1:] ** 2
    weight = 1.0 / (white + wander)
    share = np.ones(len(left))
    for _ in range(REWEIGHTED):
        known = float(((share * weight)[:, None] * per_lag**2).sum())
        if known == 0.0:
            return LAG_S
        later = float(((share * weight)[:, None] * per_lag * left).sum()) / known
        # The closures themselves say how far each is to be trusted: Cauchy's weights about the median move.
        square = weight * ((left - later * per_lag) ** 2).sum(axis=1)
        share = 1.0 / (1.0 + square / max(float(np.median(square)), _TINY))
    # ... and all together; better than the noise they can't be.
    excess = float((share * square).sum()) / max(3.0 * float(share.sum()) - 1.0, 1.0)
    known /= max(excess, float((weight * white).mean()), _TINY)
    lag = LAG_S - later * known / (known + 1.0 / LAG_SIGMA_S**2)
    return float(np.clip(lag, -MOST_LAG_S, MOST_LAG_S))
