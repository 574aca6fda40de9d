"""Match stops to points, where a demonstration has more stops than points or their order is unknown."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations, permutations

import numpy as np

from pbd.calibration.registration import align
from pbd.data.one_line_repr import counted
from pbd.errors import CalibrationError
from pbd.pose import Array, Pose

STOP_SIGMA_M = 0.005
"""m: least sigma of a stop, so that a hypothesis from two stops is not too strict."""

OUTLIER_COST = 16.0
"""Largest cost of one stop, four sigma squared: one wrong point must not hide the rest."""

HEADING_BASE_M = 0.03
"""m, horizontal: least distance between two stops or points that give a heading."""

AMBIGUOUS_COST = 12.0
"""Difference in cost below which two answers count as equally likely. A true point costs about 3."""

SAME_ANSWER_M, SAME_ANSWER_RAD = 0.05, np.radians(10.0)
"""Distance and angle, m and rad, below which two answers are the same."""

REFINED_ANSWERS = 20
"""Number of the best answers that are aligned again on all their stops."""


@dataclass(frozen=True, eq=False)
class _Answer:
    cost: float
    stops: tuple[int, ...]
    T_base_nav: Pose


def match_points(p_nav_tip: Array, sigma: Array, points: Array, in_order: bool) -> tuple[int, ...]:
    """Say which stop touched each point.

    Every two stops on every two points that are as far apart tell yaw and position, as both frames have z up; of all
    these hypotheses the one that explains the most wins. Points in order are assigned by dynamic programming, others by
    the Hungarian method.

    Args:
        p_nav_tip: (n, 3) m at the stops.
        sigma: (n,) m per axis at the stops.
        points: (m, 3) m in base.
        in_order: the points were touched in their order, with other stops between.

    Returns:
        (m,) indices of stops.

    Raises:
        CalibrationError: fewer stops than points, no stops that lie as the points do, or several ways to match them.
    """
    n, m = len(p_nav_tip), len(points)
    if n < m:
        raise CalibrationError(
            f"the demonstration has {counted(n, 'stop')}, but there are {m} points; hold still for half a second on "
            "each, or remove points",
            value=n,
            bound=m,
        )
    if in_order and n == m:
        return tuple(range(m))
    sigma = np.hypot(sigma, STOP_SIGMA_M)
    given = p_nav_tip, sigma, points, in_order
    found = sorted((_assign(pose, *given) for pose in _hypotheses(*given)), key=lambda answer: -answer.cost)
    unique = sorted({answer.stops: answer for answer in found}.values(), key=lambda answer: answer.cost)
    best = sorted((_refined(answer, *given) for answer in unique[:REFINED_ANSWERS]), key=lambda answer: answer.cost)
    if not best or best[0].cost > OUTLIER_COST * max(1.0, m - 2.0):
        raise CalibrationError(
            "no stops of the demonstration have the same distances as the points; check the points' unit and "
            "coordinates, and that the hand stopped on each"
        )
    for other in best[1:]:
        metres, rad = other.T_base_nav.distance(best[0].T_base_nav)
        if other.cost - best[0].cost < AMBIGUOUS_COST and (metres > SAME_ANSWER_M or rad > SAME_ANSWER_RAD):
            raise CalibrationError(
                f"the stops fit the points in more than one way (another is turned by {np.degrees(rad):.0f} degrees), "
                "because the points are symmetric; name the stops with --stops, touch the points in order, or add one "
                "that breaks the symmetry",
                stops=best[0].stops,
                others=other.stops,
            )
    return best[0].stops


def _hypotheses(p: Array, sigma: Array, points: Array, in_order: bool) -> Iterator[Pose]:
    for i, j in combinations(range(len(p)), 2):
        way, room = p[j] - p[i], 3.0 * np.hypot(sigma[i], sigma[j])
        if np.hypot(*way[:2]) < HEADING_BASE_M:
            continue
        for a, b in combinations(range(len(points)), 2) if in_order else permutations(range(len(points)), 2):
            wanted = points[b] - points[a]
            level = np.hypot(*wanted[:2])
            if level > HEADING_BASE_M and abs(level - np.hypot(*way[:2])) < room and abs(wanted[2] - way[2]) < room:
                yield align(p[[i, j]], points[[a, b]])


def _assign(T_base_nav: Pose, p: Array, sigma: Array, points: Array, in_order: bool) -> _Answer:
    from scipy.optimize import linear_sum_assignment

    square = ((T_base_nav.act(p)[:, None] - points[None]) ** 2).sum(axis=2) / sigma[:, None] ** 2
    cost = np.minimum(square, OUTLIER_COST) + 1e-6 * square  # of those beyond the cap the nearest
    if in_order:
        stops = rows_in_order(cost)
    else:
        rows, columns = linear_sum_assignment(cost)
        stops = tuple(int(row) for row in rows[np.argsort(columns)])
    return _Answer(float(cost[list(stops), range(len(points))].sum()), stops, T_base_nav)


def rows_in_order(cost: Array) -> tuple[int, ...]:
    """The increasing rows (m,), one for each column, of lowest cost (n, m)."""
    n, m = cost.shape
    best = np.full((n + 1, m + 1), np.inf)
    best[:, 0] = 0.0
    for row in range(1, n + 1):
        best[row, 1:] = np.minimum(best[row - 1, 1:], best[row - 1, :-1] + cost[row - 1])
    rows, row = [], n
    for column in range(m, 0, -1):
        while best[row - 1, column] <= best[row, column]:
            row -= 1
        row -= 1
        rows.append(row)
    return tuple(reversed(rows))


def _refined(answer: _Answer, p: Array, sigma: Array, points: Array, in_order: bool) -> _Answer:
    """Aligned on all the stops that fit, and assigned again."""
    for _ in range(3):
        stops = list(answer.stops)
        off = np.linalg.norm(answer.T_base_nav.act(p[stops]) - points, axis=1) / sigma[stops]
        good = off < np.sqrt(OUTLIER_COST)
        if good.sum() < 2:
            return answer
        again = _assign(align(p[stops][good], points[good]), p, sigma, points, in_order)
        if again.cost >= answer.cost:
            return answer
        answer = again
    return answer
