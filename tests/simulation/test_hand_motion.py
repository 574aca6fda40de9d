"""The hand's formulas against finite differences, and its path against its waypoints."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pbd.pose import quat_about_z, quat_exp, quat_inverse, quat_log, quat_multiply, quat_rotate
from pbd.simulation.hand_motion import HandMotion, Waypoint, minimum_jerk
from pbd.simulation.tasks import random_task
from tests.near import assert_near
from tests.simulation.sway import with_sway

seeds = st.integers(0, 2**32 - 1)


def test_minimum_jerk_begins_and_ends_at_rest() -> None:
    s, ds, dds = minimum_jerk([0.0, 0.5, 1.0])
    assert s == pytest.approx([0.0, 0.5, 1.0])
    assert ds == pytest.approx([0.0, 1.875, 0.0])  # Flash and Hogan's ratio of peak to mean velocity
    assert dds == pytest.approx([0.0, 0.0, 0.0])


@settings(max_examples=20)
@given(seeds)
def test_derivatives_are_those_of_the_pose(seed: int) -> None:
    task = random_task(seed, moves=3)
    motion = with_sway(task, 0.02, seed, turn=0.02).motion
    t, h = np.linspace(0.0, task.duration_s, 400), 1e-4
    t = t[np.abs(t[:, None] - motion.knots).min(axis=1) > h]  # where jerk jumps
    before, now, after = motion.at(t - h), motion.at(t), motion.at(t + h)
    assert_near(now.v, (after.p - before.p) / (2 * h), 1e-5)
    assert_near(now.a, (after.v - before.v) / (2 * h), 1e-4)
    turn = quat_log(quat_multiply(quat_inverse(before.wxyz), after.wxyz))
    assert_near(now.w, turn / (2 * h), 1e-4)


@given(seeds)
def test_hand_stands_at_every_waypoint(seed: int) -> None:
    task = random_task(seed)
    motion = HandMotion(task.waypoints, task.start_rpy)
    leave = np.cumsum([w.move_s + w.rest_s for w in task.waypoints])
    for when in (leave - 1e-9, leave - 0.4):
        hand = motion.at(when)
        assert hand.p == pytest.approx(np.array([w.p for w in task.waypoints]))
        assert_near(hand.v, 0.0, 1e-9)
        assert_near(hand.w, 0.0, 1e-9)


def test_moves_are_straight_and_turn_about_one_axis() -> None:
    motion = HandMotion((Waypoint(rest_s=1.0), Waypoint((0.1, 0.2, 0.3), (0.3, -0.2, 0.1), 1.0, 0.5)))
    hand = motion.at(np.linspace(1.1, 1.9, 20))
    for vector, along in ((hand.v, (1.0, 2.0, 3.0)), (hand.w, (3.0, -2.0, 1.0))):
        assert np.cross(vector, along) == pytest.approx(0.0, abs=1e-12)
        assert (vector @ np.array(along) > 0.0).all()


def test_turns_compose_in_the_sensor() -> None:
    quarter = np.pi / 2
    motion = HandMotion(
        (
            Waypoint(),
            Waypoint(turn=(0.0, quarter, 0.0), move_s=1.0),
            Waypoint(turn=(quarter, 0.0, 0.0), move_s=1.0),
        ),
        start_rpy=(0.0, 0.0, 0.5),
    )
    expected = quat_multiply(quat_about_z(0.5), quat_multiply(quat_exp((0, quarter, 0)), quat_exp((quarter, 0, 0))))
    assert motion.at([2.0]).wxyz[0] == pytest.approx(expected)


def test_outside_its_time_the_hand_rests() -> None:
    motion = HandMotion((Waypoint((1.0, 2.0, 3.0), rest_s=1.0), Waypoint((2.0, 2.0, 3.0), move_s=1.0)))
    hand = motion.at([-5.0, 9.0])
    assert hand.p == pytest.approx(np.array([[1.0, 2.0, 3.0], [2.0, 2.0, 3.0]]))
    assert not hand.v.any()
    assert not hand.a.any()


def test_knots_are_where_moves_begin_and_end() -> None:
    motion = HandMotion((Waypoint(rest_s=1.0), Waypoint(move_s=0.5, rest_s=2.0), Waypoint(move_s=0.25)))
    assert motion.knots == pytest.approx([1.0, 1.5, 3.5, 3.75])
    assert len(HandMotion((Waypoint(rest_s=1.0),)).knots) == 0


@settings(max_examples=20)
@given(seeds)
def test_a_point_of_the_hand_goes_where_the_waypoints_say(seed: int) -> None:
    """The sensor moves about it; its derivatives are still those of its own pose."""
    task, lever = random_task(seed, moves=3), (0.03, -0.02, 0.1)
    motion = HandMotion(task.waypoints, task.start_rpy, lever)
    leave = np.cumsum([w.move_s + w.rest_s for w in task.waypoints]) - 1e-9
    hand = motion.at(leave)
    assert hand.p + quat_rotate(hand.wxyz, lever) == pytest.approx(np.array([w.p for w in task.waypoints]))
    t, h = np.linspace(0.0, task.duration_s, 200), 1e-4
    before, now, after = motion.at(t - h), motion.at(t), motion.at(t + h)
    assert_near(now.v, (after.p - before.p) / (2 * h), 1e-5)
    assert now.a == pytest.approx((after.v - before.v) / (2 * h), abs=3e-3)  # jerk jumps at the knots
