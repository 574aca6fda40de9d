"""Recordings of other programs, one format a file."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from pbd.data import Demonstration
from pbd.errors import RecordingError
from pbd.files.demo import RATES_HZ

TEXT = (".csv", ".txt", ".tsv")


def import_file(
    path: Path,
    columns: Mapping[str, str] | None = None,
    units: Mapping[str, str] | None = None,
    rate_hz: float | None = None,
) -> Demonstration:
    """Read a recording in any known format. Its suffix and header tell which.

    Args:
        path: .csv, .txt or .tsv with a header, or .npz; a zip or folder of Sensor Logger's or phyphox', or a CSV in it.
        columns: of a CSV: ours (t, gx ... mz, heading, pitch, roll) -> the file's name, where the header doesn't tell.
        units: of a CSV: of t, gyr, acc, mag or angle, where the header doesn't tell.
        rate_hz: of a CSV without times.

    Raises:
        RecordingError: not such a file, or its contents can't be a recording.
    """
    from pbd.files.importers.phones import read_phone

    suffix, truth = path.suffix.lower(), None
    of_phone = (path.is_dir() or suffix in (".csv", ".zip")) and not columns and not units
    phone = read_phone(path) if of_phone else None
    if phone is not None:
        recording = phone
    elif suffix == ".npz":
        if columns or units:
            raise RecordingError(f"{path}: an npz has named arrays in SI units; leave --column and --unit out")
        if rate_hz is not None:
            raise RecordingError(f"{path}: an npz has its own rate_hz; leave --rate out", path=path)
        from pbd.files.importers.npz import read_npz

        recording, truth = read_npz(path)
    elif suffix in TEXT:
        from pbd.files.importers.csv import read_csv

        recording = read_csv(path, columns or {}, units or {}, rate_hz)
    else:
        kind = f"'{suffix}' files"
        if path.is_dir() or suffix == ".zip":
            kind = f"this {'folder' if path.is_dir() else 'zip'}: no recording of Sensor Logger or phyphox is in it"
        raise RecordingError(f"{path}: can't import {kind}; give a .csv, .tsv, .txt or .npz", path=path)
    info = replace(recording.info, name=_as_text(path.stem), sensor="unknown (imported)")
    return Demonstration(replace(recording, info=info), truth, notes=f"Imported from {_as_text(path.name)}.")


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
