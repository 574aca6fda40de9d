"""The accelerometer's signs: +g along the axis that points up at rest, in every decoder and importer here.

Some programs give the opposite (what pulls, not what holds: a level sensor then reads -g on z), some turn one axis. A
gyro carries the vertical upside down as well as upright, so it does not tell; the device's own attitude does. Where it
has none, a first rest upside down is all that can be seen.
"""

from __future__ import annotations

import warnings
from itertools import product

import numpy as np

from pbd.data import GRAVITY, Recording
from pbd.errors import PbdWarning, RecordingError
from pbd.pose import Array, quat_from_rpy, quat_inverse, quat_rotate
from pbd.tracking.steady import find_steady

CONTRADICTS, AGREES = np.radians(45.0), np.radians(15.0)
"""The device's own vertical is further than this from the accelerometer's (in the mean over all steady moments), and
other signs bring them this close: it lags, and is only as good as its maker's filter."""

SIGNS = sorted(product((1.0, -1.0), repeat=3), key=lambda signs: (sum(signs) != -3.0, -sum(signs)))
"""All turned first, then as few as can be: of those that fit alike the first is meant."""

ALIKE = np.radians(2.0)

UPSIDE_DOWN = -0.9
"""The cosine of the sensor's z axis with the vertical, below which it lies on its head (26 degrees)."""

STEEP = 0.5
"""A field whose share along the vertical is larger than this points up or down, beyond a compass' own errors."""


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

    def off(signs: tuple[float, ...]) -> float:
        cosines: Array = ((steady.up_sensor * signs) * up).sum(axis=1)
        return float(np.arccos(np.clip(cosines, -1.0, 1.0)).mean())

    fits = [off(signs) for signs in SIGNS]
    if off((1.0, 1.0, 1.0)) < CONTRADICTS or min(fits) > AGREES:
        return
    signs = next(signs for signs, fit in zip(SIGNS, fits, strict=True) if fit < min(fits) + ALIKE)
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
