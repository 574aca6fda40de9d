"""Times in two columns, whole seconds and the part of a second; and columns that are no such part."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from pbd.data.source_columns import SourceColumns
from pbd.errors import RecordingError
from pbd.files.importers import import_file
from pbd.pose import Array

STARTS_MS = 36000437  # 10:00:00.437
STEPS_MS = np.arange(0, 3000, 10)
AXES = "ax,ay,az,gx,gy,gz"


def read(folder: Path, names: str, cells: Callable[[int], str], **columns: str) -> tuple[Array, SourceColumns]:
    """Write and read a table of 3 s at 100 Hz; `cells` returns a row's times, of ms since midnight."""
    rows = [f"{cells(int(ms))},0.5,0.25,9.75,1.5,{k % 7},-2" for k, ms in enumerate(STARTS_MS + STEPS_MS)]
    (folder / "run.csv").write_text("\n".join([f"{names},{AXES}", *rows, ""]), encoding="utf-8")
    recording = import_file(folder / "run.csv", columns).recording
    return recording.t, recording.info.source


def of_day(ms: int) -> str:
    return f"{ms // 3600000:02d}:{ms // 60000 % 60:02d}:{ms // 1000 % 60:02d}"


@pytest.mark.parametrize(
    ("whole", "part", "per_ms"),
    [
        ("sec", "usec", 1000),
        ("secs", "nsecs", 1000000),
        ("stamp_sec", "stamp_nanosec", 1000000),
        ("time_s", "millis", 1),
        ("seconds", "microseconds", 1000),
        ("s", "ns", 1000000),
        ("t (s)", "rest (us)", 1000),
        ("Time(HH:MM:SS)", "ms", 1),
        ("Uhrzeit", "ms", 1),
        ("timestamp", "subsecond (10ms)", 0.1),
        ("timestamp", "fraction_s", 0.001),
    ],
)
@pytest.mark.parametrize("swapped", [False, True])
def test_the_part_of_a_second_is_added(tmp_path: Path, whole: str, part: str, per_ms: float, swapped: bool) -> None:
    def cells(ms: int) -> str:
        seconds = of_day(ms) if whole in ("Time(HH:MM:SS)", "Uhrzeit") else str(ms // 1000)
        pair = [seconds, f"{ms % 1000 * per_ms:.10g}"]
        return ",".join(pair[::-1] if swapped else pair)

    named = {"t": whole} if whole == "stamp_sec" else {}
    t, source = read(tmp_path, f"{part},{whole}" if swapped else f"{whole},{part}", cells, **named)
    assert_allclose(t, 1e-3 * STEPS_MS, atol=8e-3 if "10ms" in part else 2e-6)
    assert source.of("t")[0].name == whole
    assert source.unread[part] == f"read with {whole}"


def test_the_part_is_added_past_midnight_and_after_a_gap(tmp_path: Path) -> None:
    def at(ms: int) -> int:
        since = ms - STARTS_MS
        return (86398500 + since + 1200 * (since > 1000)) % 86400000

    t, _ = read(tmp_path, "Time,ms", lambda ms: f"{of_day(at(ms))},{at(ms) % 1000}")
    assert_allclose(t, 1e-3 * (STEPS_MS + 1200 * (STEPS_MS > 1000)), atol=1e-9)


@pytest.mark.parametrize("names", ["Time,ms", "Date,Time,ms", "t,device_time_ms"])
def test_milliseconds_since_the_start_are_a_clock_of_their_own(tmp_path: Path, names: str) -> None:
    begin = "29.11.2026," if "Date" in names else ""
    t, source = read(tmp_path, names, lambda ms: f"{begin}{of_day(ms)},{ms - STARTS_MS + 317}")
    assert_allclose(t, 1e-3 * STEPS_MS, atol=1e-9)
    assert source.of("t")[0].name == names.rpartition(",")[2]
    assert "Date" not in source.unread or source.unread["Date"] == "the date"


@pytest.mark.parametrize(
    ("name", "cell"),
    [
        ("latency_ms", lambda ms: ms * 7919 % 997),
        ("load", lambda ms: "inf" if ms % 3 else 1),
        ("note_ms", lambda _: "ok"),
        ("ms", lambda _: 10),
        ("n", lambda _: 7),
        ("sample", lambda ms: ms % 1000 // 10),
    ],
)
def test_a_column_that_is_no_part_is_not_added(tmp_path: Path, name: str, cell: Callable[[int], object]) -> None:
    t, _ = read(tmp_path, f"Time,{name}", lambda ms: f"{of_day(ms)},{cell(ms)}")
    assert_allclose(t, (437 + STEPS_MS) // 1000)


def test_a_time_with_a_fraction_needs_no_part(tmp_path: Path) -> None:
    t, _ = read(tmp_path, "Time,ms", lambda ms: f"{of_day(ms)}.{ms % 1000:03d},{ms % 1000}")
    assert_allclose(t, 1e-3 * STEPS_MS, atol=1e-9)


@pytest.mark.parametrize(
    ("name", "cell", "line", "said"),
    [
        (
            "ms",
            lambda ms: (ms + 100) % 1000,
            49,
            "falls to 7 within one; correct or remove it; if it is the time since",
        ),
        ("ms", lambda ms: 9 + ms // 10 % 3, 4, "if it is the time since the row before, import it with --column dt=ms"),
        ("part", lambda ms: ms % 1000, None, "its name has no unit that fits; name it with its unit, as 'part (ms)'"),
        ("part (ms)", lambda ms: ms % 1000 * 10, None, "name it with its unit, as 'part (ms)', or remove it"),
        ("ms", lambda ms: ms % 1000 * 10, None, "name it with its unit, as 'ms (ms)', or remove it"),
    ],
)
def test_what_may_be_a_part_is_not_left_out_silently(
    tmp_path: Path, name: str, cell: Callable[[int], float], line: int | None, said: str
) -> None:
    looks = f"the times in column 'Time' are whole seconds; the column '{name}' looks like the part of a second, but "
    with pytest.raises(RecordingError) as refused:
        read(tmp_path, f"Time,{name}", lambda ms: f"{of_day(ms)},{cell(ms)}")
    assert looks in refused.value.message
    assert said in refused.value.message
    assert refused.value.fields.get("line") == line
