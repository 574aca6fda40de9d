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
    from pbd.files.exporters.order import Order, Source

FORMATS = {
    **{"csv": "csv", "npz": "npz", "ros2-json": "ros2_json"},
    "keyframes": "keyframes",
    **{"tum": "tum", "tum-hand": "tum"},
    **{"urscript": "urscript", "mcap": "mcap"},
}
"""Format -> its file here, with `samples(order)` and `write(order, samples, path)`. COUNTED says what these samples are
called, FILLED_BY by which rules receivers fill the gaps between them."""

SUFFIXES = {".csv": "csv", ".npz": "npz", ".json": "ros2-json", ".tum": "tum", ".script": "urscript", ".mcap": "mcap"}
"""What a file's name ends in, and the format that it says."""

ALSO = {"keyframes": (".json", ".csv"), "tum-hand": (".tum",)}
"""What else the file of a format may end in: such a format must be named."""

LOWEST_HZ, HIGHEST_HZ = 10.0, 1e5

ROW_BY_ROW = ("csv", "npz")
"""Formats whose rows are sent one by one, each at its time. What cubics between them would do is told all the same."""

WITHOUT_RATE = ("keyframes", "tum-hand")
"""Formats that have no samples, or not by a clock."""

ROUNDING = 5e-4
"""Share by which a receiver may exceed a limit between points, from rounding to whole nanoseconds."""

CUBIC_EXCESS = 0.1
"""Share above a limit that cubics between samples may reach without a warning, in a format that isn't made for them.
At 1 kHz a panda's acceleration is exceeded by 0.07, which docs/exports.md says."""


FOR_SOME = ("urscript", "mcap")
"""Formats that are not for every robot, or need a package of their own."""


@dataclass(frozen=True, eq=False)
class Export:
    """What was written.

    Attributes:
        samples: the arm's points.
        counted: what these are called.
        receiver: by each rule of the format's receivers, the largest shares of velocity, acceleration and jerk limits.
    """

    samples: Samples
    counted: str
    receiver: Mapping[Rule, tuple[Share, Share, Share]]


def check_format(
    format_name: str, rate_hz: float | None = None, dense: bool = False, robot: Robot | None = None
) -> None:
    """Refuse what no motion could change.

    Raises:
        PbdError: as `export`.
        PlanError: the format is not for this robot.
    """
    if format_name not in FORMATS:
        known = f"{', '.join(FORMATS)}{nearest(format_name, FORMATS)}"
        raise PbdError(f"no format '{format_name}'; known are {known}", value=format_name)
    if rate_hz is not None and not LOWEST_HZ <= rate_hz <= HIGHEST_HZ:
        raise PbdError(f"--rate must be {LOWEST_HZ:g} to {HIGHEST_HZ:g} Hz, got {rate_hz:g}", value=rate_hz)
    if dense and format_name != "urscript":
        raise PbdError(f"--dense is for urscript; {format_name} has --rate, or no samples", value=format_name)
    if rate_hz is not None and (format_name in WITHOUT_RATE or (format_name == "urscript" and not dense)):
        raise PbdError(f"{format_name} is not sampled at a rate: leave --rate out", value=rate_hz)
    if robot is not None and format_name in FOR_SOME:
        import_module(f"{__name__}.{FORMATS[format_name]}").check(robot)


def export(
    trajectory: JointTrajectory,
    robot: Robot,
    format_name: str,
    path: Path,
    rate_hz: float | None = None,
    *,
    dense: bool = False,
    source: Source | None = None,
) -> Export:
    """Write a robot's trajectory; the file appears whole or not at all.

    Args:
        trajectory: the motion.
        robot: whose limits hold between the samples too, and whose gripper it is.
        format_name: one of FORMATS.
        path: where.
        rate_hz: samples a second; by default as the format has it.
        dense: urscript alone: servoj at the controller's period (a rate of 125, or 500), not a movej for each keyframe.
        source: what the motion was made from, which formats need that tell more than joints.

    Raises:
        PbdError: the format is not known, the rate is out of range, the file can't be written.
        PlanError: by the rule of the format's receivers a limit would be broken between samples.
    """
    check_format(format_name, rate_hz, dense)
    from pbd.files.exporters.order import Order

    file_format = import_module(f"{__name__}.{FORMATS[format_name]}")
    order = Order(format_name, trajectory, robot, path.suffix.lower(), rate_hz, dense, source)
    points = file_format.samples(order)
    receiver = _replayed(points, order, file_format.FILLED_BY)
    with atomic_file(path) as unfinished:
        file_format.write(order, points, unfinished)
    return Export(points, file_format.COUNTED, receiver)


def _replayed(points: Samples, order: Order, rules: tuple[Rule, ...]) -> dict[Rule, tuple[Share, Share, Share]]:
    """Fill the gaps as the format's receivers do; where they fill none, warn of what cubics would do."""
    from pbd.data.receiver import shares

    robot, rate_hz = order.robot, order.rate_hz
    found = {rule: shares(points, rule, robot.limits) for rule in rules}
    for rule, used in found.items():
        worst = max(used, key=lambda share: share.value)
        if not worst.value <= 1.0 + ROUNDING:
            what = _reached(points, robot, rule, worst)
            how = "give a lower --rate, or none" if rate_hz is not None else "give a lower --speed, such as 0.95"
            raise PlanError(f"{what}; {how}", joint=robot.joints[worst.joint], value=worst.value, bound=1.0)
    if order.format_name in ROW_BY_ROW:
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
