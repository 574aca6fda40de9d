"""Export of motions for other tools. Each format has a file here, and a row in FORMATS.

An export replaces an earlier one only if pbd/io/made_by_pbd.py knows how the format's files begin.
"""

from __future__ import annotations

from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from pbd.errors import PlanError, UsageError, is_number, listed, nearest, require_kind, require_type, warn
from pbd.io.atomic import atomic_file, atomic_folder, refuse_output

if TYPE_CHECKING:
    from collections.abc import Sequence

    from pbd.data import JointTrajectory, Robot, Samples
    from pbd.files.exporters.check_export import Shares
    from pbd.files.exporters.controller_interpolation import Rule
    from pbd.files.exporters.export_request import Source


class Format(NamedTuple):
    """An export format.

    Attributes:
        module: its module here. `write(request, samples, path)` writes it. `samples(request)` chooses the instants, and
            may be missing if `default_hz` is a rate. `read(path)`, if defined, reads back a file that moves an arm.
        samples_are: what messages call its samples ("points", "frames").
        rules: how receivers interpolate between its points; empty if it does not move an arm.
        suffix: the suffix of a file name that selects it; "": it must be named.
        other_suffixes: further suffixes that its files may have.
        default_hz: the default rate, Hz; 0: its own instants unless a rate is given; None: always its own instants.
        checks_robot: its module's `check(robot)` refuses unsuitable robots, and a missing package.
        binary: it is not printed to a terminal.
    """

    module: str
    samples_are: str
    rules: tuple[Rule, ...] = ()
    suffix: str = ""
    other_suffixes: tuple[str, ...] = ()
    default_hz: float | None = None
    checks_robot: bool = False
    binary: bool = False


FORMATS = {
    "csv": Format("csv", "samples", ("hold",), ".csv", default_hz=1000.0),
    "npz": Format("npz", "samples", ("hold",), ".npz", default_hz=1000.0, binary=True),
    "ros2-json": Format("ros2_json", "points", ("quintic", "cubic"), ".json", default_hz=0.0),
    "keyframes": Format("keyframes", "keyframes", other_suffixes=(".json", ".csv")),
    "tum": Format("tum", "poses", suffix=".tum", default_hz=100.0),
    "tum-hand": Format("tum", "poses", other_suffixes=(".tum",)),
    "urscript": Format("urscript", "points", ("trapezoid",), ".script", checks_robot=True),
    "mcap": Format("mcap", "points", ("quintic", "cubic"), ".mcap", default_hz=0.0, checks_robot=True, binary=True),
    "lerobot": Format("lerobot", "frames", ("hold",), checks_robot=True),
    "glb": Format("glb", "frames", suffix=".glb", default_hz=50.0, binary=True),
}
SUFFIXES = {each.suffix: name for name, each in FORMATS.items() if each.suffix}
"""Suffix of a file's name -> the format that it selects."""

DATASETS = ("lerobot",)
"""Formats that are a folder of several motions."""

LOWEST_HZ, HIGHEST_HZ = 10.0, 1e5
"""Lowest and highest --rate, Hz."""

SERVOJ_HZ = (125.0, 500.0)
"""Control rates of a CB3 and of an e-Series controller, Hz, for urscript's --dense."""


@dataclass(frozen=True, eq=False)
class Export:
    """What was written.

    Attributes:
        receiver: rule of the format's receivers -> largest used fraction of velocity, acceleration and jerk limits.
        episode: the motion's index in a dataset; None in other formats.
    """

    samples: Samples
    receiver: Shares
    episode: int | None = None


def check_format(
    format_name: str, rate_hz: float | None = None, dense: bool = False, robot: Robot | None = None
) -> None:
    """Check format and options before planning.

    Raises:
        UsageError: the format is unknown, or an option does not go with it.
        PlanError: the format is not for this robot.
        PbdError: a package is missing.
    """
    require_kind("format_name", format_name, f"one of {', '.join(FORMATS)}", isinstance(format_name, str))
    require_kind("rate_hz", rate_hz, "a number", rate_hz is None or is_number(rate_hz))
    if format_name not in FORMATS:
        known = f"{', '.join(FORMATS)}{nearest(format_name, FORMATS)}"
        raise UsageError(f"no format '{format_name}'; known are {known}", value=format_name)
    if rate_hz is not None and not LOWEST_HZ <= rate_hz <= HIGHEST_HZ:
        raise UsageError(f"--rate must be {LOWEST_HZ:g} to {HIGHEST_HZ:g} Hz, got {rate_hz:g}", value=rate_hz)
    if dense and format_name != "urscript":
        raise UsageError(f"--dense is for urscript alone; leave it out for {format_name}", value=format_name)
    if rate_hz is not None and FORMATS[format_name].default_hz is None and not dense:
        raise UsageError(f"{format_name} is not sampled at a rate: leave --rate out", value=rate_hz)
    if dense and rate_hz is not None and rate_hz not in SERVOJ_HZ:
        raise UsageError(f"--rate must be 125 (CB3) or 500 (e-Series) for servoj, got {rate_hz:g}", value=rate_hz)
    if robot is not None and FORMATS[format_name].checks_robot:
        import_module(f"{__name__}.{FORMATS[format_name].module}").check(robot)


def check_suffix(format_name: str, path: Path) -> None:
    """Refuse (UsageError) a file whose name ends as another format's does."""
    by_ending = SUFFIXES.get(suffix := path.suffix.lower())
    if by_ending not in (format_name, None) and suffix not in FORMATS[format_name].other_suffixes:
        what = f"{path} looks like {by_ending}, but the format is {format_name}"
        raise UsageError(f"{what}; name another file, or another format")


def export(
    trajectory: JointTrajectory,
    robot: Robot,
    format_name: str,
    path: str | Path,
    rate_hz: float | None = None,
    *,
    dense: bool = False,
    source: Source | None = None,
) -> Export:
    """Write a trajectory, atomically.

    Args:
        robot: its limits are checked between the samples too.
        format_name: one of FORMATS (docs/exports.md).
        path: the file, or for lerobot the folder; a file that pbd wrote before is replaced.
        rate_hz: samples a second, 10 to 100,000; None: the format's default.
        dense: urscript only: servoj at the controller's period (125 or 500 Hz) instead of a movej to each keyframe.
        source: what `pbd.planning.source_of` returns; needed by formats that contain more than joints.

    Returns:
        The samples as written, and how much of the limits a receiver that joins them will use.

    Raises:
        UsageError: the format is unknown, or the rate, the file's ending or `dense` does not go with it.
        PbdError: the file can't be written, or pbd did not make the one that is there.
        PlanError: the motion is another robot's; or, interpolated as receivers do, it would exceed a limit, miss a
            keyframe or touch something. Nothing is written.
        WrongTypeError: an argument has the wrong type, for example a robot's name.
    """
    from pbd.data import JointTrajectory, Robot
    from pbd.files.exporters.check_export import EXACT_RAD, check_received, limit_use
    from pbd.files.exporters.export_request import ExportRequest, Source

    require_type("export", trajectory, "pbd.plan", JointTrajectory)
    require_type("export", robot, "pbd.load_robot", Robot)
    require_type("export", source, "pbd.planning.source_of", Source, optional=True)
    require_kind("path", path, "a file's name", isinstance(path, str | Path))
    check_format(format_name, rate_hz, dense, robot)
    path = Path(path)
    check_suffix(format_name, path)
    if trajectory.joint_names != robot.joints:
        what = f"this motion is not {robot.name}'s: its joints are {listed(trajectory.joint_names)}"
        raise PlanError(f"{what}; give the robot that it was planned for", value=robot.name)
    beyond = abs(trajectory.q - trajectory.q.clip(robot.limits.lower, robot.limits.upper)).max(axis=0)
    if beyond.max() > EXACT_RAD:
        what = f"this motion takes {robot.joints[int(beyond.argmax())]} {beyond.max():.3g} beyond {robot.name}'s limit"
        raise PlanError(f"{what}; give the robot that it was planned for", value=robot.name)
    if format_name in DATASETS:
        return export_dataset([(trajectory, source)], robot, path)[0]
    refuse_output(path)
    from pbd.files.exporters.controller_interpolation import limit_shares

    file = import_module(f"{__name__}.{FORMATS[format_name].module}")
    request = ExportRequest(format_name, trajectory, robot, path.suffix.lower(), rate_hz, dense, source)
    points = getattr(file, "samples", ExportRequest.sampled)(request)
    rules: tuple[Rule, ...] = ("hold",) if dense else request.format.rules  # servoj holds each row
    receiver: Shares = {}
    with atomic_file(path) as unfinished:
        file.write(request, points, unfinished)
        if rules:
            receiver = check_received(request, file.read(unfinished), rules)
    if request.format.rules == ("hold",):  # warn of receivers that interpolate by cubics
        worst = max(limit_shares(points, "cubic", robot.limits), key=lambda share: share.value)
        if worst.value > 1.1:  # at 1 kHz a panda reaches 1.07 times its acceleration limit (docs/exports.md)
            warn(
                f"{limit_use(request, points, 'cubic', worst)}; send each sample at its time, give a higher --rate, or "
                "take ros2-json, which is exact"
            )
    return Export(points, receiver)


def export_dataset(
    motions: Sequence[tuple[JointTrajectory, Source | None]], robot: Robot, folder: Path, task: str = ""
) -> list[Export]:
    """Write motions of one robot as a LeRobot dataset, or append them to one, atomically.

    Args:
        folder: a new folder, or a dataset of this robot that pbd wrote.
        task: the task's description; "": each demonstration's name.

    Raises:
        PbdError: the folder contains something else, or can't be written.
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
    exports: list[Export] = []
    with atomic_folder(folder, locked=True) as unfinished:
        before = lerobot.read_episodes(folder, robot)
        lerobot.write(robot, [*before, *map(lerobot.episode, requests, points)], unfinished)
        written = lerobot.read_episodes(unfinished, robot)[len(before) :]
        for request, sampled, episode in zip(requests, points, written, strict=True):
            received = lerobot.read(robot, episode)
            used = check_received(request, received, request.format.rules, lerobot.FLOAT32_EPSILON)
            exports.append(Export(sampled, used, len(before) + len(exports)))
    return exports
