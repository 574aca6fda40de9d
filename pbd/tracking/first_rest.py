"""Find the first rest of a recording, which gives its noise, gyro bias and gravity."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from pbd.data import GRAVITY, Recording
from pbd.data.source_columns import SourceColumns
from pbd.errors import RecordingError, TrackingError
from pbd.frozen_arrays import readonly
from pbd.pose import Array, lengths
from pbd.tracking.moving_windows import PASSES, moving_mean_variance, moving_means, rows_of_mean, window_sums

REST_S, SHORT_REST_S = 1.0, 0.5
"""s: length of the first rest; and of a quiet rest (QUIET_ACC, QUIET_GYR) that is used instead if the hand moves in
every longer one (QUIET_ENERGY). A walking foot stands still for little more than half a second."""

QUIET_RATIO = 4.0
"""A second is quiet if its restlessness is at most this many times that of the quietest second."""

QUIET_ACC, QUIET_GYR = 0.08, 0.02
"""Largest rms of a hand that rests on something, m/s2 and rad/s. In the air it trembles more (zero_velocity)."""

QUIET_ENERGY = 10.0
"""Energy of a window, as a multiple of the first rest's, below which the window is quiet. It is also quiet below the
energy of a hand that rests on something (QUIET_ACC, QUIET_GYR). Likewise, a second is no rest if it is more than this
many times as restless as a quiet half second."""

COUNTS_PER_G = {f"{1.0 / per_g:.14f}".rstrip("0") + "g": per_g for per_g in (16384, 8192, 4096, 2048)}
"""Name of a 16-bit accelerometer's count as a unit -> counts per g, at ranges of 2 to 16 g (InvenSense, MPU-6000 and
MPU-6050 Product Specification). Counts are far more usual than mm/s2, whose 9807 per g are near 8192."""

STILL_ACC, STILL_GYR = 0.5, 0.15
"""rms above which a hand moves, m/s2 and rad/s."""


def restlessness(acc_var: Array | float, gyr_var: Array | float) -> Array:
    """Energies of both sensors, (m/s2)^2 and (rad/s)^2, as one number: 1 at STILL_ACC or STILL_GYR alone."""
    return np.asarray(acc_var / STILL_ACC**2 + gyr_var / STILL_GYR**2)


@dataclass(frozen=True, eq=False)
class Rest:
    """The first rest of a recording, samples start <= i < stop.

    Attributes:
        gravity: m/s2, the norm of mean specific force.
        acc_var: (m/s2)^2, variance of the `moving_means` of specific force, summed over the axes.
        gyr_var: (rad/s)^2, the same of the gyro; 0 without one.
        gyro_bias: (3,) rad/s, the gyro's mean.
        up_sensor: (3,) unit, the vertical in sensor axes.
    """

    start: int
    stop: int
    gravity: float
    acc_var: float
    gyr_var: float
    gyro_bias: Array
    up_sensor: Array

    @property
    def restless(self) -> float:
        """Its `restlessness`."""
        return float(restlessness(self.acc_var, self.gyr_var))


class _Calm(NamedTuple):
    """A calm span, rows start <= i < stop.

    Attributes:
        restless: its `restlessness`.
        acc, gyr: m/s2 and rad/s, rms of the accelerometer and of the gyro in it, all axes together.
        least_acc: m/s2, the smallest rms of the accelerometer in any span of this length.
    """

    start: int
    stop: int
    restless: float
    acc: float
    gyr: float
    least_acc: float

    def is_below(self, acc: float, gyr: float) -> bool:
        return self.acc <= acc and self.gyr <= gyr


def find_rest(recording: Recording, shortest_s: float = SHORT_REST_S) -> Rest:
    """Find the first quiet second of a recording, or half second where the hand moves in any second.

    A shorter recording is taken as a whole. A steady turn about the vertical is as quiet as a rest. So the gyro's mean
    in the rest must be that of most quiet seconds.

    Args:
        recording: without NaN in that rest.
        shortest_s: s, REST_S or SHORT_REST_S.

    Raises:
        RecordingError: at rest the norm of specific force is more than 15 % off standard gravity: another unit.
        TrackingError: the hand never stands still, or the accelerometer is dead.
    """
    gyr = np.zeros_like(recording.acc) if recording.gyr is None else recording.gyr
    calm = _first_calm(recording, gyr, REST_S)
    if shortest_s < REST_S and not calm.is_below(QUIET_ACC, QUIET_GYR):
        shorter = _first_calm(recording, gyr, shortest_s)
        if shorter.is_below(QUIET_ACC, QUIET_GYR) and calm.restless > QUIET_ENERGY * shorter.restless:
            calm = shorter
    start, stop = calm.start, calm.stop
    acc, gyr = recording.acc[start:stop], gyr[start:stop]
    gravity = float(np.linalg.norm(acc.mean(axis=0)))
    if gravity == 0.0:
        raise TrackingError(
            "the accelerometer reads zero while at rest, so it is dead or in free fall; check the sensor", value=0.0
        )
    shakes = calm.acc > STILL_ACC * max(1.0, gravity / GRAVITY)  # in any unit
    _refuse_wrong_units(gravity, recording.info.source, shakes)
    if not calm.is_below(STILL_ACC, STILL_GYR):
        unit = next((column.unit for column in recording.info.source.of("gyr")), "rad/s")
        other = "deg/s" if unit == "rad/s" else "..."
        hint = f" (if the gyro is not in {unit}, give its unit: --unit gyr={other})" * (calm.least_acc <= STILL_ACC)
        raise TrackingError(
            f"the hand never stands still for {REST_S:g} s: at its quietest (t = {recording.t[start]:.1f} s) it shakes "
            f"with {calm.acc:.2f} m/s2 and {calm.gyr:.2f} rad/s; start with two seconds of rest and stop between the "
            f"moves{hint}",
            t=float(recording.t[start]),
            value=calm.acc,
            bound=STILL_ACC,
            turn=calm.gyr,
        )
    k = rows_of_mean(recording.rate_hz)
    return Rest(
        start=start,
        stop=stop,
        gravity=gravity,
        acc_var=float(moving_means(acc, k, PASSES).var(axis=0).sum()),
        gyr_var=float(moving_means(gyr, k, PASSES).var(axis=0).sum()),
        gyro_bias=readonly(gyr.mean(axis=0)),
        up_sensor=readonly(acc.mean(axis=0) / gravity),
    )


def _first_calm(recording: Recording, gyr: Array, length_s: float) -> _Calm:
    """The first span of `length_s` that is about as calm as the calmest; `gyr` is (n, 3) rad/s."""
    length = min(len(recording), round(length_s * recording.rate_hz))
    k = rows_of_mean(recording.rate_hz)
    acc_var, gyr_var = (moving_mean_variance(values, length, k) for values in (recording.acc, gyr))
    lasts = recording.t[length - 1 :] - recording.t[: len(acc_var)]
    # Many samples with the same time stamp are no rest.
    restless = np.where(lasts < 0.5 * np.median(lasts), np.inf, restlessness(acc_var, gyr_var))
    # 1e-6: in a sensor without noise rounding alone makes one span quieter than another.
    quiet = restless <= QUIET_RATIO * restless.min() + 1e-6
    rate = window_sums(gyr, length) / length
    off = lengths(rate - np.median(rate[quiet][::k], axis=0))
    quiet &= off <= max(QUIET_GYR, float(off[quiet].min()))
    start = int(np.argmax(quiet))
    rms = (float(np.sqrt(each)) for each in (acc_var[start], gyr_var[start], acc_var.min()))
    return _Calm(start, start + length, float(restless[start]), *rms)


def likely_unit(norm_at_rest: float, factor: float) -> str | None:
    """Unit of values whose norm at rest, times `factor`, was read as m/s2; None: as it was read, or unknown."""
    if _is_gravity(norm_at_rest):
        return None
    scales = {"g": 1.0 / GRAVITY, "mg": 1e3 / GRAVITY, "cm/s2": 1e2, "m/s2": 1.0}
    scales |= {unit: per_g / GRAVITY for unit, per_g in COUNTS_PER_G.items()} | {"mm/s2": 1e3}
    if factor == 1.0:
        scales["m/s2"] = GRAVITY  # they were read as g before
    return next((unit for unit, scale in scales.items() if _is_gravity(norm_at_rest / (factor * scale))), None)


def _is_gravity(norm_at_rest: float) -> bool:
    return 0.85 < norm_at_rest / GRAVITY < 1.15


def _refuse_wrong_units(norm_at_rest: float, source: SourceColumns, shakes: bool) -> None:
    """Refuse specific force (its norm at rest, m/s2) that is not near gravity, and name the likely reason.

    If the hand `shakes` even then, its norm need not be gravity, and only a likely unit is a reason to refuse it.
    """
    if _is_gravity(norm_at_rest):
        return
    said = f"at rest the accelerometer reads {norm_at_rest:.4g}, but gravity is {GRAVITY:.2f} m/s2"
    if likely := likely_unit(norm_at_rest, source.acc_factor):
        what = "raw counts" if likely in COUNTS_PER_G else f"in {likely}"
        why = f"the values are likely {what}: import the file with --unit acc={source.acc_unit_sign}{likely}"
        why += ", and a gyro's counts with --unit gyr=NUMBERdeg/s" * (likely in COUNTS_PER_G)
    elif shakes:
        return
    elif norm_at_rest < 0.5:  # m/s2: a bare part's bias (20 mg), and what an attitude wrong by 2 degrees leaves
        why = "gravity seems to have been removed: give what the accelerometer itself reads, not linear acceleration"
    elif abs(norm_at_rest / GRAVITY - 1.0) < 0.3:  # cheap boards are off by up to 0.2 g, a wrong unit by more
        raise TrackingError(
            f"{said}; if the unit is right, that is the sensor's own error: measure it with pbd calibrate sensor, and "
            "give that --calibration",
            value=norm_at_rest,
            bound=GRAVITY,
        )
    else:
        why = f"check the unit of the columns {source.names('acc')}"
    raise RecordingError(
        f"{said}; {why}",
        value=norm_at_rest,
        bound=GRAVITY,
        unit=likely,
    )
