"""Import of recordings of other programs.

`READERS` has a function for each format, in a file that is named after it. What a column of a table means, and its
unit, is found by columns.py, from names (header_names.py), programs' habits and the caller's options.
"""

from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

from pbd.data import Demonstration
from pbd.errors import RecordingError, warn
from pbd.files.demo import read_demo_toml, utf8_name
from pbd.files.importers.bag import read_bag
from pbd.files.importers.csv import read_csv
from pbd.files.importers.npz import read_npz
from pbd.files.importers.request import Request
from pbd.files.importers.sensor_files import read_sensor_files
from pbd.files.importers.ximu3 import inertial_file

READERS: tuple[Callable[[Request], Demonstration | None], ...] = (
    read_bag,
    read_sensor_files,
    read_npz,
    read_csv,
)
"""Each returns None if the path is none of its format. The first that returns a recording has read it."""

LFS_POINTER = b"version https://git-lfs.github.com/"
"""The beginning of the small file that Git LFS keeps in place of a large one."""


def import_file(
    path: Path,
    columns: Mapping[str, str] | None = None,
    units: Mapping[str, str] | None = None,
    rate_hz: float | None = None,
    topic: str | None = None,
) -> Demonstration:
    """Read a recording in any known format, which is recognised by its suffix and header.

    `recording.info.source` tells how its columns were read.

    Args:
        path: .csv, .txt, .tsv, .log or .lvm with a header, or names beside the numbers; .npz; .mcap, .db3, .bag or a
            rosbag2 folder; an x-IMU3's folder; a zip or folder with a CSV file for each sensor, as Sensor Logger,
            phyphox and MetaBase write it, or one of these files.
        columns: our name (t, gx ... mz, heading, pitch, roll) -> the file's column, if the header doesn't tell.
        units: t, gyr, acc, mag or angle -> its unit, if the header doesn't tell.
        rate_hz: the rate of a table without times.
        topic: the topic of a bag with several.

    Raises:
        RecordingError: the format is not known, or the file can't be read as a recording.
    """
    if (path / "demo.toml").is_file():
        raise RecordingError.at(path, "it is a demonstration already; use it as it is, or copy the folder")
    request = Request(inertial_file(path), columns or {}, units or {}, rate_hz, topic)
    if _is_lfs_pointer(request.path):
        what = "it is Git LFS's pointer to the file, not the file; fetch that with `git lfs pull`"
        raise RecordingError.at(request.path, what)
    demo = next(filter(None, (read(request) for read in READERS)), None)
    if demo is None:
        raise _not_known(path)
    info = replace(demo.recording.info, name=utf8_name(path.stem))
    notes = f"Imported from {utf8_name(path.name)}."
    demo = replace(demo, recording=replace(demo.recording, info=info), notes=notes)
    if path.name == "imu.csv" and (path.parent / "demo.toml").is_file():
        same_times = rate_hz is None and "t" not in request.columns and "t" not in request.units
        return _as_before(demo, path.parent, same_times)
    return demo


def _not_known(path: Path) -> RecordingError:
    suffix = path.suffix.lower()
    kind = f"'{suffix}' files"
    if path.is_dir():
        kind = "this folder: it is no bag, no x-IMU3's, no phone's, and accelerometer.csv is not in it"
    elif suffix == ".zip":
        kind = "this zip: no recording of Sensor Logger or phyphox is in it, and no accelerometer.csv"
    elif suffix == ".json":
        kind = "'.json' files; keyframes are edited in keyframes.toml, which `pbd keyframes DEMO --save` writes"
    return RecordingError.at(path, f"can't import {kind}; give a .csv, .tsv, .txt, .npz, .mcap, .db3 or .bag")


def _is_lfs_pointer(path: Path) -> bool:
    if path.is_file():  # else it may be a pipe, which waits for its writer
        with suppress(OSError), path.open("rb") as file:  # if it can't be read, its reader says so
            return file.read(len(LFS_POINTER)) == LFS_POINTER
    return False


def _as_before(demo: Demonstration, folder: Path, same_times: bool) -> Demonstration:
    """Return a demonstration whose recording was imported anew, with what the folder's demo.toml knows of it."""
    earlier, grip, known = read_demo_toml(folder)
    info = replace(demo.recording.info, sensor=earlier.sensor, clock=earlier.clock)
    recording = replace(demo.recording, info=info)
    demo = replace(demo, recording=recording, closed=known["closed"], grasped=known["grasped"])
    if not same_times:
        warn("its times may differ from demo.toml's, whose [[grip]], [[place]] and [[contact]] are left out")
        return demo
    recording = replace(recording, grip=grip)
    return replace(demo, recording=recording, places=known["places"], contacts=known["contacts"])
