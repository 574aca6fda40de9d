"""Models of a sensor's errors, drawn for each device, and presets.

Noise, bias, range and rate of the presets are assumptions, typical of such parts. Biases and scales are the spread over
devices after the maker's calibration. Figures marked as assumed are guesses: no source was at hand.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from math import inf, sqrt

import numpy as np

from pbd.data.units import DEG, MG
from pbd.errors import SensorError
from pbd.pose import Array, quat_exp, quat_multiply, quat_to_rpy


@dataclass(frozen=True)
class Triad:
    """The errors of three axes that measure one vector, in the unit U of that vector (m/s2, rad/s or uT).

    Attributes:
        noise: white noise density, U/sqrt(Hz): the mean over T seconds has a standard deviation of noise / sqrt(T).
        bias: constant bias of an axis, one sigma over devices, U.
        bias_walk: random walk of the bias, U/sqrt(s): one sigma after T seconds is bias_walk * sqrt(T).
        scale: relative scale error of an axis, one sigma over devices.
        misalignment: each of the six angles by which an axis leans towards another, one sigma over devices, rad.
        limit: largest absolute output, U. Larger values saturate.
        step: resolution of the output, U; 0: continuous.
    """

    noise: float = 0.0
    bias: float = 0.0
    bias_walk: float = 0.0
    scale: float = 0.0
    misalignment: float = 0.0
    limit: float = inf
    step: float = 0.0

    def measure(
        self, true: Array, interval_s: Array, rng: np.random.Generator, device: np.random.Generator | None = None
    ) -> Array:
        """Draw a device and its noise; return its readings (n, 3) of true means (n, 3) over intervals (n,) s.

        The device's gain and bias come from `device`, if that is given, and all else from `rng`.
        """
        # All random numbers are drawn in any case, so that models that differ in one figure differ in its effect only.
        made = rng if device is None else device
        gain = np.eye(3) + np.diag(self.scale * made.normal(size=3))
        gain += self.misalignment * made.normal(size=(3, 3)) * (1.0 - np.eye(3))
        bias = self.bias * made.normal(size=3)
        root = np.sqrt(interval_s)[:, None]
        white, steps = rng.normal(size=(2, *true.shape))
        drift = np.cumsum(self.bias_walk * root * steps, axis=0)
        read = np.clip(true @ gain.T + bias + drift + self.noise / root * white, -self.limit, self.limit)
        return _rounded(read, self.step)


@dataclass(frozen=True)
class AttitudeOutput:
    """A device's own roll, pitch and yaw: the true attitude, delayed and rounded.

    Acceleration of the hand does not disturb it, as if a gyro aided it. A tilt compass without a gyro would be off by
    more than ten degrees in the paper's moves, too much for the paper's method, which relies on this attitude.

    Attributes:
        time_constant_s: time constant of its first-order low-pass.
        noise: one sigma per sample about each axis, rad.
        step: resolution of each angle, rad; 0: continuous.
    """

    time_constant_s: float = 0.0
    noise: float = 0.0
    step: float = 0.0

    def measure(self, wxyz: Array, rate_hz: float, rng: np.random.Generator) -> Array:
        """Return roll, pitch, yaw (n, 3) rad for true attitudes (n, 4), which are continuous from sample to sample."""
        # The low-pass acts on the quaternion: unlike angles it has neither wrap-around nor gimbal lock.
        smooth = _low_pass(wxyz, self.time_constant_s * rate_hz)
        smooth /= np.linalg.norm(smooth, axis=-1, keepdims=True)
        rpy = quat_to_rpy(quat_multiply(smooth, quat_exp(self.noise * rng.normal(size=(len(wxyz), 3)))))
        return _rounded(rpy, self.step)


def _rounded(values: Array, step: float) -> Array:
    rounded: Array = step * np.round(values / step) if step else values
    return rounded


def _low_pass(x: Array, samples: float) -> Array:
    """First-order low-pass of (n, k) with a time constant in samples, in steady state at the start."""
    if samples == 0.0:
        return x.copy()
    keep = np.exp(-1.0 / samples)
    kernel = (1.0 - keep) * keep ** np.arange(min(len(x), int(40.0 * samples) + 1))  # cut off at e^-40
    smooth = np.stack([np.convolve(column, kernel)[: len(x)] for column in (x - x[0]).T], axis=-1)
    return np.asarray(x[0] + smooth, dtype=np.float64)


@dataclass(frozen=True)
class SensorModel:
    """A kind of sensor.

    Attributes:
        name: the model's name.
        rate_hz: samples per second.
        acc, gyr, mag: errors in m/s2, rad/s and uT; None: it has no such sensor.
        attitude: its own roll, pitch, yaw, or None.
        jitter_s: one sigma of the time error of a border between two sampling intervals; errors are at most 0.45
            intervals.
        has_clock: whether `t` is the true middle of each interval; if not, `t` is evenly spaced despite the jitter.

    Raises:
        SensorError: the rate is not above 0.
    """

    name: str
    rate_hz: float
    acc: Triad = field(default_factory=Triad)
    gyr: Triad | None = field(default_factory=Triad)
    mag: Triad | None = field(default_factory=Triad)
    attitude: AttitudeOutput | None = None
    jitter_s: float = 0.0
    has_clock: bool = True

    def __post_init__(self) -> None:
        if not 0.0 < self.rate_hz < inf:
            raise SensorError(
                f"sensor model {self.name!r} has a rate of {self.rate_hz} Hz; give one above 0",
                sensor=self.name,
                value=self.rate_hz,
            )


def _triad(unit: float, *, scale: float, lean_deg: float, **in_unit: float) -> Triad:
    """Make a triad from figures in `unit` (in m/s2 or rad/s) and degrees. All figures of walk and lean are assumed."""
    figures = {name: value * unit for name, value in in_unit.items()}
    return Triad(scale=scale, misalignment=lean_deg * DEG, **figures)


_OS5000 = SensorModel(
    "os5000",
    rate_hz=40.0,
    acc=_triad(MG, noise=0.4, bias=5.0, bias_walk=0.01, scale=3e-3, lean_deg=0.1, limit=4000.0, step=1.0),
    # assumed: scale as the accelerometer's, 16 bits
    gyr=_triad(DEG, noise=0.03, bias=0.3, bias_walk=5e-4, scale=3e-3, lean_deg=0.1, limit=500.0, step=500.0 / 32768),
    mag=Triad(noise=0.3 / sqrt(40.0), step=0.1),  # assumed: 1 milligauss
    attitude=AttitudeOutput(time_constant_s=0.3, step=0.1 * DEG),
)

_WT901 = SensorModel(
    "wt901",
    rate_hz=100.0,
    acc=_triad(MG, noise=0.2, bias=20.0, bias_walk=0.01, scale=1e-2, lean_deg=0.2, limit=16000.0, step=16000.0 / 32768),
    # assumed: scale as the accelerometer's
    gyr=_triad(DEG, noise=0.02, bias=0.2, bias_walk=5e-4, scale=1e-2, lean_deg=0.2, limit=2000.0, step=2000.0 / 32768),
    mag=Triad(noise=0.2 / sqrt(100.0), step=0.15),  # assumed: that of an AK8963
    attitude=AttitudeOutput(time_constant_s=0.05, noise=0.1 * DEG, step=180.0 / 32768 * DEG),  # assumed except step
)

_MODERN = SensorModel(
    "modern",
    rate_hz=100.0,
    acc=_triad(MG, noise=0.06, bias=2.0, bias_walk=2e-3, scale=1e-3, lean_deg=0.05, limit=16000.0),
    # assumed: scale as the accelerometer's, limit
    gyr=_triad(DEG, noise=0.005, bias=0.05, bias_walk=1e-4, scale=1e-3, lean_deg=0.05, limit=2000.0),
    mag=Triad(noise=0.1 / sqrt(100.0)),
    attitude=AttitudeOutput(time_constant_s=0.02, noise=0.05 * DEG),  # assumed
)

_PHONE = SensorModel(
    "phone",
    rate_hz=100.0,
    # assumed: range as most phones have it; scale of both between wt901 and modern; 16 bits
    acc=_triad(MG, noise=0.18, bias=20.0, bias_walk=0.01, scale=5e-3, lean_deg=0.2, limit=8000.0, step=8000.0 / 32768),
    gyr=_triad(DEG, noise=0.01, bias=0.1, bias_walk=5e-4, scale=5e-3, lean_deg=0.2, limit=2000.0, step=2000.0 / 32768),
    mag=Triad(noise=0.3 / sqrt(100.0), step=0.15),  # assumed: that of an AK0991x
)

_NO_GYRO = replace(_OS5000, name="os5000-nogyro", gyr=None)
SENSOR_MODELS: Mapping[str, SensorModel] = {
    model.name: model for model in (_OS5000, _NO_GYRO, _WT901, _MODERN, _PHONE, SensorModel("ideal", 100.0))
}
"""Name -> preset. os5000: the paper's device plus a three-axis gyro. modern: the class of an MTi. phone: 8 g and
its maker's calibration. ideal: no errors."""
