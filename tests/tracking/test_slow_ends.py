"""Moves that begin and end too slowly to be noticed."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pbd.pipeline import track
from pbd.pose import Array
from pbd.simulation.hand_motion import Waypoint, minimum_jerk
from pbd.simulation.tasks import Task
from pbd.tracking.noise import Noise
from pbd.tracking.slow_ends import without_slow_ends
from tests.scenarios import simulate
from tests.simulation.sway import with_sway
from tests.tracking.nees import MODELS, against

DT = 0.005


def speeds(t: Array, begin: float, lasts: float) -> Array:
    """Speed of a smooth move of 1 m, zero beside it."""
    return minimum_jerk(np.clip((t - begin) / lasts, 0.0, 1.0))[1] / lasts


@given(lasts=st.floats(1.0, 20.0), noticed=st.floats(0.001, 0.7), again=st.booleans())
def test_a_smooth_move_is_followed_back_to_where_it_began(lasts: float, noticed: float, again: bool) -> None:
    """Also the first of two moves without a stop between them, and the last."""
    t = np.arange(0.0, 3.0 * lasts + 20.0, DT)
    speed = speeds(t, 10.0, lasts) + again * speeds(t, 10.0 + lasts, lasts)
    end = 10.0 + lasts * (1 + again)
    moving = np.flatnonzero(speed > noticed * speed.max())
    seen = [(0, int(moving[0])), (int(moving[-1]) + 1, len(t))]
    (_, stop), (start, _) = without_slow_ends(t, seen, speed, np.zeros(len(t), dtype=bool))
    assert t[stop] == pytest.approx(10.0, abs=0.01 * lasts + 2 * DT)
    assert t[start] == pytest.approx(end, abs=0.01 * lasts + 2 * DT)


def test_an_end_that_is_noticed_at_once_stays() -> None:
    t = np.arange(0.0, 15.0, DT)
    speed = speeds(t, 5.0, 5.0)
    seen = [(0, 1100), (1900, 3000)]
    sharp = np.zeros(len(t), dtype=bool)
    sharp[1100] = True
    (_, stop), (start, _) = without_slow_ends(t, seen, speed, sharp)
    assert stop == 1100
    assert t[start] == pytest.approx(10.0, abs=0.06)


def test_the_middle_of_a_rest_between_slow_moves_is_left() -> None:
    """The moves seem to overlap, as their ends are followed back too far where only their fastest half is noticed."""
    t = np.arange(0.0, 30.0, DT)
    speed = speeds(t, 2.0, 10.0) + speeds(t, 12.0, 10.0)
    edges = (np.flatnonzero(np.diff(speed > 0.5 * speed.max())) + 1).tolist()
    seen = [(0, edges[0]), (edges[1], edges[2]), (edges[3], len(t))]
    start, stop = without_slow_ends(t, seen, speed, np.zeros(len(t), dtype=bool))[1]
    assert t[start] == pytest.approx(12.0, abs=0.1)
    assert 0 < stop - start <= 0.2 / DT


SLOW = {"a straight move": (0.2, 5.0, 0.0), "a move that turns": (0.1, 5.0, 10.0)}


def slow_task(seed: int, metres: float, move_s: float, turn_deg: float) -> Task:
    """Five moves in random directions, of one length."""
    rng = np.random.default_rng(seed)
    waypoints, p = [Waypoint(rest_s=2.0)], np.zeros(3)
    for _ in range(5):
        way, turn = rng.normal(size=(2, 3))
        p = p + metres * way / np.linalg.norm(way)
        turn *= np.radians(turn_deg) / np.linalg.norm(turn)
        waypoints.append(Waypoint((p[0], p[1], p[2]), (turn[0], turn[1], turn[2]), move_s, 1.5))
    return Task("slow", tuple(waypoints))


@pytest.mark.filterwarnings("ignore::pbd.errors.PbdWarning")
@pytest.mark.parametrize("name", SLOW)
@pytest.mark.parametrize("sensor", ["wt901", "os5000", "modern"])
def test_slow_moves_are_as_true_as_their_sigma(sensor: str, name: str) -> None:
    """Each looks like rest for half a second and more at either end."""
    demo = simulate(with_sway(slow_task(0, *SLOW[name]), Noise.still_speed, 0), MODELS[sensor], 0)
    assert demo.truth is not None
    found = against(track(demo.recording), demo.truth)
    assert len(found.off) == 5
    assert np.sqrt(np.mean(found.position**2)) < 1.5


@pytest.mark.filterwarnings("ignore::pbd.errors.PbdWarning")
def test_a_rest_that_hides_a_slow_move_is_told() -> None:
    """10 cm in five seconds: the accelerometer shows less than its bias may change."""
    demo = simulate(with_sway(slow_task(0, 0.1, 5.0, 0.0), Noise.still_speed, 0), MODELS["wt901"], 0)
    with pytest.warns(match="its readings drift like those of a hand that moves slowly"):
        track(demo.recording)
