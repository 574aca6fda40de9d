"""Joint trajectories for other tools, one format a file."""

from __future__ import annotations

from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from pbd.errors import UsageError, nearest, warn
from pbd.io.atomic import atomic_file, atomic_folder

if TYPE_CHECKING:
    from collections.abc import Sequence

    from pbd.data import JointTrajectory, Robot, Samples
    from pbd.files.exporters.check_export import Shares
    from pbd.files.exporters.controller_interpolation import Rule
    from pbd.files.exporters.export_request import Source


class Format(NamedTuple):
    """How motions are written: `write(request, samples, path)` of a file here does it.

    Attributes:
        file: its name. With `samples(request)` it has instants of its own; `read(path)` reads its points back.
        counted: what its samples are called.
        filled_by: the rules by which receivers fill the gaps between points; none where nobody moves an arm by it.
        suffix: what a file's name ends in that says this format; "": it must be named.
        also: what else its file may end in.
        usual_hz: samples a second where nobody says; 0: at instants of its own; None: always at those, and no others.
        for_some: it is not for every robot, or needs a package of its own: its file's `check(robot)` says so.
    """

    file: str
    counted: str
    filled_by: tuple[Rule, ...] = ()
    suffix: str = ""
    also: tuple[str, ...] = ()
    usual_hz: float | None = None
    for_some: bool = False


FORMATS = {
    "csv": Format("csv", "samples", ("hold",), ".csv", usual_hz=1000.0),
    "npz": Format("npz", "samples", ("hold",), ".npz", usual_hz=1000.0),
    "ros2-json": Format("ros2_json", "points", ("quintic", "cubic"), ".json", usual_hz=0.0),
    "keyframes": Format("keyframes", "keyframes", also=(".json", ".csv")),
    "tum": Format("tum", "poses", suffix=".tum", usual_hz=100.0),
    "tum-hand": Format("tum", "poses", also=(".tum",)),
    "urscript": Format("urscript", "points", ("trapezoid",), ".script", for_some=True),
    "mcap": Format("mcap", "points", ("quintic", "cubic"), ".mcap", usual_hz=0.0, for_some=True),
    "lerobot": Format("lerobot", "frames", ("hold",), for_some=True),
    "glb": Format("glb", "frames", suffix=".glb", usual_hz=50.0),
}
SUFFIXES = {each.suffix: name for name, each in FORMATS.items() if each.suffix}

FOLDERS = ("lerobot",)
"""Formats that are a folder, of several motions."""

LOWEST_HZ, HIGHEST_HZ = 10.0, 1e5

CUBIC_EXCESS = 0.1
"""Share above a limit that cubics between samples may reach without a warning, in a format that isn't made for them.
At 1 kHz a panda's acceleration is exceeded by 0.07, which docs/exports.md says."""


@dataclass(frozen=True, eq=False)
class Export:
    """What was written: the arm's points.

    Attributes:
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
    if rate_hz is not None and FORMATS[format_name].usual_hz is None and not dense:
        raise UsageError(f"{format_name} is not sampled at a rate: leave --rate out", value=rate_hz)
    if robot is not None and FORMATS[format_name].for_some:
        import_module(f"{__name__}.{FORMATS[format_name].file}").check(robot)


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
    from pbd.files.exporters.check_export import check_received, reached
    from pbd.files.exporters.controller_interpolation import limit_shares
    from pbd.files.exporters.export_request import ExportRequest

    file = import_module(f"{__name__}.{FORMATS[format_name].file}")
    request = ExportRequest(format_name, trajectory, robot, path.suffix.lower(), rate_hz, dense, source)
    samples = getattr(file, "samples", ExportRequest.sampled)
    points = samples(request)
    rules: tuple[Rule, ...] = ("hold",) if dense else request.format.filled_by  # of servoj each row at its time
    receiver: Shares = {}
    with atomic_file(path) as unfinished:
        file.write(request, points, unfinished)
        if rules:
            receiver = check_received(request, file.read(unfinished), rules, sampled=samples)
    if request.format.filled_by == ("hold",):  # what cubics between the rows would do is told all the same
        worst = max(limit_shares(points, "cubic", robot.limits), key=lambda share: share.value)
        if worst.value > 1.0 + CUBIC_EXCESS:
            warn(
                f"{reached(request, points, 'cubic', worst)}; send each sample at its time, give a higher --rate, or "
                "take ros2-json, which is exact"
            )
    return Export(points, request.format.counted, receiver)


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
    from pbd.files.exporters.export_request import ExportRequest

    lerobot.check(robot)
    requests = [
        ExportRequest("lerobot", trajectory, robot, "", made_from=source, task=task) for trajectory, source in motions
    ]
    points = [lerobot.samples(request) for request in requests]
    before = lerobot.read_episodes(folder, robot)
    done: list[Export] = []
    with atomic_folder(folder) as unfinished:
        lerobot.write(robot, [*before, *map(lerobot.episode, requests, points)], unfinished)
        written = lerobot.read_episodes(unfinished, robot)[len(before) :]
        for request, sampled, episode in zip(requests, points, written, strict=True):
            found = check_received(request, lerobot.read(robot, episode), request.format.filled_by, lerobot.DIGITS)
            done.append(Export(sampled, request.format.counted, found, len(before) + len(done)))
    return done
