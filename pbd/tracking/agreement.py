"""The gyro held against gravity: what it says of a turn must bring the vertical to where the accelerometer sees it.

So a gyro in another unit is found out, or one whose axes are not the accelerometer's. A turn about the vertical says
nothing, and turns about one axis say little of the others: what is not contradicted is believed.
"""

from __future__ import annotations

from itertools import permutations, product

import numpy as np
from numpy.typing import NDArray

from pbd.data import Recording
from pbd.errors import RecordingError
from pbd.pose import Array, quat_inverse, quat_multiply, quat_rotate
from pbd.tracking.signs import refuse_turned_signs
from pbd.tracking.steady import carried, find_steady

FINE_HZ = 50.0
"""Samples are averaged down to about this rate: enough to follow a hand, and cheap in a long recording."""

STEP_S, APART_S, LONGEST_S = 0.1, 0.5, 5.0
"""Steady moments at least STEP_S apart are held against the next that is at least APART_S later, at most LONGEST_S."""

TURNED = np.radians(20.0)
"""Moments between which the vertical turns further than this, by either sensor, tell something. So far the sensors must
disagree (in the median) ..."""

AGREES, BETTER = np.radians(10.0), 3.0
"""... and another reading of the gyro must agree to this, and so many times better, for the gyro to be refused ..."""

IDENTITY = np.eye(3)

NOTHING, HELD_S = 0.1, 0.3
"""A gyro that turns by less than this share of what gravity does is dead, if it does so between moments in a row for so
long. (A hand that speeds up to one side and down is as steady as gravity for a moment, and turns the vertical.)"""

FEW, SEVERAL = 2, 8
"""... at this many pairs of moments, or more; at so many for axes, which have more ways to agree by chance."""


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
    up, up_later = steady.up_sensor[first], steady.up_sensor[second]
    begin, end = steady.rows[first], steady.rows[second]

    def turns(gyr: Array) -> Array:
        attitude = carried(gyr, 1.0 / rate_hz)
        return quat_multiply(quat_inverse(attitude[end]), attitude[begin])

    as_it_is = turns(gyr)
    predicted = quat_rotate(as_it_is, up)
    telling = np.maximum(_angles(up, up_later), _angles(up, predicted)) > TURNED
    if telling.sum() < FEW:
        return
    off = float(np.median(_angles(up_later, predicted)[telling]))
    if off < TURNED:
        return

    def disagreement(turns: Array, axes: Array = IDENTITY) -> float:
        there = quat_rotate(turns[telling], up[telling] @ axes) @ axes.T
        return float(np.median(_angles(up_later[telling], there)))

    readings: list[tuple[float, str, str]] = [
        (
            disagreement(turns(np.radians(gyr))),
            "its values are in deg/s; import the file with --unit gyr=deg/s",
            "deg/s",
        ),
        (
            disagreement(turns(np.degrees(gyr))),
            "its values were in rad/s, but were read as deg/s; import the file with --unit gyr=rad/s",
            "rad/s",
        ),
    ]
    if telling.sum() >= SEVERAL:
        back = turns(-gyr)
        for order in permutations(range(3)):
            for signs in product((1, -1), repeat=3):
                # The same turn in other axes; those that are mirrored turn the other way round.
                axes = IDENTITY[list(order)] * np.array(signs)[:, None]
                hand = float(np.linalg.det(axes))
                fits = disagreement(as_it_is if hand > 0.0 else back, hand * axes)
                readings.append((fits, _other_axes(order, signs), ""))
    best, what, unit = min(readings)
    held = _held(steady.rows, rate_hz)
    held_still = telling & held[first] & held[second]
    if best >= min(AGREES, off / BETTER) and held_still.sum() >= FEW:
        seen, said = _angles(up, up_later)[held_still], _angles(up, predicted)[held_still]
        if np.median(said) < NOTHING * np.median(seen):
            best, what, unit = (
                0.0,
                "it hardly reads anything, so it is dead; repair it, or check the columns gx, gy, gz",
                "",
            )
    if best < min(AGREES, off / BETTER):
        raise RecordingError(
            f"the gyro does not turn as gravity shows (by {np.degrees(off):.0f} degrees, first at "
            f"t = {recording.t[begin[telling][0] * every]:.1f} s): {what}",
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
