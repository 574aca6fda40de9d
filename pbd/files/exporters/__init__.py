"""Joint trajectories for other tools, one format a file."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING

from pbd.errors import PbdError, nearest
from pbd.files.whole import written_whole

if TYPE_CHECKING:
    from pbd.data import JointTrajectory, Samples

_FILES = {"csv": "csv", "npz": "npz", "ros2-json": "ros2_json"}
FORMATS = tuple(_FILES)
"""Each has a file here with `write(joint_names, samples, path)`."""

SUFFIXES = {".csv": "csv", ".npz": "npz", ".json": "ros2-json"}
"""What a file's name ends in, and the format that it says."""

LOWEST_HZ, HIGHEST_HZ = 10.0, 1e5


def export(trajectory: JointTrajectory, format_name: str, path: Path, rate_hz: float = 1000.0) -> Samples:
    """Write a trajectory, sampled at `rate_hz`; the file appears whole or not at all.

    Returns:
        What was written.

    Raises:
        PbdError: the format is not known, the rate is out of range, the file can't be written.
    """
    if format_name not in FORMATS:
        raise PbdError(
            f"no format '{format_name}'; known are {', '.join(FORMATS)}{nearest(format_name, FORMATS)}",
            value=format_name,
        )
    if not LOWEST_HZ <= rate_hz <= HIGHEST_HZ:
        raise PbdError(
            f"--rate must be {LOWEST_HZ:g} to {HIGHEST_HZ:g} Hz, got {rate_hz:g}",
            value=rate_hz,
        )
    samples = trajectory.sample(rate_hz)
    with written_whole(path) as unfinished:
        import_module(f"{__name__}.{_FILES[format_name]}").write(trajectory.joint_names, samples, unfinished)
    return samples
