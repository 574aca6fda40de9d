"""Every physical parameter of the estimator: the noise of the sensor and the motion of the hand.

White noise is measured in the recording's own rest. The rest of a sensor's errors is of its class, by data sheets;
what a hand does is physiology. `gyr_turn`, `acc_motion`, `acc_bend` and the walks were chosen with the recordings of
the benchmark in view.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from pbd.data import Recording, SensorErrors
from pbd.data.units import DEG, MG
from pbd.pose import Array, lengths
from pbd.tracking.first_rest import Rest
from pbd.tracking.moving_windows import calmed, rows_of_mean, squares, whiteness

OUTLIER_SIGMAS = 3.0
"""Deviation in sigmas along one axis that is no chance (0.27 %). There a robust factor hardly counts, a claim is
refused and a lag is real."""


@dataclass(frozen=True)
class SensorClass:
    """Spread over the devices of a class, one sigma: what calibration at the maker's leaves.

    Attributes:
        acc_bias: m/s2.
        acc_scale: share, of each axis and of each angle between axes (rad).
        gyr_scale: the same of the gyro.
        gyr_walk: rad/s/sqrt(s), random walk of the gyro's bias in the hand.
        acc_walk: m/s2/sqrt(s), of the accelerometer's.
    """

    acc_bias: float
    acc_scale: float
    gyr_scale: float
    gyr_walk: float = 0.02 * DEG
    acc_walk: float = 0.003


CALIBRATED = SensorClass(2.0 * MG, 0.001, 0.001, 0.002 * DEG, 0.0003)
"""Calibrated one by one, over temperature: Xsens MTi, VectorNav VN-100, x-IMU3 (data sheets; walks a tenth)."""

FACTORY = SensorClass(3.0 * MG, 0.005, 0.005)
"""A research part after calibration; also what nothing is known of."""

COMPASS = SensorClass(5.0 * MG, 0.003, 0.003)
"""OceanServer's compasses (data sheet)."""

BARE = SensorClass(20.0 * MG, 0.01, 0.01)
"""A bare MEMS part, as phones have them too (InvenSense MPU-6050, -9250, Bosch BMI160, ST LSM6DSO data sheets: zero-g
offset, sensitivity tolerance)."""

IDEAL = SensorClass(1e-3 * MG, 1e-6, 1e-6, 1e-6 * DEG, 1e-6)
"""The simulator's that errs in nothing."""

CLASSES = {
    "modern": CALIBRATED,
    "xsens": CALIBRATED,
    "vectornav": CALIBRATED,
    "ximu3": CALIBRATED,
    "ideal": IDEAL,
    "os5000": COMPASS,
    "wt901": BARE,
    "witmotion": BARE,
    "razor": BARE,
    "phone": BARE,
    "phyphox": BARE,
}
"""By a word in the recording's `info.sensor`."""


@dataclass(frozen=True)
class Noise:
    """Standard deviations and densities in SI, one sigma per axis.

    The white densities are measured at rest, the class is the sensor's, the others hold for all.
    """

    gyr_density: float
    """rad/s/sqrt(Hz), white; measured at rest."""

    acc_density: float
    """m/s2/sqrt(Hz), white; measured at rest."""

    device: SensorClass
    """What the device's own errors may be."""

    gyr_turn: float = 0.0007
    """rad/sqrt(rad): a random walk of attitude that grows with turning (nonlinearity, 0.1 % of 0.5 rad)."""

    gyr_bias: float = 0.5 * DEG
    """rad/s: the gyro's bias, about its mean over the first rest."""

    acc_motion: float = 0.0005
    """1/sqrt(Hz): a share of the motion's acceleration (vibration rectification, nonlinearity of 0.5 %)."""

    acc_bend: float = 0.5
    """Share of what lies between samples, as far as fourth differences show it, that a low-pass loses."""

    bend_knee: float = 10.0
    """m/s2: smooth bends below this integrate exactly, as samples are means; impacts do not."""

    lag: float = 0.001
    """s: by which a gyro is late behind its accelerometer (group delays in MEMS makers' register maps: 0.3 to 2 ms)."""

    lag_sigma: float = 0.0007
    """s: how the lag differs from device to device."""

    gravity: float = 9.80
    """m/s2: half-way between the equator and 60 degrees of latitude."""

    gravity_sigma: float = 0.02
    """m/s2: how gravity differs over the inhabited earth."""

    still_speed: float = 0.001
    """m/s: how fast a hand that holds still creeps."""

    still_shift: float = 0.002
    """m: how far a hand that holds still strays from one knot to the next."""

    still_turn: float = 0.01 * DEG
    """rad: how far a hand that holds still turns from one knot to the next, where the gyro sees no sway."""

    tremor_hz: float = 8.0
    """Hz: what shakes a hand that holds still is no slower (physiological tremor has 8 to 12 Hz)."""

    still_lever: float = 0.03
    """m: how the point that stands still, where the hand turns about it, differs from stop to stop."""

    pivot: float = 0.15
    """m: how far from the sensor that point is in the mean: a wrist, or where a foot treads."""

    reach: float = 2.0
    """m: how far from its first rest a hand is taken to be, for each second; walks go further (Cauchy)."""

    compass: float = 0.15
    """rad sqrt(s): heading from a room's magnetic field, its wander averaged over a second."""

    field: float = 0.08
    """Share of the field by which a room's differs from that at the first rest; more is a magnet."""

    device_lag: float = 0.3
    """s: by which a device's own attitude is late where it low-passes it (OceanServer's manual)."""

    device_turn: float = 0.5 * DEG
    """rad: how well a device's own attitude holds (data sheets of compasses: 0.5 to 1 degree)."""

    unseen_speed: float = 0.1
    """m/s: how fast a hand may move on average in a hole of the data. (With 5 m/s2, from rest to rest, in 0.12 s; a
    longer hole is refused unless a person says that the hand stood still.)"""

    unseen_rate: float = 0.2
    """rad/s: the same of its turning, about an elbow half a metre away."""


FINEST_STEP = 1e-12
"""m/s2 or rad/s: a smaller difference between readings is floating-point rounding."""

STEP_ROWS = 4096
"""Number of rows, spread over a recording, that suffice to find the step of its readings."""


def noise_of(recording: Recording, rest: Rest, errors: SensorErrors | None = None) -> Noise:
    """Noise of a recording: white densities from its rest, the rest from the sensor's class, or calibration's.

    Args:
        recording: names its sensor.
        rest: a quiet second.
        errors: of a calibration, which have been taken out; it knows gravity where it was made.
    """
    device = next((found for word, found in CLASSES.items() if word in recording.info.sensor), FACTORY)
    gravity = Noise.gravity
    if errors is not None and errors.acc is not None:
        device, gravity = CALIBRATED, errors.gravity
    white = 3.0 * whiteness(rows_of_mean(recording.rate_hz))
    gyr, gyr_held = (0.0, 0.0) if recording.gyr is None else _rounding(recording.gyr, np.sqrt(rest.turn / white))
    acc, acc_held = _rounding(recording.acc, np.sqrt(rest.shake / white))
    device = replace(
        device,
        acc_bias=float(np.hypot(device.acc_bias, acc_held)),
        gyr_walk=float(np.hypot(device.gyr_walk, gyr_held)),
        acc_walk=float(np.hypot(device.acc_walk, acc_held)),
    )
    root = recording.rate_hz**-0.5
    return Noise(gyr * root, acc * root, device, gravity=gravity)


def _rounding(values: Array, rms: float) -> tuple[float, float]:
    """White noise of readings (n, 3) per sample and axis; and what rounding leaves over where they hardly change.

    Their step is the smallest difference between two of them. Noise larger than the step makes the rounding white
    (it is a dither); of smaller noise a share exp(-2 pi^2 rms^2 / step^2) stays the same as long as the reading does,
    and changes from one rest to another: a random walk of a second.

    Args:
        values: of one sensor.
        rms: at rest, per axis.

    Source: B. Widrow, I. Kollar, Quantization noise, Cambridge 2008, 9.
    """
    some = values[:: max(1, len(values) // STEP_ROWS)]
    step = min(float(np.diff(np.unique(axis)).min(initial=np.inf)) for axis in some.T)
    if not FINEST_STEP < step < np.inf:
        return rms, 0.0
    rounding = step / np.sqrt(12.0)
    return max(rms, rounding), rounding * float(np.exp(-2.0 * (np.pi * rms / step) ** 2))


def acc_doubt(noise: Noise, rest: Rest) -> float:
    """Factor on the class' accelerometer sigmas: gravity at rest shows how large its errors are."""
    shown = abs(rest.gravity - noise.gravity)
    return float(np.hypot(1.0, max(shown - 2.0 * noise.gravity_sigma, 0.0) / noise.device.acc_bias))


def densities(noise: Noise, gyr: Array, u: Array, dt: float, up: Array | None = None) -> tuple[Array, Array]:
    """Densities of gyro and accelerometer noise at each row: (3, n) rad2/s and (3, n) m2/s3.

    The three parts, which add up: white noise as measured at rest, what turning adds, what motion adds.

    Args:
        noise: the parameters.
        gyr: (n, 3) rad/s, without bias.
        u: (n, 3) m/s2, specific force in the gyro frame.
        dt: s, sampling interval.
        up: (3,) m/s2, specific force at rest; by default the mean of u, which in a whole recording it is.
    """
    s_g, s_a = np.zeros((3, len(u))), np.zeros((3, len(u)))
    s_g[0], s_a[0] = noise.gyr_density**2, noise.acc_density**2
    s_g[1] = noise.gyr_turn**2 * lengths(gyr)
    motion = u - (np.full(len(u), 1.0 / len(u)) @ u if up is None else up)
    s_a[2] = noise.acc_motion**2 * np.einsum("ij,ij->i", motion, motion)
    between = np.full(len(u), np.inf)
    for n in {1, rows_of_mean(1.0 / dt)}:  # what shakes fast bends samples, but not means
        edge = 3 * n - 1
        if len(u) > 2 * edge:
            bend = _bends(calmed(u, n, 2), n, noise, dt)
            inner = noise.acc_bend * n * dt / 12.0 * bend**2 / (bend + noise.bend_knee**2)
            between[edge:-edge] = np.minimum(between[edge:-edge], inner)
    s_a[2, 2:-2] += between[2:-2]
    return s_g, s_a


def _bends(means: Array, n: int, noise: Noise, dt: float) -> Array:
    """Squares of second differences without those of white noise, (m2/s4), by fourth ones, which no steady jerk has.

    Args:
        means: (m, 3) m/s2, moving means over n samples, taken twice.
        n: samples; also of a difference.
        noise: of the accelerometer.
        dt: s, between samples.
    """
    second = means[2 * n :] - 2.0 * means[n:-n] + means[: -2 * n]
    fourth = second[2 * n :] - 2.0 * second[n:-n] + second[: -2 * n]
    # Of white noise alone fourth differences have 70 variances, second ones 6.
    white = 6.0 * 3.0 * noise.acc_density**2 / dt * whiteness(n, 2)
    bends: Array = np.maximum(6.0 / 70.0 * squares(fourth) - white, 0.0)
    return bends
