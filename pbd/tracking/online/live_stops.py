"""A live stop, and a stop under test."""

from dataclasses import dataclass

from pbd.data import Keyframe, Stop
from pbd.lazy import cached_property
from pbd.pose import Array, Pose
from pbd.tracking.online.sample_repair import RepairedSample

CONFIRM_S, CONFIRM_DOUBTED_S, CONFIRM_NO_GYRO_S = 0.2, 2.0, 0.6
"""Time at rest, s, before a stop is announced: a clear stop; a doubtful one; a doubtful one without a gyro. The time of
a doubtful stop is longer than half of a hand's slowest move."""


@dataclass(frozen=True, eq=False)
class LiveStop:
    """A stop so far: its first and latest sample, and the pose at its last knot with covariance (6, 6)."""

    first: RepairedSample
    last: RepairedSample
    pose: Pose
    cov: Array

    @property
    def duration_s(self) -> float:
        """From the first to the latest sample."""
        return self.last.t - self.first.t

    @property
    def stop(self) -> Stop:
        """The stop in rows."""
        return Stop(self.first.row, self.last.row + 1, self.duration_s)

    @cached_property  # a recording asks for those of all stops twenty times a second
    def keyframe(self) -> Keyframe:
        """The keyframe in nav."""
        return Keyframe(0.5 * (self.first.t + self.last.t), self.duration_s, self.pose, self.cov)


@dataclass(frozen=True, eq=False)
class StopTrial:
    """A stop under test.

    Attributes:
        first: its first sample.
        confirm_s: the time at rest, s, that makes it a stop.
        doubted: whether the velocity is not zero within its sigma.
        jolted: whether it continues the last stop after a jolt.
        replaces_last: whether the velocity is zero only if the last stop was none.
        worst: the largest squared Mahalanobis distance of its velocity from zero so far.
    """

    first: RepairedSample
    confirm_s: float
    doubted: bool
    jolted: bool
    replaces_last: bool
    worst: float = 0.0
