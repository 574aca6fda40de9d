"""Values of planning: the robot's motion."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from pbd.data.one_line_repr import brief, counted, span
from pbd.errors import UsageError, is_number, require_kind
from pbd.frozen_arrays import Frozen, freeze_arrays, numeric
from pbd.lazy import cached_property
from pbd.pose import Array


@dataclass(frozen=True, eq=False)
class Samples(Frozen):
    """A sampled joint trajectory: t (n,) s; q, qd, qdd (n, k) rad, rad/s, rad/s2; gripper (n,) 0 closed to 1 open."""

    t: Array
    q: Array
    qd: Array
    qdd: Array
    gripper: Array

    def __post_init__(self) -> None:
        n, k = self.q.shape
        freeze_arrays(self, t=(n,), q=(n, k), qd=(n, k), qdd=(n, k), gripper=(n,))

    def __repr__(self) -> str:
        return brief(self, span(self.t), counted(self.q.shape[1], "joint"))


@dataclass(frozen=True, eq=False)
class JointTrajectory(Frozen):
    """A piecewise cubic motion: position, velocity, acceleration and jerk are exact at every instant.

    `t`, `q`, `qd`, `qdd` and `gripper` are its samples at 1 kHz, `at` and `sample` give others.

    Attributes:
        joint_names: the k joints, base to tool, as in the URDF. A prismatic joint has m in place of rad.
        knots: (m + 1,) increasing from 0, s. Piece i covers knots[i] <= t <= knots[i + 1].
        coefficients: (m, 4, k) rad, rad/s ...: q = c0 + c1 s + c2 s^2 + c3 s^3 with s = t - knots[i].
        gripper_t, gripper_opening: (g,) s, and 0 closed to 1 open; linear between, constant outside.
        keyframe_t: (f,) when the arm reaches each keyframe, s.
        keyframe_q: (f, k) the joint positions solved for each keyframe, rad.
    """

    joint_names: tuple[str, ...]
    knots: Array
    coefficients: Array
    gripper_t: Array
    gripper_opening: Array
    keyframe_t: Array
    keyframe_q: Array

    def __post_init__(self) -> None:
        m, k, g, f = len(self.coefficients), len(self.joint_names), len(self.gripper_t), len(self.keyframe_t)
        freeze_arrays(self, knots=(m + 1,), coefficients=(m, 4, k))
        freeze_arrays(self, gripper_t=(g,), gripper_opening=(g,), keyframe_t=(f,), keyframe_q=(f, k))

    def __repr__(self) -> str:
        joints, keyframes = counted(len(self.joint_names), "joint"), counted(len(self.keyframe_t), "keyframe")
        return brief(self, joints, f"{self.duration:.1f} s", keyframes)

    @property
    def duration(self) -> float:
        """Duration, s."""
        return float(self.knots[-1])

    def at(self, t: ArrayLike) -> Samples:
        """Evaluate at one instant or at instants (n,), s: n rows. Before 0 and after `duration` the arm stands still.

        Raises:
            UsageError: an instant is NaN.
            WrongTypeError: they are no numbers, or not in one row.
        """
        t = np.atleast_1d(numeric("t", t))
        require_kind("t", t, "one instant or a row of them (n,)", t.ndim == 1)
        if np.isnan(t).any():
            raise UsageError("an instant of the trajectory is NaN; give seconds from its start", value=np.nan)
        inside = np.clip(t, 0.0, self.duration)
        piece = np.clip(np.searchsorted(self.knots, inside, side="right") - 1, 0, len(self.coefficients) - 1)
        s = (inside - self.knots[piece])[:, None]
        c0, c1, c2, c3 = np.moveaxis(self.coefficients[piece], 1, 0)
        # Velocity is exactly zero at the end and outside: controllers refuse a final velocity.
        moving = ((t >= 0.0) & (t < self.duration))[:, None]
        return Samples(
            t=t,
            q=c0 + s * (c1 + s * (c2 + s * c3)),
            qd=(c1 + s * (2.0 * c2 + s * 3.0 * c3)) * moving,
            qdd=(2.0 * c2 + 6.0 * s * c3) * moving,
            gripper=np.interp(t, self.gripper_t, self.gripper_opening),
        )

    def sample(self, rate_hz: float) -> Samples:
        """Evaluate at a constant rate, Hz, from 0 to the first sample at or after the end.

        Raises:
            UsageError: the rate is not above 0, or not finite.
        """
        require_kind("rate_hz", rate_hz, "a number", is_number(rate_hz))
        if not 0.0 < rate_hz < np.inf:
            raise UsageError(f"rate_hz must be above 0 and finite, got {rate_hz:g}", value=rate_hz)
        steps = round(self.duration * rate_hz)
        steps += steps / rate_hz < self.duration  # the quotient, not the product, is the last sample's rounded time
        return self.at(np.arange(steps + 1) / rate_hz)

    @cached_property
    def _at_1khz(self) -> Samples:
        return self.sample(1000.0)

    @property
    def t(self) -> Array:
        """(n,) s at 1 kHz."""
        return self._at_1khz.t

    @property
    def q(self) -> Array:
        """(n, k) rad at 1 kHz."""
        return self._at_1khz.q

    @property
    def qd(self) -> Array:
        """(n, k) rad/s at 1 kHz."""
        return self._at_1khz.qd

    @property
    def qdd(self) -> Array:
        """(n, k) rad/s2 at 1 kHz."""
        return self._at_1khz.qdd

    @property
    def gripper(self) -> Array:
        """(n,) opening at 1 kHz: 1 open, 0 closed."""
        return self._at_1khz.gripper
