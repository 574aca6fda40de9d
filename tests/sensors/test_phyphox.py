"""What waits for what until phyphox' answers are samples."""

import json

import numpy as np
import pytest

from pbd.pose import Array
from pbd.sensors.decoding import Sample
from pbd.sensors.phyphox.answers import BUFFERS, PhyphoxDecoder


def fed(decoder: PhyphoxDecoder, **times: Array) -> list[Sample]:
    """Feed one answer with readings (1, 1, 1) of each sensor at these times (n,) s."""
    columns = {
        name: {"buffer": t.tolist() if name == BUFFERS[kind][0] else [1.0] * len(t)}
        for kind, t in times.items()
        for name in BUFFERS[kind]
    }
    return decoder.feed(b"/get " + json.dumps({"buffer": columns}).encode() + b"\n")


def between(start: float, end: float) -> Array:
    """100 times a second, from start to end, both included."""
    return np.arange(round(100.0 * start), round(100.0 * end) + 1) / 100.0


@pytest.mark.parametrize(("end", "waits"), [(0.9, True), (1.1, False)])
def test_after_a_second_a_phone_counts_as_one_without_a_gyro(end: float, waits: bool) -> None:
    decoder = PhyphoxDecoder()
    assert (fed(decoder, acc=between(0.0, 0.3)) + fed(decoder, acc=between(0.31, end)) == []) == waits


def test_samples_wait_half_a_second_for_a_field_that_stops() -> None:
    t = between(0.0, 1.0)
    assert fed(PhyphoxDecoder(), acc=t, gyr=t, mag=between(0.0, 0.2))[-1].t_device == 0.5


def test_a_gap_stays_one_if_each_answer_has_one_row() -> None:
    """What the usual interval is must be known from rows that were used long ago."""
    decoder = PhyphoxDecoder()
    heard = fed(decoder, acc=between(0.0, 0.2), gyr=between(0.0, 0.2))
    for t in between(0.21, 1.0):
        gap = 0.5 < t < 0.8
        heard += fed(decoder, gyr=np.array([t]), **({} if gap else {"acc": np.array([t])}))
    assert [sample.t_device for sample in heard] == [*between(0.0, 0.5), *between(0.8, 1.0)]


def test_a_long_recording_takes_no_memory() -> None:
    decoder = PhyphoxDecoder()
    for k in range(20):
        fed(decoder, acc=between(0.4 * k, 0.4 * k + 0.39), gyr=between(0.4 * k, 0.4 * k + 0.39))
    assert len(decoder._rows["acc"]) <= 101
