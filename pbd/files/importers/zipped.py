"""The tables in a zip, each read when it is asked for and only up to a bound."""

from __future__ import annotations

import io
import zipfile
import zlib
from collections.abc import Callable
from functools import partial
from pathlib import Path, PurePosixPath

from pbd.errors import RecordingError, in_words
from pbd.io.read_file import LARGE, read_bytes

LARGEST_FILE = LARGE // 4
"""Largest file in a zip, bytes: an hour at 400 Hz has 120 MB. So a small zip can't fill the memory."""

MOST_FILES = 1000
"""Most files of a recording that are looked at: Sensor Logger keeps pictures, too."""

PHYPHOX_MOMENTS = "meta/time"
"""phyphox' table of starts and pauses. What else is in its folder `meta` is about the phone."""

Files = dict[str, Callable[[], bytes]]


def zipped_tables(path: Path) -> Files:
    """The tables of a zip by name, whatever folder they are in; RecordingError: no zip, or several recordings."""
    data = read_bytes(path, RecordingError, "export it again")
    try:
        archive = zipfile.ZipFile(io.BytesIO(data))
    except (zipfile.BadZipFile, OSError, ValueError) as reason:
        what = f"{path}: the zip is damaged or cut off ({in_words(reason)}); copy or export it again"
        raise RecordingError(what, path=path) from None
    files: Files = {}
    for member in archive.infolist()[:MOST_FILES]:
        place = PurePosixPath(member.filename)
        if place.suffix.lower() != ".csv" or "__MACOSX" in place.parts:
            continue
        name = PHYPHOX_MOMENTS if place.parts[-2:] == ("meta", "time.csv") else place.stem
        if place.parts[-2:-1] == ("meta",) and name != PHYPHOX_MOMENTS:
            continue
        if name in files:
            raise RecordingError.at(path, f"it holds several recordings ({name}.csv twice); export one")
        files[name] = partial(_member, path, archive, member)
    return files


def _member(path: Path, archive: zipfile.ZipFile, member: zipfile.ZipInfo) -> bytes:
    if member.file_size > LARGEST_FILE:
        most = f"{LARGEST_FILE / 1e6:.0f} MB"
        what = f"'{member.filename}' in it has {member.file_size / 1e6:.3g} MB, more than the {most} that are read"
        raise RecordingError.at(path, f"{what}; export a shorter recording", value=member.file_size)
    try:
        return archive.read(member)
    except (zipfile.BadZipFile, zlib.error, OSError, EOFError, RuntimeError, NotImplementedError, ValueError) as reason:
        what = f"'{member.filename}' in the zip can't be read ({in_words(reason)}); export it again"
        raise RecordingError.at(path, what) from None
