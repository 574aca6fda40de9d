"""The real recordings of the data folder, read for scoring (its README says what they are and how they are scored)."""

import re
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pbd.data import Recording
from pbd.pose import Array, quat_rotate
from pbd.tracking.noise import FACTORY
from tests.not_none import not_none

OPTICS_AHEAD_S = 0.8 / 286.0
"""The optics run ahead of the sensor by this much."""

VELOCITY_S = 35 / 286.0
"""s: the optics' velocity is the slope of a polynomial over so long (35 of their samples)."""

VELOCITY_SIGMA = 0.003
"""m/s: how sure that velocity is along each axis of a calm hand (reference.py prints it; of a fast one .8 cm/s)."""

RATES = {"286": 1, "95": 3, "40": 7}
"""Rate as it is called -> how many samples are averaged."""


@dataclass(frozen=True, eq=False)
class Trial:
    """A BROAD trial at one of its rates: the recording and the optics at the middle of each sample; NaN is unknown."""

    recording: Recording
    p_true: Array
    v_true: Array
    wxyz_true: Array
    moving: NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Window:
    """First and last row, length in s, the displacement's error (3,) m in the optics' frame, and in sigmas in nav."""

    start: int
    end: int
    length: float
    error: Array
    z: Array


def kind_of(name: str) -> str:
    """`14_undisturbed_slow_translation_with_breaks_B` -> slow_translation."""
    return re.sub(r"^\d+_|undisturbed_|_with_breaks|_[A-Z]$", "", name)


def read_broad(path: Path) -> dict[str, Trial]:
    """Read a trial at each of RATES, slower ones by averaging as a slower sensor's own low-pass would."""
    with np.load(path, allow_pickle=False) as file:
        arrays = {key: file[key].astype(np.float64) for key in file.files}
    rate = float(arrays["rate_hz"])
    t = np.arange(len(arrays["acc"])) / rate
    velocity = slope(filled(arrays["true_position"]), rate)
    velocity[~np.isfinite(arrays["true_position"]).all(axis=1)] = np.nan
    trials = {}
    for name, every in RATES.items():
        recording = averaged(Recording(t, arrays["acc"], arrays.get("gyr"), arrays.get("mag")), every)
        n = len(recording)
        optics = recording.t - OPTICS_AHEAD_S
        trials[name] = Trial(
            recording=replace(recording, t=recording.t - recording.t[0]),
            p_true=_at(optics, t, arrays["true_position"]),
            v_true=_at(optics, t, velocity),
            wxyz_true=_nearest(optics, rate, arrays["true_wxyz"]),
            moving=arrays["moving"][: n * every].reshape(n, every).mean(axis=1) > 0.5,
        )
    return trials


def averaged(recording: Recording, every: int) -> Recording:
    """As a slower sensor with a low-pass of its own would record: means of `every` samples, each at its middle."""
    n = len(recording) // every

    def mean(values: Array) -> Array:
        found: Array = values[: n * every].reshape(n, every, *values.shape[1:]).mean(axis=1)
        return found

    gyr, mag = (None if values is None else mean(values) for values in (recording.gyr, recording.mag))
    rate = recording.info.rate_hz
    info = replace(recording.info, rate_hz=rate and rate / every)
    return replace(recording, t=mean(recording.t), acc=mean(recording.acc), gyr=gyr, mag=mag, info=info)


def with_hard_iron(recording: Recording, seed: int) -> Recording:
    """As with a magnet of 20 uT beside the sensor, half the earth's field."""
    way = np.random.default_rng(seed).normal(size=3)
    return replace(recording, mag=not_none(recording.mag) + 20.0 * way / np.linalg.norm(way))


def with_drift(recording: Recording, share: float, seed: int) -> Recording:
    """As with a gyro whose bias walks by that share of what is assumed of its class."""
    assert recording.gyr is not None
    step = share * FACTORY.gyr_walk / np.sqrt(recording.rate_hz)
    walk = np.cumsum(step * np.random.default_rng(seed).normal(size=recording.gyr.shape), axis=0)
    return replace(recording, gyr=recording.gyr + walk)


def with_taps(recording: Recording) -> Recording:
    """As if tapped every thousand samples: a tap pushes, and turns by 4 rad/s in one sample, then back within fifty."""
    acc, gyr = recording.acc.copy(), not_none(recording.gyr).copy()
    for row in range(5000, len(acc) - 5000, 1000):
        acc[row : row + 3, 2] += (60.0, -90.0, 30.0)
        gyr[row, 0] += 4.0
        gyr[row + 1 : row + 51, 0] -= 0.08
    return replace(recording, acc=acc, gyr=gyr)


def slope(p: Array, rate_hz: float) -> Array:
    """Velocity (n, 3) as the optics have it: the slope of a quartic over VELOCITY_S, which loses half of 12 Hz."""
    from scipy.signal import savgol_filter  # loads scipy.stats, which takes a second

    samples = max(2 * round(0.5 * (VELOCITY_S * rate_hz - 1.0)) + 1, 5)
    velocity: Array = savgol_filter(p, samples, 4, deriv=1, delta=1.0 / rate_hz, axis=0)
    return velocity


def at_sensor(trial: Trial, lever: Array) -> Trial:
    """The truth of the sensor itself, `lever` (3,) m away from the markers' origin in sensor axes."""
    offset, speed = _of_lever(trial, np.eye(3))
    return replace(trial, p_true=trial.p_true + offset @ lever, v_true=trial.v_true + speed @ lever)


def fit_lever(trial: Trial, windows: list[Window]) -> Array:
    """Find the lever (3,) m that explains most of the windows' errors.

    A window's displacement is judged by the optics at both ends, and its velocity there is given by them.
    """
    offset, speed = _of_lever(trial, np.eye(3))
    t = trial.recording.t
    effects, errors = [], []
    for window in windows:
        i, j = window.start, window.end
        effect = 0.5 * (t[j] - t[i]) * (speed[i] + speed[j]) - (offset[j] - offset[i])
        if np.isfinite(effect).all():
            effects.append(effect)
            errors.append(window.error)
    if not effects:
        return np.zeros(3)
    lever: Array = np.linalg.lstsq(np.vstack(effects), -np.concatenate(errors))[0]
    return lever


def _of_lever(trial: Trial, axes: Array) -> tuple[Array, Array]:
    """How position and velocity change by each component of a lever: (n, 3, 3), in the optics' frame."""
    turned = [quat_rotate(trial.wxyz_true, axis) for axis in axes]
    swung = [quat_rotate(trial.wxyz_true, np.cross(not_none(trial.recording.gyr), axis)) for axis in axes]
    return np.stack(turned, axis=-1), np.stack(swung, axis=-1)


def phases(moving: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Half-open ranges in which the sensor moves."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], moving, [False])).astype(np.int8)))
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))


def filled(values: Array) -> Array:
    """Interpolate over what is unknown, component by component: (n, 3). Where all is unknown, it is zero."""
    rows, values = np.arange(len(values)), values if np.isfinite(values).any() else np.zeros_like(values)
    return np.column_stack([np.interp(rows, rows[np.isfinite(c)], c[np.isfinite(c)]) for c in values.T])


def _at(instants: Array, t: Array, values: Array) -> Array:
    """Interpolate linearly; what has an unknown neighbour is unknown."""
    return np.column_stack([np.interp(instants, t, column) for column in values.T])


def _nearest(instants: Array, rate: float, values: Array) -> Array:
    return values[np.clip(np.rint(instants * rate).astype(np.intp), 0, len(values) - 1)]
