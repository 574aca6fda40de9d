"""Reading named numpy arrays: only the wanted ones, no Python objects, within a bound."""

from __future__ import annotations

import io
import warnings
import zipfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pbd.errors import PbdError, in_words
from pbd.io.opening import LARGE, read_bytes


def read_arrays(
    path: Path, names: Sequence[str], error: type[PbdError], next_step: str
) -> tuple[dict[str, NDArray[Any]], tuple[str, ...]]:
    """Return those of the named arrays that are there and hold numbers, and the names of all others.

    The `error`: no npz, or an array that holds Python objects, is larger than LARGE or than its member.
    """
    data = read_bytes(path, error, next_step)
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            sizes = {member.filename.removesuffix(".npy"): member.file_size for member in archive.infolist()}
        there = [name for name in names if name in sizes]
        if sum(sizes[name] for name in there) > LARGE:
            raise ValueError(f"its arrays take more than the {LARGE / 1e6:.0f} MB that are read")
        with warnings.catch_warnings(), np.load(io.BytesIO(data), allow_pickle=False) as arrays:
            warnings.simplefilter("ignore")  # numpy warns when it repairs files of Python 2
            read = {name: arrays[name] for name in there}
    except Exception as reason:  # damaged bytes make zip, zlib, tokenize and numpy raise errors of their own
        what = f"{path}: can't be read as an npz ({in_words(reason)}); {next_step}"
        raise error(what, path=path) from None
    numbers = {name: array for name, array in read.items() if array.dtype.kind in "fiub"}
    return numbers, tuple(name for name in sizes if name not in there)
