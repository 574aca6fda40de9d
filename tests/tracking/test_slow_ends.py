"""Moves that begin and end too slowly to be noticed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pbd.pose import Array
from pbd.simulation.hand_motion import Waypoint, minimum_jerk
from pbd.simulation.tasks import Task
from pbd.tracking.noise import Noise
from pbd.tracking.slow_ends import without_slow_ends
from pbd.tracking.smoother.doubtful_stops import SLOW_SPEED
from tests.tracking.nees import MODELS, against
from tests.scenarios import simulate
from pbd.pipeline import track
from tests.simulation.sway import with_sway

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
    t = np.arange(0.0, 30.0, DT)
    speed = speeds(t, 2.0, 10.0) + speeds(t, 12.1, 10.0)
    moving = speed > 0.5 * speed.max()
    edges = np.flatnonzero(np.diff(moving)) + 1
    seen = [(0, int(edges[0])), (int(edges[1]), int(edges[2])), (int(edges[3]), len(t))]
    rest = without_slow_ends(t, seen, speed, np.zeros(len(t), dtype=bool))[1]
    assert t[rest[0]] <= 12.05 + 2 * DT <= t[rest[1]] + 4 * DT
    assert rest[1] > rest[0]
