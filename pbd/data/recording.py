"""A sensor's recording, and the truth that is known of a simulated or optical one."""

from dataclasses import dataclass, field

import numpy as np

from pbd.data.field_checks import freeze_tuples, require_fields, require_finite
from pbd.data.one_line_repr import brief, counted, span
from pbd.data.source_columns import IMU_CSV, SourceColumns
from pbd.errors import require_kind
from pbd.frozen_arrays import Frozen, freeze_arrays, numeric
from pbd.lazy import cached_property
from pbd.pose import Array
from pbd.timestamps.even_times import batched_interval

DEVICE_CLOCK = "device"
"""`RecordingInfo.clock` of a recording whose rows have the times that the sensor itself gave them."""


@dataclass(frozen=True)
class GripEvent:
    """The hand closed (or opened) its grip at `t` s, by the clock of `Recording.t`."""

    t: float
    closed: bool

    def __post_init__(self) -> None:
        require_fields(self, closed=bool | np.bool_)
        require_finite(self, "t")


@dataclass(frozen=True)
class RecordingInfo:
    """Where a recording comes from: its name, the sensor, the nominal rate in Hz, the UTC start in ISO 8601.

    `clock` says in words where its times come from; `source` tells an imported file's columns, for advice.
    """

    name: str = "recording"
    sensor: str = "unknown"
    rate_hz: float | None = None
    created: str | None = None
    clock: str = ""
    source: SourceColumns = field(default=IMU_CSV, compare=False, repr=False)


@dataclass(frozen=True, eq=False)
class Recording(Frozen):
    """A sensor's readings in SI units and the housing's axes.

    Attributes:
        t: (n,) s from the first sample, increasing. Of a clock's times subtract the first one, from `grip` too.
        acc: (n, 3) specific force, m/s2: +g up at rest. NaN (or masked) where a sample is missing.
        gyr: (n, 3) angular rate, rad/s, or None without a gyro.
        mag: (n, 3) magnetic field, uT, or None.
        device_rpy: (n, 3) the device's own roll, pitch, yaw, rad (about x, y, z of ENU, URDF's order), or None.
        grip, info: when the grip closed and opened; the names of recording and sensor, which selects its error model.

    Raises:
        WrongTypeError: an argument has another type or shape. Whether the readings make sense, `pbd.track` checks.
    """

    t: Array
    acc: Array
    gyr: Array | None = None
    mag: Array | None = None
    device_rpy: Array | None = None
    grip: tuple[GripEvent, ...] = ()
    info: RecordingInfo = field(default_factory=RecordingInfo)

    def __post_init__(self) -> None:
        n = numeric("Recording.t", self.t).size
        require_kind("Recording.acc", self.acc, "an array of numbers", self.acc is not None)
        freeze_arrays(self, t=(n,), acc=(n, 3), gyr=(n, 3), mag=(n, 3), device_rpy=(n, 3))
        freeze_tuples(self, grip=GripEvent)
        require_fields(self, info=RecordingInfo)

    def __len__(self) -> int:
        return len(self.t)

    def __repr__(self) -> str:
        return brief(self, span(self.t), *self.channels, counted(len(self.grip), "grip"), name=self.info.name)

    @property
    def channels(self) -> dict[str, Array]:
        """Name -> readings (n, 3) of each channel that there is."""
        given = {"acc": self.acc, "gyr": self.gyr, "mag": self.mag, "device_rpy": self.device_rpy}
        return {name: values for name, values in given.items() if values is not None}

    @cached_property
    def rate_hz(self) -> float:
        """The measured rate, Hz: the inverse of the median step; if most times are equal, rows per time. 0: unknown."""
        if len(self) < 2:
            return 0.0
        step = float(np.median(np.diff(self.t))) or batched_interval(self.t)
        return 1.0 / step if step else 0.0


def resolution_of(values: Array) -> float:
    """Resolution of readings (n, 3): the smallest difference of two on an axis, in their unit (infinite: all equal)."""
    some = values[:: max(1, len(values) // 4096)]  # rows spread over the recording
    return min(float(np.diff(np.unique(axis)).min(initial=np.inf)) for axis in some.T)


@dataclass(frozen=True, eq=False)
class Truth(Frozen):
    """The sensor's true pose in nav (simulated or optical): t (n,) s, p (n, 3) m, wxyz (n, 4)."""

    t: Array
    p_nav_sensor: Array
    wxyz_nav_sensor: Array

    def __post_init__(self) -> None:
        n = len(self.t)
        freeze_arrays(self, t=(n,), p_nav_sensor=(n, 3), wxyz_nav_sensor=(n, 4))

    def __repr__(self) -> str:
        return brief(self, span(self.t))
