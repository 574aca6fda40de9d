"""Named numpy arrays in SI units: rate_hz, acc, gyr and, where they are known, mag, true_position, true_wxyz."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pbd.data import Demonstration, Recording, RecordingInfo, Truth
from pbd.doors.npz import read_arrays
from pbd.errors import RecordingError, listed
from pbd.files.demo import check_rate
from pbd.paths import as_text
from pbd.pose import Array

KEYS = ("rate_hz", "acc", "gyr", "mag", "true_position", "true_wxyz", "true_rate_hz")


def read_npz(path: Path) -> Demonstration:
    """Read a recording from an npz.

    Keys: rate_hz; acc (n, 3) m/s2; gyr (n, 3) rad/s; mag (n, 3) uT; true_position (m, 3) m; true_wxyz (m, 4);
    true_rate_hz where the truth has a rate of its own. NaN is "unknown". Truth counts from its first known position.

    Raises:
        RecordingError: not an npz, or without rate_hz and acc.
    """
    arrays, others = read_arrays(path, KEYS, RecordingError, "save it with numpy.savez")
    for key in ("rate_hz", "acc"):
        if key not in arrays:
            raise RecordingError(f"{path}: no array '{key}'; it has {listed((*arrays, *others))}", path=path, value=key)
    for key in ("rate_hz", "true_rate_hz"):
        value = np.ravel(arrays.get(key, 1.0))
        if len(value) != 1:
            raise RecordingError(f"{path}: {key} holds {len(value)} numbers; it must be one", path=path)
        check_rate(path, value[0], f"{key} is")
    rate_hz = float(arrays["rate_hz"].ravel()[0])
    if "true_wxyz" in arrays and "true_position" not in arrays:
        raise RecordingError(f"{path}: 'true_wxyz' without 'true_position'; add it, or leave both out", path=path)
    n, m = (len(np.atleast_1d(arrays.get(key, ()))) for key in ("acc", "true_position"))
    shapes = {"acc": (n, 3), "gyr": (n, 3), "mag": (n, 3), "true_position": (m, 3), "true_wxyz": (m, 4)}
    for key, shape in shapes.items():
        if key in arrays and arrays[key].shape != shape:
            raise RecordingError(f"{path}: '{key}' has shape {arrays[key].shape}, not {shape}; correct it", path=path)
    return Demonstration(
        recording=Recording(
            t=np.arange(n) / rate_hz,
            acc=arrays["acc"],
            gyr=arrays.get("gyr"),
            mag=arrays.get("mag"),
            info=RecordingInfo(name=as_text(path.stem), sensor="unknown (imported)", rate_hz=rate_hz),
        ),
        truth=_truth(arrays, rate_hz),
        notes=f"Imported from {as_text(path.name)}.",
    )


def _truth(arrays: dict[str, Array], rate_hz: float) -> Truth | None:
    if "true_position" not in arrays:
        return None
    position = arrays["true_position"]
    known = np.flatnonzero(np.isfinite(position).all(axis=1))
    if len(known) == 0:
        return None
    return Truth(
        t=np.arange(len(position)) / float(np.ravel(arrays.get("true_rate_hz", rate_hz))[0]),
        p_nav_sensor=position - position[known[0]],
        wxyz_nav_sensor=arrays.get("true_wxyz", np.full((len(position), 4), np.nan)),
    )
