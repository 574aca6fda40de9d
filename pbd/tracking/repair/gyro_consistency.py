"""Compare the accelerometer's vertical with that of the device's attitude, and with the gyro's turn from rest to rest.

This finds an accelerometer with flipped signs (some programs give gravity, not specific force), a gyro in another unit,
or one whose axes are not the accelerometer's. A gyro carries the vertical upside down as well as upright, so it can't
show that all three signs are flipped. A turn about the vertical shows nothing. Turns about one axis show little of the
others. Data that nothing contradicts are accepted.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pbd.data import GRAVITY, Recording
from pbd.errors import RecordingError, warn
from pbd.pose import (
    Array,
    quat_cumulative,
    quat_exp,
    quat_from_rpy,
    quat_inverse,
    quat_multiply,
    quat_rotate,
    quat_to_matrix,
)
from pbd.tracking.first_rest import restlessness
from pbd.tracking.moving_windows import squares, window_moments, window_sums
from pbd.tracking.repair.axes import (
    AS_GOOD_DEG,
    CONTRADICTION_DEG,
    IMPROVEMENT,
    Witness,
    angles,
    find_other_axes,
    readings,
)

UPSIDE_DOWN_COS = -0.9
"""Cosine between the sensor's z axis and the vertical below which it lies upside down: within 26 degrees."""

STEEP_FIELD = 0.5
"""Vertical share of a magnetic field above which it surely points up or down."""

CHECK_HZ = 50.0
"""Samples are averaged down to about this rate: fast enough for a hand."""

STEADY_S, STEADY_ACC = 0.2, 0.05
"""In a steady moment the accelerometer shows gravity alone. It lasts STEADY_S. The rms of specific force, and what its
norm differs from g, are below this share of g: a WT901's bias of 20 mg changes it by 4 % from one side to the other."""

PAIR_SHORTEST_S, PAIR_LONGEST_S = 0.5, 5.0
"""How far the two steady moments of a pair are apart, s. One pair at most begins in half a steady moment."""

SHOWN_BY = {"a": "gravity", "m": "the field", "": "the device's own attitude"}
"""What shows a turn, by the channel of a witness."""


@dataclass(frozen=True, eq=False)
class Steady:
    """Steady moments of a recording.

    Attributes:
        rows: (m,) the first row of each moment's second half.
        up_sensor: (m, 3) unit, the vertical in sensor axes at each.
        gyro_bias: (3,) rad/s, the gyro's mean over the quietest second.
    """

    rows: NDArray[np.intp]
    up_sensor: Array
    gyro_bias: Array


def find_steady(acc: Array, gyr: Array, rate_hz: float) -> Steady:
    """Find the steady moments of acc (n, 3) and gyr (n, 3) rad/s, without NaN; g is taken from the quietest second."""
    second, half = max(2, round(rate_hz)), max(1, round(0.5 * STEADY_S * rate_hz))
    if len(acc) < max(second, 2 * half):
        return Steady(np.zeros(0, dtype=np.intp), np.zeros((0, 3)), np.zeros(3))
    variance, mean = window_moments(acc, second)
    # The rate itself, not its variance: a turn about the vertical leaves the accelerometer as quiet as a rest.
    rate = window_sums(squares(gyr), second) / second
    quietest = int(np.argmin(restlessness(variance, rate)))
    g = float(np.linalg.norm(mean[quietest]))
    variance, mean = window_moments(acc, 2 * half)
    norm = np.linalg.norm(mean, axis=1)
    steady = np.flatnonzero((np.abs(norm - g) < STEADY_ACC * g) & (variance < (STEADY_ACC * g) ** 2) & (norm > 0.0))
    return Steady(steady + half, mean[steady] / norm[steady, None], gyr[quietest : quietest + second].mean(axis=0))


def refuse_turned_signs(recording: Recording) -> None:
    """Refuse specific force whose signs contradict the device's own attitude; `recording` without NaN.

    Raises:
        RecordingError: with what to give `pbd import`.
    """
    if recording.device_rpy is None:
        return
    gyr = np.zeros_like(recording.acc) if recording.gyr is None else recording.gyr
    steady = find_steady(recording.acc, gyr, recording.rate_hz)
    if len(steady.rows) == 0:
        return
    up = up_in_sensor(quat_from_rpy(recording.device_rpy[steady.rows]))
    signs = [reading for reading in readings() if reading.order == (0, 1, 2)]
    off, *fits = (float(np.degrees(angles(steady.up_sensor * each.signs, up).mean())) for each in signs)
    if off < CONTRADICTION_DEG or min(fits) > off / IMPROVEMENT:
        return
    good = [each for each, fit in zip(signs[1:], fits, strict=True) if fit <= min(fits) + AS_GOOD_DEG]
    # Of a level axis nothing is seen: where all others are turned, it is meant too.
    found = min(good, key=lambda each: (each.causes, sum(each.signs)))
    if recording.gyr is not None and found.signs[2] > 0:
        return  # the attitude may count its pitch or roll the other way; the gyro knows better, and is asked
    turned = [axis for axis, sign in zip("xyz", found.signs, strict=True) if sign < 0]
    how = "--unit acc=-g (or -m/s2)" if len(turned) == 3 else " ".join(f"--column a{axis}=-NAME" for axis in turned)
    wrong = "has the wrong sign: it contradicts" if len(turned) == 1 else "have the wrong sign: they contradict"
    raise RecordingError(
        f"the accelerometer's {', '.join(turned)} {wrong} the device's own attitude (the axis that points up must read "
        f"+{GRAVITY:.1f} m/s2 at rest); import the file with {how}",
        axes="".join(turned),
    )


def up_in_sensor(wxyz_nav_sensor: Array) -> Array:
    """The vertical in the sensor's axes, (..., 3), of attitudes (..., 4)."""
    vertical = np.broadcast_to((0.0, 0.0, 1.0), (*wxyz_nav_sensor.shape[:-1], 3))
    return quat_rotate(quat_inverse(wxyz_nav_sensor), vertical)


def warn_upside_down(recording: Recording, up_sensor: Array, start: int, stop: int) -> None:
    """Warn where the sensor lies on its head over the samples of its first rest, where this (3,) points up."""
    if up_sensor[2] > UPSIDE_DOWN_COS:
        return
    hint = ""
    if recording.mag is not None:
        field = recording.mag[start:stop].mean(axis=0)  # of a NaN nothing follows
        if up_sensor @ field > STEEP_FIELD * np.linalg.norm(field):
            hint = "; the magnetic field points up, as it does only south of the equator, so they likely are"
    warn(
        f"at the first rest the sensor lies upside down (z reads {GRAVITY * up_sensor[2]:.1f} m/s2), or the signs of "
        f"its accelerometer are turned{hint}; if z was up, import the file with --unit acc=-g (or -m/s2), or "
        "--column az=-NAME for that axis alone"
    )


def refuse_disagreement(recording: Recording) -> None:
    """Refuse a gyro in another unit than rad/s, or with other axes or signs than the accelerometer's.

    `recording` has no NaN.

    Raises:
        RecordingError: with what to give `pbd import`.
    """
    refuse_turned_signs(recording)
    if recording.gyr is None:
        return
    every = max(1, round(recording.rate_hz / CHECK_HZ))
    acc, gyr = _averaged(recording.acc, every), _averaged(recording.gyr, every)
    rate_hz = recording.rate_hz / every
    steady = find_steady(acc, gyr, rate_hz)
    gyr = gyr - steady.gyro_bias
    first, second = _pairs(steady.rows, rate_hz)
    there, here = steady.rows[second], steady.rows[first]

    def turn(factor: float) -> Array:
        attitude = np.vstack(((1.0, 0.0, 0.0, 0.0), quat_cumulative(quat_exp(factor * gyr / rate_hz))))
        return quat_to_matrix(quat_multiply(quat_inverse(attitude[there]), attitude[here]))

    up = Witness("a", steady.up_sensor[first], steady.up_sensor[second])
    found = find_other_axes([up, *_other_witnesses(recording, every, here, there)], turn)
    if found is not None:
        at = recording.t[here[found.pair] * every]
        raise RecordingError(
            f"the gyro does not turn as {SHOWN_BY[found.witness]} shows (by {found.off_deg:.0f} degrees, first at "
            f"t = {at:.1f} s): {found.message}",
            value=np.radians(found.off_deg),
        )


def _other_witnesses(
    recording: Recording, every: int, here: NDArray[np.intp], there: NDArray[np.intp]
) -> Iterator[Witness]:
    """The field, and the device's own up and north, at the rows of pairs."""
    if recording.mag is not None:
        field = _averaged(recording.mag, every)
        norm = np.linalg.norm(field, axis=1, keepdims=True)
        if norm.all():
            yield Witness("m", (field / norm)[here], (field / norm)[there])
    if recording.device_rpy is not None:
        wxyz = quat_inverse(quat_from_rpy(recording.device_rpy[every // 2 :: every]))
        for axis in ((0.0, 0.0, 1.0), (0.0, 1.0, 0.0)):
            seen = quat_rotate(wxyz, np.broadcast_to(axis, (len(wxyz), 3)))
            yield Witness("", seen[here], seen[there])


def _pairs(rows: NDArray[np.intp], rate_hz: float) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Indices of moments (k,), and of those to hold them against (k,)."""
    if len(rows) == 0:
        return rows, rows
    _, first = np.unique(rows // max(1, round(0.5 * STEADY_S * rate_hz)), return_index=True)
    second = np.searchsorted(rows, rows[first] + PAIR_SHORTEST_S * rate_hz)
    there = second < len(rows)
    first, second = first[there], second[there]
    near = rows[second] - rows[first] <= PAIR_LONGEST_S * rate_hz
    return first[near], second[near]


def _averaged(values: Array, every: int) -> Array:
    averaged: Array = values[: len(values) // every * every].reshape(-1, every, 3).mean(axis=1)
    return averaged
