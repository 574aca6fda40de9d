"""Compare the accelerometer's vertical with the device's attitude, and with the gyro's turn from rest to rest.

This finds an accelerometer with flipped signs (some programs give gravity, not specific force), a gyro in a wrong unit,
and a gyro whose axes are not the accelerometer's. Turns about the vertical show nothing, and turns about one axis
little of the others. Data without a contradiction are accepted.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pbd.data import GRAVITY, Recording
from pbd.errors import RecordingError, in_degrees, warn
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
from pbd.tracking.first_rest import QUIET_ACC, SHORT_REST_S, STILL_ACC, likely_unit, restlessness
from pbd.tracking.moving_windows import squares, window_moments, window_sums
from pbd.tracking.repair.axes import (
    AS_GOOD_DEG,
    CONTRADICTION_DEG,
    IMPROVEMENT,
    Witness,
    angles,
    find_axis_error,
)
from pbd.tracking.repair.axis_mappings import AXIS_MAPPINGS

UPSIDE_DOWN_COS = -0.9
"""The sensor is upside down if cos(its z axis, up) is below this: z within 26 degrees of down."""

STEADY_S, STEADY_ACC = 0.3, 0.05
"""Length, s, of a steady moment, in which the accelerometer shows gravity.
Largest standard deviation of specific force in it, and largest difference of the mean's norm from g, both as shares of
g. (A WT901's bias of 20 mg changes the norm by 4 % between two sides of the sensor.)"""

PAIR_AFTER_S = (0.5, 1.0, 2.0, 4.0)
"""Times, s, after which a steady moment is paired with the next one: a slow turn shows only after seconds. At most one
moment per STEADY_S / 2 begins pairs."""

SHOWN_BY = {"a": "gravity", "m": "the field", "": "the device's own attitude"}
"""Channel of a witness -> its name."""


@dataclass(frozen=True, eq=False)
class Steady:
    """Steady moments of a recording.

    Attributes:
        rows: (m,) middle row of each moment.
        up_sensor: (m, 3) unit, the vertical in sensor axes at each moment.
        tilt_deg: (m,) degrees, by which the vertical may be off because the hand accelerates.
        gyro_bias: (3,) rad/s, the gyro's mean over the quietest half second.
    """

    rows: NDArray[np.intp]
    up_sensor: Array
    tilt_deg: Array
    gyro_bias: Array


def find_steady(acc: Array, gyr: Array, rate_hz: float) -> Steady:
    """Find the steady moments of acc (n, 3) and gyr (n, 3) rad/s, without NaN; g is that of the quietest half second.

    Without a rest there are none: neither g nor the gyro's bias is known.
    """
    calm, half = round(SHORT_REST_S * rate_hz), round(0.5 * STEADY_S * rate_hz)
    none = Steady(np.zeros(0, dtype=np.intp), np.zeros((0, 3)), np.zeros(0), np.zeros(3))
    if len(acc) < calm:
        return none
    variance, mean = window_moments(acc, calm)
    # Mean square of the rate, not its variance: in a turn about the vertical the accelerometer is as quiet as at rest.
    rate = window_sums(squares(gyr), calm) / calm
    quietest = int(np.argmin(restlessness(variance, rate)))
    if variance[quietest] > STILL_ACC**2:
        return none
    g = float(np.linalg.norm(mean[quietest]))
    variance, mean = window_moments(acc, 2 * half)
    norm = np.linalg.norm(mean, axis=1)
    steady = np.flatnonzero((np.abs(norm - g) < STEADY_ACC * g) & (variance < (STEADY_ACC * g) ** 2))
    # At the peak of a smooth move a horizontal acceleration is steady, and hardly changes the norm.
    hidden_deg = np.degrees(np.arccos(1.0 / (1.0 + STEADY_ACC)))
    tilt_deg = np.where(variance[steady] > (QUIET_ACC / GRAVITY * g) ** 2, hidden_deg, 0.0)
    gyro_bias = gyr[quietest : quietest + calm].mean(axis=0)
    return Steady(steady + half, mean[steady] / norm[steady, None], tilt_deg, gyro_bias)


def refuse_flipped_signs(recording: Recording) -> None:
    """Refuse specific force (without NaN) whose signs contradict the device's own attitude.

    Raises:
        RecordingError: with the options of `pbd import` that correct it.
    """
    if recording.device_rpy is None:
        return
    gyr = np.zeros_like(recording.acc) if recording.gyr is None else recording.gyr
    steady = find_steady(recording.acc, gyr, recording.rate_hz)
    if len(steady.rows) == 0:
        return
    up = up_in_sensor(quat_from_rpy(recording.device_rpy[steady.rows]))
    signs = [mapping for mapping in AXIS_MAPPINGS if mapping.order == (0, 1, 2)]
    off, *fits = (float(np.degrees(angles(steady.up_sensor * each.signs, up).mean())) for each in signs)
    if off < CONTRADICTION_DEG or min(fits) > off / IMPROVEMENT:
        return
    good = [each for each, fit in zip(signs[1:], fits, strict=True) if fit <= min(fits) + AS_GOOD_DEG]
    # A horizontal axis shows no sign. If all others are flipped, so is it, we assume.
    found = min(good, key=lambda each: (each.causes, sum(each.signs)))
    if recording.gyr is not None and found.signs[2] > 0:
        return  # the attitude's pitch or roll may have the other sign; `find_axis_error` asks the gyro
    flipped = [axis for axis, sign in zip("xyz", found.signs, strict=True) if sign < 0]
    source = recording.info.source
    columns = (source.column_option(f"a{axis}", f"a{axis}", reverse=True) for axis in flipped)
    how = source.reverse_acc_option() if len(flipped) == 3 else " ".join(columns)
    wrong = "has the wrong sign: it contradicts" if len(flipped) == 1 else "have the wrong sign: they contradict"
    raise RecordingError(
        f"the accelerometer's {', '.join(flipped)} {wrong} the device's own attitude (the axis that points up must "
        f"read +{GRAVITY:.1f} m/s2 at rest); import the file with {how}",
        axes="".join(flipped),
    )


def up_in_sensor(wxyz_nav_sensor: Array) -> Array:
    """The vertical in sensor axes (..., 3), given attitudes (..., 4)."""
    return quat_rotate(quat_inverse(wxyz_nav_sensor), (0.0, 0.0, 1.0))


def warn_upside_down(recording: Recording, up_sensor: Array, start: int, stop: int) -> None:
    """Warn if the sensor is upside down in its first rest, rows start <= i < stop; `up_sensor` (3,) is the vertical."""
    if up_sensor[2] > UPSIDE_DOWN_COS:
        return
    hint = ""
    if recording.mag is not None:
        field = recording.mag[start:stop].mean(axis=0)  # with a NaN there is no hint
        if up_sensor @ field > 0.5 * np.linalg.norm(field):  # surely up: 30 degrees or more
            hint = " (likely, because the magnetic field points up, as it does only south of the equator)"
    source = recording.info.source
    read = {"a": recording.acc, "g": recording.gyr, "m": recording.mag}
    columns = [f"{first}{axis}" for first in read if read[first] is not None for axis in "yz"]
    as_a_drone = " ".join(source.column_option(each, each, reverse=True) for each in columns)
    warn(
        f"at the first rest the sensor lies upside down (z reads {GRAVITY * up_sensor[2]:.1f} m/s2), or the signs of "
        f"its accelerometer are flipped{hint}; if z was up, import the file with {source.reverse_acc_option()}, or "
        f"{source.column_option('az', 'az', reverse=True)} for that axis alone; if its axes point forward, right and "
        f"down, as a drone's, with {as_a_drone}"
    )


def refuse_disagreement(recording: Recording) -> None:
    """Refuse a gyro that is not in rad/s, or whose axes or signs are not the accelerometer's.

    `recording` has no NaN.

    Raises:
        RecordingError: with the options of `pbd import` that correct it.
    """
    refuse_flipped_signs(recording)
    recording = _evenly_spaced(recording)
    if recording.gyr is None:
        return
    source, every = recording.info.source, max(1, round(recording.rate_hz / 50.0))  # 50 Hz do for a hand
    acc, gyr = _block_means(recording.acc, every), _block_means(recording.gyr, every)
    rate_hz = recording.rate_hz / every
    steady = find_steady(acc, gyr, rate_hz)
    gyr = gyr - steady.gyro_bias
    first, second = _pairs(steady.rows, rate_hz)
    row_after, row_before = steady.rows[second], steady.rows[first]

    def turn(factor: float) -> Array:
        attitude = np.vstack(((1.0, 0.0, 0.0, 0.0), quat_cumulative(quat_exp(factor * gyr / rate_hz))))
        return quat_to_matrix(quat_multiply(quat_inverse(attitude[row_after]), attitude[row_before]))

    unsure_deg = steady.tilt_deg[first] + steady.tilt_deg[second]
    up = Witness("a", steady.up_sensor[first], steady.up_sensor[second], unsure_deg)
    witnesses = [up, *_other_witnesses(recording, every, row_before, row_after)]
    found = find_axis_error(witnesses, turn, source)
    if found is not None and found.witness == "m" and recording.mag is not None:
        field = _block_means(recording.mag, every)
        if _is_iron(field[row_before], field[row_after], turn(1.0)):
            found = find_axis_error([each for each in witnesses if each.channel != "m"], turn, source)
    if found is not None:
        at = recording.t[row_before[found.pair] * every]
        unit = likely_unit(float(np.median(np.linalg.norm(acc, axis=1))), source.acc_factor)
        raise RecordingError(
            f"the gyro does not turn as {SHOWN_BY[found.witness]} shows "
            f"(by {in_degrees(np.radians(found.off_deg))}, first at t = {at:.1f} s): {found.message}"
            + (f"; with --unit acc={source.acc_unit_sign}{unit} too" if unit else ""),
            value=np.radians(found.off_deg),
        )


def _other_witnesses(
    recording: Recording, every: int, row_before: NDArray[np.intp], row_after: NDArray[np.intp]
) -> Iterator[Witness]:
    """The magnetic field, and the device's own up and north, at the pairs of rows."""
    if recording.mag is not None:
        field = _block_means(recording.mag, every)
        norm = np.linalg.norm(field, axis=1, keepdims=True)
        if norm.all():
            yield Witness("m", (field / norm)[row_before], (field / norm)[row_after])
    if recording.device_rpy is not None:
        wxyz = quat_inverse(quat_from_rpy(recording.device_rpy[every // 2 :: every]))
        for axis in ((0.0, 0.0, 1.0), (0.0, 1.0, 0.0)):
            seen = quat_rotate(wxyz, axis)
            yield Witness("", seen[row_before], seen[row_after])


def _is_iron(first: Array, second: Array, turn: Array) -> bool:
    """Whether iron or a magnet beside the sensor explains how the field turns, from the first to the second of pairs.

    Its field b is fixed in sensor axes: second - b = turn (first - b). Fields are (k, 3), the gyro's `turn` (k, 3, 3).
    """
    rotated = (turn @ first[:, :, None])[:, :, 0]
    b = np.linalg.lstsq((np.eye(3) - turn).reshape(-1, 3), (second - rotated).ravel())[0]
    earth = Witness("m", *(each / np.linalg.norm(each, axis=1, keepdims=True) for each in (first - b, second - b)))
    turned = earth.turns_to(earth.second)
    return bool(turned.any() and np.median(earth.off(turn)[turned]) < AS_GOOD_DEG)


def _pairs(rows: NDArray[np.intp], rate_hz: float) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Pairs of steady moments to compare: indices of the first (k,) and of the second (k,)."""
    if len(rows) == 0:
        return rows, rows
    _, starts = np.unique(rows // round(0.5 * STEADY_S * rate_hz), return_index=True)
    second = np.searchsorted(rows, rows[starts, None] + rate_hz * np.array(PAIR_AFTER_S)).ravel()
    pairs = np.column_stack((np.repeat(starts, len(PAIR_AFTER_S)), second))[second < len(rows)]
    first, second = np.unique(pairs, axis=0).T
    near = rows[second] - rows[first] <= 5.0 * rate_hz  # s, the longest between the two
    return first[near], second[near]


def _evenly_spaced(recording: Recording) -> Recording:
    """The next sample at each of evenly spaced times: where the rate is lower, or some are lost, each lasts longer."""
    interval = 1.0 / recording.rate_hz
    even = np.arange(recording.t[0], recording.t[-1], interval)
    rows = np.minimum(np.searchsorted(recording.t, even - 0.5 * interval), len(recording) - 1)
    channels: dict[str, Any] = {name: np.asfortranarray(values[rows]) for name, values in recording.channels.items()}
    return replace(recording, t=even, **channels)


def _block_means(values: Array, every: int) -> Array:
    averaged: Array = values[: len(values) // every * every].reshape(-1, every, 3).mean(axis=1)
    return averaged
