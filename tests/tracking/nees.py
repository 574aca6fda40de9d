"""Normalised estimation errors squared (NEES): errors of keyframes, relative to the tracker's own covariance.

The sensor's axes are those of the accelerometer (preintegration.LOWER). A recording can't show how they lie in the
housing. So the truth, which is that of the housing, is rotated into them.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import partial
from math import inf

import numpy as np

from pbd.data import Demonstration, HandPath, Truth
from pbd.data.units import MG
from pbd.pipeline import track
from pbd.pose import (
    Array,
    quat_about_z,
    quat_exp,
    quat_from_matrix,
    quat_from_rpy,
    quat_inverse,
    quat_log,
    quat_multiply,
    quat_rotate,
    quat_to_matrix,
    quat_to_rpy,
    yaw_toward,
)
from pbd.simulation.simulate import SENSOR_MODELS, TASKS, random_task, simulate
from pbd.simulation.tasks import Task
from pbd.tracking.noise import FACTORY, Noise
from pbd.tracking.smoother.attitude import mean_quaternion
from tests.not_none import not_none
from tests.simulation.sway import with_sway

RANDOM: dict[str, Callable[[int], Task]] = {
    "random": random_task,
    "tipping": partial(random_task, max_turn=np.radians(80.0)),
    "dawdling": partial(random_task, rest_s=(6.0, 10.0)),
    "creeping": partial(random_task, move_s=(4.0, 8.0), rest_s=(1.0, 2.0), max_turn=np.radians(30.0)),
}
"""Tasks that are drawn at random for each seed."""

PHONE = SENSOR_MODELS["wt901"]
assert PHONE.gyr is not None
WANDERING = replace(
    PHONE,
    name="wandering",
    acc=replace(PHONE.acc, bias=3.0 * MG, scale=FACTORY.acc_scale, bias_walk=FACTORY.acc_walk),
    gyr=replace(PHONE.gyr, scale=FACTORY.gyr_scale, bias_walk=FACTORY.gyr_walk),
)
"""A sensor whose biases drift as fast as in a warm hand. Those of the presets hardly drift in so short a time."""

MODELS = {**SENSOR_MODELS, "wandering": WANDERING}


@dataclass(frozen=True, eq=False)
class Errors:
    """Errors of all keyframes but the first, and the tracker's covariance.

    Attributes:
        off, turn: (k, 3) m, rad, in nav.
        cov: (k, 6, 6) position, then rotation.
    """

    off: Array
    turn: Array
    cov: Array

    @property
    def position(self) -> Array:
        """Whitened position errors (k, 3): their mean square is one if the covariance is true."""
        return whitened(self.off, self.cov[:, :3, :3])

    @property
    def rotation(self) -> Array:
        """The same for rotation."""
        return whitened(self.turn, self.cov[:, 3:, 3:])

    @property
    def in_sigmas(self) -> Array:
        """Errors (k, 6), each axis divided by its own sigma."""
        sigma: Array = np.sqrt(np.diagonal(self.cov, axis1=1, axis2=2))
        return np.hstack((self.off, self.turn)) / sigma


def demonstration(task: str, sensor: str, seed: int, sway_speed: float = 0.0) -> Demonstration:
    """A simulated demonstration; with an odd seed, without magnetometer and the device's own angles.

    The hand sways by `sway_speed`, m/s, and turns as about its pivot.
    """
    drawn = RANDOM[task](seed) if task in RANDOM else TASKS[task]
    demo = simulate(with_sway(drawn, sway_speed, seed, turn=sway_speed / Noise.pivot_distance), MODELS[sensor], seed)
    truth = demo.truth
    assert truth is not None
    wxyz = quat_multiply(truth.wxyz_nav_sensor, quat_inverse(accelerometer_axes(sensor, seed)))
    if seed % 2:
        demo = replace(demo, recording=replace(demo.recording, mag=None, device_rpy=None))
    return replace(demo, truth=replace(truth, wxyz_nav_sensor=wxyz))


def without_gyro(demo: Demonstration, seed: int) -> Demonstration:
    """The demonstration without a gyro. The device's own attitude errs by 0.5 degrees about each axis.

    The error changes smoothly with the attitude (a sum of waves in its matrix), and is another one after about 1 rad.
    """
    rng, wxyz, waves = np.random.default_rng(seed), quat_from_rpy(not_none(demo.recording.device_rpy)), 64
    phase = quat_to_matrix(wxyz).reshape(-1, 9) @ rng.normal(0.0, np.sqrt(0.5), (9, waves))
    amplitude = rng.normal(0.0, Noise.device_attitude * np.sqrt(2.0 / waves), (waves, 3))
    off = np.cos(phase + rng.uniform(0.0, 2.0 * np.pi, waves)) @ amplitude
    rpy = quat_to_rpy(quat_multiply(quat_exp(off), wxyz))
    return replace(demo, recording=replace(demo.recording, gyr=None, device_rpy=rpy))


def accelerometer_axes(sensor: str, seed: int) -> Array:
    """Rotation of the accelerometer's axes in a simulated housing, wxyz (4,)."""
    acc_rng = np.random.default_rng(seed).spawn(5)[1]  # as simulate() does
    model = replace(MODELS[sensor].acc, noise=0.0, bias=0.0, bias_walk=0.0, limit=inf, step=0.0)
    turned, triangle = np.linalg.qr(model.measure(np.eye(3), np.ones(3), acc_rng))  # gain = lower triangle x turn
    return quat_from_matrix((turned * np.sign(np.diagonal(triangle))).T)


def errors_of(demo: Demonstration) -> Errors:
    """Track a demonstration and compare it with its truth."""
    if demo.truth is None:
        raise ValueError("a simulated demonstration has its truth")
    return against(track(demo.recording), demo.truth)


def against(path: HandPath, truth: Truth) -> Errors:
    """Errors of a path, relative to position and heading of the first stop."""
    rests = [slice(stop.start, stop.stop) for stop in path.stops]
    wxyz, wxyz_true = (
        np.array([mean_quaternion(each[rest]) for rest in rests])
        for each in (path.wxyz_nav_sensor, truth.wxyz_nav_sensor)
    )
    p, p_true = (
        np.array([each[rest].mean(axis=0) for rest in rests]) for each in (path.p_nav_sensor, truth.p_nav_sensor)
    )
    # The truth is turned into nav, in which the covariance is.
    yaw = quat_about_z(yaw_toward(wxyz_true[0], wxyz[0]))
    off = p - p[0] - quat_rotate(yaw, p_true - p_true[0])
    turn = quat_log(quat_multiply(wxyz, quat_inverse(quat_multiply(yaw, wxyz_true))))
    return Errors(off[1:], turn[1:], path.cov[1:])


def whitened(errors: Array, covariance: Array) -> Array:
    """L^-1 e with L L^T the covariance: (k, 3)."""
    white: Array = np.linalg.solve(np.linalg.cholesky(covariance), errors[:, :, None])[:, :, 0]
    return white


def nees(whites: Iterable[Array]) -> float:
    """Mean normalised squared error, with equal weight for each recording: 1 if the covariance is true."""
    return float(np.mean([np.mean(white**2) for white in whites]))


def band(recordings: int, share: float = 0.95) -> tuple[float, float]:
    """Interval in which that mean lies with this probability, if all keyframes of a recording err together (chi-square,
    3 degrees of freedom per recording)."""
    from scipy.special import chdtri

    beyond, freedom = 0.5 * (1.0 - share), 3.0 * recordings
    return float(chdtri(freedom, 1.0 - beyond) / freedom), float(chdtri(freedom, beyond) / freedom)
