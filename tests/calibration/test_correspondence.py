"""Stops are matched to the points that they touched."""

from itertools import combinations
from unittest.mock import Mock

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from pbd.calibration.correspondence import match_points
from pbd.calibration.registration import align
from pbd.errors import CalibrationError, PbdWarning
from pbd.pose import Array, Pose, quat_about_z, quat_exp

POINTS = np.array([[0.3, -0.2, 0.0], [0.62, -0.15, 0.02], [0.55, 0.2, 0.0], [0.2, 0.05, 0.1], [0.4, 0.0, 0.35]])
SQUARE = np.array([[0.3, 0.0, 0.0], [0.6, 0.0, 0.0], [0.6, 0.3, 0.0], [0.3, 0.3, 0.0]])


def stops_at(places: Array, seed: int = 0, noise: float = 0.002) -> tuple[Array, Array]:
    """Return noisy stops at places of the base, in a random nav, and their sigmas."""
    rng = np.random.default_rng(seed)
    T_base_nav = Pose(rng.normal(size=3), quat_about_z(rng.uniform(-np.pi, np.pi)))
    p = T_base_nav.inverse().act(places) + noise * rng.normal(size=places.shape)
    return p, np.full(len(p), noise)


@settings(max_examples=30)
@given(st.integers(0, 10_000), st.permutations(range(5)))
def test_any_order_is_found(seed: int, order: list[int]) -> None:
    p, sigma = stops_at(POINTS[order], seed)
    assert match_points(p, sigma, POINTS, in_order=False) == tuple(order.index(k) for k in range(5))


@settings(max_examples=30)
@given(st.integers(0, 10_000), st.integers(0, 5), st.integers(0, 5))
def test_stops_that_touch_no_point_are_ignored(seed: int, one: int, two: int) -> None:
    rng = np.random.default_rng(seed)
    places = np.insert(POINTS, sorted((one, two)), rng.uniform(-0.4, -0.1, (2, 3)), axis=0)
    p, sigma = stops_at(places, seed)
    wanted = tuple(int(np.flatnonzero((places == point).all(axis=1))[0]) for point in POINTS)
    assert match_points(p, sigma, POINTS, in_order=True) == wanted
    assert match_points(p, sigma, POINTS, in_order=False) == wanted


@settings(max_examples=15)
@given(st.integers(0, 10_000), st.integers(0, 5))
@example(14, 0)  # upright, two orders fit as badly
def test_extra_stops_do_no_harm_while_the_tilt_is_free(seed: int, extra: int) -> None:
    rng = np.random.default_rng(seed)
    places = np.insert(POINTS, (0, extra), rng.uniform(-0.4, -0.1, (2, 3)), axis=0)
    base = Pose(np.zeros(3), quat_exp(rng.normal(size=3)))
    p, sigma = stops_at(base.act(places), seed)
    wanted = tuple(int(np.flatnonzero((places == point).all(axis=1))[0]) for point in POINTS)
    assert match_points(p, sigma, POINTS, in_order=True, free=True) == wanted
    assert match_points(p, sigma, POINTS, in_order=False, free=True) == wanted


@pytest.mark.parametrize("start", [0, 1])
@pytest.mark.parametrize("pair", list(combinations(range(5), 2)))
def test_two_points_that_were_touched_in_the_other_order_are_found(pair: tuple[int, int], start: int) -> None:
    order = np.arange(5)
    order[list(pair)] = order[list(pair[::-1])]
    p, sigma = stops_at(np.vstack(((0.1, -0.3, 0.2), POINTS[order]))[1 - start :])
    with pytest.warns(PbdWarning, match=f"rows {pair[0] + 1} and {pair[1] + 1} of the points fit if they were"):
        assert match_points(p, sigma, POINTS, in_order=True) == tuple((order + start).tolist())


def test_two_corners_of_a_square_that_were_touched_in_the_other_order_are_found() -> None:
    """Begun at another corner, the square fits too, but then three are in another's place, not two."""
    with pytest.warns(PbdWarning) as told:
        assert match_points(*stops_at(SQUARE[[1, 0, 2, 3]]), SQUARE, in_order=True) == (1, 0, 2, 3)
    assert [str(each.message).split(" (")[0] for each in told] == [
        "rows 1 and 2 of the points fit if they were touched in each other's place, so they are exchanged",
        "the points fit in another order too",
    ]


@pytest.mark.parametrize("wrong", range(5))
def test_a_wrong_point_is_not_taken_for_another_order(wrong: int) -> None:
    for seed in range(10):
        points = POINTS.copy()
        points[wrong] += 0.1 * np.random.default_rng(seed).normal(size=3)
        p, sigma = stops_at(np.vstack(((0.1, -0.3, 0.2), POINTS)), seed)
        stops = match_points(p, sigma, points, in_order=True)
        assert list(stops) == sorted(stops)


def test_a_wrong_point_does_not_hide_the_others() -> None:
    p, sigma = stops_at(POINTS[[3, 1, 0, 4, 2]])
    wrong = POINTS.copy()
    wrong[1] += (0.0, 0.1, 0.0)
    assert match_points(p, sigma, wrong, in_order=False) == (2, 1, 4, 0, 3)


def test_two_points_above_each_other_say_nothing_of_the_heading() -> None:
    """With a heading by chance, the third point would be taken for a wrong one, and the points for symmetric."""
    points = np.array([[0.3, -0.2, 0.0], [0.31, -0.2, 0.3], [0.6, 0.1, 0.1]])
    for seed in range(40):
        p, sigma = stops_at(np.vstack((points, [[0.1, -0.4, 0.1]])), seed, noise=0.01)
        assert match_points(p, sigma, points, in_order=True) == (0, 1, 2)


def test_a_square_is_ambiguous() -> None:
    p, sigma = stops_at(SQUARE)
    with pytest.raises(
        CalibrationError, match=r"more than one way .*turned by (90|180) degrees.* --stops, touch the"
    ) as caught:
        match_points(p, sigma, SQUARE, in_order=False)
    assert caught.value.fields["stops"] != caught.value.fields["others"]


@pytest.mark.parametrize("start", [0, 1])
def test_a_square_that_was_touched_in_order_may_have_been_begun_at_another_corner(start: int) -> None:
    p, sigma = stops_at(np.vstack(((0.1, -0.3, 0.2), SQUARE))[1 - start :])
    with pytest.warns(
        PbdWarning, match=r"in another order too \(rows (2, 3, 4, 1|3, 4, 1, 2|4, 1, 2, 3)\), so a wrong"
    ):
        assert match_points(p, sigma, SQUARE, in_order=True) == tuple(range(start, start + 4))
    above = np.vstack((SQUARE, [[0.3, 0.0, 0.2]]))
    p, sigma = stops_at(above)
    assert match_points(p, sigma, above, in_order=True) == (0, 1, 2, 3, 4)  # without a warning


def test_many_points_are_matched_from_few_hypotheses_and_a_grid_fits_turned(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each two of 25 stops and of 25 points took a minute, and the sum of many small misfits hid the other order."""
    grid = 0.08 * np.array([(a, b, 0.0) for a in range(5) for b in range(5)])
    p, sigma = stops_at(np.vstack(((-0.3, 0.4, 0.2), grid)), noise=0.005)
    spy = Mock(wraps=align)
    monkeypatch.setattr("pbd.calibration.correspondence.align", spy)
    with pytest.warns(PbdWarning, match="in another order too"):
        assert match_points(p, sigma, grid, in_order=True) == tuple(range(1, 26))
    assert spy.call_count < 10_000


def test_a_point_above_a_corner_breaks_the_symmetry() -> None:
    points = np.vstack((SQUARE, [[0.3, 0.0, 0.2]]))
    p, sigma = stops_at(points[[4, 2, 3, 0, 1]])
    with pytest.warns(PbdWarning, match="fit as in a mirror too"):  # across the diagonal through that corner
        assert match_points(p, sigma, points, in_order=False) == (3, 4, 1, 2, 0)


def test_points_that_match_better_in_a_mirror_are_refused() -> None:
    """Three of them are their own mirror's image, so only the fourth, which would be called wrong, shows it."""
    points = np.array([[0.2, -0.2, 0.0], [0.6, -0.2, 0.0], [0.4, 0.1, 0.0], [0.75, -0.1, 0.0]])
    p, sigma = stops_at(points)
    assert match_points(p, sigma, points, in_order=False) == (0, 1, 2, 3)
    with pytest.raises(CalibrationError, match="fit the demonstration as in a mirror; check the sign of x or y"):
        match_points(p, sigma, points * (1.0, -1.0, 1.0), in_order=False)


@pytest.mark.parametrize("in_order", [True, False])
def test_many_mirrored_points_are_not_called_symmetric(in_order: bool) -> None:
    """Of points on a grid several mirrored ones fit turned stops, in more than one way."""
    rng = np.random.default_rng(3)
    grid = 0.2 * np.array([(a, b, 0.0) for a in range(3) for b in range(3)]) + 0.03 * rng.normal(size=(9, 3))
    p, sigma = stops_at(np.vstack(((0.1, -0.3, 0.2), grid)))
    with pytest.raises(CalibrationError, match="fit the demonstration as in a mirror; check the sign of x or y"):
        match_points(p, sigma, grid * (-1.0, 1.0, 1.0), in_order)


@pytest.mark.parametrize("in_order", [True, False])
@pytest.mark.parametrize(
    ("mistake", "check"),
    [(np.diag((1.0, -1.0, 1.0)), "x or y"), (np.eye(3)[[1, 0, 2]], "x or y"), (np.diag((1.0, 1.0, -1.0)), "z$")],
)
def test_mirrored_points_that_fit_no_stops_are_not_said_to_have_other_distances(
    mistake: Array, check: str, in_order: bool
) -> None:
    p, sigma = stops_at(np.vstack(((0.1, -0.3, 0.2), POINTS)))
    with pytest.raises(CalibrationError, match=f"fit the demonstration as in a mirror; check the sign of {check}"):
        match_points(p, sigma, POINTS @ mistake, in_order)


@pytest.mark.parametrize("in_order", [True, False])
def test_stops_that_can_not_match_are_refused(in_order: bool) -> None:
    p, sigma = stops_at(POINTS[:3])
    with pytest.raises(CalibrationError, match="has 3 stops, but there are 5 points; hold still"):
        match_points(p, sigma, POINTS, in_order)
    if in_order:  # as many stops as points: the fit, which knows all sigmas, says what is wrong
        assert match_points(p, sigma, 10.0 * POINTS[:3], in_order) == (0, 1, 2)
    p, sigma = stops_at(np.vstack((POINTS, [[0.0, 0.0, 0.0]])))
    with pytest.raises(
        CalibrationError, match=r"no stops .* have the same distances and heights as the points; check the points' unit"
    ):
        match_points(p, sigma, 10.0 * POINTS, in_order)


def test_a_wrong_order_is_named_as_a_cause_only_where_order_counts() -> None:
    p, sigma = stops_at(np.vstack((POINTS[::-1], [[0.0, 0.0, 0.0]])))
    with pytest.raises(CalibrationError, match=r"and coordinates, their order \(--any-order finds it\), and that"):
        match_points(p, sigma, POINTS, in_order=True)
    assert match_points(p, sigma, POINTS, in_order=False) == (4, 3, 2, 1, 0)
    with pytest.raises(CalibrationError, match=r"unit, signs and coordinates, and that the hand"):
        match_points(p, sigma, 10.0 * POINTS, in_order=False)
