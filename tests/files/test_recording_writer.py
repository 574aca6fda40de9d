"""A demonstration while it is recorded can be read at any moment."""

import os
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pbd.data import GripEvent, Recording, RecordingInfo
from pbd.errors import RecordingError
from pbd.files.demo import read_demo, refuse_demo_folder
from pbd.files.recording_writer import RecordingWriter
from tests.system_failures import no_space


def begun(folder: Path) -> RecordingWriter:
    info = RecordingInfo(sensor="witmotion", created="2026-01-02T03:04:05Z", clock="device")
    return RecordingWriter(folder, info, ("gyr", "acc", "mag"), closed=True)


ACC, GYR, MAG = (0.0, 0.0, 9.81), (0.1, 0.2, 0.3), (20.0, 0.0, -40.0)


def samples(*t: float) -> Recording:
    acc, gyr, mag = (np.tile(each, (len(t), 1)) for each in (ACC, GYR, MAG))
    return Recording(np.array(t), acc, gyr, mag)


def test_it_is_readable_after_every_row(tmp_path: Path) -> None:
    demo = begun(tmp_path / "tea")
    for k in range(1, 5):
        demo.add(samples(0.01 * k))
        recording = read_demo(tmp_path / "tea").recording
        assert len(recording) == k
        assert recording.acc[-1] == pytest.approx(ACC)
        assert recording.info.sensor == "witmotion"
    demo.mark(GripEvent(0.02, True))
    assert read_demo(tmp_path / "tea").recording.grip == (GripEvent(0.02, True),)
    demo.finish(100.0, "device")
    read = read_demo(tmp_path / "tea")
    assert read.closed
    assert read.recording.info.rate_hz == 100.0
    assert read.recording.info.clock == "device"


def test_a_missing_sample_is_nan(tmp_path: Path) -> None:
    demo = begun(tmp_path / "tea")
    demo.add(samples(0.0))
    demo.add(replace(samples(0.01), mag=None))
    demo.close()
    mag = read_demo(tmp_path / "tea").recording.mag
    assert mag is not None
    assert np.isnan(mag[1]).all()
    assert np.isfinite(mag[0]).all()


def test_better_times_replace_the_first_ones(tmp_path: Path) -> None:
    demo = begun(tmp_path / "tea")
    demo.add(samples(0.0, 0.013, 0.018))
    demo.finish(100.0, "host", t=np.array([0.0, 0.01, 0.02]))
    recording = read_demo(tmp_path / "tea").recording
    assert recording.t == pytest.approx([0.0, 0.01, 0.02])
    assert recording.acc[2] == pytest.approx(ACC)


def test_a_demonstration_is_not_replaced_while_it_is_recorded(tmp_path: Path) -> None:
    demo = begun(tmp_path / "tea")
    with pytest.raises(RecordingError, match="is being recorded; end that first"):
        refuse_demo_folder(tmp_path / "tea", force=True)
    demo.close()
    refuse_demo_folder(tmp_path / "tea", force=True)
    with pytest.raises(RecordingError, match="exists; give another name, or --force"):
        begun(tmp_path / "tea")


def test_a_full_disk_leaves_the_written_rows_intact(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    demo = begun(tmp_path / "tea")
    demo.add(samples(0.0))

    room = [20]

    def half(handle: int, data: bytes) -> int:
        return write(handle, data[: room.pop()]) if room else no_space()

    write = os.write
    monkeypatch.setattr(os, "write", half)
    with pytest.raises(
        RecordingError, match=r"No space left on device\); give another place; intact so far: 1 sample$"
    ):
        demo.add(samples(0.01))
    monkeypatch.undo()
    demo.close()
    assert len(read_demo(tmp_path / "tea").recording) == 1


@pytest.mark.parametrize(
    ("method", "act"),
    [
        ("write_text", lambda demo: demo.mark(GripEvent(0.0, True))),
        ("open", lambda demo: demo.finish(100.0, "host", np.array([0.0, 0.01]))),
    ],
)
def test_a_disk_that_is_full_at_a_grip_or_the_end_leaves_the_rows_intact_and_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, method: str, act: Callable[[RecordingWriter], None]
) -> None:
    demo = begun(tmp_path / "tea")
    demo.add(samples(0.0, 0.01))
    monkeypatch.setattr(Path, method, no_space)
    with pytest.raises(
        RecordingError, match=r"No space left on device\); give another place; intact so far: 2 samples$"
    ):
        act(demo)
    monkeypatch.undo()
    demo.close()
    assert len(read_demo(tmp_path / "tea").recording) == 2


def test_a_deleted_folder_ends_the_recording_at_once(tmp_path: Path) -> None:
    """Not at its end, when minutes of it are lost."""
    demo = begun(tmp_path / "tea")
    demo.add(samples(0.0))
    shutil.rmtree(tmp_path / "tea")
    with pytest.raises(RecordingError, match="tea was renamed or deleted meanwhile; record again"):
        demo.add(samples(0.01))
    demo.close()


def test_a_discarded_demonstration_is_removed(tmp_path: Path) -> None:
    demo = begun(tmp_path / "tea")
    demo.add(samples(0.0))
    demo.discard()
    assert not (tmp_path / "tea").exists()
