"""Match stops to touched points, if a demonstration has more stops than points or the order is unknown."""

from collections.abc import Iterator
from itertools import combinations, permutations
from typing import NamedTuple

import numpy as np

from pbd.calibration.points import FEWEST_POINTS, MAY_BE_MIRRORED, MIRRORED, mirrored
from pbd.calibration.registration import align
from pbd.errors import CalibrationError, amount, in_degrees, listed, warn
from pbd.pose import Array, Pose, lengths

OUTLIER_COST = 16.0
"""Largest cost of one stop (four sigmas, squared), so that one wrong point does not outweigh the others."""

AMBIGUOUS_COST = 12.0
"""Difference in cost below which two matches count as equally likely. A correct point costs about 3."""


class _Touched(NamedTuple):
    """The stops and points to be matched: the first five arguments of `match_points`."""

    p: Array
    sigma: Array
    points: Array
    in_order: bool
    free: bool


class _Match(NamedTuple):
    """The stop that touched each point, the pose of nav that fits best, and the cost: a sum of squared sigmas."""

    cost: float
    stops: tuple[int, ...]
    T_base_nav: Pose


def match_points(p_nav_tip: Array, sigma: Array, points: Array, in_order: bool, free: bool = False) -> tuple[int, ...]:
    """Find which stop touched each point.

    Two stops and two points at the same distance give a hypothesis of nav in base: yaw and position, because both
    frames have z up. With a free tilt it takes three. The hypothesis of lowest cost wins. Points in order are assigned
    by dynamic programming, others by the Hungarian method.

    Args:
        p_nav_tip: (n, 3) m, the tip at each stop.
        sigma: (n,) m per axis, sigma of the tip.
        points: (m, 3) m in base.
        in_order: the points were touched in their order, possibly with other stops in between. Two of them are
            exchanged if four or more fit clearly better so.
        free: nav's tilt in base is unknown.

    Returns:
        (m,) indices of stops.

    Raises:
        CalibrationError: there are fewer stops than points, no stops fit the points, or they fit in several ways.
    """
    n, m = len(p_nav_tip), len(points)
    if n < m:
        raise CalibrationError(
            f"the demonstration has {amount(n, 'stop')}, but there are {m} points; hold still for half a second on "
            "each, or remove points",
            value=n,
            bound=m,
        )
    sigma = np.hypot(sigma, 0.005)  # m; with less, a hypothesis from two stops is too strict
    touched = _Touched(p_nav_tip, sigma, points, in_order, free)
    best, bound = _best_matches(touched), OUTLIER_COST * max(1.0, m - 2.0)
    cost = best[0].cost if best else np.inf
    exchanged = None
    if in_order and m > FEWEST_POINTS and cost > OUTLIER_COST:
        exchanged = _exchanged(_best_matches(touched._replace(in_order=False)), cost)
    if in_order and exchanged is None:
        if cost <= bound:
            _warn_of_other_orders(best[0], touched, bound)
        if n == m:
            return tuple(range(m))
    alike = []
    for check, mirror in MIRRORED.items():
        for other in _best_matches(touched._replace(points=points * mirror))[:1]:
            if other.cost < min(cost - AMBIGUOUS_COST, bound):
                raise mirrored(check)
            if best and other.stops != best[0].stops and other.cost < cost + AMBIGUOUS_COST:
                alike.append(check)
    if exchanged is not None:
        rows = " and ".join(f"{k + 1}" for k in _moved(exchanged))
        warn(f"rows {rows} of the points fit if they were touched in each other's place, so they are exchanged")
        _warn_of_other_orders(exchanged, touched, bound)
        return exchanged.stops
    if cost > bound:
        raise CalibrationError(
            "no stops of the demonstration have the same distances and heights as the points; check the points' unit, "
            + ("signs and coordinates, their order (--any-order finds it)" if in_order else "signs and coordinates")
            + ", and that the hand stopped on each"
        )
    if rival := _rival(best[0], best):
        rad = rival.T_base_nav.distance(best[0].T_base_nav)[1]
        raise CalibrationError(
            f"the stops fit the points in more than one way (another is turned by {in_degrees(rad)}), "
            "because the points are symmetric; name the stops with --stops, touch the points in order, or add one "
            "that breaks the symmetry",
            stops=best[0].stops,
            others=rival.stops,
        )
    for check in alike:
        warn(MAY_BE_MIRRORED.format(check))
    return best[0].stops


def _exchanged(orders: list[_Match], cost: float) -> _Match | None:
    """Return the match of two exchanged points, if of all `orders` it alone is likely and clearly below `cost`."""
    likely = [match for match in orders if match.cost < orders[0].cost + AMBIGUOUS_COST and len(_moved(match)) == 2]
    alone = len({match.stops for match in likely}) == 1
    return likely[0] if alone and likely[0].cost < cost - AMBIGUOUS_COST else None


def _moved(match: _Match) -> list[int]:
    """Return the points that were touched in another place than theirs in the order."""
    return [k for k, stop in enumerate(sorted(match.stops)) if stop != match.stops[k]]


def _rival(match: _Match, others: list[_Match]) -> _Match | None:
    """Return another match that fits about as well as this one, or better, but puts nav 5 cm or 10 degrees away."""
    for other in others:
        metres, rad = other.T_base_nav.distance(match.T_base_nav)
        if other.cost - match.cost < AMBIGUOUS_COST and (metres > 0.05 or rad > np.radians(10.0)):
            return other
    return None


def _warn_of_other_orders(match: _Match, touched: _Touched, bound: float) -> None:
    """Warn if the points, touched in their order by a match's stops, fit in another order too, as a square's corners.

    Such a pose puts two stops on the two points that are farthest apart. `bound` is the largest cost of a fit.
    """
    stops, points = list(match.stops), touched.points
    alone = _Touched(touched.p[stops], touched.sigma[stops], points, in_order=False, free=False)
    apart = lengths((points[:, None] - points[None])[..., :2])
    ends = list(np.unravel_index(int(np.argmax(apart)), apart.shape))
    poses = _hypotheses(alone._replace(points=points[ends]))
    found = [_refined(_assign(pose, alone), alone) for pose in poses]
    in_order = next((match for match in found if list(match.stops) == sorted(match.stops)), None)
    if in_order and in_order.cost <= bound and (other := _rival(in_order, found)):
        rows = listed(f"{other.stops.index(k) + 1}" for k in range(len(points)))
        warn(
            f"the points fit in another order too (rows {rows}), so a wrong order does not show; check it, or touch "
            "one more that breaks the symmetry"
        )


def _best_matches(touched: _Touched) -> list[_Match]:
    """Return the 20 best matches of different stops, aligned again on all of their stops, by cost."""
    matches = sorted((_assign(pose, touched) for pose in _hypotheses(touched)), key=lambda match: -match.cost)
    unique = sorted({match.stops: match for match in matches}.values(), key=lambda match: match.cost)
    return sorted((_refined(match, touched) for match in unique[:20]), key=lambda match: match.cost)


def _hypotheses(touched: _Touched) -> Iterator[Pose]:
    """Yield T_base_nav for each two stops and two points with the same horizontal distance.

    If the tilt is `free`, they are three stops and three points with the same distances. The points are among six,
    evenly spaced in their order: two right ones suffice. Points within 3 cm of each other give no heading.
    """
    p, sigma, points, in_order, free = touched
    among = np.unique(np.linspace(0, len(points) - 1, 6).round().astype(int))
    chosen = np.array(list((combinations if in_order else permutations)(among, 2 + free)))

    def sides(corners: Array) -> Array:
        return lengths((corners - np.roll(corners, 1, axis=-2))[..., : 2 + free])

    apart = sides(points[chosen])
    for stops in combinations(range(len(p)), 2 + free):
        i = list(stops)
        close = np.abs(apart - sides(p[i])) < 3.0 * np.hypot(sigma[i], np.roll(sigma[i], 1))
        for places in chosen[(close & (apart > 0.03)).all(axis=1)]:
            yield align(p[i], points[places], free)


def _assign(T_base_nav: Pose, touched: _Touched) -> _Match:
    from scipy.optimize import linear_sum_assignment

    p, sigma, points, in_order, _ = touched
    square = ((T_base_nav.act(p)[:, None] - points[None]) ** 2).sum(axis=2) / sigma[:, None] ** 2
    cost = np.minimum(square, OUTLIER_COST) + 1e-6 * square  # beyond the cap, nearer stops still cost less
    if in_order:
        stops = _rows_in_order(cost)
    else:
        rows, columns = linear_sum_assignment(cost)
        stops = tuple(int(row) for row in rows[np.argsort(columns)])
    return _Match(float(cost[list(stops), range(len(points))].sum()), stops, T_base_nav)


def _rows_in_order(cost: Array) -> tuple[int, ...]:
    """Return the increasing rows (m,), one for each column of cost (n, m), with the lowest sum."""
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


def _refined(match: _Match, touched: _Touched) -> _Match:
    """Align a match on all of its stops that fit, assign again, and repeat while that lowers the cost."""
    p, sigma, points, _, free = touched
    while True:
        stops = list(match.stops)
        off = np.linalg.norm(match.T_base_nav.act(p[stops]) - points, axis=1) / sigma[stops]
        good = off < np.sqrt(OUTLIER_COST)
        if good.sum() < 2 + free:
            return match
        again = _assign(align(p[stops][good], points[good], free), touched)
        if again.cost >= match.cost:
            return match
        match = again
