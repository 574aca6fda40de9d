"""Keyframes, and the touch-ups that correct them."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import partial
from graphlib import CycleError, TopologicalSorter

import numpy as np

from pbd.data.field_checks import freeze_tuples, require_covariance, require_fields, require_finite, wrong_value
from pbd.data.one_line_repr import brief
from pbd.errors import RecordingError, require_kind
from pbd.frozen_arrays import Frozen, freeze_arrays
from pbd.pose import Array, Pose


@dataclass(frozen=True, eq=False)
class Keyframe(Frozen):
    """A pose at which the hand stood still.

    Attributes:
        t: the middle of the stop, s.
        dwell_s: how long the hand stood still; at an edited keyframe, how long the arm stays.
        cov: (6, 6) m and rad, covariance of position, then rotation vector, in nav.
        grip: True if the grip closes at this stop, False if it opens, None if it does not change.
        tolerance_m: (3,) allowed deviation along nav's axes: learned from several takes, or given; None: unknown.
        tolerance_rad: allowed deviation of the attitude, from the same sources.
        weight: the tracker's confidence that the hand stood still, 0 to 1.
        nudge_base_m: (3,) a person's correction of the tool's position, in base axes.
        nudge_tool_m: (3,) likewise, in tool axes.
        frames: names of the things that the keyframe moves with, each carried by the next: ("lid", "cup").
    """

    t: float
    dwell_s: float
    T_nav_sensor: Pose
    cov: Array
    grip: bool | None = None
    label: str = ""
    tolerance_m: Array | None = None
    tolerance_rad: float | None = None
    weight: float = 1.0
    nudge_base_m: Array = field(default_factory=partial(np.zeros, 3))
    nudge_tool_m: Array = field(default_factory=partial(np.zeros, 3))
    frames: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        require_fields(self, T_nav_sensor=Pose, grip=bool | np.bool_ | None, label=str)
        require_finite(self, "t", "dwell_s", "weight")
        if not self.dwell_s >= 0.0:
            raise wrong_value(self, "dwell_s", "must be 0 or above, s")
        freeze_arrays(self, cov=(6, 6), tolerance_m=(3,), nudge_base_m=(3,), nudge_tool_m=(3,))
        require_covariance(self, "cov")
        require_finite(self, "nudge_base_m", "nudge_tool_m")
        require_finite(self, "tolerance_m", "tolerance_rad", above=0.0)
        freeze_tuples(self, frames=str)

    def __repr__(self) -> str:
        x, y, z = self.T_nav_sensor.p + 0.0
        sigma_mm = 1e3 * float(np.sqrt(np.diagonal(self.cov)[:3].max()))
        sigma = f"sigma {sigma_mm:.1f} mm" if self.cov.any() else ""
        grip = {True: "grip closes", False: "grip opens", None: ""}[self.grip]
        where = f"at {self.t:.2f} s for {self.dwell_s:.2f} s"
        return brief(self, where, f"({x:.3f}, {y:.3f}, {z:.3f}) m", sigma, grip, name=self.label)


def require_keyframes(keyframes: object) -> None:
    """Raise WrongTypeError unless this is a list or another sequence of keyframes."""
    valid = isinstance(keyframes, Sequence) and all(isinstance(each, Keyframe) for each in keyframes)
    require_kind("keyframes", keyframes, "a sequence of Keyframe", valid)


def thing_carriers(keyframes: Sequence[Keyframe]) -> dict[str, set[str]]:
    """For each thing all things that carry it, directly or not. Carriers come before what they carry.

    Raises:
        RecordingError: a thing would carry itself.
    """
    nearest: dict[str, set[str]] = {}
    for keyframe in keyframes:
        for name, *carriers in (keyframe.frames[k : k + 2] for k in reversed(range(len(keyframe.frames)))):
            nearest.setdefault(name, set()).update(carriers)
    try:
        order = list(TopologicalSorter(nearest).static_order())
    except CycleError as loop:
        raise RecordingError(f"'{loop.args[1][0]}' can't carry itself: {' carries '.join(loop.args[1])}") from None
    above: dict[str, set[str]] = {}
    for name in order:
        above[name] = nearest[name].union(*(above[carrier] for carrier in nearest[name]))
    return above


@dataclass(frozen=True, eq=False)
class TouchUp(Frozen):
    """A correction of a keyframe's position that a person measured with the arm.

    Attributes:
        by_nav_m: (3,) displacement from the position at the time of the measurement, in nav axes.
        only: do not move the other keyframes, although their errors are correlated with this one's.
        undone: the correction is no longer used.
        from_base_m: (3,) the tool's place in base without nudges and touch-ups, when it was measured; None: not noted.
    """

    t: float
    by_nav_m: Array
    only: bool = False
    undone: bool = False
    from_base_m: Array | None = None

    def __post_init__(self) -> None:
        freeze_arrays(self, by_nav_m=(3,), from_base_m=(3,))

    def index_in(self, keyframes: Sequence[Keyframe]) -> int | None:
        """The index of the touched keyframe; None if the touch-up was undone, or the keyframe is gone."""
        # Files round the times of both to milliseconds.
        at = int(np.argmin([abs(keyframe.t - self.t) for keyframe in keyframes]))
        return None if self.undone or abs(keyframes[at].t - self.t) > 0.002 else at
