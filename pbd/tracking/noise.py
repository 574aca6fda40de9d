"""All physical parameters of the estimator: the sensor's errors and the motion of the hand.

White noise is measured in the first rest. The sensor's other errors are those of its class, from data sheets. The
hand's parameters are from physiology. `gyr_turn`, `acc_motion`, `acc_bend` and the random walks were tuned on the
benchmark's recordings.
"""

from dataclasses import dataclass, replace

import numpy as np

from pbd.data import LinearErrors, Recording, SensorErrors
from pbd.data.units import DEG, GRAVITY_SIGMA, MG
from pbd.pose import Array, lengths
from pbd.tracking.first_rest import Rest
from pbd.tracking.moving_windows import moving_means, rows_of_mean, squares, white_noise_variance
from pbd.tracking.white_noise import steps_of, white_noise

OUTLIER_SIGMAS = 3.0
"""An error of more sigmas along one axis is an outlier; by chance, 0.27 % of errors are. A robust factor loses its
weight there, a claim is refused, and a lag is taken as real."""


@dataclass(frozen=True)
class SensorClass:
    """One sigma of a device's errors after the maker's calibration, over the devices of a class.

    Attributes:
        acc_bias: m/s2.
        acc_scale: relative scale error of each axis, and error of each angle between axes (rad).
        gyr_scale: the same of the gyro.
        gyr_walk: rad/s/sqrt(s), random walk of the gyro's bias in the hand.
        acc_walk: m/s2/sqrt(s), random walk of the accelerometer's bias in the hand.
    """

    acc_bias: float
    acc_scale: float
    gyr_scale: float
    gyr_walk: float = 0.02 * DEG
    acc_walk: float = 0.003


CALIBRATED = SensorClass(2.0 * MG, 0.001, 0.001, 0.002 * DEG, 0.0003)
"""Calibrated one by one, over temperature: Xsens MTi, VectorNav VN-100, x-IMU3 (data sheets; walks a tenth)."""

FACTORY = SensorClass(3.0 * MG, 0.005, 0.005)
"""A research part after calibration. Also for an unknown sensor."""

BARE = SensorClass(20.0 * MG, 0.01, 0.01)
"""A bare MEMS part, as in phones (InvenSense MPU-6050, -9250, Bosch BMI160, ST LSM6DSO data sheets: zero-g
offset, sensitivity tolerance)."""

CLASSES = {
    **dict.fromkeys(("modern", "xsens", "vectornav", "ximu3"), CALIBRATED),
    "ideal": SensorClass(1e-3 * MG, 1e-6, 1e-6, 1e-6 * DEG, 1e-6),  # the simulator's sensor without errors
    "os5000": SensorClass(5.0 * MG, 0.003, 0.003),  # OceanServer's compasses (data sheet)
    **dict.fromkeys(("wt901", "witmotion", "razor", "openlog", "metawear", "phone", "phyphox"), BARE),
}
"""Word in the recording's `info.sensor` -> class."""


@dataclass(frozen=True)
class Noise:
    """One sigma per axis, or densities, in SI.

    The white densities are measured at rest, `sensor` depends on its class, all else holds for every sensor and hand.
    """

    gyr_density: float
    """rad/s/sqrt(Hz), white; measured at rest."""

    acc_density: float
    """m/s2/sqrt(Hz), white; measured at rest."""

    sensor: SensorClass
    """Priors of the sensor's errors."""

    gyr_turn: float = 0.0007
    """rad/sqrt(rad): random walk of attitude per angle turned (nonlinearity: 0.1 % of 0.5 rad)."""

    gyr_bias: float = 0.5 * DEG
    """rad/s: the gyro's bias, relative to its mean rate in the first rest."""

    acc_motion: float = 0.0005
    """1/sqrt(Hz): noise per m/s2 of the motion's acceleration (vibration rectification, nonlinearity of 0.5 %)."""

    acc_bend: float = 0.5
    """Share of the motion between samples, estimated from fourth differences, that the sensor's low-pass loses."""

    bend_knee: float = 10.0
    """m/s2: below this bend of the acceleration nothing is lost, because samples are means. Impacts bend more."""

    lag: float = 0.001
    """s: lag of a gyro behind its accelerometer (group delays in MEMS makers' register maps: 0.3 to 2 ms)."""

    lag_sigma: float = 0.0007
    """s: how much the lag differs between devices."""

    wide_lag_sigma: float = 0.03
    """s: the same where a sensor's filters may differ (two low-pass filters of one chip)."""

    gravity: float = 9.80
    """m/s2: half-way between the equator and 60 degrees of latitude."""

    gravity_sigma: float = GRAVITY_SIGMA
    """m/s2: how much gravity varies over the inhabited earth."""

    still_speed: float = 0.001
    """m/s: speed at which a hand that holds still creeps."""

    still_shift: float = 0.002
    """m: how far a hand that holds still moves from knot to knot."""

    still_turn: float = 0.01 * DEG
    """rad: how far a hand that holds still turns from knot to knot, if the gyro shows no sway."""

    tremor_hz: float = 8.0
    """Hz: lowest frequency at which a hand that holds still shakes (physiological tremor: 8 to 12 Hz)."""

    pivot_scatter: float = 0.03
    """m: how much the pivot's place relative to the sensor differs from stop to stop. The pivot is the fixed point
    about which a swaying hand turns."""

    pivot_distance: float = 0.15
    """m: mean distance of the pivot from the sensor: a wrist, or the point on which a foot treads."""

    reach: float = 2.0
    """m: a hand that moves for long stays about this near to its first rest. One measurement a second; robust."""

    stride_time: float = 2.0
    """s: a foot that walks stands still at least so often (healthy people stride in 1 to 1.4 s, slow ones in 2 s)."""

    compass_heading: float = 0.15
    """rad sqrt(s): error of the heading by a room's magnetic field; over T s it averages to this / sqrt(T)."""

    field_change: float = 0.08
    """Relative change of a room's magnetic field since the first rest. A larger change is a magnet's."""

    device_lag: float = 0.3
    """s: sigma of the time constant of the low-pass of a device's own attitude (OceanServer's manual: 0.3 s)."""

    device_attitude: float = 0.5 * DEG
    """rad: error of a device's own attitude (data sheets of compasses: 0.5 to 1 degree). It is another one after a turn
    of 1 rad: it depends on how the device lies in gravity and in the magnetic field."""

    device_drift: float = 0.01
    """rad/s: it changes in time as by this turn. In a second that is 0.07 degrees, about the resolution of 0.1 degree
    of such devices (OceanServer's data sheet)."""

    unseen_speed: float = 0.1
    """m/s: mean speed of a hand in a gap in the data: from rest to rest in 0.12 s with 5 m/s2. (A longer gap is
    refused unless a person says that the hand stood still.)"""

    unseen_rate: float = 0.2
    """rad/s: mean rate of such a hand, which turns about an elbow half a metre away."""


def noise_of(
    recording: Recording, rest: Rest, errors: SensorErrors | None = None, steps: tuple[float, float] | None = None
) -> Noise:
    """Noise of a recording: white densities from its rest, all else from the sensor's class or a calibration.

    Args:
        recording, rest: `info.sensor` gives the class, the rest white noise.
        errors: the calibration's, already corrected in the recording. They also give the local gravity.
        steps: smallest steps of the readings of the gyro, rad/s, and the accelerometer, m/s2; by default the
            recording's own.
    """
    sensor = next((found for word, found in CLASSES.items() if word in recording.info.sensor), FACTORY)
    gravity = Noise.gravity
    if errors is not None and errors.acc is not None:
        sensor, gravity = _calibrated(sensor, errors.acc, errors.gyr), errors.gravity
    gyr_step, acc_step = steps_of(recording) if steps is None else steps
    still, rate_hz = slice(rest.start, rest.stop), recording.rate_hz
    rates = np.zeros_like(recording.acc) if recording.gyr is None else recording.gyr
    gyr, gyr_held = white_noise(rates[still], rest.gyr_var, gyr_step, rate_hz)
    acc, acc_held = white_noise(recording.acc[still], rest.acc_var, acc_step, rate_hz)
    sensor = replace(
        sensor,
        acc_bias=float(np.hypot(sensor.acc_bias, acc_held)),
        gyr_walk=float(np.hypot(sensor.gyr_walk, gyr_held)),
        acc_walk=float(np.hypot(sensor.acc_walk, acc_held)),
    )
    root = rate_hz**-0.5
    noise = Noise(gyr * root, acc * root, sensor, gravity=gravity)
    return noise if recording.gyr is not None else _of_device_attitude(noise)


def _of_device_attitude(noise: Noise) -> Noise:
    """Noise where the device's own attitude replaces a gyro: the lag is that of its low-pass, and `gyr_turn` the random
    walk of a Gauss-Markov process, sqrt(2 / 1 rad) of its sigma."""
    walk, lag = 2.0**0.5 * noise.device_attitude, noise.device_lag
    return replace(noise, gyr_turn=walk, lag=0.0, lag_sigma=lag, wide_lag_sigma=lag)


def _calibrated(own: SensorClass, acc: LinearErrors, gyr: LinearErrors | None) -> SensorClass:
    """What a calibration leaves, at best CALIBRATED: its sigmas; the class' sigmas of what it did not determine."""
    names = "acc_bias", "acc_scale", "gyr_scale"
    found = acc.bias_sigma.max(), acc.matrix_sigma, np.nan if gyr is None else gyr.matrix_sigma
    best, usual = ([getattr(each, name) for name in names] for each in (CALIBRATED, own))
    left = np.maximum(best, np.where(np.isnan(found), usual, found)).tolist()
    return replace(CALIBRATED, **dict(zip(names, left, strict=True)))


def acc_sigma_factor(noise: Noise, rest: Rest) -> float:
    """Factor, 1 or more, on the accelerometer sigmas of the class. It grows with the error of gravity at rest."""
    shown = abs(rest.gravity - noise.gravity)
    return float(np.hypot(1.0, max(shown - 2.0 * noise.gravity_sigma, 0.0) / noise.sensor.acc_bias))


def densities(noise: Noise, gyr: Array, u: Array, dt: float, up: Array) -> tuple[Array, Array]:
    """Noise densities of gyro and accelerometer at each row: (3, n) rad2/s and (3, n) m2/s3.

    The three parts add up: white noise measured at rest, noise from turning, noise from motion.

    Args:
        gyr: (n, 3) rad/s, without bias.
        u: (n, 3) m/s2, specific force in the gyro frame.
        dt: s, sampling interval.
        up: (3,) or (n, 3) m/s2, specific force at rest.
    """
    s_g, s_a = np.zeros((3, len(u))), np.zeros((3, len(u)))
    s_g[0], s_a[0] = noise.gyr_density**2, noise.acc_density**2
    s_g[1] = noise.gyr_turn**2 * lengths(gyr)
    motion = u - up
    s_a[2] = noise.acc_motion**2 * np.einsum("ij,ij->i", motion, motion)
    between = np.full(len(u), np.inf)
    for n in {1, rows_of_mean(1.0 / dt)}:  # fast vibration bends the samples, but not their means
        edge = 3 * n - 1
        if len(u) > 2 * edge:
            bend = _bends(moving_means(u, n, 2), n, noise, dt)
            inner = noise.acc_bend * n * dt / 12.0 * bend**2 / (bend + noise.bend_knee**2)
            between[edge:-edge] = np.minimum(between[edge:-edge], inner)
    s_a[2, 2:-2] += between[2:-2]
    return s_g, s_a


def _bends(means: Array, n: int, noise: Noise, dt: float) -> Array:
    """Squared second differences (m2/s4) beyond white noise, by fourth differences: these ignore a steady jerk.

    `means` (m, 3) m/s2 are moving means over n samples, taken twice; differences are over n samples, dt s apart.
    """
    second = means[2 * n :] - 2.0 * means[n:-n] + means[: -2 * n]
    fourth = second[2 * n :] - 2.0 * second[n:-n] + second[: -2 * n]
    # White noise of variance 1 has fourth differences of variance 70 and second differences of variance 6.
    white = 6.0 * 3.0 * noise.acc_density**2 / dt * white_noise_variance(n, 2)
    return np.maximum(6.0 / 70.0 * squares(fourth) - white, 0.0)
