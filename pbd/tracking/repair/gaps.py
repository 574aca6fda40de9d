"""Find gaps in a recording, and refuse those in which the hand may have moved."""

from bisect import bisect_right
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pbd.data import Recording, Stop
from pbd.data.one_line_repr import counted
from pbd.data.streams import interpolate
from pbd.errors import TrackingError, warn
from pbd.pose import Array
from pbd.timestamps.even_times import LATE_SAMPLES
from pbd.tracking.first_rest import STILL_ACC
from pbd.tracking.zero_velocity import ENERGY_WINDOW_S

FROZEN = "frozen (the reading repeats)"
"""Fault of a gap whose rows repeat the one before."""

BRIDGED_S = 0.050
"""Longest gap, s, that is bridged even in a move."""

HIDDEN_MOVE_S = 0.12
"""Longest gap in a rest, s, that can only hide a small move. A minimum-jerk move (Flash and Hogan, 1985) of T s with
peak acceleration a has length a T^2 / 5.77: 1.2 cm in this time with 5 m/s2, brisk for a hand. A shorter gap widens
sigma by that much (`Noise.unseen_speed`)."""


def bridged(t: Array, values: Array, good: NDArray[np.bool_]) -> Array:
    """Values (n, k), with rows that are not good (n,) bridged linearly in t (n,)."""
    if good.all():
        return values
    return interpolate(t, t[good], values[good])


@dataclass(frozen=True)
class Gap:
    """Rows between `before` and `after` have no data. They are `missing_s` (s) further apart than one interval.

    `fault` is what messages say of its samples: `missing`, or FROZEN.
    """

    before: int
    after: int
    missing_s: float
    fault: str = "missing"


def find_gaps(t: Array, missing: NDArray[np.bool_], interval: float) -> list[Gap]:
    """Gaps: good rows that are more than one and a half sampling intervals (s) apart. At least one row must be good."""
    good = np.flatnonzero(~missing)
    good = good[np.concatenate(([True], np.diff(t[good]) > 0.0))]
    late = np.cumsum(np.diff(t[good], prepend=t[good[0]]) - interval)  # relative to evenly spaced times
    spans = np.diff(late)
    far = np.flatnonzero(spans > 0.5 * interval)
    # The stamps catch up after a late one, but not after a lost sample.
    made_up = late[np.minimum(far + 1 + LATE_SAMPLES, len(good) - 1)] - late[np.maximum(far - LATE_SAMPLES, 0)]
    gaps = [Gap(int(good[i]), int(good[i + 1]), float(spans[i])) for i in far[made_up > 0.75 * interval]]
    if good[0] > 0:
        gaps.insert(0, Gap(0, int(good[0]), float(t[good[0]] - t[0])))
    if t[good[-1]] < t[-1]:
        gaps.append(Gap(int(good[-1]), len(t) - 1, float(t[-1] - t[good[-1]])))
    return gaps


def warn_of_gaps(gaps: list[Gap], t: Array, interval: float) -> None:
    """Warn of missing and frozen samples: how many, in how many gaps, and the longest."""
    if not gaps:
        return
    longest = max(gaps, key=lambda gap: gap.missing_s)
    lost = sum(round(gap.missing_s / interval) for gap in gaps)
    faults = " or ".join(dict.fromkeys(gap.fault for gap in gaps))
    warn(
        f"{counted(lost, 'sample')} {faults}, in {counted(len(gaps), 'gap')}; the longest is "
        f"{longest.missing_s * 1e3:.0f} ms after row {longest.before} (t = {t[longest.before]:.2f} s)"
    )


def refuse_gaps(gaps: tuple[Gap, ...], recording: Recording, stops: tuple[Stop, ...], *, accept: bool) -> None:
    """Refuse a gap in a move, and a long gap in a rest. Warn of a short gap in a rest, which can hide little.

    The sensor's attitude after the gap proves nothing: the hand may be elsewhere, and as level as before. With
    `accept`, only warn of gaps in rests, because a person knows that the hand stood still.

    Raises:
        TrackingError: with `t`, `row` and the gap's length (`value`).
    """
    t = recording.t
    for gap in gaps:
        if not is_in_rest(recording, gap, stops):
            raise TrackingError(
                f"{gap.missing_s * 1e3:.0f} ms of data are {gap.fault} after row {gap.before} "
                f"(t = {t[gap.before]:.2f} s), while the hand moves; "
                f"at most {BRIDGED_S * 1e3:.0f} ms can be bridged: record again",
                row=gap.before,
                t=float(t[gap.before]),
                value=gap.missing_s,
                bound=BRIDGED_S,
            )
    inner = [gap for gap in gaps if gap.missing_s > HIDDEN_MOVE_S or not _at_an_end(gap, recording)]
    if not inner:
        return
    longest = max(inner, key=lambda gap: gap.missing_s)
    said = (
        f"{longest.missing_s * 1e3:.0f} ms of data are {longest.fault} in a rest, {_where(longest, t)}: a move may be "
        "hidden in it" + (f", and in {counted(len(inner) - 1, 'other gap')}" if len(inner) > 1 else "")
    )
    if longest.missing_s > HIDDEN_MOVE_S + 1e-6 and not accept:
        raise TrackingError(
            f"{said}; record again, or give --accept-gap to each command if the hand stood still there",
            row=longest.before,
            t=float(t[longest.before]),
            value=longest.missing_s,
            bound=HIDDEN_MOVE_S,
        )
    so = "it is taken that the hand stood still there" if accept else "the sigma of later keyframes is wider"
    warn(f"{said}; {so}; record again if the hand moved")


def _at_an_end(gap: Gap, recording: Recording) -> bool:
    return gap.before == 0 or gap.after == len(recording) - 1


def _where(gap: Gap, t: Array) -> str:
    if gap.after == len(t) - 1:
        return f"from row {gap.before} (t = {t[gap.before]:.2f} s) to the end"
    if gap.before == 0:
        return f"up to row {gap.after} (t = {t[gap.after]:.2f} s)"
    return f"after row {gap.before} (t = {t[gap.before]:.2f} s)"


def is_in_rest(recording: Recording, gap: Gap, stops: tuple[Stop, ...]) -> bool:
    """Whether a gap is in one of the stops, with rest in the same attitude before and after it.

    Interpolated data are smooth, so the stop might have been found in them alone.
    """
    k = bisect_right(stops, gap.before, key=lambda stop: stop.start) - 1
    stop = stops[k]  # the last one, which begins later, if the gap is before all stops
    rows = max(2, round(ENERGY_WINDOW_S * recording.rate_hz))
    before, after = slice(gap.before + 1 - rows, gap.before + 1), slice(gap.after, gap.after + rows)
    if _at_an_end(gap, recording):
        return stop.start <= gap.before and gap.after < stop.stop
    if before.start < stop.start or after.stop > stop.stop:
        return False
    turned = recording.acc[after].mean(axis=0) - recording.acc[before].mean(axis=0)
    return float(np.linalg.norm(turned)) < STILL_ACC
