"""The live path: its shape, and that its cost does not grow with its length."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from pbd.pose import Array
from pbd.view.live_path import CAMERA_REACH_M, MAX_NEW_POINTS, PIECE_POINTS, SPACING_M, LivePath

walks = arrays(np.float64, st.tuples(st.integers(2, 60), st.just(3)), elements=st.floats(-0.05, 0.05)).map(
    lambda steps: np.cumsum(steps, axis=0)
)


class Picture:
    """Keeps the pieces as a page does: a new version of a piece replaces the old one."""

    def __init__(self, live: LivePath) -> None:
        self.path, self.pieces = live, dict[str, Array]()

    def take(self, most: int = 1000) -> int:
        """Take what is new, and return the number of points."""
        new = self.path.take(most)
        self.pieces |= {name: points for name, points, _ in new}
        return sum(len(points) for _, points, _ in new)

    def line(self, move: int) -> Array:
        """A move's points, without the duplicates where pieces meet."""
        names = sorted((name for name in self.pieces if name.startswith(f"{move}/")), key=lambda n: int(n[2:]))
        pieces = [self.pieces[name] for name in names]
        for before, after in pairwise(pieces):
            np.testing.assert_array_equal(before[-1], after[0])
        return np.concatenate([pieces[0], *(piece[1:] for piece in pieces[1:])])


def lifted(t: Array) -> tuple[Array, Array]:
    """A smooth move of one second: positions and velocities."""
    p = np.stack((0.3 * (3 * t**2 - 2 * t**3), 0.1 * t**3, 0.05 * t**2), axis=1)
    v = np.stack((1.8 * (t - t**2), 0.3 * t**2, 0.1 * t), axis=1)
    return p, v


def test_a_cubic_is_drawn_as_it_is() -> None:
    """Drawn 20 times a second from points and velocities of a cubic, the path is that cubic."""
    t = np.linspace(0.0, 1.0, 21)
    live = LivePath()
    live.begin(0.0, np.zeros(3))
    for at, p, v in zip(t, *lifted(t), strict=True):
        live.grow(at, p, v)
    picture = Picture(live)
    picture.take()
    drawn, fine = picture.line(0), lifted(np.linspace(0.0, 1.0, 20001))[0]
    off = np.array([np.linalg.norm(fine - p, axis=1).min() for p in drawn])
    assert off.max() < 2e-5  # spacing of the fine line
    assert np.linalg.norm(np.diff(drawn, axis=0), axis=1).max() < 1.5 * SPACING_M
    assert np.linalg.norm(drawn[-1] - fine[-1]) < SPACING_M


@given(walks)
def test_it_goes_through_all_points_without_holes(walk: Array) -> None:
    live = LivePath()
    picture = Picture(live)
    live.begin(0.0, np.zeros(3))
    here, points = np.zeros(3), []
    for k, p in enumerate(walk):
        live.grow(0.05 * (k + 1), p, np.zeros(3))
        picture.take()
        if np.linalg.norm(p - here) >= SPACING_M:
            here = p
            points.append(p)
    if points:
        line = picture.line(0)
        np.testing.assert_array_equal(line[0], np.zeros(3))
        np.testing.assert_allclose(line[-1], here, atol=1e-12)
        for p in points:
            assert np.linalg.norm(line - p, axis=1).min() < 1e-12


def test_a_long_move_costs_the_same_at_its_end() -> None:
    live = LivePath()
    picture = Picture(live)
    live.begin(0.0, np.zeros(3))
    costs = []
    for k in range(1, 4001):
        live.grow(0.05 * k, np.array((0.02 * k, 0.0, 0.0)), np.array((0.4, 0.0, 0.0)))
        costs.append(picture.take())
    assert max(costs) <= 2 * (PIECE_POINTS + 1)
    assert max(costs[:100]) == max(costs[-100:])


def test_diverging_dead_reckoning_has_a_bounded_cost() -> None:
    live = LivePath()
    live.begin(0.0, np.zeros(3))
    live.grow(0.05, np.array((1e4, 0.0, 0.0)), np.array((1e5, 0.0, 0.0)))
    assert Picture(live).take() == MAX_NEW_POINTS + 1


@pytest.mark.parametrize("rest_s", [0.3, 30.0])
def test_a_stop_removes_the_error_of_an_accelerometer_bias(rest_s: float) -> None:
    """A bias is a velocity error that grows linearly from the start of the move; the rest before does not matter."""
    live, bias = LivePath(), np.array((0.04, -0.06, 0.02))
    picture = Picture(live)
    live.begin(0.0, np.zeros(3))
    for still in np.arange(0.0, rest_s, 0.05):
        live.grow(still, np.zeros(3), np.zeros(3))
    began = 0.05 * round(rest_s / 0.05) - 0.05
    t = np.linspace(0.0, 1.0, 21)
    p, v = lifted(t)
    for k in range(1, 21):
        live.grow(began + t[k], p[k] + 0.5 * bias * t[k] ** 2, v[k] + bias * t[k])
    for k in range(1, 6):  # after the stop, before it is known
        drift = 0.5 * bias + bias * 0.05 * k
        live.grow(began + 1.0 + 0.05 * k, p[-1] + drift, bias)
    picture.take()
    before = picture.line(0)
    live.correct(began + 1.0, p[-1])
    picture.take()
    after, fine = picture.line(0), lifted(np.linspace(0.0, 1.0, 2001))[0]

    def off(line: Array) -> float:
        return max(float(np.linalg.norm(fine - point, axis=1).min()) for point in line)

    assert off(before) > 0.03
    assert off(after) < 0.002
    np.testing.assert_array_equal(after[0], np.zeros(3))
    np.testing.assert_allclose(after[-1], p[-1], atol=1e-12)
    live.grow(began + 2.0, p[-1] + (0.0, 0.0, 0.1), np.zeros(3))
    picture.take()
    np.testing.assert_array_equal(picture.line(1)[0], p[-1])  # the next move begins there


def test_a_gap_makes_no_loop() -> None:
    """Half a minute without samples: the velocities before and after do not shape the path between."""
    live, fast = LivePath(), np.array((0.0, 0.5, 0.0))
    picture = Picture(live)
    live.begin(0.0, np.zeros(3))
    live.grow(0.05, np.array((0.0, 0.01, 0.0)), fast)
    live.grow(30.0, np.array((0.1, 0.01, 0.0)), fast)
    picture.take()
    assert np.abs(picture.line(0)).max() < 0.1 + 0.1


def test_the_camera_does_not_follow_diverged_dead_reckoning_until_a_stop() -> None:
    live = LivePath()
    live.begin(0.0, np.zeros(3))
    live.grow(0.5, np.array((0.3, -0.2, 0.1)), np.zeros(3))
    np.testing.assert_allclose(live.corners(), [(0.0, -0.2, 0.0), (0.3, 0.0, 0.1)], atol=1e-12)
    live.grow(9.0, np.array((80.0, 0.0, 0.0)), np.zeros(3))
    np.testing.assert_allclose(live.corners(), [(0.0, -0.2, 0.0), (CAMERA_REACH_M, 0.0, 0.1)], atol=1e-12)
    live.correct(9.0, (0.5, 0.0, 0.0))
    assert live.corners()[1, 0] <= 0.5 + CAMERA_REACH_M
    live.grow(10.0, np.array((0.5, 7.0, 0.0)), np.zeros(3))
    np.testing.assert_allclose(live.corners()[1, 1], CAMERA_REACH_M)


def test_remaining_pieces_come_later() -> None:
    live = LivePath()
    live.begin(0.0, np.zeros(3))
    for k in range(1, 11):
        live.grow(0.05 * k, np.array((0.05 * k, 0.0, 0.0)), np.array((1.0, 0.0, 0.0)))
    live.correct(0.5, (0.4, 0.0, 0.0))
    names = []
    while live.more:
        pieces = live.take(1)
        assert len(pieces) == 1
        names += [name for name, _, _ in pieces]
    assert names == [f"0/{k}" for k in range(len(names))]
    assert len(names) > 2
    assert live.take(1) == []
