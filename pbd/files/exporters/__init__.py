"""Joint trajectories for other tools, one format a file."""

from __future__ import annotations

import os
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING

from pbd.errors import PbdError

if TYPE_CHECKING:
    from pbd.data import JointTrajectory, Samples

_FILES = {"csv": "csv", "npz": "npz", "ros2-json": "ros2_json"}
FORMATS = tuple(_FILES)
"""Each has a file here with `write(joint_names, samples, path)`."""


def export(trajectory: JointTrajectory, format_name: str, path: Path, rate_hz: float = 1000.0) -> Samples:
    """Write a trajectory, sampled at `rate_hz`; the file appears whole or not at all.

    Returns:
        What was written.

    Raises:
        PbdError: the format is not known, the rate is out of range, the file can't be written.
    """
    if format_name not in FORMATS:
        raise PbdError(f"no format '{format_name}'; known are {', '.join(FORMATS)}", value=format_name)
    if not 0.0 < rate_hz <= 1e5:
        raise PbdError(f"the rate must be above 0 and at most 100000 Hz, got {rate_hz:g}; mend it", value=rate_hz)
    if not path.name or path.is_dir():
        raise PbdError(f"{path} can't be written (it is a folder); give another place with -o", path=path)
    samples = trajectory.sample(rate_hz)
    unfinished = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        import_module(f"{__name__}.{_FILES[format_name]}").write(trajectory.joint_names, samples, unfinished)
        unfinished.replace(path)
    except OSError as reason:
        raise PbdError(f"{path} can't be written ({reason.strerror}); give another place with -o", path=path) from None
    finally:
        with suppress(OSError):
            unfinished.unlink()
    return samples
