"""Joint trajectories for other tools, one format a file."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

from pbd.data import JointTrajectory, Samples
from pbd.errors import PbdError
from pbd.files.exporters.csv import write_csv
from pbd.files.exporters.npz import write_npz
from pbd.files.exporters.ros2 import write_ros2_json

FORMATS: dict[str, Callable[[tuple[str, ...], Samples, Path], None]] = {
    "csv": write_csv,
    "npz": write_npz,
    "ros2-json": write_ros2_json,
}


def export(trajectory: JointTrajectory, format_name: str, path: Path, rate_hz: float = 1000.0) -> Samples:
    """Write a trajectory, sampled at `rate_hz`; the file appears whole or not at all.

    Returns:
        What was written.

    Raises:
        PbdError: the format is not known, the rate is not above zero, the file can't be written.
    """
    if format_name not in FORMATS:
        raise PbdError(f"no format '{format_name}'; known are {', '.join(FORMATS)}", value=format_name)
    if not 0.0 < rate_hz <= 1e5:
        raise PbdError(
            f"the rate must be above 0 and at most 100000 Hz, got {rate_hz:g}; give such a one", value=rate_hz
        )
    samples = trajectory.sample(rate_hz)
    unfinished = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        FORMATS[format_name](trajectory.joint_names, samples, unfinished)
        unfinished.replace(path)
    except OSError as reason:
        raise PbdError(f"{path} can't be written ({reason.strerror}); give another place with -o", path=path) from None
    finally:
        unfinished.unlink(missing_ok=True)
    return samples
