"""Joint trajectories for other tools, one format a file."""

from __future__ import annotations

from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING

from pbd.errors import UsageError, nearest, warn
from pbd.io.atomic import atomic_file, atomic_folder

if TYPE_CHECKING:
    from collections.abc import Sequence

    from pbd.data import JointTrajectory, Robot, Samples
    from pbd.data.controller_interpolation import Rule
    from pbd.files.exporters.check_export import Shares
    from pbd.files.exporters.job import Source

FORMATS = {
    **{"csv": "csv", "npz": "npz", "ros2-json": "ros2_json"},
    "keyframes": "keyframes",
    **{"tum": "tum", "tum-hand": "tum"},
    **{"urscript": "urscript", "mcap": "mcap", "lerobot": "lerobot", "glb": "glb"},
}
"""Format -> its file here, with `samples(order)` and `write(order, samples, path)`. COUNTED says what these samples are
called, FILLED_BY by which rules receivers fill the gaps between them; `read(path)` reads them back for that."""

SUFFIXES = {
    **{".csv": "csv", ".npz": "npz", ".json": "ros2-json", ".tum": "tum"},
    **{".script": "urscript", ".mcap": "mcap", ".glb": "glb"},
}
"""What a file's name ends in, and the format that it says."""

ALSO = {"keyframes": (".json", ".csv"), "tum-hand": (".tum",), "lerobot": ()}
"""What else the file of a format may end in: such a format must be named."""

FOLDERS = ("lerobot",)
"""Formats that are a folder, of several motions."""

LOWEST_HZ, HIGHEST_HZ = 10.0, 1e5

ROW_BY_ROW = ("csv", "npz")
"""Formats whose rows are sent one by one, each at its time. What cubics between them would do is told all the same."""

WITHOUT_RATE = ("keyframes", "tum-hand", "lerobot")
"""Formats that have no samples, not by a clock, or at 30 Hz alone."""

CUBIC_EXCESS = 0.1
"""Share above a limit that cubics between samples may reach without a warning, in a format that isn't made for them.
At 1 kHz a panda's acceleration is exceeded by 0.07, which docs/exports.md says."""

FOR_SOME = ("urscript", "mcap", "lerobot")
"""Formats that are not for every robot, or need a package of their own."""


@dataclass(frozen=True, eq=False)
class Export:
    """What was written.

    Attributes:
        samples: the arm's points.
        counted: what these are called.
        receiver: by each rule of the format's receivers, the largest shares of velocity, acceleration and jerk limits.
        episode: its number, in a format that has several.
    """

    samples: Samples
    counted: str
    receiver: Shares
    episode: int | None = None


def check_format(
    format_name: str, rate_hz: float | None = None, dense: bool = False, robot: Robot | None = None
) -> None:
    """Refuse what no motion could change: a format or option (UsageError), or what the robot isn't for (PlanError)."""
    if format_name not in FORMATS:
        known = f"{', '.join(FORMATS)}{nearest(format_name, FORMATS)}"
        raise UsageError(f"no format '{format_name}'; known are {known}", value=format_name)
    if rate_hz is not None and not LOWEST_HZ <= rate_hz <= HIGHEST_HZ:
        raise UsageError(f"--rate must be {LOWEST_HZ:g} to {HIGHEST_HZ:g} Hz, got {rate_hz:g}", value=rate_hz)
    if dense and format_name != "urscript":
        raise UsageError(f"--dense is for urscript alone; leave it out for {format_name}", value=format_name)
    if rate_hz is not None and (format_name in WITHOUT_RATE or (format_name == "urscript" and not dense)):
        raise UsageError(f"{format_name} is not sampled at a rate: leave --rate out", value=rate_hz)
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
        UsageError: as `check_format`.
        PbdError: the file can't be written.
        PlanError: replayed from the file by the rule of the format's receivers, the motion would break a limit, miss a
            keyframe or touch something; nothing is written.
    """
    check_format(format_name, rate_hz, dense)
    if format_name in FOLDERS:
        return export_dataset([(trajectory, source)], robot, path)[0]
    from pbd.data.controller_interpolation import shares
    from pbd.files.exporters.check_export import check_received, reached
    from pbd.files.exporters.job import Order

    file_format = import_module(f"{__name__}.{FORMATS[format_name]}")
    order = Order(format_name, trajectory, robot, path.suffix.lower(), rate_hz, dense, source)
    points = file_format.samples(order)
    rules: tuple[Rule, ...] = file_format.DENSE_FILLED_BY if dense else file_format.FILLED_BY
    receiver: Shares = {}
    with atomic_file(path) as unfinished:
        file_format.write(order, points, unfinished)
        if rules:
            receiver = check_received(order, file_format.read(unfinished), rules, sampled=file_format.samples)
    if format_name in ROW_BY_ROW:
        worst = max(shares(points, "cubic", robot.limits), key=lambda share: share.value)
        if worst.value > 1.0 + CUBIC_EXCESS:
            warn(
                f"{reached(order, points, 'cubic', worst)}; send each sample at its time, give a higher --rate, or "
                "take ros2-json, which is exact"
            )
    return Export(points, file_format.COUNTED, receiver)


def export_dataset(
    motions: Sequence[tuple[JointTrajectory, Source | None]], robot: Robot, folder: Path, task: str = ""
) -> list[Export]:
    """Write motions of one robot as a LeRobot dataset, or add them to one; it appears whole or stays as it was.

    Args:
        motions: each with what it was made from.
        robot: whose they are.
        folder: where; it is made, or holds this robot's episodes that pbd wrote.
        task: what they do, in words; each motion's own name where nobody said.

    Raises:
        PbdError: the folder holds something else, or can't be written.
        PlanError: as `export`.
    """
    from pbd.files.exporters import lerobot
    from pbd.files.exporters.check_export import check_received
    from pbd.files.exporters.job import Order

    lerobot.check(robot)
    orders = [Order("lerobot", trajectory, robot, "", made_from=source, task=task) for trajectory, source in motions]
    points = [lerobot.samples(order) for order in orders]
    before = lerobot.read_episodes(folder, robot)
    done: list[Export] = []
    with atomic_folder(folder) as unfinished:
        lerobot.write(robot, [*before, *map(lerobot.episode, orders, points)], unfinished)
        written = lerobot.read_episodes(unfinished, robot)[len(before) :]
        for order, sampled, episode in zip(orders, points, written, strict=True):
            found = check_received(order, lerobot.read(robot, episode), lerobot.FILLED_BY, lerobot.DIGITS)
            done.append(Export(sampled, lerobot.COUNTED, found, len(before) + len(done)))
    return done
