"""Import of recordings of other programs. Each format has a file here."""

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

from pbd.data import Demonstration
from pbd.errors import RecordingError, warn
from pbd.files.demo import RATES_HZ, read_demo_toml, utf8_name

TEXT = (".csv", ".txt", ".tsv", ".log")
BAGS = (".mcap", ".db3", ".bag")
LFS_POINTER = b"version https://git-lfs.github.com/"
"""The beginning of the small file that Git LFS keeps in place of a large one."""

XIO_FILE = "Inertial.csv"
"""The file by which an x-IMU3's folder is recognised. x-io's x-IMU3 GUI writes a file for each type of message."""


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
        path: .csv, .txt, .tsv or .log with a header, or with names beside the numbers; .npz; .mcap, .db3, .bag or a
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
    source = path / XIO_FILE if (path / XIO_FILE).is_file() else path
    suffix, truth = source.suffix.lower(), None
    if _is_lfs_pointer(source):
        what = "it is Git LFS's pointer to the file, not the file; fetch that with `git lfs pull`"
        raise RecordingError.at(source, what)
    is_bag = suffix in BAGS or (source / "metadata.yaml").is_file()
    columns, units = columns or {}, units or {}
    same_times = rate_hz is None and "t" not in columns and "t" not in units
    # With --column or --unit, a phone's CSV file is read as an ordinary table.
    is_table = suffix == ".csv" and not any(".csv: " in name for name in columns.values())
    if topic is not None and not is_bag:
        raise RecordingError.at(path, "only a bag has topics; leave --topic out")
    of_app = None
    may_be_apps = source.is_dir() or suffix == ".zip" or (suffix == ".csv" and source.is_file())
    if may_be_apps and not is_bag and not (is_table and columns):
        from pbd.files.importers.one_file_per_sensor import read_sensor_files
        from pbd.files.importers.phones import phone_files, read_phone

        of_app = None if is_table and units else read_phone(source)
        if of_app is None and not (is_table and phone_files(source)):
            of_app = read_sensor_files(source, units)
            units = units if of_app is None else {}
    if rate_hz is not None and (of_app is not None or is_bag or suffix == ".npz"):
        known = "a bag has times" if is_bag else "an npz has a rate" if suffix == ".npz" else "an app's file has times"
        raise RecordingError.at(path, f"{known} of its own; leave --rate out")
    if of_app is not None:
        recording = of_app
    elif is_bag:
        from pbd.files.importers.bag import read_bag

        recording = read_bag(source, topic)
    elif suffix == ".npz":
        from pbd.files.importers.npz import read_npz

        recording, truth = read_npz(source)
    elif suffix in TEXT:
        from pbd.files.importers.csv import read_csv

        beside = {ours: name for ours, name in columns.items() if ".csv: " in name}
        in_table = {ours: name for ours, name in columns.items() if ours not in beside}
        recording = read_csv(source, in_table, units, rate_hz)
        columns, units = beside, {}
    else:
        kind = f"'{suffix}' files"
        if path.is_dir():
            kind = "this folder: it is no bag, no x-IMU3's, no phone's, and accelerometer.csv is not in it"
        elif suffix == ".zip":
            kind = "this zip: no recording of Sensor Logger or phyphox is in it, and no accelerometer.csv"
        elif suffix == ".json":
            kind = "'.json' files; keyframes are edited in keyframes.toml, which `pbd keyframes DEMO --save` writes"
        raise RecordingError.at(path, f"can't import {kind}; give a .csv, .tsv, .txt, .npz, .mcap, .db3 or .bag")
    if columns or units:
        from pbd.files.importers.columns import remapped

        recording = remapped(path, recording, columns, units)
    info = replace(recording.info, name=utf8_name(path.stem), sensor=f"{recording.info.sensor} (imported)")
    demo = Demonstration(replace(recording, info=info), truth, notes=f"Imported from {utf8_name(path.name)}.")
    if path.name == "imu.csv" and (path.parent / "demo.toml").is_file():
        return _as_before(demo, path.parent, same_times)
    return demo


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


def check_rate(path: Path, rate_hz: float, what: str) -> None:
    """Refuse (RecordingError) a rate that no sensor has; `what` is the beginning of the message."""
    slowest, fastest = RATES_HZ
    if not slowest <= rate_hz <= fastest:
        bound = "above zero" if not rate_hz > 0.0 else f"{slowest:g} to {fastest:g} Hz"
        raise RecordingError.at(path, f"{what} {rate_hz:g}; it must be {bound}", value=rate_hz)
