"""Errors of the sensor that are too large for a linear model: the gyro's lag and common scale, and hard iron.

They are found by a solution with wide priors, and removed from the samples, which are then smoothed anew.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from pbd.data import Recording
from pbd.data.streams import interpolate
from pbd.pose import Array
from pbd.tracking.noise import OUTLIER_SIGMAS, Noise
from pbd.tracking.smoother.attitude import without_low_pass
from pbd.tracking.smoother.gauss_newton import Descent
from pbd.tracking.smoother.hard_iron import find_hard_iron
from pbd.tracking.smoother.knots import Problem
from pbd.tracking.smoother.normal_equations import Solved
from pbd.tracking.smoother.preintegration import GYR_MATRIX, LAG
from pbd.tracking.smoother.state import SHARED, State

REMOVED_LAG = 0.005
"""s: smallest lag of the gyro that is removed from the samples."""


@dataclass(frozen=True, eq=False)
class LargeErrors:
    """What is removed from the samples.

    Attributes:
        lag, scale: s, of the gyro's time stamps; the gyro's readings are multiplied by 1 + scale. Without a gyro, `lag`
            is the time constant of the low-pass of the device's own attitude.
        hard_iron: (3,) in the unit of the magnetic field.
    """

    lag: float = 0.0
    scale: float = 0.0
    hard_iron: Array = field(default_factory=lambda: np.zeros(3))

    def removed_from(self, recording: Recording) -> Recording:
        """The recording without these errors."""
        gyr, mag, device_rpy = recording.gyr, recording.mag, recording.device_rpy
        if gyr is None and device_rpy is not None and self.lag != 0.0:
            device_rpy = without_low_pass(recording.t, device_rpy, self.lag)
        if gyr is not None and (self.lag != 0.0 or self.scale != 0.0):
            gyr = interpolate(recording.t + self.lag, recording.t, gyr) * (1.0 + self.scale)
        if mag is not None and self.hard_iron.any():
            mag = mag - self.hard_iron
        return replace(recording, gyr=gyr, mag=mag, device_rpy=device_rpy)


def find_large_errors(problem: Problem, found: Descent, mag: Array | None, removed: LargeErrors) -> LargeErrors | None:
    """Find large errors that are left in `found`, the solution of `problem` with wide priors; return all to be removed.

    `mag` (n, 3) is the magnetic field as measured, or None; `removed` is what was removed before.
    """
    noise, lag = problem.noise, removed.lag
    more_lag, more_scale = _large_lag_and_scale(found.x, found.solved)
    iron = None if mag is None or removed.hard_iron.any() else find_hard_iron(problem, mag, found.x)
    # A lag outside the wide prior is another fault.
    if not (more_lag or more_scale or iron is not None) or abs(lag + more_lag) > OUTLIER_SIGMAS * noise.wide_lag_sigma:
        return None
    scale = (1.0 + removed.scale) * (1.0 + more_scale) - 1.0
    return LargeErrors(lag + more_lag, scale, removed.hard_iron if iron is None else iron)


def _large_lag_and_scale(x: State, solved: Solved) -> tuple[float, float]:
    """The lag (s) and the common scale error, each if it is significant and too large for a linear model; else 0.

    Before it has settled, an estimate far from the truth may look significant: the last step must be below a sigma.
    """
    i, step = np.arange(SHARED), solved.d_shared
    tau, sigma = float(x.shared[LAG][0]), float(np.sqrt(solved.shared[0, 0]))
    away = tau - Noise.lag
    lag = tau if abs(away) > max(REMOVED_LAG, OUTLIER_SIGMAS * sigma) and abs(step[LAG][0]) < sigma else 0.0
    diagonal = i[GYR_MATRIX][::4]
    more_scale = -float(x.shared[diagonal].mean())  # w_true = (1 - M) w
    sigma = float(np.sqrt(solved.shared[np.ix_(diagonal, diagonal)].mean()))
    large = abs(more_scale) > max(0.05, 5.0 * sigma)  # 5 %: below, a linear model does
    return lag, more_scale if large and abs(step[diagonal].mean()) < sigma else 0.0
