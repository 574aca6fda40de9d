"""Recordings of other programs, one format a file."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from pbd.data import Demonstration
from pbd.errors import RecordingError
from pbd.files.demo import RATES_HZ

if TYPE_CHECKING:
    from pbd.files.importers.columns import Understood

TEXT = (".csv", ".txt", ".tsv", ".log")
XIO_FILE = "Inertial.csv"
"""What an x-IMU3's folder is known by (x-io Technologies, x-IMU3 GUI: a file for each kind of message)."""


@dataclass(frozen=True)
class Imported:
    """A recording of another program, and what was made of its columns; None where they have no names."""

    demo: Demonstration
    understood: Understood | None = None


def import_file(
    path: Path,
    columns: Mapping[str, str] | None = None,
    units: Mapping[str, str] | None = None,
    rate_hz: float | None = None,
) -> Demonstration:
    """Read a recording in any known format; see `import_recording`."""
    return import_recording(path, columns, units, rate_hz).demo


def import_recording(
    path: Path,
    columns: Mapping[str, str] | None = None,
    units: Mapping[str, str] | None = None,
    rate_hz: float | None = None,
    topic: str | None = None,
) -> Imported:
    """Read a recording in any known format. Its suffix and header tell which.

    Args:
        path: .csv, .txt, .tsv or .log with a header or with names beside the numbers; .npz; .mcap, .db3 or a rosbag2's
            folder; an x-IMU3's folder; a zip or folder of Sensor Logger's or phyphox', or a CSV in it.
        columns: of a table: ours (t, gx ... mz, heading, pitch, roll) -> the file's, where the header doesn't tell.
        units: of a table: of t, gyr, acc, mag or angle, where the header doesn't tell.
        rate_hz: of a table without times.
        topic: of a bag with several.

    Raises:
        RecordingError: not such a file, or its contents can't be a recording.
    """
    source = path / XIO_FILE if (path / XIO_FILE).is_file() else path
    suffix, truth, understood = source.suffix.lower(), None, None
    is_bag = suffix in (".mcap", ".db3") or (source / "metadata.yaml").is_file()
    may_be_phone = not is_bag and (source.is_dir() or suffix in (".csv", ".zip")) and not columns and not units
    if topic is not None and not is_bag:
        raise RecordingError(f"{path}: only a bag has topics; leave --topic out", path=path)
    if suffix == ".npz" or is_bag:
        kind, what = ("a bag", "messages") if is_bag else ("an npz", "named arrays")
        if columns or units:
            raise RecordingError(f"{path}: {kind} has {what} in SI units; leave --column and --unit out")
        if rate_hz is not None:
            its = "times of its own" if is_bag else "its own rate_hz"
            raise RecordingError(f"{path}: {kind} has {its}; leave --rate out", path=path)
    phone = None
    if may_be_phone:
        from pbd.files.importers.phones import read_phone

        phone = read_phone(source)
    if phone is not None:
        recording, understood = phone
    elif is_bag:
        from pbd.files.importers.bag import read_bag

        recording = read_bag(source, topic)
    elif suffix == ".npz":
        from pbd.files.importers.npz import read_npz

        recording, truth = read_npz(source)
    elif suffix in TEXT:
        from pbd.files.importers.csv import read_csv

        recording, understood = read_csv(source, columns or {}, units or {}, rate_hz)
    else:
        known = ".csv, .tsv, .txt, .npz, .mcap or .db3"
        kind = f"'{suffix}' files"
        if path.is_dir():
            kind = "this folder: it is no bag, no x-IMU3's and no phone's"
        elif suffix == ".zip":
            kind = "this zip: no recording of Sensor Logger or phyphox is in it"
        raise RecordingError(f"{path}: can't import {kind}; give a {known}", path=path)
    info = replace(recording.info, name=_as_text(path.stem), sensor=f"{'phone' if phone else 'unknown'} (imported)")
    demo = Demonstration(replace(recording, info=info), truth, notes=f"Imported from {_as_text(path.name)}.")
    return Imported(demo, understood)


def check_rate(path: Path, rate_hz: float, what: str) -> None:
    """Refuse a rate that no sensor has; `what` begins the message.

    Raises:
        RecordingError: it lies beyond RATES_HZ.
    """
    slowest, fastest = RATES_HZ
    if not slowest <= rate_hz <= fastest:
        bound = "above zero" if not rate_hz > 0.0 else f"{slowest:g} to {fastest:g} Hz"
        raise RecordingError(f"{path}: {what} {rate_hz:g}; it must be {bound}", path=path, value=rate_hz)


def _as_text(name: str) -> str:
    """A file's name as text: the bytes of it that are not UTF-8 are written out."""
    return os.fsencode(name).decode("utf-8", "backslashreplace")
