"""Reading named numpy arrays: the wanted ones alone, and none that is larger than its file says or than is bounded."""

from __future__ import annotations

import io
import math
import warnings
import zipfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pbd.doors.opening import LARGE, read_bytes
from pbd.errors import PbdError, in_words

MOST_DIRECTORY = 1_000_000
"""Largest list of an archive's members, bytes: ten thousand arrays."""

LONGEST_HEADER = 1000
"""Longest description of an array's kind and shape, characters: numpy's own take 118."""


def read_arrays(
    path: Path, names: Sequence[str], error: type[PbdError], next_step: str
) -> tuple[dict[str, NDArray[Any]], tuple[str, ...]]:
    """Return those of the named arrays that are there and hold numbers, and the names of all others.

    Raises:
        error: no npz, or an array that holds Python objects, is larger than LARGE or than its member.
    """
    data = read_bytes(path, error, next_step)
    try:
        if _directory_size(data) > MOST_DIRECTORY:
            raise ValueError("its list of arrays is too long")
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            there = {member.filename.removesuffix(".npy"): member for member in archive.infolist()}
            if sum(there[name].file_size for name in names if name in there) > LARGE:
                raise ValueError(f"its arrays take more than the {LARGE / 1e6:.0f} MB that are read")
            read = {name: _read(archive, there.pop(name)) for name in names if name in there}
    except Exception as reason:  # damaged bytes make zip, zlib, tokenize and numpy raise errors of their own
        what = f"{path}: can't be read as an npz ({in_words(reason)}); {next_step}"
        raise error(what, path=path) from None
    return {name: array for name, array in read.items() if array is not None}, tuple(there)


def _directory_size(data: bytes) -> int:
    """Return the size of a zip's list of members, as its end record says; zipfile reads it whole, unasked."""
    at = data.rfind(b"PK\x05\x06")
    return int.from_bytes(data[at + 12 : at + 16], "little") if at >= 0 else 0


def _read(archive: zipfile.ZipFile, member: zipfile.ZipInfo) -> NDArray[Any] | None:
    if member.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
        raise ValueError(f"{member.filename} is packed in a way that numpy doesn't use")
    with archive.open(member) as file:
        shape, fortran, dtype = _header(file)
        if dtype.hasobject:
            raise ValueError(f"{member.filename} holds Python objects, which are not loaded")
        if dtype.kind not in "fiub":
            return None
        size = math.prod(shape) * dtype.itemsize
        if not 0 <= size <= member.file_size:
            raise ValueError(f"{member.filename} is shorter than its shape {shape} says")
        data = file.read(size)
    if len(data) < size:
        raise ValueError(f"{member.filename} is shorter than its shape {shape} says")
    array = np.frombuffer(data, dtype).reshape(shape[::-1] if fortran else shape)
    return array.T if fortran else array


def _header(file: Any) -> tuple[tuple[int, ...], bool, np.dtype[Any]]:
    """Read an array's shape, whether it is in Fortran's order, and its kind."""
    version = np.lib.format.read_magic(file)
    read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # numpy mends what Python 2 wrote, and says so
        shape, fortran, dtype = read(file, max_header_size=LONGEST_HEADER)
    return shape, fortran, dtype
