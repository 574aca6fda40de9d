"""Compare the accelerometer's vertical with that of the device's attitude, and with the gyro's turn from rest to rest.

This finds an accelerometer with flipped signs (some programs give gravity, not specific force), a gyro in another unit,
or one whose axes are not the accelerometer's. A gyro carries the vertical upside down as well as upright, so it can't
show that all three signs are flipped. A turn about the vertical shows nothing. Turns about one axis show little of the
others. Data that nothing contradicts are accepted.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NoReturn

import numpy as np
from numpy.typing import NDArray

from pbd.data import GRAVITY, Recording
from pbd.errors import PbdWarning, RecordingError
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
from pbd.tracking.first_rest import STILL_ACC, STILL_GYR
from pbd.tracking.moving_windows import squares, window_moments, window_sums
from pbd.tracking.repair.axes import IMPROVEMENT, Witness, angles, find_other_axes

CONTRADICTION_RAD = np.radians(20.0)
"""Angle, rad, between two estimates of the vertical above which they contradict each other."""

SIGN_PRODUCT = 0.04
"""Mean product of two verticals along an axis above which its sign is observable: 11 degrees off level."""

UPSIDE_DOWN_COS = -0.9
"""Cosine between the sensor's z axis and the vertical below which it lies upside down: within 26 degrees."""

STEEP_FIELD = 0.5
"""Vertical share of a magnetic field above which it surely points up or down."""

CHECK_HZ = 50.0
"""Samples are averaged down to about this rate: fast enough for a hand."""

STEADY_S, STEADY_ACC, STEADY_NORM = 0.2, 0.05, 0.04
"""In a steady moment the accelerometer shows gravity alone. It lasts STEADY_S; the rms of specific force is below
STEADY_ACC, and its norm differs from g by less than STEADY_NORM (shares of g): a WT901's bias of 20 mg changes it by
4 % from one side to the other."""

PAIR_EVERY_S, PAIR_SHORTEST_S, PAIR_LONGEST_S = 0.1, 0.5, 5.0
"""Pairs of steady moments: one begins every PAIR_EVERY_S at most; the two are PAIR_SHORTEST_S to PAIR_LONGEST_S
apart."""

SHOWN_BY = {"a": "gravity", "m": "the field", "": "the device's own attitude"}
"""What shows a turn, by the channel of a witness."""

UNIT_PAIRS = 2
"""Least number of pairs between which the vertical turns, to judge the unit."""


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
    quietest = int(np.argmin(variance / STILL_ACC**2 + rate / STILL_GYR**2))
    g = float(np.linalg.norm(mean[quietest]))
    variance, mean = window_moments(acc, 2 * half)
    norm = np.linalg.norm(mean, axis=1)
    steady = np.flatnonzero((np.abs(norm - g) < STEADY_NORM * g) & (variance < (STEADY_ACC * g) ** 2) & (norm > 0.0))
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
    along = (steady.up_sensor * up).mean(axis=0)
    # Of a level axis nothing is seen: where all others are turned, it is meant too.
    signs = np.where(along < (SIGN_PRODUCT if (along < SIGN_PRODUCT).all() else -SIGN_PRODUCT), -1.0, 1.0)
    off, fit = (float(angles(steady.up_sensor * turn, up).mean()) for turn in (np.ones(3), signs))
    if off < CONTRADICTION_RAD or fit > off / IMPROVEMENT:
        return
    if recording.gyr is not None and signs[2] > 0.0:
        return  # the attitude may count its pitch or roll the other way; the gyro knows better, and is asked
    turned = [axis for axis, sign in zip("xyz", signs, strict=True) if sign < 0.0]
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
    warnings.warn(
        f"at the first rest the sensor lies upside down (z reads {GRAVITY * up_sensor[2]:.1f} m/s2), or the signs of "
        f"its accelerometer are turned{hint}; if z was up, import the file with --unit acc=-g (or -m/s2), or "
        "--column az=-NAME for that axis alone",
        PbdWarning,
        stacklevel=2,
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
    up, up_later = steady.up_sensor[first], steady.up_sensor[second]
    there, here = steady.rows[second], steady.rows[first]

    def turn(gyr: Array) -> Array:
        """The gyro's turns (k, 4) from the axes of the first moments to those of the second."""
        attitude = np.vstack(((1.0, 0.0, 0.0, 0.0), quat_cumulative(quat_exp(gyr / rate_hz))))
        return quat_multiply(quat_inverse(attitude[there]), attitude[here])

    def refuse(off_deg: float, pair: int, what: str, shows: str = "gravity", **fields: object) -> NoReturn:
        at = recording.t[here[pair] * every]
        raise RecordingError(
            f"the gyro does not turn as {shows} shows (by {off_deg:.0f} degrees, first at t = {at:.1f} s): {what}",
            value=np.radians(off_deg),
            **fields,
        )

    as_it_is = turn(gyr)
    witnesses = [Witness("a", up, up_later), *_other_witnesses(recording, every, here, there)]
    found = find_other_axes(witnesses, quat_to_matrix(as_it_is), lambda: quat_to_matrix(turn(-gyr)))
    carried = quat_rotate(as_it_is, up)
    telling = np.maximum(angles(up, up_later), angles(up, carried)) > CONTRADICTION_RAD
    off = float(np.median(angles(up_later, carried)[telling])) if telling.any() else 0.0
    if telling.sum() >= UNIT_PAIRS and off > CONTRADICTION_RAD:
        pair, mended = int(np.flatnonzero(telling)[0]), np.radians(found.fit_deg) if found else np.inf
        for unit, other, what in (
            ("deg/s", np.radians(gyr), "its values are in deg/s"),
            ("rad/s", np.degrees(gyr), "its values were in rad/s, but were read as deg/s"),
        ):
            fit = float(np.median(angles(up_later, quat_rotate(turn(other), up))[telling]))
            if fit < min(off / IMPROVEMENT, mended):
                refuse(np.degrees(off), pair, f"{what}; import the file with --unit gyr={unit}", unit=unit)
        if not np.diff(gyr, axis=0).any():  # with noise in the accelerometer, `refuse_dead` has refused it
            dead = "it reads the same all the time, so it is dead; check the columns gx, gy, gz"
            refuse(np.degrees(off), pair, dead)
    if found is not None:
        refuse(found.off_deg, found.pair, found.message, SHOWN_BY[found.witness])


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
    _, first = np.unique(rows // max(1, round(PAIR_EVERY_S * rate_hz)), return_index=True)
    second = np.searchsorted(rows, rows[first] + PAIR_SHORTEST_S * rate_hz)
    there = second < len(rows)
    first, second = first[there], second[there]
    near = rows[second] - rows[first] <= PAIR_LONGEST_S * rate_hz
    return first[near], second[near]


def _averaged(values: Array, every: int) -> Array:
    averaged: Array = values[: len(values) // every * every].reshape(-1, every, 3).mean(axis=1)
    return averaged
