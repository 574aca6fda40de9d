"""The simulator: a hand with a sensor does a task. The result has the sensor's readings and the true path.

The true path is a formula (hand_motion.py), which gives exact specific force, angular rate and magnetic field in sensor
axes. The sensor (sensor_model.py) averages each over its sampling intervals and adds its errors.

Time. Sample k is the mean over an interval whose middle is t[k], as from an integrating sensor. The intervals have no
gaps between them. Truth row k is the pose at t[k]. So the rotation from truth row k-1 to row k is in the second half of
gyr[k-1]'s interval and the first half of gyr[k]'s. (A real device sends a sample half an interval later, which delays
the whole recording by the same time.)

World is x east, y magnetic north, z up. Truth is in the recording's own nav frame (docs/tracking.md): the origin at the
first rest and z up; x east and y magnetic north where the sensor has a magnetometer; else x along the sensor's x axis
at the first rest laid level, or along its y axis where x is within 30 degrees of vertical.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from pbd.data import Demonstration, Recording, RecordingInfo, Truth
from pbd.errors import SensorError, UsageError, is_number, is_whole_number, nearest, require_kind
from pbd.pose import (
    Array,
    quat_about_z,
    quat_canonical,
    quat_inverse,
    quat_multiply,
    quat_rotate,
    quat_to_matrix,
)
from pbd.simulation.calibration_tasks import CALIBRATION_TASKS
from pbd.simulation.hand_motion import HandMotion
from pbd.simulation.sensor_model import SENSOR_MODELS, SensorModel
from pbd.simulation.tasks import TASKS, Task, random_task

_T = TypeVar("_T")

__all__ = ["CALIBRATION_TASKS", "EARTH", "SENSOR_MODELS", "TASKS", "World", "random_task", "simulate"]


@dataclass(frozen=True)
class World:
    """The environment: gravity, m/s2, and the magnetic field in world (x, y, z up), uT.

    The default field is about that of central Europe: 48 uT, 66 degrees below the horizon.
    """

    gravity: float = 9.81
    field: tuple[float, float, float] = (0.0, 19.5, -44.0)


EARTH = World()


def simulate(
    task: str | Task,
    sensor: str | SensorModel = "modern",
    seed: int = 0,
    *,
    rate_hz: float | None = None,
    world: World = EARTH,
    device: int | None = None,
) -> Demonstration:
    """Simulate a hand that holds `sensor` and does `task`.

    Args:
        task: a name of TASKS or CALIBRATION_TASKS, or a task.
        sensor: a name of SENSOR_MODELS, or a model (`dataclasses.replace` changes one).
        seed: seed of the device's errors and noise. The same seed gives the same bytes.
        rate_hz: replaces the model's rate.
        world: gravity and the magnetic field.
        device: seed of the device's errors: recordings with the same one are of the same device. Default: the errors
            follow from `seed`; that is another device than `device=seed`.

    Returns:
        The demonstration: recording, truth at each sample, grasped object. Its notes say that it is simulated.

    Raises:
        UsageError: no task or sensor has this name.
        SensorError: the rate is not above 0, or the seed is negative.
        WrongTypeError: an argument is of another kind.
    """
    for name, value in (("seed", seed), ("device", 0 if device is None else device)):
        require_kind(name, value, "a whole number", is_whole_number(value))
    require_kind("rate_hz", rate_hz, "a number", rate_hz is None or is_number(rate_hz))
    require_kind("task", task, "a task, or the name of one", isinstance(task, str | Task))
    require_kind("sensor", sensor, "a sensor model, or the name of one", isinstance(sensor, str | SensorModel))
    if seed < 0:
        raise SensorError(f"the seed {seed} is negative; give 0 or more", value=seed)
    task = _look_up({**TASKS, **CALIBRATION_TASKS}, task, "task") if isinstance(task, str) else task
    model = _look_up(SENSOR_MODELS, sensor, "sensor model") if isinstance(sensor, str) else sensor
    if rate_hz is not None:
        model = replace(model, rate_hz=rate_hz)
    # One random stream per part, so that a model without a part has the same errors in the others.
    clock_rng, acc_rng, gyr_rng, mag_rng, attitude_rng = np.random.default_rng(seed).spawn(5)
    acc_device, gyr_device, mag_device = [None] * 3 if device is None else np.random.default_rng(device).spawn(3)

    motion = task.motion
    even_t = np.arange(int(task.duration_s * model.rate_hz + 1e-6) + 1) / model.rate_hz
    borders = np.append(even_t, len(even_t) / model.rate_hz) - 0.5 / model.rate_hz
    jitter = model.jitter_s * clock_rng.normal(size=len(borders))
    edges = borders + np.clip(jitter, -0.45 / model.rate_hz, 0.45 / model.rate_hz)
    middles = 0.5 * (edges[1:] + edges[:-1])
    t = middles - middles[0] if model.has_clock else even_t

    interval_s = np.diff(edges)
    acc, gyr, mag = np.split(
        _interval_means(lambda at: _true_readings(motion, world, at), edges, motion.knots), 3, axis=-1
    )

    hand = motion.at(middles)
    wxyz_nav_world = quat_about_z(_yaw_nav_world(hand.wxyz[0], model, world))
    wxyz_nav_sensor = quat_multiply(wxyz_nav_world, hand.wxyz)
    attitude = model.attitude
    return Demonstration(
        recording=Recording(
            t=t,
            acc=model.acc.measure(acc, interval_s, acc_rng, acc_device),
            gyr=None if model.gyr is None else model.gyr.measure(gyr, interval_s, gyr_rng, gyr_device),
            mag=None if model.mag is None else model.mag.measure(mag, interval_s, mag_rng, mag_device),
            device_rpy=None if attitude is None else attitude.measure(wxyz_nav_sensor, model.rate_hz, attitude_rng),
            grip=task.grip,
            info=RecordingInfo(name=task.name, sensor=f"simulated {model.name}", rate_hz=model.rate_hz),
        ),
        truth=Truth(t, quat_rotate(wxyz_nav_world, hand.p - hand.p[0]), quat_canonical(wxyz_nav_sensor)),
        notes=f"Simulated (sensor model {model.name}, seed {seed}).{task.description and f' {task.description}.'}",
        closed=task.closed,
        grasped=task.grasped,
    )


def _look_up(known: Mapping[str, _T], name: str, kind: str) -> _T:
    if name not in known:
        raise UsageError(
            f"no {kind} is called {name!r}; choose one of {', '.join(known)}{nearest(name, known)}", value=name
        )
    return known[name]


def _true_readings(motion: HandMotion, world: World, t: Array) -> Array:
    """Specific force, angular rate and magnetic field (n, 9) in sensor axes at instants (n,) s."""
    hand = motion.at(t)
    R_sensor_world = quat_to_matrix(quat_inverse(hand.wxyz))
    acc = R_sensor_world @ (hand.a + np.array((0.0, 0.0, world.gravity)))[..., None]
    return np.concatenate((acc[..., 0], hand.w, R_sensor_world @ np.array(world.field)), axis=-1)


def _interval_means(signal: Callable[[Array], Array], edges: Array, knots: Array) -> Array:
    """Mean (n, k) of a signal (m,) -> (m, k) over each interval between edges (n + 1,) s.

    Gauss-Legendre quadrature between neighbouring edges and knots (n,) s. Jerk jumps at the knots only, so the result
    is exact to rounding.
    """
    breaks = np.union1d(edges, knots[(knots > edges[0]) & (knots < edges[-1])])
    nodes, weights = np.polynomial.legendre.leggauss(6)
    width = np.diff(breaks)[:, None]
    values = signal((breaks[:-1, None] + width * (0.5 + 0.5 * nodes)).ravel()).reshape(len(width), len(nodes), -1)
    integrals = 0.5 * width * np.einsum("q,mqk->mk", weights, values)
    return np.add.reduceat(integrals, np.searchsorted(breaks, edges[:-1])) / np.diff(edges)[:, None]


def _yaw_nav_world(wxyz_world_sensor: Array, model: SensorModel, world: World) -> float:
    """Yaw from world to the recording's own nav frame, rad, for the attitude (4,) at the first rest."""
    if model.mag is not None:
        return float(np.arctan2(world.field[0], world.field[1]))
    x_axis, y_axis, _ = quat_to_matrix(wxyz_world_sensor).T
    ahead = x_axis if abs(x_axis[2]) <= np.cos(np.radians(30.0)) else y_axis
    return float(-np.arctan2(ahead[1], ahead[0]))
