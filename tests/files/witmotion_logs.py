"""Logs as each of WitMotion's programs writes them."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta

import numpy as np

from pbd.data import GRAVITY, Recording
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
