"""Recordings of other programs, one format a file."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from pbd.data import Demonstration
from pbd.errors import RecordingError


def import_file(
    path: Path,
    columns: Mapping[str, str] | None = None,
    units: Mapping[str, str] | None = None,
    rate_hz: float | None = None,
) -> Demonstration:
    """Read a recording in any format known here, told by its suffix and its header.

    Args:
        path: .csv, .txt or .tsv with a header, or .npz.
        columns: of a CSV: ours (t, gx ... mz, heading, pitch, roll) -> the file's name, where the header doesn't tell.
        units: of a CSV: of t, gyr, acc, mag or angle, where the header doesn't tell.
        rate_hz: of a CSV without times.

    Raises:
        RecordingError: not such a file, or its contents can't be a recording.
    """
    suffix = path.suffix.lower()
    if suffix == ".npz":
        if columns or units:
            raise RecordingError(f"{path}: an npz has named arrays in SI units; leave --column and --unit out")
        if rate_hz is not None:
            raise RecordingError(f"{path}: an npz has its own rate_hz; leave --rate out", path=path)
        from pbd.files.importers.npz import read_npz

        return read_npz(path)
    if suffix in (".csv", ".txt", ".tsv"):
        from pbd.files.importers.csv import read_csv

        return read_csv(path, columns or {}, units or {}, rate_hz)
    raise RecordingError(f"{path}: can't import '{suffix}' files; give a .csv, .tsv, .txt or .npz", path=path)
