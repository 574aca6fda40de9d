"""npz: named numpy arrays in SI units."""

import io
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pbd.data import Demonstration, Recording, RecordingInfo, Truth
from pbd.errors import RecordingError, in_words, listed, no_library_warnings, printable
from pbd.files.importers.columns import remapped, with_source
from pbd.files.importers.header_names import looks_inertial
from pbd.files.importers.request import Request, check_rate
from pbd.io.read_file import read_bytes, refuse_bomb
from pbd.pose import Array

KEYS = ("rate_hz", "acc", "gyr", "mag", "true_position", "true_wxyz", "true_rate_hz")

NEXT_STEP = "save it with numpy.savez"


def read_npz(request: Request) -> Demonstration | None:
    """Read a recording and, if known, its truth, whose first known position becomes the origin; None: it is no npz.

    The arrays are rate_hz; acc (n, 3) m/s2; gyr (n, 3) rad/s; mag (n, 3) uT; true_position (m, 3) m; true_wxyz (m, 4);
    true_rate_hz if the truth has another rate. Only rate_hz and acc are required. NaN means unknown.

    Raises:
        RecordingError: the file is not an npz, or an array is missing or has a wrong shape.
    """
    path = request.path
    if request.suffix != ".npz":
        return None
    request.refuse_rate("an npz has a rate")
    arrays, others = _arrays(path)
    for key in ("rate_hz", "acc"):
        if key not in arrays:
            raise RecordingError.at(path, f"no array '{key}'; it has {listed((*arrays, *others))}", value=key)
    rates = {}
    for key in ("rate_hz", "true_rate_hz"):
        value = np.ravel(arrays.get(key, arrays["rate_hz"]))
        if len(value) != 1:
            raise RecordingError.at(path, f"{key} holds {len(value)} numbers; it must be one")
        rates[key] = float(value[0])
        check_rate(path, rates[key], f"{key} is")
    if "true_wxyz" in arrays and "true_position" not in arrays:
        raise RecordingError.at(path, "'true_wxyz' without 'true_position'; add it, or leave both out")
    for name in others:
        if (letter := looks_inertial(name)) and (key := {"g": "gyr", "a": "acc", "m": "mag"}[letter]) not in arrays:
            what = f"the array '{printable(name)}' looks like inertial data, but is not read"
            what += f"; name it '{key}', or remove it"
            raise RecordingError.at(path, what, value=name)
    n, m = (len(np.atleast_1d(arrays.get(key, ()))) for key in ("acc", "true_position"))
    shapes = {"acc": (n, 3), "gyr": (n, 3), "mag": (n, 3), "true_position": (m, 3), "true_wxyz": (m, 4)}
    for key, shape in shapes.items():
        if key in arrays and arrays[key].shape != shape:
            raise RecordingError.at(path, f"'{key}' has shape {arrays[key].shape}, not {shape}; correct it")
    recording = Recording(
        t=np.arange(n) / rates["rate_hz"],
        acc=arrays["acc"],
        gyr=arrays.get("gyr"),
        mag=arrays.get("mag"),
        info=RecordingInfo(rate_hz=rates["rate_hz"]),
    )
    unread = dict.fromkeys(others, "none of the names that are known")
    recording = with_source(recording, {key: key for key in ("gyr", "acc", "mag")}, "its name", unread)
    recording = remapped(path, recording, request.columns, request.units)
    return Demonstration(recording, _truth(arrays, rates["true_rate_hz"]))


def _arrays(path: Path) -> tuple[dict[str, NDArray[Any]], tuple[str, ...]]:
    """Return the arrays of numbers under KEYS, and the names of all other arrays."""
    data = read_bytes(path, RecordingError, NEXT_STEP)
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            members = {member.filename.removesuffix(".npy"): member for member in archive.infolist()}
        known = [name for name in KEYS if name in members]
        packed, unpacked = (
            sum(getattr(members[name], size) for name in known) for size in ("compress_size", "file_size")
        )
        refuse_bomb(path, "its content", packed, unpacked)
        # numpy warns of files written by Python 2
        with no_library_warnings(), np.load(io.BytesIO(data), allow_pickle=False) as arrays:
            read = {name: np.asarray(arrays[name]) for name in known}  # of a file that is no npy its bytes
    except RecordingError:
        raise
    except Exception as reason:  # damaged bytes cause errors of zip, zlib, tokenize and numpy
        raise RecordingError.at(path, f"can't be read as an npz ({in_words(reason)}); {NEXT_STEP}") from None
    numbers = {name: array for name, array in read.items() if array.dtype.kind in "fiub"}
    return numbers, tuple(name for name in members if name not in known)


def _truth(arrays: dict[str, Array], rate_hz: float) -> Truth | None:
    position = arrays.get("true_position", np.zeros((0, 3)))
    known = np.flatnonzero(np.isfinite(position).all(axis=1))
    if len(known) == 0:
        return None
    wxyz = arrays.get("true_wxyz", np.full((len(position), 4), np.nan))
    return Truth(np.arange(len(position)) / rate_hz, position - position[known[0]], wxyz)
