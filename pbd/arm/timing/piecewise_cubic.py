"""Piecewise cubic joint motions from rest to rest: a dwell, a move, or a sequence of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pbd.data import JointLimits
from pbd.pose import Array

WITHIN = 1.0 - 1e-9
"""Share of each limit that is used, so that rounding errors do not exceed it."""

_NO_TIME = 1e-12  # s; shorter pieces are dropped: unused phases of ruckig have no duration


@dataclass(frozen=True, eq=False)
class PiecewiseCubic:
    """A motion from rest to rest.

    Attributes:
        durations: (m,) s.
        coefficients: (m, 4, k): q = c0 + c1 s + c2 s^2 + c3 s^3, s from the piece's beginning.
    """

    durations: Array
    coefficients: Array

    @staticmethod
    def of(durations: Array, coefficients: Array) -> PiecewiseCubic:
        """Make the pieces, without those of no duration."""
        lasting = durations >= _NO_TIME
        return PiecewiseCubic(durations[lasting], coefficients[lasting])

    @staticmethod
    def hold(q: Array, duration: float) -> PiecewiseCubic:
        """Stay at joints q (k,) for a duration, s."""
        coefficients = np.zeros((1, 4, len(q)))
        coefficients[0, 0] = q
        return PiecewiseCubic.of(np.array([duration]), coefficients)

    @staticmethod
    def join(parts: Sequence[PiecewiseCubic]) -> PiecewiseCubic:
        """Put parts one after the other."""
        return PiecewiseCubic(
            np.concatenate([part.durations for part in parts]), np.concatenate([part.coefficients for part in parts])
        )

    @property
    def duration(self) -> float:
        """Return the motion's duration, s."""
        return float(self.durations.sum())

    def slowed(self, factor: float) -> PiecewiseCubic:
        """Return the same path, `factor` times as long."""
        powers = factor ** -np.arange(4.0)
        return PiecewiseCubic(factor * self.durations, self.coefficients * powers[:, None])

    def lasting(self, least_s: float) -> PiecewiseCubic:
        """Return the same path, slowed if needed to take at least `least_s`."""
        return self.slowed(least_s / self.duration) if 0.0 < self.duration < least_s else self

    def slowed_to_limits(self, limits: JointLimits, factor: float) -> PiecewiseCubic:
        """Return the same path, slowed as much as needed to keep a share `factor` of all limits."""
        velocity, acceleration, jerk = self.peaks()
        slow = max(
            float((velocity / (WITHIN * factor * limits.velocity)).max()),
            float((acceleration / (WITHIN * factor * limits.acceleration)).max()) ** (1.0 / 2.0),
            float((jerk / (WITHIN * factor * limits.jerk)).max()) ** (1.0 / 3.0),
        )
        return self.slowed(slow) if slow > 1.0 else self

    def peaks(self) -> tuple[Array, Array, Array]:
        """Return each joint's highest velocity, acceleration and jerk (k,)."""
        s = self.durations[:, None]
        _, c1, c2, c3 = np.moveaxis(self.coefficients, 1, 0)
        begin, end = 2.0 * c2, 2.0 * c2 + 6.0 * c3 * s
        turning = begin * end < 0.0  # the velocity has an extremum inside, where the acceleration is zero
        s_turn = np.where(turning, s * begin / np.where(turning, begin - end, 1.0), 0.0)
        velocity = [np.abs(c1 + x * (2.0 * c2 + 3.0 * c3 * x)).max(axis=0) for x in (0.0 * s, s, s_turn)]
        acceleration = np.maximum(np.abs(begin), np.abs(end)).max(axis=0)
        return np.max(velocity, axis=0), acceleration, np.abs(6.0 * c3).max(axis=0)
