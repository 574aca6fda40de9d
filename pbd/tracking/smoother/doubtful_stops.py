"""Find the stops that the estimated velocity contradicts, and cut them to their slow parts."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from pbd.data.tracking import DOUBTED_WEIGHT
from pbd.pose import Array, lengths
from pbd.tracking.moving_windows import Spans
from pbd.tracking.noise import OUTLIER_SIGMAS
from pbd.tracking.slow_ends import without_slow_ends
from pbd.tracking.smoother.factors import pivot_velocity, robust_weights
from pbd.tracking.smoother.gauss_newton import UNDOUBTED_SIGMAS
from pbd.tracking.smoother.knots import LONG_STOP_S, Problem
from pbd.tracking.smoother.normal_equations import Solved
from pbd.tracking.smoother.preintegration import VEL
from pbd.tracking.smoother.state import State
from pbd.tracking.zero_velocity import ENERGY_WINDOW_S, lasts, slow_parts, trimmed

MOVING_WEIGHT = 0.29
"""Robust weight of zero velocity below which the hand seems to move. With noise of one sigma on each axis, one knot in
twenty has a smaller weight."""

SHORTEST_DIVIDED_S = 0.5
"""Shortest candidate, s, that can contain both a rest and a move. A shorter one is accepted or dropped as a whole."""

SLOW_SPEED = 0.02
"""m/s: a doubted stop is cut where the estimated speed is larger, and larger than noise explains."""


def doubted_stops(problem: Problem, v: Array, still: Array, candidates: Spans, still_sigma: Array) -> NDArray[np.bool_]:
    """Which candidates (c,) contain a knot that seems to move, and are long enough for both a rest and a move.

    Between the knots of a long one the velocity counts too: a hand that moves and rests in turns may rest at each knot.

    Args:
        still: weights of zero velocity at the knots.
        problem, v, candidates, still_sigma: as `revised_stops` takes them.
    """
    spans, moving = np.array(candidates), problem.rows[(problem.stop_of >= 0) & (still < MOVING_WEIGHT)]
    lasts = np.diff(problem.frame.t[spans - (0, 1)], axis=1)[:, 0]
    fast = np.flatnonzero(lengths(v) > np.maximum(SLOW_SPEED, OUTLIER_SIGMAS * still_sigma))
    has_moving, has_fast = (np.diff(np.searchsorted(rows, spans), axis=1)[:, 0] > 0 for rows in (moving, fast))
    doubted: NDArray[np.bool_] = has_moving & (lasts > SHORTEST_DIVIDED_S) | has_fast & (lasts > LONG_STOP_S)
    return doubted


def revised_stops(
    problem: Problem,
    v: Array,
    solved: Solved,
    candidates: Spans,
    cut: NDArray[np.bool_],
    still_sigma: Array,
    gaps: Sequence[tuple[int, int]] = (),
) -> Spans:
    """The stops according to the estimated velocity.

    A doubted candidate is cut to its slow parts, without the slow ends of the moves between them. Ends at which the
    hand moves are trimmed. If less than half a window is left, the hand only reversed its direction there.

    Args:
        problem, v, solved: the last iteration's, with its estimate of velocity (n, 3) m/s.
        candidates: spans that look still.
        cut: (c,) which of them were doubted.
        still_sigma: (n,) m/s per axis, sigma of zero velocity.
        gaps: last row before and first row after each gap in the data.
    """
    t, fast = problem.frame.t, np.maximum(SLOW_SPEED, OUTLIER_SIGMAS * still_sigma)
    if cut.any():
        sigma = np.sqrt(np.trace(solved.covariance_of_knots(VEL), axis1=1, axis2=2))
        fast = np.maximum(fast, UNDOUBTED_SIGMAS * np.interp(t, problem.t, sigma))
    steps = np.diff(t, prepend=t[0])
    for first, after in gaps:  # only seen time counts: a row beside a gap may seem to move, but divides no stop
        steps[first + 1 : after + 1] = 0.0
    seen = np.cumsum(steps)
    blurred = np.trace(problem.legs.parts[:, :, 3:6, 3:6].sum(axis=0), axis1=1, axis2=2) / 3.0
    speed, stops = lengths(v), Spans()
    for span, in_parts in zip(candidates, cut.tolist(), strict=True):
        parts = [span]
        if in_parts:
            slow = slow_parts(seen, span, speed[slice(*span)] < fast[slice(*span)])
            parts = without_slow_ends(t, slow, speed)
        for part in parts:
            inside = slice(*part)
            # Sigma per axis of the change of velocity from knot to knot.
            first, last = np.searchsorted(problem.rows, part)
            between = blurred[first : max(last - 1, first + 1)]
            blur = float(np.sqrt(between.sum() / max(len(between), 1)))
            creep = lengths(v[inside] - np.median(v[inside], axis=0))
            stop = trimmed(part, creep < OUTLIER_SIGMAS * (float(np.median(still_sigma[inside])) + blur))
            if lasts(t, stop, 0.5 * ENERGY_WINDOW_S):
                stops.append(stop)
    return stops


def stop_weights(problem: Problem, x: State) -> Array:
    """Weight of each stop, 0 to 1: the largest robust weight of a knot beside another slow one; 0: it is no stop.

    A hand that turns back has zero velocity too, but only for an instant.
    """
    found, speed = np.zeros(len(problem.stops)), lengths(pivot_velocity(problem, x)[0])
    weights = robust_weights(np.maximum((speed / problem.still_sigma) ** 2 - 3.0, 0.0))
    slow = speed < np.maximum(SLOW_SPEED, OUTLIER_SIGMAS * problem.still_sigma)
    before, after = np.pad(problem.same_stop, (1, 0)), np.pad(problem.same_stop, (0, 1))
    rests = before & np.roll(slow, 1) | after & np.roll(slow, -1) | ~(before | after)
    np.maximum.at(found, problem.stop_of, weights * (rests & (problem.stop_of >= 0)))
    return np.where(found > 1.0 - DOUBTED_WEIGHT, found, 0.0)


def settled(t: Array, before: Spans, after: Spans) -> bool:
    """Whether the stops are the same within 20 ms: evenly spaced knots are no nearer to their ends."""
    if len(before) != len(after):
        return False
    ends = t[np.array([before, after]) - (0, 1)]
    return bool(np.abs(ends[1] - ends[0]).max() < 0.02)
