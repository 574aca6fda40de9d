"""The tasks: the paper's Table I to the sample, the pouring's layout, what can't be a task."""

from math import inf, nan, radians

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pbd.errors import SensorError
from pbd.pose import quat_log, quat_multiply
from pbd.simulation.hand_motion import Waypoint
from pbd.simulation.simulate import TASKS, simulate
from pbd.simulation.tasks import HEADING, Task, random_task
from tests.near import assert_near

# Table I of the paper: first and last sample, at 40 Hz, and the axis of the motion in nav.
TABLE_1 = (
    ((0, 86), None),
    ((87, 94), 2),
    ((95, 114), None),
    ((115, 126), 0),
    ((127, 140), None),
    ((141, 155), 1),
    ((156, 185), None),
    ((186, 192), "roll"),
    ((193, 250), None),
)


def test_table_1_boundaries() -> None:
    """Exactly the samples that the table calls moving differ from rest, and in what it says."""
    demo = simulate("pick-and-place-stops", "ideal", rate_hz=40.0)
    acc, gyr, truth = demo.recording.acc, demo.recording.gyr, demo.truth
    assert gyr is not None
    assert truth is not None
    assert len(acc) == 251
    for (first, last), kind in TABLE_1:
        here = slice(first, last + 1)
        moved = truth.p_nav_sensor[min(last + 1, 250)] - truth.p_nav_sensor[max(first - 1, 0)]
        if kind is None:
            assert np.ptp(acc[here], axis=0) == pytest.approx(0.0, abs=1e-9)
            assert gyr[here] == pytest.approx(0.0, abs=1e-9)
            assert np.ptp(truth.p_nav_sensor[here], axis=0) == pytest.approx(0.0)
        elif kind == "roll":
            assert (np.abs(gyr[here, 0]) > 0.1).all()
            assert gyr[here, 1:] == pytest.approx(0.0, abs=1e-9)
            assert gyr[here].sum(axis=0) / 40.0 == pytest.approx([radians(60.0), 0.0, 0.0])
            assert moved == pytest.approx(0.0)
        else:
            assert isinstance(kind, int)
            pushed = np.linalg.norm(acc[here] - acc[first - 1], axis=1) > 0.1
            assert pushed[[0, -1]].all()
            assert pushed.sum() >= len(pushed) - 1  # halfway the push becomes a pull
            assert moved == pytest.approx(np.eye(3)[kind] * (0.10 if kind == 2 else 0.15))


def test_other_rates_keep_the_times() -> None:
    slow, fast = (simulate("pick-and-place-stops", "ideal", rate_hz=rate).truth for rate in (40.0, 400.0))
    assert slow is not None
    assert fast is not None
    assert_near(slow.t, fast.t[::10], 1e-9)
    assert_near(slow.p_nav_sensor, fast.p_nav_sensor[::10], 1e-9)


def test_direct_ends_where_stops_does() -> None:
    for name in ("pick-and-place-stops", "pick-and-place-direct"):
        truth = simulate(name, "ideal").truth
        assert truth is not None
        assert truth.p_nav_sensor[-1] == pytest.approx([0.15, 0.15, 0.10])
        turn = quat_log(quat_multiply(truth.wxyz_nav_sensor[0] * (1, -1, -1, -1), truth.wxyz_nav_sensor[-1]))
        assert turn == pytest.approx([radians(60.0), 0.0, 0.0])
    assert [w.move_s for w in TASKS["pick-and-place-direct"].waypoints] == [0.0, 0.8]


def test_paper_tasks_grip_once_and_do_not_return() -> None:
    for name in ("pick-and-place-stops", "pick-and-place-direct"):
        (event,) = TASKS[name].grip
        assert event.closed
        assert event.t == pytest.approx(86.5 / 40 / 2)
        assert not TASKS[name].closed


def test_pour_is_an_everyday_task() -> None:
    pour = TASKS["pour"]
    assert len(pour.waypoints) >= 8
    assert all(0.8 <= w.move_s <= 1.4 for w in pour.waypoints[1:])
    assert pour.closed
    assert pour.waypoints[-1].turn == (0.0, 0.0, 0.0)
    assert np.sum([w.turn for w in pour.waypoints], axis=0) == pytest.approx(0.0)
    assert [event.closed for event in pour.grip] == [True, False]
    p = np.array([w.p for w in pour.waypoints])
    assert p[:, 2].min() >= -0.15
    assert np.ptp(p, axis=0).max() < 0.35
    # the bottle is put back where it was taken
    demo = simulate(pour, "ideal")
    assert demo.truth is not None
    index = np.searchsorted(demo.truth.t, [event.t for event in demo.recording.grip])
    taken, put = demo.truth.p_nav_sensor[index]
    assert taken == pytest.approx(put)
    assert taken[2] == pytest.approx(-0.10)


@pytest.mark.parametrize("task", TASKS.values(), ids=TASKS.keys())
def test_every_task_starts_level_with_a_heading(task: Task) -> None:
    assert task.start_rpy == pytest.approx((0.0, 0.0, HEADING))
    assert task.waypoints[0].p == (0.0, 0.0, 0.0)
    assert task.grasped is not None
    assert task.description


@given(st.integers(0, 2**32 - 1), st.integers(1, 12))
def test_random_tasks_keep_to_their_bounds(seed: int, moves: int) -> None:
    task = random_task(seed, moves=moves, reach_m=0.2, max_turn=0.5, move_s=(0.4, 0.9), rest_s=(0.3, 0.6))
    assert task == random_task(seed, moves=moves, reach_m=0.2, max_turn=0.5, move_s=(0.4, 0.9), rest_s=(0.3, 0.6))
    assert len(task.waypoints) == moves + 1
    for w in task.waypoints[1:]:
        assert np.abs(w.p).max() <= 0.1
        assert np.linalg.norm(w.turn) <= 0.5 + 1e-12
        assert 0.4 <= w.move_s <= 0.9
        assert 0.3 <= w.rest_s <= 0.6


@pytest.mark.parametrize(
    "waypoints",
    [
        (Waypoint(move_s=1.0),),
        (Waypoint(turn=(0.1, 0.0, 0.0)),),
        (Waypoint(), Waypoint(move_s=0.0)),
        (Waypoint(), Waypoint(move_s=-1.0)),
        (Waypoint(), Waypoint(move_s=1.0, rest_s=-0.1)),
        (Waypoint(), Waypoint((nan, 0.0, 0.0), move_s=1.0)),
        (Waypoint(), Waypoint(turn=(0.0, inf, 0.0), move_s=1.0)),
        (Waypoint(), Waypoint(move_s=nan)),
        (Waypoint(rest_s=inf),),
    ],
)
def test_a_task_that_cannot_be_names_its_waypoint(waypoints: tuple[Waypoint, ...]) -> None:
    with pytest.raises(SensorError, match="task 'odd', waypoint") as caught:
        Task("odd", waypoints)
    assert caught.value.fields["waypoint"] == len(waypoints) - 1


def test_a_task_needs_a_waypoint() -> None:
    with pytest.raises(SensorError, match="at least a first rest"):
        Task("empty", ())
