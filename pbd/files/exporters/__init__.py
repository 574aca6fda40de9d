"""Joint trajectories for other tools, one format a file."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING

from pbd.doors.atomic import atomic_file
from pbd.errors import PbdError, PbdWarning, PlanError, nearest

if TYPE_CHECKING:
    from collections.abc import Mapping

    from pbd.data import JointTrajectory, Robot, Samples
    from pbd.data.receiver import Rule, Share

FORMATS = {"csv": "csv", "npz": "npz", "ros2-json": "ros2_json"}
"""Format -> its file here, with `write(trajectory, robot, samples, path)` and `FILLED_BY`, the rules by which receivers
fill the gaps between samples."""

SUFFIXES = {".csv": "csv", ".npz": "npz", ".json": "ros2-json"}
"""What a file's name ends in, and the format that it says."""

LOWEST_HZ, HIGHEST_HZ = 10.0, 1e5
USUAL_HZ = 1000.0

ROUNDING = 5e-4
"""Share by which a receiver may exceed a limit between points, from rounding to whole nanoseconds."""

CUBIC_EXCESS = 0.1
"""Share above a limit that cubics between samples may reach without a warning, in a format that isn't made for them.
At 1 kHz a panda's acceleration is exceeded by 0.07, which docs/exports.md says."""


@dataclass(frozen=True, eq=False)
class Export:
    """What was written.

    Attributes:
        samples: the arm's points.
        receiver: by each rule of the format's receivers, the largest shares of velocity, acceleration and jerk limits.
    """

    samples: Samples
    receiver: Mapping[Rule, tuple[Share, Share, Share]]


def export(
    trajectory: JointTrajectory, robot: Robot, format_name: str, path: Path, rate_hz: float | None = None
) -> Export:
    """Write a robot's trajectory; the file appears whole or not at all.

    Args:
        trajectory: the motion.
        robot: whose limits hold between the samples too, and whose gripper it is.
        format_name: one of FORMATS.
        path: where.
        rate_hz: samples a second; by default 1000, for ros2-json none but the trajectory's own knots.

    Raises:
        PbdError: the format is not known, the rate is out of range, the file can't be written.
        PlanError: by the rule of the format's receivers a limit would be broken between samples.
    """
    if format_name not in FORMATS:
        known = f"{', '.join(FORMATS)}{nearest(format_name, FORMATS)}"
        raise PbdError(f"no format '{format_name}'; known are {known}", value=format_name)
    if rate_hz is not None and not LOWEST_HZ <= rate_hz <= HIGHEST_HZ:
        raise PbdError(f"--rate must be {LOWEST_HZ:g} to {HIGHEST_HZ:g} Hz, got {rate_hz:g}", value=rate_hz)
    file_format = import_module(f"{__name__}.{FORMATS[format_name]}")
    if format_name == "ros2-json":
        points = file_format.samples(trajectory, rate_hz)
    else:
        points = trajectory.sample(rate_hz or USUAL_HZ)
    receiver = _replayed(points, robot, file_format.FILLED_BY, rate_hz)
    with atomic_file(path) as unfinished:
        file_format.write(trajectory, robot, points, unfinished)
    return Export(points, receiver)


def _replayed(
    points: Samples, robot: Robot, rules: tuple[Rule, ...], rate_hz: float | None
) -> dict[Rule, tuple[Share, Share, Share]]:
    """Check the limits as the format's receivers interpolate. Where they don't, warn of the excess of cubics."""
    from pbd.data.receiver import shares

    found = {rule: shares(points, rule, robot.limits) for rule in rules}
    for rule, used in found.items():
        worst = max(used, key=lambda share: share.value)
        if not worst.value <= 1.0 + ROUNDING:
            what = _reached(points, robot, rule, worst)
            how = "give a lower --rate, or none" if rate_hz is not None else "give a lower --speed, such as 0.95"
            raise PlanError(f"{what}; {how}", joint=robot.joints[worst.joint], value=worst.value, bound=1.0)
    if not rules:
        worst = max(shares(points, "cubic", robot.limits), key=lambda share: share.value)
        if worst.value > 1.0 + CUBIC_EXCESS:
            what = _reached(points, robot, "cubic", worst)
            warnings.warn(
                f"{what}; send each sample at its time, give a higher --rate, or take ros2-json, which is exact",
                PbdWarning,
                stacklevel=3,
            )
    return found


def _reached(points: Samples, robot: Robot, rule: Rule, worst: Share) -> str:
    return (
        f"a controller that fills the gaps between samples by {rule}s would reach {worst.value:.2f} times "
        f"{robot.joints[worst.joint]}'s {worst.limit} limit, at {points.t[worst.point]:.2f} s"
    )
