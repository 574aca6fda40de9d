"""The files of a recording that an app writes: CSV files in a zip or a folder, one for each sensor."""

import io
import zipfile
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path, PurePosixPath

from pbd.errors import RecordingError, in_words
from pbd.files.importers.header_names import looks_inertial
from pbd.files.table import Sheet, foreign_text, open_sheet
from pbd.io.read_file import read_bytes, refuse_bomb

PHYPHOX_CLOCK = "meta/time"
"""phyphox' table of starts and pauses. The other files in its folder `meta` describe the phone."""

Files = dict[str, Callable[[], bytes]]
"""Name of a CSV file, without suffix -> a function that reads it."""


def files_of(path: Path) -> Files:
    """List the CSV files of a zip or a folder, or those beside a CSV file."""
    if path.suffix.lower() == ".zip":
        return _files_in_zip(path)
    folder = path if path.is_dir() else path.parent
    names = sorted(each for each in (*folder.glob("*.csv"), folder / f"{PHYPHOX_CLOCK}.csv") if each.is_file())
    return {
        str(file.relative_to(folder).with_suffix("")): partial(read_bytes, file, RecordingError, "give another")
        for file in names
    }


def _files_in_zip(path: Path) -> Files:
    """List the CSV files of a zip, in any folder; RecordingError: it is not a zip, or has several recordings."""
    data = read_bytes(path, RecordingError, "export it again")
    try:
        archive = zipfile.ZipFile(io.BytesIO(data))
    except (zipfile.BadZipFile, OSError, ValueError) as reason:
        what = f"the zip is damaged or cut off ({in_words(reason)}); copy or export it again"
        raise RecordingError.at(path, what) from None
    files: Files = {}
    for member in archive.infolist():
        place = PurePosixPath(member.filename)
        if place.name == "demo.toml":
            raise RecordingError.at(path, "it is a demonstration already; unzip it into ./demos, and use it as it is")
        if place.suffix.lower() != ".csv" or "__MACOSX" in place.parts:
            continue
        name = PHYPHOX_CLOCK if place.parts[-2:] == ("meta", "time.csv") else place.stem
        if place.parts[-2:-1] == ("meta",) and name != PHYPHOX_CLOCK:
            continue
        if name in files:
            raise RecordingError.at(path, f"it holds several recordings ({name}.csv twice); export one")
        files[name] = partial(_member, path, archive, member)
    return files


def _member(path: Path, archive: zipfile.ZipFile, member: zipfile.ZipInfo) -> bytes:
    refuse_bomb(path, f"'{member.filename}' in it", member.compress_size, member.file_size)
    try:
        return archive.read(member)
    except (zipfile.BadZipFile, zlib.error, OSError, EOFError, RuntimeError, NotImplementedError, ValueError) as reason:
        what = f"'{member.filename}' in the zip can't be read ({in_words(reason)}); export it again"
        raise RecordingError.at(path, what) from None


def sheet_of(path: Path, name: str, read: Callable[[], bytes]) -> Sheet:
    """Read the header of a CSV file, `name` without suffix, of the recording at `path`."""
    folder = path.parent if path.suffix.lower() == ".csv" else path
    file = folder / f"{name}.csv"
    with may_be_removed(name):
        return open_sheet(file, foreign=True, text=foreign_text(file, read()))


@contextmanager
def may_be_removed(name: str) -> Iterator[None]:
    """Read the file `name`, without suffix, of one sensor. If it is broken, and not needed, say that it may be removed.

    Tracking needs an accelerometer, and does without a gyro or a magnetometer.
    """
    try:
        yield
    except RecordingError as error:
        if sensor := {"g": "gyro", "m": "magnetometer"}.get(looks_inertial(f"{name} x")):
            what = f"{error.message}; or remove {name}.csv, to import the recording without its {sensor}"
            raise RecordingError(what, **error.fields) from None
        raise
