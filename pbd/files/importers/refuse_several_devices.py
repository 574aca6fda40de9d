"""Rows of several devices in one table, which would be read as one sensor that jumps to and fro."""

import re
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pbd.data.source_columns import SourceColumns
from pbd.errors import RecordingError, listed
from pbd.files.importers.header_names import our_name, plain
from pbd.files.table import Sheet
from pbd.pose import Array

DEVICE_NAMES = re.compile(
    r"(?:device|sensor|imu|node|board|tracker)(?:_?(?:id|name|tag|mac|address|serial|nr|no|number))?"
    r"|id|mac|(?:\w+_|mac)?addr(?:ess)?|(?:\w+_)?frame_id|设备名称|i|instance(?:_?id)?"
)
"""Names of columns that tell devices apart, as `mpu_address`. `I` is ArduPilot's number of an IMU."""

MOST_DEVICES = 20
"""Largest number of devices in a file. A column with more names counts something else."""

TOP = 200_000
"""Number of characters of the first rows, whose readings are compared: ten seconds and more at 100 Hz."""

SAME_DEVICE = 0.5
"""Largest change between successive rows of one device, as a share of the change between successive rows of the file,
if devices alternate. If a column divides the rows of a lone sensor, the rows of one group are farther apart in time, so
their readings change as much as the file's, or more."""


def refuse_several_devices(sheet: Sheet) -> None:
    """Refuse columns or rows of several devices, by the names of the columns."""
    names = [name for name in sheet.header if (ours := our_name(name)) and ours[0] == "ax"]
    if len(names) > MOST_DEVICES:
        what = f"a row has {len(names)} accelerometers or samples ({listed(names[:3])}, ...)"
        raise RecordingError.at(sheet.path, f"{what}; write one sample of one sensor in a row", value=len(names))
    for name in sheet.header:
        if DEVICE_NAMES.fullmatch(plain(name)) and 1 < len(devices := set(sheet.words(name)) - {""}) <= MOST_DEVICES:
            raise _mixed(sheet, name, devices)


def refuse_alternating_devices(sheet: Sheet, found: SourceColumns) -> None:
    """Refuse rows of several devices that alternate, by their readings, if a column that isn't read tells them apart.

    It may have any name, as `side`. The readings then change less from row to row of one device than of the file.
    """
    top = replace(sheet, body=_first_rows(sheet))
    sensors = [[column.name for column in found.of(channel)] for channel in ("acc", "gyr") if found.of(channel)]
    table = top.read([name for names in sensors for name in names])
    columns = zip(*(row for _, row in top.rows(top.body, 0)), strict=False)
    cells = dict(zip(sheet.header, columns, strict=False))
    for name in filter(cells.__contains__, found.unread):
        words = [cell.strip() for cell in cells[name]]
        devices, device, rows = np.unique(words, return_inverse=True, return_counts=True)
        few = not 1 < len(devices) <= MOST_DEVICES or rows.min() < 50  # half a second at 100 Hz tells nothing
        if few or len(device) != len(table.values):
            continue
        order = np.argsort(device, kind="stable")
        same = np.diff(device[order]) == 0
        readings = [table.columns(*names) for names in sensors]
        alternate = any(_change(each[order], same) < SAME_DEVICE * _change(each) for each in readings)
        if alternate and 2 * len(devices) * rows.min() >= len(device):  # not a mark of some rows, as of faults
            raise _mixed(sheet, name, set(devices.tolist()))


def _first_rows(sheet: Sheet) -> str:
    if len(sheet.body) <= TOP:
        return sheet.body
    *_, (line, _) = sheet.rows(sheet.body[:TOP], sheet.first_line)  # of the last row, which is cut
    whole = line - sheet.first_line
    return "\n".join(sheet.body[:TOP].split("\n", whole)[:whole])


def _change(values: Array, counted: NDArray[np.bool_] | slice = slice(None)) -> float:
    """Return the rms change from row to row, over those that are counted."""
    steps = np.square(np.diff(values, axis=0)).sum(axis=1)[counted]
    return float(np.sqrt(steps[np.isfinite(steps)].mean())) if np.isfinite(steps).any() else 0.0


def _mixed(sheet: Sheet, name: str, devices: set[str]) -> RecordingError:
    what = f"the rows of {len(devices)} devices ({listed(sorted(devices)[:3])}) in the column '{name}'"
    keep = f"keep one device's, or give its sensors columns of their own (ax, gx, mx, ...) instead of '{name}'"
    return RecordingError.at(sheet.path, f"{what}; {keep}", value=len(devices))
