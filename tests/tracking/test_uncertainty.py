"""What sigma says of a move, against moves that are known."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pbd.pipeline import track
from pbd.sensors.simulate import simulate
from pbd.sensors.simulated_hand import Waypoint
from pbd.sensors.simulated_tasks import Task
from pbd.tracking.integration import edge, integrate_move
from pbd.tracking.rest import find_rest
from pbd.tracking.uncertainty import MoveFigures, move_covariance, move_figures, shaking_speed, stop_speed
from tests.scenarios import pour

REST = find_rest(pour().recording)


@pytest.mark.parametrize(("duration", "end_speed"), [(0.2, 0.1), (1.0, 1e-3), (5.0, 0.01)])
def test_velocities_not_quite_known_at_the_ends_add_what_they_do_to_a_move(duration: float, end_speed: float) -> None:
    t = np.linspace(0.0, duration, 20)
    v = np.random.default_rng(0).normal(scale=end_speed, size=(400, 2, 3))
    ways = np.array([integrate_move(t, np.outer(np.ones(20), (f - e) / duration), e, f).p_nav[-1] for e, f in v])
    figures = MoveFigures(duration, 0.0, 0.0, 0.0, 0.0)
    added = move_covariance(figures, REST, 100.0, end_speed=end_speed) - move_covariance(
        figures, REST, 100.0, end_speed=0.0
    )
    assert np.sqrt(added[0, 0]) == pytest.approx(np.sqrt((ways**2).mean()), rel=0.1)


@pytest.mark.parametrize("move_s", [1.5, 2.0, 3.0])
def test_a_smooth_hand_sets_out_and_arrives_unseen(move_s: float) -> None:
    """It has at most the speed that is said where integration begins, and about that at the edges of its stops."""
    waypoints = [Waypoint(((k % 2) * 0.2, 0.0, 0.0), move_s=move_s if k else 0.0, rest_s=1.5) for k in range(7)]
    demo = simulate(Task("slow", tuple(waypoints)), "modern", 1)
    path, truth = track(demo.recording), demo.truth
    assert truth is not None
    assert len(path.stops) == 7
    speed = np.linalg.norm(np.gradient(truth.p_nav_sensor, truth.t, axis=0), axis=1)
    at_edge, inside, said = [], [], []
    for k, (before, after) in enumerate(pairwise(path.stops)):
        move = slice(before.stop - 1, after.start + 1)
        a_nav = np.gradient(path.v_nav_sensor[move], path.t[move], axis=0)
        gone = path.p_nav_sensor[after.start] - path.p_nav_sensor[before.start]
        figures = move_figures(path.t[move], a_nav, None, path.closure[k], gone)
        said.append(np.sqrt(3.0) * stop_speed(figures, REST, 100.0))
        at_edge += [speed[move.start], speed[move.stop - 1]]
        inside += [speed[move.start - edge(before, path.t)], speed[move.stop - 1 + edge(after, path.t)]]
    assert np.mean(inside) < np.mean(said) < 1.5 * np.mean(at_edge)


def test_a_quick_or_turning_hand_is_seen_at_once() -> None:
    quick, slow = MoveFigures(0.5, 0.0, 0.0, 5.0, 0.2), MoveFigures(3.0, 0.0, 0.0, 0.02, 0.2)
    turning = MoveFigures(3.0, 0.0, 1.5, 0.02, 0.2)
    still = stop_speed(MoveFigures(1.0, 0.0, 1e9, 1e9, 0.0), REST, 100.0)
    assert stop_speed(quick, REST, 100.0) < 1.5 * still
    assert stop_speed(slow, REST, 100.0) > 3.0 * stop_speed(turning, REST, 100.0) > 3.0 * still


@given(st.floats(8.0, 12.0), st.floats(1e-4, 1e-3))
def test_a_tremor_is_no_faster_than_it_is_said_to_be(frequency: float, amplitude: float) -> None:
    t = np.arange(0.0, 1.0, 0.001)
    v = amplitude * 2.0 * np.pi * frequency * np.cos(2.0 * np.pi * frequency * t)
    a_nav = np.outer(np.gradient(v, t), (1.0, 1.0, 1.0))
    assert v.std() <= 1.01 * shaking_speed(a_nav) <= 1.6 * v.std()
