"""Simulated recordings of a sensor that is put down in several orientations, or pivoted on its tip."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pbd.data import GRAVITY
from pbd.pose import Array, quat_exp, quat_inverse, quat_log, quat_multiply, quat_rotate
from pbd.sensors.simulated_hand import Waypoint
from pbd.sensors.simulated_sensor import SENSOR_MODELS, SensorModel
from pbd.sensors.simulated_tasks import Task

_SIDES = ((0, 0, 1), (1, 0, 0), (0, 1, 0), (-1, 0, 0), (0, -1, 0), (0, 0, -1))
_EDGES = ((1, 1, 0), (0, 1, 1), (1, 0, 1), (-1, -1, 0), (0, -1, -1), (-1, 0, -1))
SIDES = np.array((*_SIDES, *_EDGES), dtype=np.float64) / np.repeat((1.0, np.sqrt(2.0)), 6)[:, None]
"""(12, 3): which way is up in sensor axes, each side and six edges."""

_MG = 1e-3 * GRAVITY
WT901 = SENSOR_MODELS["wt901"]
assert WT901.mag is not None
BAD = replace(
    WT901,
    name="bad wt901",
    acc=replace(WT901.acc, bias=50.0 * _MG, scale=0.02, misalignment=np.radians(1.0)),
    mag=replace(WT901.mag, bias=20.0, scale=0.1, misalignment=np.radians(3.0)),
)
"""One sigma over devices: 50 mg, 2 %, 1 degree; hard iron 20 uT, soft iron 10 %."""


def sides(seed: int, up_sensor: Array = SIDES, rest_s: float = 2.0) -> Task:
    """Put the sensor down with each of (k, 3) up, roughly, turning it about that on the way."""
    rng = np.random.default_rng(seed)
    wxyz, waypoints = np.array([1.0, 0.0, 0.0, 0.0]), [Waypoint(rest_s=rest_s + 1.0)]
    for wanted in up_sensor[1:]:
        wanted = wanted + rng.normal(scale=0.05, size=3)
        wanted /= np.linalg.norm(wanted)
        turn = _between(wanted, quat_rotate(quat_inverse(wxyz), (0.0, 0.0, 1.0)))
        spin = wanted * rng.choice((-1.0, 1.0)) * rng.uniform(0.5, 1.5)
        waypoints.append(Waypoint(turn=_triple(turn), move_s=1.5, rest_s=0.3))
        waypoints.append(Waypoint(turn=_triple(spin), move_s=1.5, rest_s=rest_s))
        wxyz = quat_multiply(wxyz, quat_multiply(quat_exp(turn), quat_exp(spin)))
    return Task("sides", tuple(waypoints))


def pivoting(seed: int, p_sensor_tip: tuple[float, float, float], tilts: int = 9) -> Task:
    """Tilt the hand to all sides with its tip on one point."""
    rng = np.random.default_rng(seed)
    attitudes = []
    for k in range(tilts):
        to, tilt = 2.4 * k + rng.normal(scale=0.2), np.radians(rng.uniform(25.0, 45.0))
        tilted = quat_exp((tilt * np.cos(to), tilt * np.sin(to), 0.0))
        attitudes.append(quat_multiply(tilted, quat_exp((0.0, 0.0, rng.uniform(-0.5, 0.5)))))
    return replace(through(attitudes, rng), name="pivot", p_sensor_point=p_sensor_tip)


def through(attitudes: Sequence[Array], rng: np.random.Generator) -> Task:
    """Turn on the spot, from level, from attitude to attitude (4,), with a rest at each."""
    wxyz, waypoints = np.array([1.0, 0.0, 0.0, 0.0]), [Waypoint(rest_s=2.0)]
    for attitude in attitudes:
        turn = quat_log(quat_multiply(quat_inverse(wxyz), attitude))
        waypoints.append(Waypoint(turn=_triple(turn), move_s=rng.uniform(0.8, 1.3), rest_s=rng.uniform(0.6, 1.0)))
        wxyz = attitude
    return Task("turning", tuple(waypoints))


def device(model: SensorModel, seed: int) -> dict[str, tuple[Array, Array]]:
    """The errors that `simulate` draws for a device: by triad the gain (3, 3) and the bias (3,)."""
    drawn = {}
    streams = np.random.default_rng(seed).spawn(5)[1:4]
    for name, triad, rng in zip(("acc", "gyr", "mag"), (model.acc, model.gyr, model.mag), streams, strict=True):
        assert triad is not None
        gain = np.eye(3) + np.diag(triad.scale * rng.normal(size=3))
        gain += triad.misalignment * rng.normal(size=(3, 3)) * (1.0 - np.eye(3))
        drawn[name] = (gain, triad.bias * rng.normal(size=3))
    return drawn


def symmetric(gain: Array) -> Array:
    """The symmetric matrix that undoes a gain but for a rotation: (gain gain^T)^(-1/2)."""
    values, axes = np.linalg.eigh(gain @ gain.T)
    return np.asarray((axes / np.sqrt(values)) @ axes.T)


def _between(wanted: Array, now: Array) -> Array:
    """The turn in sensor axes that makes `wanted` point where `now` does."""
    axis = np.cross(wanted, now)
    sine = float(np.linalg.norm(axis))
    if sine < 1e-6:
        axis = np.cross(wanted, np.eye(3)[int(np.argmin(np.abs(wanted)))])
    angle = np.arctan2(sine, wanted @ now)
    return np.asarray(angle * axis / np.linalg.norm(axis))


def _triple(values: Array) -> tuple[float, float, float]:
    x, y, z = values.tolist()
    return x, y, z
