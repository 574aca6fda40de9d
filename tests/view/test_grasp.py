"""The grasped object's way."""

from __future__ import annotations

import numpy as np
import pytest

from pbd.data import GraspedObject
from pbd.pose import quat_rotate
from pbd.view import grasp
from pbd.view.motion import Track

T = np.linspace(0.0, 10.0, 101)
BOTTLE = GraspedObject("cylinder", (0.06, 0.2))


def sweep() -> Track:
    """A tool that points down and goes along x at 0.1 m/s, 10 cm above the table, rolling slowly."""
    p = np.stack((0.1 * T, np.zeros(101), np.full(101, 0.1)), axis=1)
    half = 0.5 * (np.pi + 0.05 * T)
    return Track(p, np.stack((np.cos(half), np.sin(half), np.zeros(101), np.zeros(101)), axis=1))


@pytest.mark.parametrize(
    ("t", "opening", "spans"),
    [
        ([0, 2, 3, 6, 7], [1, 1, 0.3, 0.3, 1], [(3, 6)]),
        ([0, 2, 2.5, 3, 6, 7, 8, 9], [1, 1, 0.6, 0.3, 0.3, 1, 1, 0.5], [(3, 6), (9, np.inf)]),
        ([0, 4, 5], [0.2, 0.2, 1], [(0, 4)]),
        ([0, 4], [1, 1], []),
    ],
)
def test_it_holds_from_the_end_of_closing_to_the_start_of_opening(
    t: list[float], opening: list[float], spans: list[tuple[float, float]]
) -> None:
    assert grasp.holds(np.array(t), np.array(opening)) == spans


def test_it_stands_then_goes_with_the_tool_then_stands() -> None:
    tool = sweep()
    way = grasp.carried(BOTTLE, T, tool, [(3.0, 6.0)], 0.0)
    np.testing.assert_allclose(way.p[:31], np.tile([0.3, 0.0, 0.1], (31, 1)), atol=1e-12)
    np.testing.assert_allclose(quat_rotate(way.wxyz[0], (0, 0, 1)), [0, 0, 1], atol=1e-12)  # upright
    held = [(tool[i].inverse() @ way[i]).log() for i in range(30, 61)]
    np.testing.assert_allclose(held, np.tile(held[0], (31, 1)), atol=1e-9)
    np.testing.assert_allclose(way.p[60:], np.tile(way.p[60], (41, 1)), atol=1e-12)
    assert way.p[60, 0] == pytest.approx(0.6)


def test_it_does_not_reach_into_the_table() -> None:
    way = grasp.carried(BOTTLE, T, sweep(), [(3.0, 6.0)], 0.04)
    assert way.p[0, 2] == pytest.approx(0.04 + 0.1)


def test_a_gripper_that_closes_elsewhere_takes_nothing() -> None:
    once = grasp.carried(BOTTLE, T, sweep(), [(3.0, 4.0)], None)
    again = grasp.carried(BOTTLE, T, sweep(), [(3.0, 4.0), (8.0, np.inf)], None)
    np.testing.assert_array_equal(once.p, again.p)
