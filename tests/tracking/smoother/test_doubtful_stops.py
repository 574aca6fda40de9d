"""Which stops are believed once the velocity is known."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from pbd.pipeline import track
from pbd.simulation.hand_motion import Waypoint
from pbd.simulation.tasks import Task
from pbd.tracking.smoother.doubtful_stops import settled, stop_weights
from tests.scenarios import simulate, uncalibrated
from tests.tracking.fault_matrix import SILENT_RIGHT, Case, named, outcome


def weights(speeds: list[list[float]]) -> list[float]:
    """Weights of stops by the speeds (m/s) at their knots, with a fast knot between any two; sigma is 2 mm/s."""
    of_knots = [(k, speed) for k, stop in enumerate(speeds) for speed in (*stop, None)]
    stop_of = np.array([-1 if speed is None else k for k, speed in of_knots])
    v = np.array([[speed or 0.0, 0.0, 0.0] for _, speed in of_knots])
    zeros = np.zeros((len(v), 3, 3))
    problem: Any = SimpleNamespace(
        stops=speeds,
        stop_of=stop_of,
        same_stop=(stop_of[1:] == stop_of[:-1]) & (stop_of[1:] >= 0),
        still_sigma=np.full(len(v), 2e-3),
        C=zeros,
        rate=np.zeros((len(v), 3)),
    )
    state: Any = SimpleNamespace(E=zeros, v=v, shared=np.zeros(40))
    found: list[float] = stop_weights(problem, state).tolist()
    return found


@pytest.mark.parametrize(("end", "same"), [(51, True), (53, False)])
def test_a_stop_is_the_same_if_its_ends_move_by_less_than_two_hundredths_of_a_second(end: int, same: bool) -> None:
    assert settled(0.01 * np.arange(100.0), [(20, 50)], [(20, end)]) == same


def test_a_hand_that_turns_back_does_not_stop() -> None:
    rests = [[0.0, 0.0], [0.1, 0.0, 0.0], [0.0, 0.015], [0.0]]
    turns_back = [[0.1, 0.0, 0.1], [0.0, 0.1], [0.03, 0.0]]
    assert weights([*rests, *turns_back]) == [1.0, 1.0, 1.0, 1.0, 0.0, 0.0, 0.0]


def test_a_stop_that_is_doubted_too_much_is_left_out() -> None:
    doubted, left_out = weights([[0.006, 0.006], [0.008, 0.008]])
    assert doubted == pytest.approx((1.0 + (3.0**2 - 3.0) / 9.0) ** -2)
    assert left_out == 0.0


def test_between_two_taps_the_middle_of_a_slow_move_is_no_stop() -> None:
    """Each tap hides how fast the hand is."""
    found = outcome(Case(named("taps", "80 m/s2"), "pour", "modern", 10))
    assert found.verdict == SILENT_RIGHT
    assert found.error_m < 0.01


@uncalibrated
@pytest.mark.parametrize("sensor", ["modern", "wt901"])
def test_a_hand_that_rests_every_other_second_stops_each_time(sensor: str) -> None:
    """The moves are calm, so all of it seems one long rest, in which the knots are a second apart."""
    turns = [Waypoint((0.05 * (k % 2), 0.0, 0.0), move_s=1.0, rest_s=1.0) for k in range(1, 12)]
    task = Task("in time", (Waypoint(rest_s=2.0), *turns))
    assert len(track(simulate(task, sensor, 0).recording).stops) == 12
