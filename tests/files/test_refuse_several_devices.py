"""Rows of several devices in one table: told apart by a column of any name, and by their readings."""

from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from pbd.data import Recording
from pbd.errors import RecordingError
from pbd.files.importers import import_file
from pbd.pose import Array
from pbd.simulation.simulate import simulate

N = 1500


@cache
def hand(seed: int) -> Array:
    """Accelerometer and gyro of a hand, (N, 6)."""
    recording = simulate("pour", "modern", seed).recording
    assert recording.gyr is not None
    return np.column_stack((recording.acc, recording.gyr))[:N]


def read(folder: Path, name: str, rows: Sequence[tuple[float, object, Array]]) -> Recording:
    cells = (f"{t:.3f},{mark},{','.join(map('{:.5f}'.format, values))}\n" for t, mark, values in rows)
    (folder / "run.csv").write_text(f"t,{name},ax,ay,az,gx,gy,gz\n" + "".join(cells))
    return import_file(folder / "run.csv").recording


@pytest.mark.parametrize("late_s", [0.0, 0.003])
@pytest.mark.parametrize(("name", "marks"), [("side", ("L", "R")), ("dev", (0, 1)), ("port", ("ttyUSB0", "ttyUSB1"))])
def test_devices_whose_rows_alternate_are_refused(
    tmp_path: Path, name: str, marks: tuple[object, object], late_s: float
) -> None:
    """They were read as one sensor at twice the rate, and the path was a mean of both."""
    hands = hand(1), np.roll(hand(2), 300, axis=0)  # the other hand does the same three seconds later
    both = [(0.01 * k + late_s * i, marks[i], hands[i][k]) for k in range(N) for i in range(2)]
    with pytest.raises(RecordingError, match=rf"rows of 2 devices \({marks[0]}, {marks[1]}\) in the column '{name}'"):
        read(tmp_path, name, both)


@pytest.mark.parametrize(
    "mark",
    [
        lambda k: k % 2,  # a bit that toggles with each packet
        lambda k: k % 10,  # the number of a sample in its packet
        lambda k: "closed" if 500 < k < 1000 else "open",
        lambda k: "" if k != 700 else "grip",
        lambda k: k // 100 % 2,
    ],
)
def test_a_mark_in_the_rows_of_one_device_is_no_second_device(tmp_path: Path, mark: Callable[[int], object]) -> None:
    recording = read(tmp_path, "mark", [(0.01 * k, mark(k), hand(1)[k]) for k in range(N)])
    assert len(recording) == N


def test_a_mark_of_wild_samples_is_no_second_device(tmp_path: Path) -> None:
    wild = np.random.default_rng(0).random(N) < 0.2
    rows = [(0.01 * k, int(not wild[k]), hand(1)[k] + (40.0 if wild[k] else 0.0)) for k in range(N)]
    assert len(read(tmp_path, "valid", rows)) == N


def test_rows_with_line_ends_in_cells_are_compared_whole(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The first rows of a large file are enough, but in the middle of a cell no row ends."""
    monkeypatch.setattr("pbd.files.importers.refuse_several_devices.TOP", 1000)
    rows = [(0.01 * k, f'"\nside {k % 2}"', hand(1)[k]) for k in range(N)]
    assert len(read(tmp_path, "note", rows)) == N


def test_a_lone_quote_does_not_end_the_first_rows(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("pbd.files.importers.refuse_several_devices.TOP", 20_000)
    notes = {5: 'a pipe of 5"'}
    rows = [(0.005 * k, f"{notes.get(k, '')},{k % 2}", hand(1 + k % 2)[k // 2]) for k in range(N)]
    with pytest.raises(RecordingError, match="rows of 2 devices"):
        read(tmp_path, "note,side", rows)
