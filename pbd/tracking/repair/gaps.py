"""Gaps in a recording: where samples are missing, and whether the hand may have moved meanwhile."""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pbd.data import Recording, Stop
from pbd.data.one_line_repr import counted
from pbd.errors import TrackingError, warn
from pbd.pose import Array
from pbd.tracking.first_rest import STILL_ACC
from pbd.tracking.repair.clock import LATE_SAMPLES
from pbd.tracking.zero_velocity import ENERGY_WINDOW_S

BRIDGED_S = 0.050
"""Longest gap, s, that is interpolated."""

HIDDEN_MOVE_S = 0.12
"""Longest gap in a rest, s, that can't hide a move worth knowing. A minimum-jerk move (Flash and Hogan, 1985) of T s
with a peak acceleration a goes a T^2 / 5.77: with 5 m/s2, brisk for a hand, 1.2 cm in this time. A shorter gap widens
sigma by that much (`Noise.unseen_speed`)."""


def interpolated(t: Array, values: Array, good: NDArray[np.bool_]) -> Array:
    """Values (n, k) with the rows that are not good put between their neighbours."""
    if good.all():
        return values
    return np.column_stack([np.interp(t, t[good], column) for column in values[good].T])


@dataclass(frozen=True)
class Gap:
    """No data between row `before` and row `after`, for `missing_s` more than one sampling interval."""

    before: int
    after: int
    missing_s: float


def find_gaps(t: Array, missing: NDArray[np.bool_], interval: float) -> list[Gap]:
    """Neighbouring good rows that lie more than one and a half sampling intervals apart."""
    good = np.flatnonzero(~missing)
    if len(good) == 0:
        return [Gap(0, len(t) - 1, float(t[-1] - t[0]))]
    good = good[np.concatenate(([True], np.diff(t[good]) > 0.0))]
    late = np.cumsum(np.diff(t[good], prepend=t[good[0]]) - interval)  # behind a steady beat
    spans = np.diff(late)
    far = np.flatnonzero(spans > 0.5 * interval)
    # A late stamp is made up for by the next ones, a lost sample is not.
    made_up = late[np.minimum(far + 1 + LATE_SAMPLES, len(good) - 1)] - late[np.maximum(far - LATE_SAMPLES, 0)]
    gaps = [Gap(int(good[i]), int(good[i + 1]), float(spans[i])) for i in far[made_up > 0.75 * interval]]
    if good[0] > 0:
        gaps.insert(0, Gap(0, int(good[0]), float(t[good[0]] - t[0])))
    if good[-1] < len(t) - 1:
        gaps.append(Gap(int(good[-1]), len(t) - 1, float(t[-1] - t[good[-1]])))
    return gaps


def warn_of_gaps(gaps: list[Gap], t: Array, interval: float) -> None:
    """Warn of lost samples: how many, in how many gaps."""
    if not gaps:
        return
    longest = max(gaps, key=lambda gap: gap.missing_s)
    lost = sum(round(gap.missing_s / interval) for gap in gaps)
    warn(
        f"{counted(lost, 'sample')} missing, in {counted(len(gaps), 'gap')}; the longest is "
        f"{longest.missing_s * 1e3:.0f} ms after row {longest.before} (t = {t[longest.before]:.2f} s)"
    )


def refuse_gaps(gaps: tuple[Gap, ...], recording: Recording, stops: tuple[Stop, ...], accept: bool = False) -> None:
    """Refuse a long gap, in which the hand's motion is unknown. Warn of a short one in a rest, which hides little.

    The sensor's attitude after the gap is no proof: the hand may be elsewhere, and as level as before.

    Args:
        gaps: of `condition`.
        recording: of `condition`.
        stops: in order.
        accept: only warn of gaps in rests, as a person knows that the hand stood still.

    Raises:
        TrackingError: with `t`, `row` and the gap's length as fields.
    """
    t, starts = recording.t, [stop.start for stop in stops]
    for gap in gaps:
        k = bisect_right(starts, gap.before) - 1
        if k < 0 or not _rests_beside(recording, gap, stops[k]):
            raise TrackingError(
                f"{gap.missing_s * 1e3:.0f} ms of data are missing after row {gap.before} (t = {t[gap.before]:.2f} s), "
                f"while the hand moves; at most {BRIDGED_S * 1e3:.0f} ms can be bridged: record again",
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
        f"{longest.missing_s * 1e3:.0f} ms of data are missing in a rest, {_where(longest, t)}: a move may be hidden "
        "in it" + (f", and in {counted(len(inner) - 1, 'other gap')}" if len(inner) > 1 else "")
    )
    if longest.missing_s > HIDDEN_MOVE_S + 1e-6 and not accept:
        raise TrackingError(
            f"{said}; record again, or give --accept-gap if the hand stood still there",
            row=longest.before,
            t=float(t[longest.before]),
            value=longest.missing_s,
            bound=HIDDEN_MOVE_S,
        )
    warn(f"{said}; the sigma of later keyframes is wider; record again if the hand moved")


def _at_an_end(gap: Gap, recording: Recording) -> bool:
    """Whether nothing comes before a gap, or after it."""
    return gap.before == 0 or gap.after == len(recording) - 1


def _where(gap: Gap, t: Array) -> str:
    if gap.after == len(t) - 1:
        return f"from row {gap.before} (t = {t[gap.before]:.2f} s) to the end"
    if gap.before == 0:
        return f"up to row {gap.after} (t = {t[gap.after]:.2f} s)"
    return f"after row {gap.before} (t = {t[gap.before]:.2f} s)"


def _rests_beside(recording: Recording, gap: Gap, stop: Stop) -> bool:
    """Tell whether a gap lies in a stop, and the hand rests in the same attitude before and after it.

    Interpolated data are smooth. Without this check, the stop might have been found in them.
    """
    rows = max(2, round(ENERGY_WINDOW_S * recording.rate_hz))
    before, after = slice(gap.before + 1 - rows, gap.before + 1), slice(gap.after, gap.after + rows)
    if _at_an_end(gap, recording):
        return stop.start <= gap.before and gap.after < stop.stop
    if before.start < stop.start or after.stop > stop.stop:
        return False
    turned = recording.acc[after].mean(axis=0) - recording.acc[before].mean(axis=0)
    return float(np.linalg.norm(turned)) < STILL_ACC
