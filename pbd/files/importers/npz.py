"""Named numpy arrays in SI units: rate_hz, acc, gyr and, where they are known, mag, true_position, true_wxyz."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pbd.data import Recording, RecordingInfo, Truth
from pbd.errors import RecordingError, listed
from pbd.files.importers import check_rate
from pbd.files.importers.columns import Understood
from pbd.files.importers.headerless import understood_channels
from pbd.io.npz import read_arrays
from pbd.pose import Array

KEYS = ("rate_hz", "acc", "gyr", "mag", "true_position", "true_wxyz", "true_rate_hz")


def read_npz(path: Path) -> tuple[Recording, Understood, Truth | None]:
    """Read a recording, and what was read of it, from an npz.

    Keys: rate_hz; acc (n, 3) m/s2; gyr (n, 3) rad/s; mag (n, 3) uT; true_position (m, 3) m; true_wxyz (m, 4);
    true_rate_hz where the truth has a rate of its own. NaN is "unknown". Truth counts from its first known position.

    Raises:
        RecordingError: not an npz, or without rate_hz and acc.
    """
    arrays, others = read_arrays(path, KEYS, RecordingError, "save it with numpy.savez")
    for key in ("rate_hz", "acc"):
        if key not in arrays:
            raise RecordingError(f"{path}: no array '{key}'; it has {listed((*arrays, *others))}", path=path, value=key)
    rates = {}
    for key in ("rate_hz", "true_rate_hz"):
        value = np.ravel(arrays.get(key, arrays["rate_hz"]))
        if len(value) != 1:
            raise RecordingError(f"{path}: {key} holds {len(value)} numbers; it must be one", path=path)
        rates[key] = float(value[0])
        check_rate(path, rates[key], f"{key} is")
    if "true_wxyz" in arrays and "true_position" not in arrays:
        raise RecordingError(f"{path}: 'true_wxyz' without 'true_position'; add it, or leave both out", path=path)
    n, m = (len(np.atleast_1d(arrays.get(key, ()))) for key in ("acc", "true_position"))
    shapes = {"acc": (n, 3), "gyr": (n, 3), "mag": (n, 3), "true_position": (m, 3), "true_wxyz": (m, 4)}
    for key, shape in shapes.items():
        if key in arrays and arrays[key].shape != shape:
            raise RecordingError(f"{path}: '{key}' has shape {arrays[key].shape}, not {shape}; correct it", path=path)
    recording = Recording(
        t=np.arange(n) / rates["rate_hz"],
        acc=arrays["acc"],
        gyr=arrays.get("gyr"),
        mag=arrays.get("mag"),
        info=RecordingInfo(rate_hz=rates["rate_hz"]),
    )
    unread = dict.fromkeys(others, "none of the names that are known")
    told = understood_channels(recording, {key: key for key in ("gyr", "acc", "mag")}, "its name", unread)
    return recording, told, _truth(arrays, rates["true_rate_hz"])


def _truth(arrays: dict[str, Array], rate_hz: float) -> Truth | None:
    position = arrays.get("true_position", np.zeros((0, 3)))
    known = np.flatnonzero(np.isfinite(position).all(axis=1))
    if len(known) == 0:
        return None
    wxyz = arrays.get("true_wxyz", np.full((len(position), 4), np.nan))
    return Truth(np.arange(len(position)) / rate_hz, position - position[known[0]], wxyz)
