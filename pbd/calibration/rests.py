"""Find the rests of a sensor that was put down in several orientations, with its mean readings."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pbd.data import Recording
from pbd.data.recording import resolution_of
from pbd.errors import CalibrationError
from pbd.pose import Array

SHORTEST_REST_S = 1.0
"""Duration of the shortest rest, s."""

SHAKES = {
    "accelerometer": (0.1, 0.02, 1.0, "m/s2"),
    "gyro": (np.radians(1.0), np.radians(0.1), np.pi / 180.0, "degrees/s"),
}
"""Sensor -> how much it shakes, m/s2 or rad/s rms over a window, all axes together: more than the first, and it is not
still, as on a table it shakes less; less than the second, and it always is. Then the unit for messages."""


@dataclass(frozen=True, eq=False)
class Rests:
    """Mean readings of a sensor at k rests.

    Attributes:
        start, stop: (k,) half-open ranges of rows.
        acc: (k, 3) m/s2.
        gyr: (k, 3) rad/s, or None.
        mag: (k, 3) uT, or None.
        acc_noise, gyr_noise, mag_noise: rms per sample and axis, in the same units; 0 without that sensor.
        turning: number of further rests that are left out, because the sensor turned slowly.
    """

    start: NDArray[np.intp]
    stop: NDArray[np.intp]
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
    rate = recording.rate_hz
    length = max(4, round(0.5 * rate))  # of a window, half a second
    if len(recording) < length:
        raise CalibrationError(
            f"the recording lasts only {recording.t[-1]:.1f} s; put the sensor down for two seconds in each orientation"
        )
    acc_var, _ = _moving(recording.acc, length)
    still = quiet = _still("accelerometer", recording.t, recording.acc, acc_var)
    if recording.gyr is not None:
        gyr_var, gyr_mean = _moving(recording.gyr, length)
        quiet &= _still("gyro", recording.t, recording.gyr, gyr_var)
        if quiet.any():
            # A sensor that turns at constant rate deviates by more than 0.3 degrees/s; a wandering bias does not.
            tolerance = np.hypot(np.radians(0.3), 4.0 * np.sqrt(np.median(gyr_var[quiet]) / length))
            off = np.linalg.norm(gyr_mean - np.median(gyr_mean[quiet], axis=0), axis=1)
            still = quiet & (off < tolerance)
    spans = _long_spans(still, length, rate)
    turning = max(0, len(_long_spans(quiet, length, rate)) - len(spans))
    if not spans:
        raise CalibrationError(
            f"the sensor was never still for {SHORTEST_REST_S:g} s; put it down for two seconds in each orientation, "
            "on something that does not shake",
            bound=SHORTEST_REST_S,
        )
    start, stop = np.array(spans, dtype=np.intp).T
    mean, noise = dict[str, Array](), dict.fromkeys(("acc", "gyr", "mag"), 0.0)
    for name, values in recording.channels.items():
        mean[name] = np.array([values[a:b].mean(axis=0) for a, b in spans])
        noise[name] = float(np.sqrt(np.mean([values[a:b].var(axis=0).mean() for a, b in spans])))
    acc, gyr, mag = mean["acc"], mean.get("gyr"), mean.get("mag")
    return Rests(start, stop, acc, gyr, mag, noise["acc"], noise["gyr"], noise["mag"], turning)


def rms(values: Array) -> float:
    """Return the root mean square."""
    return float(np.sqrt(np.mean(values**2)))


def count_orientations(up_sensor: Array) -> int:
    """Return the number of orientations that differ by 15 degrees or more among unit verticals (k, 3)."""
    found: list[Array] = []
    for up in up_sensor:
        if all(up @ other < np.cos(np.radians(15.0)) for other in found):
            found.append(up)
    return len(found)


def _still(what: str, t: Array, values: Array, variance: Array) -> NDArray[np.bool_]:
    """Say in which windows a sensor of SHAKES is still, with readings (n, 3) and their variance, summed over the axes.

    Raises:
        CalibrationError: it was never still.
    """
    still, floor, unit_si, unit = SHAKES[what]
    quietest = float(variance.min())
    if quietest > still**2:
        raise CalibrationError(
            f"the sensor was never still: at its quietest (t = {t[int(np.argmin(variance))]:.1f} s) the "
            f"{what} shakes by {np.sqrt(quietest) / unit_si:.2f} {unit}; put it down for two seconds in each "
            "orientation",
            value=float(np.sqrt(quietest)),
            bound=still,
        )
    rounding = 3.0 * resolution_of(values) ** 2 / 12.0
    # Three times as much, because one window of coarse readings may show one value while the next alternates.
    return np.asarray(variance <= np.clip(3.0**2 * max(quietest, rounding), floor**2, still**2))


def _long_spans(windows: NDArray[np.bool_], length: int, rate_hz: float) -> list[tuple[int, int]]:
    """Return the rows of each run of windows of `length` samples that is a rest, without 0.2 s at each end."""
    from scipy.ndimage import find_objects, label

    edge = round(0.2 * rate_hz)
    spans = ((rows.start, rows.stop + length - 1) for (rows,) in find_objects(label(windows)[0]))
    return [(start + edge, stop - edge) for start, stop in spans if (stop - start) / rate_hz >= SHORTEST_REST_S]


def _moving(values: Array, length: int) -> tuple[Array, Array]:
    """Return variance (n - length + 1,), summed over the axes, and mean (..., 3) of each window of `length` samples."""
    from scipy.ndimage import uniform_filter1d

    middle = values.mean(axis=0)
    centred = values - middle  # keeps the difference of squares well conditioned
    full_windows = slice(length // 2, length // 2 + len(values) - length + 1)
    mean, square = (uniform_filter1d(x, length, axis=0)[full_windows] for x in (centred, centred**2))
    return np.maximum((square - mean**2).sum(axis=1), 0.0), mean + middle
