"""What a person knows about the stops, and how well the data agree."""

from dataclasses import dataclass, replace

import numpy as np

from pbd.data.calibration import Calibration
from pbd.data.covariance import PoseCovariance
from pbd.data.field_checks import freeze_tuples, require_finite
from pbd.errors import CalibrationError, UsageError, require_kind
from pbd.frozen_arrays import Frozen, freeze_arrays
from pbd.pose import Array, Pose


@dataclass(frozen=True)
class Place:
    """The tool stood at the same place at each of these instants.

    Attributes:
        t: one instant in each stop, s.
        p_base_tool: the place in the robot's base, m, or None.
        sigma_m: one sigma along each axis of how well the hand met it, m; None: as pbd.tracking.stop_constraints.

    Raises:
        UsageError: fewer than two instants and no position, an instant named twice, a sigma not above zero, or a value
            that is no number.
    """

    t: tuple[float, ...]
    p_base_tool: tuple[float, float, float] | None = None
    sigma_m: float | None = None

    def __post_init__(self) -> None:
        freeze_tuples(self, t=float)
        if self.p_base_tool is not None:
            freeze_tuples(self, p_base_tool=float)
            require_kind("Place.p_base_tool", self.p_base_tool, "three numbers, m", len(self.p_base_tool) == 3)
        require_finite(self, "t", "p_base_tool")
        require_finite(self, "sigma_m", above=0.0)
        if len(self.t) < (2 if self.p_base_tool is None else 1):
            raise UsageError("Place must name at least two stops, or one and a p_base_tool")
        if len(set(self.t)) < len(self.t):
            raise UsageError("Place must name each stop once")


@dataclass(frozen=True)
class Contact:
    """The tool stood at a known height: on the table, unless `as_at` or `height` is given.

    Attributes:
        t: an instant in the stop, s.
        as_at: an instant in another stop with the same height, s.
        height: height above the tool's height at the first rest, m.
        sigma_m: one sigma of the height, m; None: the default of pbd.tracking.stop_constraints.

    Raises:
        UsageError: both are given, `as_at` equals `t`, a sigma not above zero, or a value that is no number.
    """

    t: float
    as_at: float | None = None
    height: float | None = None
    sigma_m: float | None = None

    def __post_init__(self) -> None:
        require_finite(self, "t", "as_at", "height")
        require_finite(self, "sigma_m", above=0.0)
        if self.as_at is not None and self.height is not None:
            raise UsageError("Contact takes as_at or height, not both")
        if self.as_at == self.t:
            raise UsageError("Contact.t and as_at must be two stops")


@dataclass(frozen=True)
class Known:
    """What a person knows about a demonstration's stops. `closed`: the last stop is where the first one was."""

    closed: bool = False
    places: tuple[Place, ...] = ()
    contacts: tuple[Contact, ...] = ()


@dataclass(frozen=True)
class ClaimFit:
    """How well the data agreed with a claim about a stop before the claim was used.

    Attributes:
        t: the middle of the stop, s.
        off_m: misfit, m.
        sigmas: misfit in sigmas. A typical value is 1.5 for a position and 0.7 for a height.
    """

    saying: str
    t: float
    stop: int
    off_m: float
    sigmas: float


@dataclass(frozen=True, eq=False)
class CalibrationUpdate(Frozen):
    """What known places say of a calibration, besides the poses at the k stops.

    Attributes:
        before, after: the calibration; and with start in base, mount (whose rotation they don't show) and scale as
            corrected.
        by_calibration: (k + 3, 6, 10), the errors that remain at the stops and, last, in start, mount and scale, per
            error of `before`: of the start (m, rad), of the tool's position on the sensor (m), of the scale (a share).
        covariance: of the same k + 3 errors, without those of `before`. Of the scale only the first of 6 counts.
    """

    before: Calibration
    after: Calibration
    by_calibration: Array
    covariance: PoseCovariance

    def __post_init__(self) -> None:
        freeze_arrays(self, by_calibration=(self.covariance.count, 6, 10))

    def applied_to(self, calibration: Calibration) -> Calibration:
        """Return the calibration as corrected; CalibrationError if its start, mount or scale are not as in `before`."""
        parts = ("T_base_dock", "T_base_nav", "T_sensor_tool", "scale")
        if not all(_same(getattr(calibration, part), getattr(self.before, part)) for part in parts):
            raise CalibrationError(
                f"the path was tracked with '{self.before.name}': known places fitted it to the start, mount and scale "
                f"there, and '{calibration.name}' has others; track it with the calibration that you plan with: "
                "pbd.track(..., calibration=...)"
            )
        return replace(calibration, **{part: getattr(self.after, part) for part in parts})


def _same(one: Pose | float | None, other: Pose | float | None) -> bool:
    if isinstance(one, Pose) and isinstance(other, Pose):
        return np.array_equal(one.p, other.p) and np.array_equal(one.wxyz, other.wxyz)
    return one == other
