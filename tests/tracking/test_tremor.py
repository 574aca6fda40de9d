"""A hand in the air trembles. Its stops are found all the same, in a recording and live."""

from __future__ import annotations

import numpy as np
import pytest

from pbd.pipeline import track
from pbd.tracking.keyframes import find_keyframes
from tests.scenarios import truth_at
from tests.tracking.test_online import began, fed
from tests.tracking.trembling import STRONG, USUAL, trembling

STOPS = 11


@pytest.mark.parametrize("seed", [2, 3])
@pytest.mark.parametrize(("rms", "may_miss"), [(USUAL, 0), (STRONG, 1)], ids=["usual", "strong"])
@pytest.mark.parametrize("sensor", ["modern", "wt901"])
def test_the_stops_are_found_where_they_are(sensor: str, rms: tuple[float, float], may_miss: int, seed: int) -> None:
    demo = trembling(sensor, seed, rms)
    assert demo.truth is not None
    keyframes = find_keyframes(track(demo.recording))
    off = np.array([k.T_nav_sensor.p - truth_at(demo.truth, k.t) for k in keyframes])
    assert abs(len(keyframes) - STOPS) <= may_miss
    assert np.linalg.norm(off, axis=1).max() < (0.008 if sensor == "modern" else 0.03)


@pytest.mark.parametrize("seed", [2, 3])
@pytest.mark.parametrize("sensor", ["modern", "wt901"])
def test_live_one_may_be_lost_or_divided(sensor: str, seed: int) -> None:
    _, events = fed(trembling(sensor, seed, USUAL).recording)
    assert abs(len({event.index for event in began(events)}) - STOPS) <= 1
