"""pbd export [DEMO] --robot R --format F -o FILE: write the joint trajectory for other tools."""

import argparse
import shutil
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from pbd.cli.common import load_demonstration, named_calibration, plan_demonstration, track_demonstration, without_aside
from pbd.cli.console import print_json, say, working
from pbd.cli.plan_report import moves_json, plan_json, remarks, unfollowed
from pbd.errors import PbdError, PlanError, UsageError, listed, naming, warn
from pbd.files.exporters import DATASETS, FORMATS, SUFFIXES, Export, check_format, check_suffix, export, export_dataset
from pbd.files.exporters.lerobot import first_frame_text, refuse_dataset
from pbd.files.exporters.tum import write_poses
from pbd.files.find_by_name import names
from pbd.files.robot import load_robot
from pbd.io.atomic import atomic_file, refuse_output
from pbd.planning import Plan, source_of
from pbd.view.terminal import is_closed

STDOUT = Path("-")


def run(args: argparse.Namespace) -> None:
    """Plan each demonstration, audit the motion and write it."""
    args.demos = without_aside(args.demos)
    format_name = _format(args)
    if args.robot is None and format_name != "tum-hand":
        known = f"one of {listed(names('robots'))}, or a file"
        raise UsageError(f"name the robot: --robot ({known}); only the hand's path (--format tum-hand) needs none")
    robot = load_robot(args.robot) if FORMATS[format_name].checks_robot else None
    check_format(format_name, args.rate, args.dense, robot)
    if robot is not None and format_name in DATASETS:
        refuse_dataset(args.output, robot)
    elif args.output != STDOUT:
        refuse_output(args.output, (*args.demos, args.robot, args.calibration, args.start))
    if args.robot is None:
        return _write_hand(args, format_name)
    plans = [_plan(args, name) for name in args.demos or (None,)]
    _tell(warn, plans, unfollowed)
    _tell(say, plans, lambda plan: remarks(plan, args.calibration))
    done = _write(args, plans, format_name)
    count, duration = sum(len(each.samples.t) for each in done), sum(plan.trajectory.duration for plan in plans)
    name = "to standard output" if args.output == STDOUT else args.output
    if format_name == "tum-hand":  # the hand's time, not the arm's
        say(f"wrote {name}: {count} poses, {np.ptp(plans[0].tracked[0].t):.1f} s")
    else:
        what, joints = FORMATS[format_name].samples_are, len(plans[0].robot.joints)
        say(f"wrote {name}: {count} {what}, {duration:.1f} s, {joints} joints")
    if format_name in DATASETS:
        first = first_frame_text(plans[0].robot, done[0].samples)
        numbers = ", ".join(str(each.episode) for each in done)
        say(f"episode{'s' if len(done) > 1 else ''} {numbers} (lerobot-replay --dataset.episode={done[0].episode})")
        say(f"lerobot-replay jumps to the first frame, so bring the arm there before: {first}")
    if args.json:
        results = [_json(args, format_name, *each) for each in zip(args.demos or [None], plans, done, strict=True)]
        print_json({"episodes": results} if format_name in DATASETS else results[0])
    return None


def _write_hand(args: argparse.Namespace, format_name: str) -> None:
    """Write the hand's path, as tracked: it is the same for every robot."""
    demo = load_demonstration(args.demos[0] if args.demos else None)
    path, _ = track_demonstration(args, demo, named_calibration(args))
    with _output(args) as file, atomic_file(file) as unfinished:
        write_poses(path.t, path.p_nav_sensor, path.wxyz_nav_sensor, unfinished)
    name = "to standard output" if args.output == STDOUT else args.output
    say(f"wrote {name}: {len(path.t)} poses, {np.ptp(path.t):.1f} s")
    if args.json:
        result = {"demo": demo.recording.info.name, "format": format_name, "output": str(args.output)}
        print_json(result | {"samples": len(path.t), "warnings": args.warnings})


def _plan(args: argparse.Namespace, name: str | None) -> Plan:
    args.demo = name
    with naming(name) if name and len(args.demos) > 1 else nullcontext():
        plan = plan_demonstration(args)
    if plan.touching is not None:
        touches = plan.touching.error
        what = f"{touches.message}; no such motion is exported: --allow-collision is for pbd replay, which shows it"
        raise PlanError(what, **touches.fields)
    return plan


def _tell(tell: Callable[[str], None], plans: list[Plan], remarks_on: Callable[[Plan], list[str]]) -> None:
    """Tell the remarks on the motions: one on all of them once, one on some of them with their names."""
    named: dict[str, list[str]] = {}
    for plan in plans:
        for remark in remarks_on(plan):
            named.setdefault(remark, []).append(plan.name)
    for remark, whose in named.items():
        tell(remark if len(whose) == len(plans) else f"{listed(whose)}: {remark}")


def _json(args: argparse.Namespace, format_name: str, demo: str | None, plan: Plan, done: Export) -> dict[str, Any]:
    return {
        **plan_json(plan, args.calibration, demo),
        "format": format_name,
        "output": str(args.output),
        "samples": len(done.samples.t),
        **({} if done.episode is None else {"episode": done.episode}),
        "receiver": {rule: {share.limit: share.value for share in shares} for rule, shares in done.receiver.items()},
        "moves": moves_json(plan),
        "warnings": args.warnings,
    }


def _format(args: argparse.Namespace) -> str:
    """Return the format given by --format, or by the ending of the file's name."""
    by_ending = SUFFIXES.get(args.output.suffix.lower())
    if args.output == STDOUT:
        if args.json:
            raise UsageError("-o - and --json would both go to standard output; name a file, or leave --json out")
        if args.format in DATASETS:
            raise UsageError(f"{args.format} writes a folder, which standard output can't be; name one")
        if is_closed(sys.stdout):
            raise PbdError("standard output is closed: name a file")
        if args.format and FORMATS[args.format].binary and sys.stdout.isatty():
            raise UsageError(f"{args.format} is binary, so it is not printed to a terminal; name a file, or pipe it")
    name: str | None = args.format or by_ending
    if name is None:
        raise UsageError(f"name the --format ({', '.join(FORMATS)}), or a file that ends in {', '.join(SUFFIXES)}")
    check_suffix(name, args.output)
    if name not in DATASETS and (len(args.demos) > 1 or args.task):
        what = "--task is" if args.task else "several demonstrations are"
        raise UsageError(f"{what} for {', '.join(DATASETS)}; {name} has one motion a file")
    if name in DATASETS and not (args.approach and args.retreat):
        raise UsageError(
            f"{name}'s episodes begin and end away from the task: leave --no-approach and --no-retreat out"
        )
    return name


def _write(args: argparse.Namespace, plans: list[Plan], format_name: str) -> list[Export]:
    """Write the file or the folder."""
    pairs = [(plan.trajectory, source_of(plan)) for plan in plans]
    (trajectory, source), robot = pairs[0], plans[0].robot
    with _output(args) as file, working("writing the motion"):
        if format_name in DATASETS:
            return export_dataset(pairs, robot, file, args.task)
        return [export(trajectory, robot, format_name, file, args.rate, dense=args.dense, source=source)]


@contextmanager
def _output(args: argparse.Namespace) -> Iterator[Path]:
    """Yield the file to write; for standard output a temporary one, which is then copied."""
    if args.output != STDOUT:
        yield args.output
        return
    with TemporaryDirectory() as folder:
        yield Path(folder) / "motion"
        with (Path(folder) / "motion").open("rb") as written:
            shutil.copyfileobj(written, sys.stdout.buffer)
