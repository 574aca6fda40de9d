"""Any numbers in a recording: it is refused with a PbdError, or gives a sound path."""

from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from pbd.data import Recording
from pbd.pose import Array
from pbd.simulation.simulate import random_task
from pbd.track_recording import METHODS
from tests.scenarios import simulate, with_channel, with_rows
from tests.tracking.track_or_refuse import every_method, path_or_none, quietly


@pytest.mark.filterwarnings("ignore:--method paper finds:pbd.errors.PbdWarning")
@every_method
@pytest.mark.parametrize("rows", [2, 5, 20])
@pytest.mark.parametrize("rate_hz", [10.0, 100.0])
def test_a_few_samples_of_a_rest_are_a_rest_or_refused(method: str, rows: int, rate_hz: float) -> None:
    recording = with_rows(simulate("pour", "modern", rate_hz=rate_hz).recording, slice(0, rows))
    path = path_or_none(recording, method)
    if path is not None:
        assert len(path.stops) == 1
        assert path.p_nav_sensor == pytest.approx(0.0, abs=1e-3)


@st.composite
def recordings(draw: st.DrawFn) -> Recording:
    """A few arbitrary numbers, finite or not, in any channels and in time."""
    n = draw(st.integers(0, 40))
    number = st.floats() | st.sampled_from((0.0, 9.81, -9.81, 1.0))
    rows = arrays(np.float64, (n, 3), elements=number)
    beat = draw(st.floats(1e-3, 0.3)) * np.arange(n, dtype=np.float64)
    t: Array = draw(st.just(beat) | arrays(np.float64, n, elements=number) | st.just(np.cumsum(beat)))
    level = st.just(np.tile((0.0, 0.0, 9.81), (n, 1)))
    return Recording(
        t,
        acc=draw(rows | level),
        gyr=draw(st.none() | rows | st.just(np.zeros((n, 3)))),
        mag=draw(st.none() | rows),
        device_rpy=draw(st.none() | rows),
    )


@quietly
@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(recordings(), st.sampled_from(METHODS))
def test_any_few_numbers_are_refused_or_give_a_sound_path(recording: Recording, method: str) -> None:
    path_or_none(recording, method)


@dataclass(frozen=True)
class Fault:
    """A fault in some rows of a channel."""

    channel: str
    start: int
    length: int
    kind: str
    value: float

    def befall(self, values: Array) -> Array:
        spoilt, rows = values.copy(), slice(self.start, self.start + self.length)
        if self.kind == "set":
            spoilt[rows] = self.value
        elif self.kind == "one axis":
            spoilt[rows, 0] = self.value
        elif self.kind == "hold":
            spoilt[rows] = spoilt[self.start : self.start + 1]
        with np.errstate(all="ignore"):
            if self.kind == "scale":
                spoilt[rows] *= self.value
            elif self.kind == "add":
                spoilt[rows, 1] += self.value
        return spoilt


SOUND = {
    rate_hz: simulate(random_task(3, moves=2, rest_s=(1.1, 1.2)), "modern", 3, rate_hz=rate_hz).recording
    for rate_hz in (10.0, 40.0)
}


@st.composite
def spoilt_recordings(draw: st.DrawFn) -> Recording:
    """A sound recording of two moves, cut, with rows lost or repeated, and faults in its channels."""
    recording = SOUND[draw(st.sampled_from(tuple(SOUND)))]
    n = len(recording)
    rows = np.arange(draw(st.integers(0, n // 2)), draw(st.integers(n // 2, n)))
    again = draw(st.lists(st.tuples(st.integers(0, n), st.integers(1, 12)), max_size=2))
    lost = draw(st.lists(st.tuples(st.integers(0, n), st.integers(1, 12)), max_size=2))
    rows = np.sort(np.concatenate([rows, *(np.full(count, row) for row, count in again if row in rows)]))
    rows = rows[~np.isin(rows, np.concatenate([[-1], *(np.arange(row, row + count) for row, count in lost)]))]
    recording = with_rows(recording, rows.astype(np.intp))
    value = st.floats() | st.floats(-20.0, 20.0) | st.sampled_from((0.0, -1.0, 9.81, 57.3))
    kind = st.sampled_from(("set", "one axis", "hold", "scale", "add"))
    channel = st.sampled_from(("acc", "gyr", "mag", "device_rpy"))
    fault = st.builds(Fault, channel, st.integers(0, n), st.integers(1, n), kind, value)
    for each in draw(st.lists(fault, max_size=3)):
        recording = with_channel(recording, each.channel, each.befall(getattr(recording, each.channel)))
    for absent in draw(st.sets(st.sampled_from(("gyr", "mag", "device_rpy")), max_size=2)):
        recording = with_channel(recording, absent, None)
    return recording


@quietly
@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(spoilt_recordings(), st.sampled_from(METHODS))
def test_a_spoilt_recording_is_refused_or_gives_a_sound_path(recording: Recording, method: str) -> None:
    path_or_none(recording, method)
