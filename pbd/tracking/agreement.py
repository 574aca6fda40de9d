"""What says where up is, held against the accelerometer: the device's own attitude, and the gyro from rest to rest.

So an accelerometer with turned signs is found out (some programs give what pulls, not what holds), and a gyro in
another unit, or one whose axes are not the accelerometer's. A gyro carries the vertical upside down as well as
upright, so of all three signs it tells nothing; a turn about the vertical says nothing, and turns about one axis say
little of the others. What is not contradicted is believed.
"""

from __future__ import annotations

import warnings
from itertools import permutations, product

import numpy as np
from numpy.typing import NDArray

from pbd.data import GRAVITY, Recording
from pbd.errors import PbdWarning, RecordingError
from pbd.pose import Array, quat_from_rpy, quat_inverse, quat_multiply, quat_rotate
from pbd.tracking.steady import carried, find_steady

CONTRADICTS, FITS = np.radians(45.0), np.radians(15.0)
"""The device's own vertical is further than this from the accelerometer's (in the mean over all steady moments), and
other signs bring them this close: it lags, and is only as good as its maker's filter."""

SHOWN = 0.04
"""An axis along which both verticals lie by more than this (mean product) shows its sign: 11 degrees off the level."""

UPSIDE_DOWN = -0.9
"""The cosine of the sensor's z axis with the vertical, below which it lies on its head (26 degrees)."""

STEEP = 0.5
"""A field whose share along the vertical is larger than this points up or down, beyond a compass' own errors."""

FINE_HZ = 50.0
"""Samples are averaged down to about this rate: enough to follow a hand, and cheap in a long recording."""

STEP_S, APART_S, LONGEST_S = 0.1, 0.5, 5.0
"""Steady moments at least STEP_S apart are held against the next that is at least APART_S later, at most LONGEST_S."""

TURNED = np.radians(20.0)
"""Moments between which the vertical turns further than this, by either sensor, tell something. So far the sensors must
disagree (in the median) ..."""

AGREES, BETTER = np.radians(10.0), 3.0
"""... and another reading of the gyro must agree to this, and so many times better, for the gyro to be refused."""

NOTHING, HELD_S = 0.1, 0.3
"""A gyro that turns by less than this share of what gravity does is dead, if it does so between moments in a row for so
long (s). (A hand that speeds up to one side and down is as steady as gravity for a moment, and turns the vertical.)"""

FEW, SEVERAL = 2, 8
"""So many pairs of moments tell of a unit or a dead gyro, at least; so many of axes, which may agree by chance."""


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
    signs = np.where(along < (SHOWN if (along < SHOWN).all() else -SHOWN), -1.0, 1.0)
    off, fit = (float(_angles(steady.up_sensor * turn, up).mean()) for turn in (np.ones(3), signs))
    if off < CONTRADICTS or fit > FITS:
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
    if up_sensor[2] > UPSIDE_DOWN:
        return
    told = ""
    if recording.mag is not None:
        field = recording.mag[start:stop].mean(axis=0)  # a NaN tells nothing
        if up_sensor @ field > STEEP * np.linalg.norm(field):
            told = "; the magnetic field points up, as it does only south of the equator, so they likely are"
    warnings.warn(
        f"at the first rest the sensor lies upside down (z reads {GRAVITY * up_sensor[2]:.1f} m/s2), or the signs of "
        f"its accelerometer are turned{told}; if z was up, import the file with --unit acc=-g (or -m/s2), or "
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
    every = max(1, round(recording.rate_hz / FINE_HZ))
    acc, gyr = _averaged(recording.acc, every), _averaged(recording.gyr, every)
    rate_hz = recording.rate_hz / every
    steady = find_steady(acc, gyr, rate_hz)
    gyr = gyr - steady.gyro_bias
    first, second = _pairs(steady.rows, rate_hz)

    def turns(gyr: Array) -> Array:
        attitude = carried(gyr, 1.0 / rate_hz)
        return quat_multiply(quat_inverse(attitude[steady.rows[second]]), attitude[steady.rows[first]])

    up, up_later, as_it_is = steady.up_sensor[first], steady.up_sensor[second], turns(gyr)
    seen, said = _angles(up, up_later), _angles(up, quat_rotate(as_it_is, up))
    telling = np.maximum(seen, said) > TURNED
    if telling.sum() < FEW:
        return

    def disagreement(turns: Array, axes: Array) -> float:
        there = quat_rotate(turns[telling], up[telling] @ axes) @ axes.T
        return float(np.median(_angles(up_later[telling], there)))

    off = disagreement(as_it_is, np.eye(3))
    if off < TURNED:
        return
    readings = [
        (disagreement(turns(np.radians(gyr)), np.eye(3)), "its values are in deg/s; import the file with", "deg/s"),
        (
            disagreement(turns(np.degrees(gyr)), np.eye(3)),
            "its values were in rad/s, but were read as deg/s; import the file with",
            "rad/s",
        ),
    ]
    back = turns(-gyr)
    for order, signs in product(permutations(range(3)), product((1, -1), repeat=3)) if telling.sum() >= SEVERAL else ():
        # The same turn in other axes; those that are mirrored turn the other way round.
        axes = np.eye(3)[list(order)] * np.array(signs)[:, None]
        hand = float(np.linalg.det(axes))
        readings.append((disagreement(as_it_is if hand > 0.0 else back, hand * axes), _other_axes(order, signs), ""))
    best, what, unit = min(readings)
    held = _held(steady.rows, rate_hz)
    still = telling & held[first] & held[second]
    if best < min(AGREES, off / BETTER):
        what += f" --unit gyr={unit}" if unit else ""
    elif still.sum() >= FEW and np.median(said[still]) < NOTHING * np.median(seen[still]):
        what, unit = "it hardly reads anything, so it is dead; repair it, or check the columns gx, gy, gz", ""
    else:
        return
    raise RecordingError(
        f"the gyro does not turn as gravity shows (by {np.degrees(off):.0f} degrees, first at "
        f"t = {recording.t[steady.rows[first][telling][0] * every]:.1f} s): {what}",
        value=off,
        unit=unit or None,
    )


def _other_axes(order: tuple[int, ...], signs: tuple[int, ...]) -> str:
    """Say which of the gyro's axes are the accelerometer's, and how to import them so.

    Where two only have the other sign, it may as well be the accelerometer's third that has.
    """
    ours = [("-" if sign < 0 else "", "xyz"[axis]) for axis, sign in zip(order, signs, strict=True)]
    fit = ", ".join(f"{minus or '+'}{axis}" for minus, axis in ours)
    import_so = " ".join(
        f"--column g{axis}={minus}G{its.upper()}"
        for axis, (minus, its) in zip("xyz", ours, strict=True)
        if minus or its != axis
    )
    what = (
        f"its axes {fit} are the accelerometer's +x, +y, +z; import the file with {import_so} (GX: the column of its x)"
    )
    if order == (0, 1, 2) and sum(signs) == -1:
        third = "xyz"[signs.index(1)]
        what += f"; or, if it is the accelerometer's {third} that has the wrong sign, with --column a{third}=-NAME"
    return what


def _pairs(rows: NDArray[np.intp], rate_hz: float) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Indices of moments (k,), and of those to hold them against (k,)."""
    if len(rows) == 0:
        return rows, rows
    _, first = np.unique(rows // max(1, round(STEP_S * rate_hz)), return_index=True)
    second = np.searchsorted(rows, rows[first] + APART_S * rate_hz)
    there = second < len(rows)
    first, second = first[there], second[there]
    near = rows[second] - rows[first] <= LONGEST_S * rate_hz
    return first[near], second[near]


def _held(rows: NDArray[np.intp], rate_hz: float) -> NDArray[np.bool_]:
    """Which moments (m,) lie among others for HELD_S: the hand is held there."""
    run = np.cumsum(np.diff(rows, prepend=rows[:1]) > 1)
    held: NDArray[np.bool_] = np.bincount(run, minlength=1)[run] >= HELD_S * rate_hz
    return held


def _angles(a: Array, b: Array) -> Array:
    """Angles (k,) rad between unit vectors (k, 3)."""
    angles: Array = np.arccos(np.clip((a * b).sum(axis=1), -1.0, 1.0))
    return angles


def _averaged(values: Array, every: int) -> Array:
    averaged: Array = values[: len(values) // every * every].reshape(-1, every, 3).mean(axis=1)
    return averaged
