"""What is to be looked at in a demonstration: in words, and when."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from pbd.data import HandPath, Keyframe, Stop
from pbd.data.hand import DOUBTED
from pbd.pose import Array, quat_to_matrix
from pbd.view.plot_values import Finding, Span, TruthPlot

FIRST_REST_S = 1.0
"""All else is seen from the first rest. Two seconds are asked for; less than half of that is remarked upon."""

SHORT_STOP_S = 0.3
"""Who shows a place stays there longer. A hand that moves on steadily looks as still for a moment; its speed is then
taken for zero."""

UNSURE_MOVE_M = 0.01
"""A move that adds more than this to sigma is remarked upon (`pbd record` says "pause now" from there on)."""

DRIFT = 0.2
"""m/s2: the bias of a cheap accelerometer (20 mg). More velocity than that makes in the time of a move is no drift."""

AROUND_S, AROUND_M, AROUND_RAD, TREMBLES = 0.5, 0.015, 0.3, 0.3
"""A hand that for so long stays within this of one place and attitude, and accelerates to and fro by more than that
(rms, m/s2), is held still and trembles. (A move that is so short and takes so long accelerates by at most 0.25.)"""

TO_AND_FRO = 0.25
"""To and fro: the square of the mean acceleration is less than this share of its mean square. Half a move is not."""

OFF_SIGMAS = 4.0
"""A keyframe that is further than this from the truth is remarked upon: of a thousand one by chance."""

SAID_ONE_BY_ONE, SHOWN = 3, 10
"""More findings of a kind share one remark, which points at so many of them."""

Weighed = tuple[float, Finding]
"""How bad it is, and what."""


def find(
    path: HandPath, names: Sequence[str], a_nav: Array, truth: TruthPlot | None, remarks: Sequence[str]
) -> tuple[Finding, ...]:
    """Collect what a person should look at.

    Args:
        path: as tracked.
        names: of its stops, from `stop_names`.
        a_nav: (n, 3) m/s2, motion acceleration at the path's instants.
        truth: where it is known.
        remarks: the warnings that were given on the way.
    """
    passed = _passed(path)
    short = f"last less than {SHORT_STOP_S:g} s, so the hand may not have stopped there: stop for half a second"
    return (
        *map(Finding, remarks),
        *_off(path, names, truth),
        *_first_rest(path),
        *_few(
            _trembling(path, names, a_nav),
            "moves end with a trembling hand, so no stop is found there: rest the hand on something",
        ),
        *_few(
            _no_stops(path, names, passed),
            "keyframes may not be stops, since the hand seems to pass through them: stop for half a second",
        ),
        *_few(_short_stops(path, names, passed), f"keyframes {short}"),
        *_unsure_moves(path, names),
        *_few(
            _left_over(path, names, passed),
            "moves end with more residual velocity than drift explains: hold still at both ends",
        ),
    )


def stop_names(path: HandPath, keyframes: Sequence[Keyframe]) -> tuple[str, ...]:
    """What each stop is called in the plots: its keyframe's number, or, where a person took that out, when it is."""
    t = np.array([keyframe.t for keyframe in keyframes])
    names = []
    for stop in path.stops:
        begin, end = _during(path, stop)
        k = int(np.searchsorted(t, begin))
        names.append(str(k) if k < len(t) and t[k] <= end else f"the stop at {begin:.1f} s")
    return tuple(names)


def at_stop(name: str) -> str:
    """A stop's name within a sentence."""
    return f"keyframe {name}" if name.isdecimal() else name


def length(metres: float) -> str:
    """Write a length for people."""
    if metres < 0.01:
        return f"{1e3 * metres:.1f} mm"
    return f"{100.0 * metres:.1f} cm" if metres < 1.0 else f"{metres:.2f} m"


def _few(found: Iterator[Weighed], together: str) -> list[Finding]:
    """The worst first; more than a few in one remark."""
    worst = [finding for _, finding in sorted(found, key=lambda each: -each[0])]
    if len(worst) > SAID_ONE_BY_ONE:
        return [Finding(f"{len(worst)} {together}", tuple(span for finding in worst[:SHOWN] for span in finding.spans))]
    return worst


def _first_rest(path: HandPath) -> Iterator[Finding]:
    first = path.stops[0]
    if len(path.stops) == 1:
        yield Finding("the hand stands still all the time: there is nothing to replay")
    elif first.dwell_s < FIRST_REST_S:
        rest = f"the first rest lasts only {first.dwell_s:.2f} s, but all else is measured from it"
        yield Finding(f"{rest}: hold still for two seconds", (_during(path, first),))


def _passed(path: HandPath) -> tuple[int, ...]:
    """Stops that the tracker doubts: a hand that goes on at a steady speed looks as still as one that stops."""
    return tuple(k for k, stop in enumerate(path.stops) if stop.weight < DOUBTED)


def _no_stops(path: HandPath, names: Sequence[str], passed: Sequence[int]) -> Iterator[Weighed]:
    for k in passed:
        sure = path.stops[k].weight
        words = (
            f"{at_stop(names[k])} may not be a stop ({100.0 * sure:.0f} % sure): the hand seems to pass through it; "
            "stop for half a second, or move faster"
        )
        yield -sure, Finding(words, (_during(path, path.stops[k]),))


def _short_stops(path: HandPath, names: Sequence[str], passed: Sequence[int]) -> Iterator[Weighed]:
    for k, stop in enumerate(path.stops[1:], start=1):
        if k not in passed and round(stop.dwell_s, 2) < SHORT_STOP_S:  # as it is written
            words = (
                f"{at_stop(names[k])} lasts only {stop.dwell_s:.2f} s, from {path.t[stop.start]:.1f} s on, so the hand "
                "may not have stopped: stop for half a second"
            )
            yield -stop.dwell_s, Finding(words, (_during(path, stop),))


def _trembling(path: HandPath, names: Sequence[str], a_nav: Array) -> Iterator[Weighed]:
    """Where the hand is held in one place, but no stop is seen."""
    n = max(2, round(AROUND_S * (len(path.t) - 1) / float(path.t[-1] - path.t[0])))
    around = _around(path, a_nav, n)
    for k, (before, after) in enumerate(pairwise(path.stops)):
        begins = np.flatnonzero(around[before.stop : max(after.start - n, before.stop)]) + before.stop
        runs = np.split(begins, np.flatnonzero(np.diff(begins) > 1) + 1)
        longest = max(runs, key=len)
        if not len(longest):
            continue
        span = (float(path.t[longest[0]]), float(path.t[longest[-1] + n]))
        if not any(_shows(path, stop, span) for stop in (before, after)):
            words = (
                f"between {names[k]} and {names[k + 1]} the hand is held still from {span[0]:.1f} to {span[1]:.1f} s, "
                "but trembles, so no stop is found: rest the hand on something"
            )
            yield span[1] - span[0], Finding(words, (span,))


def _shows(path: HandPath, stop: Stop, span: Span) -> bool:
    """Whether it is a stop that shows the place where the hand trembles: long enough, and soon before or after."""
    begin, end = _during(path, stop)
    return stop.dwell_s >= SHORT_STOP_S and begin - SHORT_STOP_S < span[1] and span[0] < end + SHORT_STOP_S


def _around(path: HandPath, a_nav: Array, n: int) -> NDArray[np.bool_]:
    """For each sample, whether the hand trembles around one place during it and the n - 1 that follow."""
    from scipy.ndimage import maximum_filter1d, minimum_filter1d, uniform_filter1d

    if len(path.t) <= n:
        return np.zeros(len(path.t), dtype=bool)
    attitude = quat_to_matrix(path.wxyz_nav_sensor).reshape(-1, 9)
    values = np.hstack((path.p_nav_sensor / AROUND_M, attitude / AROUND_RAD))
    ahead = -(n // 2)  # scipy centres its windows
    reach = maximum_filter1d(values, n, axis=0, origin=ahead) - minimum_filter1d(values, n, axis=0, origin=ahead)
    squares = (a_nav**2).sum(axis=1)
    steady = (uniform_filter1d(a_nav, n, axis=0, origin=ahead) ** 2).sum(axis=1)
    to_and_fro = steady < TO_AND_FRO * uniform_filter1d(squares, n, origin=ahead)
    # All the time: being set down is one bump.
    least = minimum_filter1d(uniform_filter1d(squares, max(n // 2, 1)), n, origin=ahead)
    around: NDArray[np.bool_] = (reach <= 1.0).all(axis=1) & (least > TREMBLES**2) & to_and_fro
    return around


def _unsure_moves(path: HandPath, names: Sequence[str]) -> list[Finding]:
    """Say which moves add much to what is not known."""
    added = np.sqrt(_added(path))
    unsure = sorted(np.flatnonzero(added > UNSURE_MOVE_M).tolist(), key=lambda k: -added[k])
    moves = [(f"from {names[k]} to {names[k + 1]} ({_lasts(path, k):.1f} s)", length(float(added[k]))) for k in unsure]
    spans = [_move(path, k) for k in unsure]
    advice = "stop on the way, or move more calmly"
    if len(moves) > SAID_ONE_BY_ONE:
        each, (worst, sigma) = length(UNSURE_MOVE_M), moves[0]
        words = (
            f"{len(moves)} moves add an uncertainty of more than {each} each (one sigma), the worst, {worst}, {sigma}: "
            f"{advice}"
        )
        return [Finding(words, tuple(spans[:SHOWN]))]
    return [
        Finding(f"the move {move} adds an uncertainty of {sigma} (one sigma): {advice}", (span,))
        for (move, sigma), span in zip(moves, spans, strict=True)
    ]


def _added(path: HandPath) -> Array:
    """The variance of each move's way, m2, along the worst axis."""
    added: Array = np.diagonal(path.covariance.of_moves, axis1=1, axis2=2).max(axis=1, initial=0.0)
    return added


def _left_over(path: HandPath, names: Sequence[str], passed: Sequence[int]) -> Iterator[Weighed]:
    """Moves at whose end more velocity is left over than a sensor drifts by; sure ones, the others are told already."""
    added = _added(path)
    for k, left_over in enumerate(np.linalg.norm(path.closure, axis=1).tolist()):
        lasts = _lasts(path, k)
        told = added[k] > UNSURE_MOVE_M**2 or k in passed or k + 1 in passed
        if left_over > DRIFT * lasts and not told:
            words = (
                f"a residual velocity of {length(left_over)}/s at {at_stop(names[k + 1])}, after a move of {lasts:.1f} "
                f"s, is more than drift: hold still at {names[k]} and {names[k + 1]}, and turn more slowly in between"
            )
            yield left_over / lasts, Finding(words, (_move(path, k),))


def _off(path: HandPath, names: Sequence[str], truth: TruthPlot | None) -> Iterator[Finding]:
    """The keyframe that is the most sigmas away from the truth, if that is too many."""
    if truth is None:
        return
    middles = [(stop.start + stop.stop - 1) // 2 for stop in path.stops]
    off = np.linalg.norm(truth.error[middles], axis=1)
    sigma = np.sqrt(np.diagonal(path.cov, axis1=1, axis2=2)[:, :3].max(axis=1))
    sigmas = np.divide(off, sigma, out=np.zeros_like(off), where=(sigma > 0.0) & np.isfinite(off))
    far = np.flatnonzero(sigmas > OFF_SIGMAS)
    if len(far):
        k = int(np.argmax(sigmas))
        more = f" ({len(far)} keyframes are more than {OFF_SIGMAS:g} off)" if len(far) > 1 else ""
        words = f"{at_stop(names[k])} is {length(float(off[k]))} from the truth, {sigmas[k]:.0f} sigma{more}"
        yield Finding(words, (_during(path, path.stops[k]),))


def _during(path: HandPath, stop: Stop) -> Span:
    return float(path.t[stop.start]), float(path.t[stop.stop - 1])


def _move(path: HandPath, k: int) -> Span:
    """From keyframe k to the one after it."""
    return float(path.t[path.stops[k].stop - 1]), float(path.t[path.stops[k + 1].start])


def _lasts(path: HandPath, k: int) -> float:
    begin, end = _move(path, k)
    return end - begin
