"""Logs of WitMotion's programs: a simulated recording in each version's format is read again."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pbd.data import GRAVITY, Recording
from pbd.errors import RecordingError
from pbd.files.importers import import_file
from pbd.io.numbers import seconds
from pbd.simulation.simulate import simulate
from tests.not_none import not_none

START = datetime(2025, 10, 9, 8, 18, 9, 90_000)
STEP_S = 0.01


def iso(at: datetime) -> str:
    return at.isoformat(timespec="milliseconds")


def spaced(at: datetime) -> str:
    return iso(at).replace("T", " ")


def of_day(at: datetime) -> str:
    return f" {at:%H:%M:%S}.{at.microsecond // 1000:03d}"


def unpadded(at: datetime) -> str:
    """Write whole numbers without leading zeros, the last one milliseconds."""
    return f"{at.year}-{at.month}-{at.day} {at.hour}:{at.minute}:{at.second}:{at.microsecond // 1000}"


@dataclass(frozen=True)
class Dialect:
    """The format of one program. In the header, `*` stands for X, Y, Z."""

    header: str
    times: tuple[Callable[[datetime], str], ...]
    delimiter: str = "\t"
    remarks: str = ""
    encoding: str = "utf-8"
    mark: str = "."
    end: str = "\r\n"
    tail: str = ""


def null(_: datetime) -> str:
    return "null"


def stuck(_: datetime) -> str:
    return spaced(START)


DIALECTS = {
    "MiniIMU": Dialect(
        "address Time(s) a*(g) w*(deg/s) Angle*(deg) h* T(°)",
        (of_day,),
        remarks="StartTime：2025-10-09 08:18:09.090\r\n",
        encoding="gb18030",
    ),
    "with a date, decimal commas, a tab at the end": Dialect(
        "Time(s) ChipTime a*(g) w*(deg/s) Angle*(deg) h* T(°)", (of_day, spaced), mark=",", tail="\t"
    ),
    "WitMotion 2024, CSV": Dialect(
        "Time,Device name,Chip Time(),Acceleration *(g),Angular velocity *(°/s),Angle *(°),Magnetic field *(ʯt),"
        "Temperature(℃)",
        (of_day, unpadded),
        delimiter=",",
    ),
    "WitMotion 2024, western": Dialect(
        "Time,Device name,Chip Time(),Acceleration *(g),Angular velocity *(°/s),Angle *(°),Magnetic field *(uT),"
        "Temperature(°C)",
        (of_day, unpadded),
        delimiter=",",
        encoding="cp1252",
    ),
    "WitMotion 2025": Dialect(
        "time DeviceName ChipTime() Acc*(g) As*(°/s) Angle*(°) H*(uT) Temperature(°C)", (iso, null), end="\n"
    ),
    "a chip time that stands still": Dialect(
        "time DeviceName ChipTime() Acc*(g) As*(°/s) Angle*(°) H*(uT) Temperature(°C)", (unpadded, stuck)
    ),
    "Chinese": Dialect(
        "时间 设备名称 片上时间() 加速度*(g) 角速度*(°/s) 角度*(°) 磁场*(uT) 温度(°C)",
        (spaced, unpadded),
        encoding="gb18030",
    ),
}


def columns_of(dialect: Dialect) -> list[str]:
    words = dialect.header.split("," if dialect.delimiter == "," else " ")
    return [
        word.replace("*", axis) for word in words for axis in ("XYZ" if "*" in word else " ")[: 3 if "*" in word else 1]
    ]


def written(dialect: Dialect, recording: Recording, devices: Sequence[str] = ("WT901(d6:a8)",)) -> bytes:
    """Write a recording with 4 decimals of g, 3 of deg/s, 3 of degrees, and whole uT."""
    header = columns_of(dialect)
    rows = [dialect.delimiter.join(header) + dialect.tail]
    degrees = 180.0 / np.pi
    parts = (
        (recording.acc / GRAVITY, 4),
        (not_none(recording.gyr) * degrees, 3),
        (not_none(recording.device_rpy) * degrees, 3),
        (not_none(recording.mag), 0),
    )
    for k in range(len(recording)):
        at = START + timedelta(seconds=STEP_S * k)
        clocks = iter(dialect.times)
        cells = []
        for name in header[: next(i for i, name in enumerate(header) if "X" in name)]:
            device = name.lower().replace(" ", "") in ("address", "devicename", "设备名称")
            cells.append(devices[k % len(devices)] if device else next(clocks)(at))
        cells += [f"{x:.{places}f}".replace(".", dialect.mark) for values, places in parts for x in values[k]]
        rows.append(dialect.delimiter.join([*cells, "24" + dialect.mark + "51"]) + dialect.tail)
    return (dialect.remarks + dialect.end.join(rows) + dialect.end).encode(dialect.encoding)


@pytest.fixture(scope="module")
def recording() -> Recording:
    return simulate("pick-and-place-stops", "wt901", 3).recording


@pytest.mark.parametrize("dialect", DIALECTS.values(), ids=list(DIALECTS))
def test_the_log_of_every_program_is_read(dialect: Dialect, recording: Recording, tmp_path: Path) -> None:
    file = tmp_path / "log.txt"
    file.write_bytes(written(dialect, recording))
    got = import_file(file).recording
    np.testing.assert_allclose(got.t, STEP_S * np.arange(len(recording)), atol=1e-6)
    np.testing.assert_allclose(got.acc, recording.acc, atol=0.51e-4 * GRAVITY)
    np.testing.assert_allclose(not_none(got.gyr), not_none(recording.gyr), atol=np.radians(0.51e-3))
    np.testing.assert_allclose(not_none(got.device_rpy), not_none(recording.device_rpy), atol=np.radians(0.51e-3))
    np.testing.assert_allclose(not_none(got.mag), not_none(recording.mag), atol=0.51)


def test_an_attitude_that_the_module_does_not_send_is_left_out(tmp_path: Path) -> None:
    head = "time,AccX(g),AccY(g),AccZ(g),AsX(°/s),AsY(°/s),AsZ(°/s),AngleX(°),AngleY(°),AngleZ(°)\n"
    (tmp_path / "log.txt").write_text(head + "".join(f"10:00:0{k}.000,0,0,1,1,2,3,,,\n" for k in range(3)))
    recording = import_file(tmp_path / "log.txt").recording
    assert recording.device_rpy is None
    assert recording.info.source.unread["AngleZ(°)"] == "no number in any row"


def test_a_broken_cell_is_named_with_its_line(recording: Recording, tmp_path: Path) -> None:
    file = tmp_path / "log.txt"
    lines = written(DIALECTS["MiniIMU"], recording).decode("gb18030").split("\r\n")
    lines[7] = lines[7].rsplit("\t", 3)[0] + "\tx\ty\tz"
    file.write_text("\r\n".join(lines), encoding="gb18030", newline="")
    with pytest.raises(RecordingError, match=r":8: 'x' in column 'hY' is not a number"):
        import_file(file)


@given(st.datetimes(min_value=datetime(1990, 1, 1), max_value=datetime(2090, 1, 1)))
def test_stamps_count_seconds(at: datetime) -> None:
    at = at.replace(microsecond=at.microsecond // 1000 * 1000)
    exact = (at - datetime(2000, 1, 1)).total_seconds()
    for write in (iso, spaced, unpadded):
        assert seconds(write(at)) == pytest.approx(exact, abs=1e-6)
    midnight = at.replace(hour=0, minute=0, second=0, microsecond=0)
    assert seconds(of_day(at)) == pytest.approx((at - midnight).total_seconds(), abs=1e-9)


@pytest.mark.parametrize("cell", ["noon", "8:18", "2025-13-41 8:18:09", "8:18:9pm"])
def test_a_text_that_is_not_a_time_is_refused(cell: str) -> None:
    with pytest.raises(ValueError, match=r".+"):
        seconds(cell)
