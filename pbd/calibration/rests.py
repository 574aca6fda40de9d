"""Find the rests of a sensor that was put down in several orientations, with its mean readings."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pbd.data import Recording
from pbd.data.recording import resolution_of
from pbd.errors import CalibrationError
from pbd.pose import Array

STILL_WINDOW_S, SHORTEST_REST_S, REST_EDGE_S = 0.5, 1.0, 0.2
"""Durations, s: the windows in which stillness is measured, the shortest rest, the margin cut off at each end of it."""

STILL_RATIO = 9.0
"""Largest variance of a still window, relative to that of the quietest window or of rounding, the larger. If readings
are coarse, one window may show a single value while the next alternates between two."""

REST_ACC, REST_GYR = 0.1, np.radians(1.0)
"""A sensor that shakes more than this, m/s2 and rad/s rms over a window, all axes together, is not still. On a table it
shakes less."""

SURELY_STILL_ACC, SURELY_STILL_GYR = 0.02, np.radians(0.1)
"""A sensor that shakes less than this, m/s2 and rad/s rms over a window, all axes together, is always still."""

RATE_DEVIATION = np.radians(0.3)
"""Largest deviation, rad/s, of a window's mean rate from the median over still windows, beyond noise. A sensor that
turns at constant rate exceeds it; a wandering bias does not."""

SAME_ORIENTATION_DEG = 15.0
"""Angle, degrees, between the verticals of two rests, below which they count as one orientation."""


@dataclass(frozen=True, eq=False)
class Rests:
    """Mean readings of a sensor at k rests.

    Attributes:
        start, stop: (k,) half-open ranges of rows.
        seconds: (k,) s, duration.
        acc: (k, 3) m/s2.
        gyr: (k, 3) rad/s, or None.
        mag: (k, 3) uT, or None.
        acc_noise, gyr_noise, mag_noise: rms per sample and axis, in the same units; 0 without that sensor.
        turning: number of further rests that are left out, by RATE_DEVIATION.
    """

    start: NDArray[np.intp]
    stop: NDArray[np.intp]
    seconds: Array
    acc: Array
    gyr: Array | None
    mag: Array | None
    acc_noise: float
    gyr_noise: float
    mag_noise: float
    turning: int = 0

    def __len__(self) -> int:
        return len(self.start)

    @property
    def samples(self) -> NDArray[np.intp]:
        """Number of samples in each rest, (k,)."""
        return self.stop - self.start

    @property
    def up_sensor(self) -> Array:
        """Unit vertical by the accelerometer, (k, 3), in sensor axes."""
        return np.asarray(self.acc / np.linalg.norm(self.acc, axis=1, keepdims=True))


def find_rests(recording: Recording) -> Rests:
    """Find all rests of SHORTEST_REST_S or more, by the variance of both sensors relative to the quietest window.

    Source: the static detector of D. Tedaldi, A. Pretto and E. Menegatti, A robust and easy to implement method for IMU
    calibration without external equipments, ICRA 2014.

    Args:
        recording: without NaN.

    Raises:
        CalibrationError: the sensor was never still, or the recording is too short.
    """
    from scipy.ndimage import find_objects, label

    rate = recording.rate_hz
    length = max(4, round(STILL_WINDOW_S * rate))
    if len(recording) < length:
        raise CalibrationError(
            f"the recording lasts only {recording.t[-1]:.1f} s; put the sensor down for two seconds in each orientation"
        )
    acc_var, _ = _moving(recording.acc, length)
    still = quiet = _still(recording, "accelerometer", recording.acc, acc_var, REST_ACC, SURELY_STILL_ACC, "m/s2", 1.0)
    if recording.gyr is not None:
        gyr_var, gyr_mean = _moving(recording.gyr, length)
        quiet &= _still(
            recording, "gyro", recording.gyr, gyr_var, REST_GYR, SURELY_STILL_GYR, "degrees/s", 180.0 / np.pi
        )
        if quiet.any():
            tolerance = np.hypot(RATE_DEVIATION, 4.0 * np.sqrt(np.median(gyr_var[quiet]) / length))
            off = np.linalg.norm(gyr_mean - np.median(gyr_mean[quiet], axis=0), axis=1)
            still = quiet & (off < tolerance)
    edge = round(REST_EDGE_S * rate)

    def spans_of(windows: NDArray[np.bool_]) -> list[tuple[int, int]]:
        spans = ((rows.start, rows.stop + length - 1) for (rows,) in find_objects(label(windows)[0]))
        return [(start + edge, stop - edge) for start, stop in spans if (stop - start) / rate >= SHORTEST_REST_S]

    spans = spans_of(still)
    turning = max(0, len(spans_of(quiet)) - len(spans))
    if not spans:
        raise CalibrationError(
            f"the sensor was never still for {SHORTEST_REST_S:g} s; put it down for two seconds in each orientation, "
            "on something that does not shake",
            bound=SHORTEST_REST_S,
        )
    start, stop = np.array(spans, dtype=np.intp).T

    def means(values: Array | None) -> tuple[Array | None, float]:
        if values is None:
            return None, 0.0
        noise = np.mean([values[a:b].var(axis=0).mean() for a, b in spans])
        return np.array([values[a:b].mean(axis=0) for a, b in spans]), float(np.sqrt(noise))

    (acc, acc_noise), (gyr, gyr_noise), (mag, mag_noise) = map(means, (recording.acc, recording.gyr, recording.mag))
    assert acc is not None
    return Rests(start, stop, (stop - start) / rate, acc, gyr, mag, acc_noise, gyr_noise, mag_noise, turning)


def rms(values: Array) -> float:
    """Return the root mean square."""
    return float(np.sqrt(np.mean(values**2)))


def count_orientations(up_sensor: Array) -> int:
    """Return the number of different orientations among unit verticals (k, 3)."""
    found: list[Array] = []
    for up in up_sensor:
        if all(up @ other < np.cos(np.radians(SAME_ORIENTATION_DEG)) for other in found):
            found.append(up)
    return len(found)


def _still(
    recording: Recording,
    what: str,
    values: Array,
    variance: Array,
    still: float,
    floor: float,
    unit: str,
    factor: float,
) -> NDArray[np.bool_]:
    """Say in which windows a sensor is still.

    Args:
        recording: for the time in the message.
        what: name of the sensor.
        values: its readings (n, 3).
        variance: their variance in each window, summed over the axes.
        still, floor: upper and lower bound of the threshold on the root of the variance, in SI units.
        unit, factor: unit in the message, and how many of it are one SI unit.

    Raises:
        CalibrationError: it was never still.
    """
    quietest = float(variance.min())
    if quietest > still**2:
        raise CalibrationError(
            f"the sensor was never still: at its quietest (t = {recording.t[int(np.argmin(variance))]:.1f} s) the "
            f"{what} shakes by {factor * np.sqrt(quietest):.2f} {unit}; put it down for two seconds in each "
            "orientation",
            value=float(np.sqrt(quietest)),
            bound=still,
        )
    rounding = 3.0 * resolution_of(values) ** 2 / 12.0
    return np.asarray(variance <= np.clip(STILL_RATIO * max(quietest, rounding), floor**2, still**2))


def _moving(values: Array, length: int) -> tuple[Array, Array]:
    """Return variance (n - length + 1,), summed over the axes, and mean (..., 3) of each window of `length` samples."""
    from scipy.ndimage import uniform_filter1d

    middle = values.mean(axis=0)
    centred = values - middle  # keeps the difference of squares well conditioned
    full_windows = slice(length // 2, length // 2 + len(values) - length + 1)
    mean, square = (uniform_filter1d(x, length, axis=0)[full_windows] for x in (centred, centred**2))
    return np.maximum((square - mean**2).sum(axis=1), 0.0), mean + middle
