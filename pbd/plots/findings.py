"""Findings: problems of a demonstration that a person should look at, in words and with their times."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby, pairwise

import numpy as np
from numpy.typing import NDArray

from pbd.data import HandPath, Keyframe
from pbd.data.tracking import DOUBTED_WEIGHT
from pbd.pose import Array, quat_to_matrix

FIRST_REST_S = 1.0
"""Shortest first rest, s, without a finding. Users are asked for two seconds, as everything is measured from it."""

SHORT_STOP_S = 0.3
"""Shortest stop, s, without a finding. A hand that moves steadily looks still for a moment too."""

UNSURE_MOVE_M = 0.01
"""Largest sigma, m, that a move adds without a finding. (`pbd record` says "pause now" above it.)"""

DRIFT_M_S2 = 0.2
"""Largest bias of a cheap accelerometer, m/s2 (20 mg). It bounds the residual velocity that drift explains."""

TREMBLE_S, TREMBLE_WITHIN_M, TREMBLE_WITHIN_RAD = 0.5, 0.015, 0.3
"""Duration, s, of a window, and largest range of the position, m, and the attitude, rad, of a hand held still in it."""
TREMBLE_RMS_M_S2 = 0.3
"""Smallest acceleration, m/s2 rms, of a trembling hand. A short and slow move reaches at most 0.25."""
TREMBLE_MEAN_SHARE = 0.25
"""Largest ratio of squared mean to mean square of a trembling hand's acceleration. It is small: the sign alternates."""

OFF_SIGMAS = 4.0
"""Largest error of a keyframe, in sigmas, without a finding. The probability of a larger one is one in a thousand."""

MAX_LISTED, MAX_HIGHLIGHTED = 3, 10
"""Largest number of findings of one kind that are listed one by one; more become one, which highlights this many."""

MAX_RANGES = 3
"""Largest number of keyframe numbers, or ranges of them, in a label or a finding."""

Span = tuple[float, float]
"""Start and end, s."""


@dataclass(frozen=True)
class Finding:
    """A problem in words, and its times if it has any."""

    words: str
    spans: tuple[Span, ...] = ()


RankedFinding = tuple[float, Finding]
"""Severity, and the finding."""


def find_problems(
    path: HandPath, names: Sequence[str], a_nav: Array, error: Array | None, remarks: Sequence[str]
) -> tuple[Finding, ...]:
    """Collect the findings of a demonstration.

    Args:
        names: names of the path's stops, from `stop_names`.
        a_nav: (n, 3) m/s2, motion acceleration at the path's instants.
        error: (n, 3) m, path minus truth; None where the truth is unknown.
        remarks: warnings given while it was tracked.
    """
    # Sigma that each move adds along its worst axis, m.
    added_m = np.sqrt(np.diagonal(path.covariance.of_moves, axis1=1, axis2=2).max(axis=1, initial=0.0))
    doubted = [k for k, stop in enumerate(path.stops) if stop.weight < DOUBTED_WEIGHT]
    return (
        *map(Finding, remarks),
        *_off_the_truth(path, names, error),
        *_first_rest(path),
        *_grouped(
            _trembling(path, names, a_nav),
            "moves end with a trembling hand, so no stop is found there: rest the hand on something",
        ),
        *_grouped(
            _doubted(path, names, doubted),
            "keyframes may not be stops, since the hand seems to pass through them: stop for half a second",
        ),
        *_grouped(
            _short_stops(path, names, doubted),
            f"keyframes last less than {SHORT_STOP_S:g} s, so the hand may not have stopped there: stop for half a "
            "second",
        ),
        *_unsure_moves(path, names, added_m),
        *_grouped(
            _residual_velocities(path, names, doubted, added_m),
            "moves end with more residual velocity than drift explains: hold still at both ends",
        ),
    )


def stop_names(path: HandPath, keyframes: Sequence[Keyframe]) -> tuple[str, ...]:
    """Name of each stop in plots: its keyframe's number, or its time if that keyframe was removed."""
    t = np.array([keyframe.t for keyframe in keyframes])
    names = []
    for begin, end in path.rests:
        k = int(np.searchsorted(t, begin))
        names.append(str(k) if k < len(t) and t[k] <= end else f"the stop at {begin:.1f} s")
    return tuple(names)


def stop_phrase(name: str) -> str:
    """A stop's name within a sentence."""
    return f"keyframe {name}" if name.isdecimal() else name


def length_text(metres: float) -> str:
    """Write a length for people."""
    if metres < 0.01:
        return f"{1e3 * metres:.1f} mm"
    return f"{100.0 * metres:.1f} cm" if metres < 1.0 else f"{metres:.2f} m"


def ranges(numbers: Sequence[int]) -> str:
    """Write increasing numbers as ranges: 0, 4–6, 9."""
    runs = [[each for _, each in run] for _, run in groupby(enumerate(numbers), lambda pair: pair[1] - pair[0])]
    words = [str(run[0]) if len(run) == 1 else f"{run[0]}{', ' if len(run) == 2 else '–'}{run[-1]}" for run in runs]
    return ", ".join(words if len(words) <= MAX_RANGES else [*words[: MAX_RANGES - 1], "…"])


def _grouped(found: Iterable[RankedFinding], summary: str) -> list[Finding]:
    """The findings, worst first; more than MAX_LISTED are summed up in one."""
    worst = [finding for _, finding in sorted(found, key=lambda each: -each[0])]
    if len(worst) <= MAX_LISTED:
        return worst
    spans = (span for finding in worst[:MAX_HIGHLIGHTED] for span in finding.spans)
    return [Finding(f"{len(worst)} {summary}", tuple(spans))]


def _first_rest(path: HandPath) -> Iterator[Finding]:
    first = path.stops[0]
    if len(path.stops) == 1:
        yield Finding("the hand stops only once: there is nothing to replay; hold still, move, and hold still again")
    elif first.dwell_s < FIRST_REST_S:
        rest = f"the first rest lasts only {first.dwell_s:.2f} s, but all else is measured from it"
        yield Finding(f"{rest}: hold still for two seconds", path.rests[:1])


def _doubted(path: HandPath, names: Sequence[str], doubted: Sequence[int]) -> Iterator[RankedFinding]:
    for k in doubted:
        sure = path.stops[k].weight
        words = (
            f"{stop_phrase(names[k])} may not be a stop ({100.0 * sure:.0f} % sure): the hand seems to pass through "
            "it; stop for half a second, or move faster"
        )
        yield -sure, Finding(words, (path.rests[k],))


def _short_stops(path: HandPath, names: Sequence[str], doubted: Sequence[int]) -> Iterator[RankedFinding]:
    for k, stop in enumerate(path.stops[1:], start=1):
        if k not in doubted and round(stop.dwell_s, 2) < SHORT_STOP_S:  # rounded as in the text
            words = (
                f"{stop_phrase(names[k])} lasts only {stop.dwell_s:.2f} s, from {path.rests[k][0]:.1f} s on, so the "
                "hand may not have stopped: stop for half a second"
            )
            yield -stop.dwell_s, Finding(words, (path.rests[k],))


def _trembling(path: HandPath, names: Sequence[str], a_nav: Array) -> Iterator[RankedFinding]:
    """Find times at which the hand is held still but trembles, so that no stop is found."""
    n = max(2, round(TREMBLE_S * (len(path.t) - 1) / float(path.t[-1] - path.t[0])))
    trembles = _trembles(path, a_nav, n)
    for k, (before, after) in enumerate(pairwise(path.stops)):
        begins = np.flatnonzero(trembles[before.stop : max(after.start - n, before.stop)]) + before.stop
        if not len(begins):
            continue
        longest = max(np.split(begins, np.flatnonzero(np.diff(begins) > 1) + 1), key=len)
        span = (float(path.t[longest[0]]), float(path.t[longest[-1] + n]))
        if not any(_marks(path, stop, span) for stop in (k, k + 1)):
            words = (
                f"between {names[k]} and {names[k + 1]} the hand is held still from {span[0]:.1f} to {span[1]:.1f} s, "
                "but trembles, so no stop is found: rest the hand on something"
            )
            yield span[1] - span[0], Finding(words, (span,))


def _marks(path: HandPath, stop: int, span: Span) -> bool:
    """Whether a long enough stop, right before or after the trembling, marks the same place."""
    begin, end = path.rests[stop]
    return path.stops[stop].dwell_s >= SHORT_STOP_S and begin - SHORT_STOP_S < span[1] and span[0] < end + SHORT_STOP_S


def _trembles(path: HandPath, a_nav: Array, n: int) -> NDArray[np.bool_]:
    """For each sample, whether the hand trembles about one pose during this and the next n - 1 samples."""
    from scipy.ndimage import maximum_filter1d, minimum_filter1d, uniform_filter1d

    attitude = quat_to_matrix(path.wxyz_nav_sensor).reshape(-1, 9)
    values = np.hstack((path.p_nav_sensor / TREMBLE_WITHIN_M, attitude / TREMBLE_WITHIN_RAD))
    ahead = -(n // 2)  # scipy centres its windows
    reach = maximum_filter1d(values, n, axis=0, origin=ahead) - minimum_filter1d(values, n, axis=0, origin=ahead)
    squares = (a_nav**2).sum(axis=1)
    steady = (uniform_filter1d(a_nav, n, axis=0, origin=ahead) ** 2).sum(axis=1)
    alternates = steady < TREMBLE_MEAN_SHARE * uniform_filter1d(squares, n, origin=ahead)
    # The hand must tremble all the time: setting it down is a single bump.
    smallest = minimum_filter1d(uniform_filter1d(squares, max(n // 2, 1)), n, origin=ahead)
    return np.asarray((reach <= 1.0).all(axis=1) & (smallest > TREMBLE_RMS_M_S2**2) & alternates)


def _unsure_moves(path: HandPath, names: Sequence[str], added_m: Array) -> list[Finding]:
    advice, found, worst = "stop on the way, or move more calmly", list[RankedFinding](), ""
    for k in sorted(np.flatnonzero(added_m > UNSURE_MOVE_M).tolist(), key=lambda k: -added_m[k]):
        move = f"from {names[k]} to {names[k + 1]} ({_move_s(path, k):.1f} s)"
        sigma = length_text(float(added_m[k]))
        words = f"the move {move} adds an uncertainty of {sigma} (one sigma): {advice}"
        found.append((float(added_m[k]), Finding(words, (_move_span(path, k),))))
        worst = worst or f"{move}, {sigma}"
    least = length_text(UNSURE_MOVE_M)
    return _grouped(
        found, f"moves add an uncertainty of more than {least} each (one sigma), the worst, {worst}: {advice}"
    )


def _residual_velocities(
    path: HandPath, names: Sequence[str], doubted: Sequence[int], added_m: Array
) -> Iterator[RankedFinding]:
    """Find moves that end with more velocity than drift explains, and that have no other finding."""
    for k, residual in enumerate(np.linalg.norm(path.closure, axis=1).tolist()):
        duration = _move_s(path, k)
        remarked = added_m[k] > UNSURE_MOVE_M or k in doubted or k + 1 in doubted
        if residual > DRIFT_M_S2 * duration and not remarked:
            words = (
                f"a residual velocity of {length_text(residual)}/s at {stop_phrase(names[k + 1])}, after a move of "
                f"{duration:.1f} s, is more than drift: hold still at {names[k]} and {names[k + 1]}, and turn "
                "slowly and without knocks in between"
            )
            yield residual / duration, Finding(words, (_move_span(path, k),))


def _off_the_truth(path: HandPath, names: Sequence[str], error: Array | None) -> Iterator[Finding]:
    """Find the keyframe with the largest error in sigmas, if that exceeds OFF_SIGMAS."""
    if error is None:
        return
    off = np.linalg.norm(error[[stop.middle for stop in path.stops]], axis=1)
    sigma = np.sqrt(np.diagonal(path.cov, axis1=1, axis2=2)[:, :3].max(axis=1))
    sigmas = np.divide(off, sigma, out=np.zeros_like(off), where=(sigma > 0.0) & np.isfinite(off))
    if far := int((sigmas > OFF_SIGMAS).sum()):
        k = int(np.argmax(sigmas))
        more = f" ({far} keyframes are more than {OFF_SIGMAS:g} off)" if far > 1 else ""
        words = f"{stop_phrase(names[k])} is {length_text(float(off[k]))} from the truth, {sigmas[k]:.0f} sigma{more}"
        yield Finding(words, (path.rests[k],))


def _move_span(path: HandPath, k: int) -> Span:
    """From the end of stop k to the start of the next one."""
    return path.rests[k][1], path.rests[k + 1][0]


def _move_s(path: HandPath, k: int) -> float:
    begin, end = _move_span(path, k)
    return end - begin
