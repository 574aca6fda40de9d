"""How sure the tracker is of the pose at each stop: what the sensor's noise and the moves' closures imply."""

from __future__ import annotations

import numpy as np

from pbd.data import Recording, Stop
from pbd.pose import Array
from pbd.tracking.rest import Rest

TILT_SIGMA = np.radians(0.3)
"""rad, of VQF while moving: 0.2 to 0.4 degrees over the real recordings of the benchmark."""

HEADING_SIGMA = np.radians(0.4)
"""rad, with a magnetometer or over the first seconds without one."""

WANDER, UNSEEN_SPEED = 0.25, 0.0025
"""Of `move_covariance`: a share, and m/s."""

GYRO_WALK = np.radians(0.02)
"""rad/s: what is left of the gyro's bias after its estimation; heading without a magnetometer drifts by it."""


def stop_covariance(recording: Recording, stops: tuple[Stop, ...], closure: Array, rest: Rest) -> Array:
    """Covariance (len(stops), 6, 6) of position (m) and rotation vector (rad) in nav at each stop.

    The first stop is the origin and certain; each move adds its own.
    """
    cov = np.zeros((len(stops), 6, 6))
    for k in range(1, len(stops)):
        duration = float(recording.t[stops[k].start] - recording.t[stops[k - 1].stop - 1])
        cov[k, :3, :3] = cov[k - 1, :3, :3] + move_covariance(duration, closure[k - 1], rest, recording.rate_hz)
    for k, stop in enumerate(stops):
        heading = HEADING_SIGMA
        if recording.mag is None:
            heading = np.hypot(heading, GYRO_WALK * (recording.t[stop.start] - recording.t[stops[0].start]))
        cov[k, 3:, 3:] = np.diag([TILT_SIGMA**2, TILT_SIGMA**2, heading**2])
    return cov


def move_covariance(duration: float, closure: Array, rest: Rest, rate_hz: float) -> Array:
    """Covariance (3, 3) m2 of a move's displacement, its velocity being known at both ends.

    With T its duration and the drift of velocity taken out linearly, three parts:

    - white noise of density N m/s2/rtHz: N^2 T^3 / 12 (double integral of white noise, its end velocity removed);
    - what the closure c betrays of acceleration errors that wander (tilt, bias): (WANDER |c| / sqrt(3) T)^2 along each
      axis. For a random walk of intensity q, var(v_end) = q T^3 / 3 and, de-drifted, var(p_end) = q T^5 / 120, so that
      WANDER would be sqrt(3 / 120) = 0.16; errors that come and go within the move leave more;
    - what it doesn't betray: (UNSEEN_SPEED T)^2.

    The last two constants make 70 % and 92 % of all errors of the benchmark's recordings lie inside one and two sigma
    (tests/benchmarks/tracking.py prints the shares; fast motion has fewer inside).
    """
    density = rest.acc_rms / np.sqrt(3.0 * rate_hz)
    white = density**2 * duration**3 / 12.0
    wander = (WANDER * duration) ** 2 * float(closure @ closure) / 3.0
    covariance: Array = (white + wander + (UNSEEN_SPEED * duration) ** 2) * np.eye(3)
    return covariance


def sigmas(cov: Array) -> tuple[Array, Array]:
    """One sigma along nav's axes of a (6, 6) covariance: (3,) m, (3,) degrees."""
    sigma = np.sqrt(np.diagonal(cov))
    return sigma[:3], np.degrees(sigma[3:])
