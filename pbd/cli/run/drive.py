"""Plan from where the arm stands, show, ask, stream, watch."""

from __future__ import annotations

import argparse
import math
import sys
import time
from collections.abc import Sequence
from typing import Any

import numpy as np
from rich.table import Table

from pbd.cli.common import plan_demonstration
from pbd.cli.console import print_json, say
from pbd.cli.plan_report import say_torque
from pbd.cli.recording.device import only_port
from pbd.cli.recording.keys import Keys
from pbd.data import JointTrajectory, Robot
from pbd.driving import bus as servo_bus
from pbd.driving import stream as streaming
from pbd.driving.arm import ServoArm, State
from pbd.driving.bus import Bus
from pbd.driving.encoder_counts import EncoderCounts, servo_names
from pbd.driving.stream import Clock, StreamResult, planned_start, sample_goals, stream
from pbd.driving.watch import Watch, check_health
from pbd.errors import SensorError
from pbd.files.servo_calibration import find_servo_calibration, read_servo_calibration
from pbd.pose import Array
from pbd.view.terminal_tables import make_table, print_table

STOPPED_BY_HAND = 130
"""Exit code, as of Ctrl-C elsewhere."""

MOVED_DEG = 2.0
"""How far an arm may be moved between its measurement and its start, degrees."""

ASKED = 10
"""How many answers are timed before the arm moves."""


def drive_arm(args: argparse.Namespace, robot: Robot) -> int:
    """Run the demonstration on the arm; return the exit code."""
    assert robot.servos is not None
    assert robot.gripper is not None
    stroke_s = robot.gripper.stroke_s
    device = args.port or only_port("arm", "")
    file = find_servo_calibration(args.servos, robot.name, robot.servos.robot_type)
    counts = EncoderCounts(robot, read_servo_calibration(file, servo_names(robot)))
    with Bus.open(device) as bus:
        arm = ServoArm(bus, counts)
        _check_pace(bus, arm)
        before = arm.state()
        check_health(counts.names, arm.bounds, before)
        start = planned_start(counts, before, robot.limits)
        plan = plan_demonstration(args, start)
        t, goals = sample_goals(counts, plan.trajectory, before, args.rate, stroke_s)
        say(f"'{plan.name}' on {robot.name} at {device}, its servos calibrated in {file}")
        print_table(_preview(counts, before, goals, t, plan.trajectory), sys.stderr)
        say(_timetable(plan.trajectory, goals, t))
        say_torque(plan)
        with Keys() as keys:
            if args.dry_run:
                say("dry run: the servos are read, and given no goals")
            else:
                if not args.yes:
                    keys.ask(
                        "Clear the arm's way; keep a hand at its power switch. Enter starts it; any other key cancels."
                    )
                now = arm.state()
                by = np.degrees(np.abs(counts.to_joints(now.counts) - counts.to_joints(before.counts)).max())
                if by > MOVED_DEG:
                    what = f"the arm was moved by {by:.1f} degrees since it was measured"
                    raise SensorError(f"{what}, so the motion doesn't begin there: run it again")
                t, goals = sample_goals(counts, plan.trajectory, now, args.rate, stroke_s)
                arm.enable_torque(now.counts)
                say("the arm moves: any key stops it")
            bus.answer_s = servo_bus.ANSWER_S
            tolerance = math.inf if args.dry_run else args.tolerance
            watch = Watch(counts.names, arm.bounds, before, tolerance, args.rate)
            done = stream(
                arm,
                goals,
                args.rate,
                watch,
                Clock(),
                lambda: bool(keys.next()),
                dry_run=args.dry_run,
                stall_s=streaming.STALL_S,
            )
    if args.json:
        print_json(
            {
                "demo": plan.name,
                "robot": robot.name,
                "port": device,
                "servos": str(file),
                "dry_run": args.dry_run,
                "duration_s": plan.trajectory.duration,
                **_motion_json(done, watch, bus, counts.names, args.dry_run),
                "warnings": args.warnings,
            }
        )
    return _report_end(done, watch, counts, args, device)


def _check_pace(bus: Bus, arm: ServoArm) -> None:
    """Refuse an adapter that is too slow to stop the arm in time."""
    took = []
    for _ in range(ASKED):
        asked = time.monotonic()
        arm.state()
        took.append(time.monotonic() - asked)
    usual = float(np.median(took))
    if usual > servo_bus.ANSWER_S:
        what = (
            f"the servos' answers take {1e3 * usual:.0f} ms on {bus.device}, more than {1e3 * servo_bus.ANSWER_S:.0f}"
        )
        raise SensorError(f"{what}: lower the adapter's latency timer (docs/running.md), or close other programs")


def _preview(counts: EncoderCounts, state: State, goals: Array, t: Array, trajectory: JointTrajectory) -> Table:
    """Where each joint stands, where the demonstration begins, and between what it will be."""
    table = make_table("joint", "now", "start", "lowest", "highest", "servo's range", left=("joint",))
    at = goals[int(np.searchsorted(t, trajectory.keyframe_t[0]))]
    rows = np.array([state.counts, at, goals.min(axis=0), goals.max(axis=0), counts.lower, counts.upper])
    degrees = np.degrees(counts.to_joints(rows))
    for i, name in enumerate(counts.names[:-1]):
        now, start, low, high, *ends = degrees[:, i]
        reach = f"{min(ends):.0f} to {max(ends):.0f}"
        table.add_row(name, *(f"{value:.1f}°" for value in (now, start, low, high)), f"{reach}°")
    percent = counts.gripper_percent(rows)
    table.add_row(counts.names[-1], *(f"{value:.0f} %" for value in percent[:4]), "0 to 100 %")
    return table


def _timetable(trajectory: JointTrajectory, goals: Array, t: Array) -> str:
    first, last = float(trajectory.keyframe_t[0]), float(trajectory.keyframe_t[-1])
    parts = [f"to the start {first - t[0]:.1f} s", f"the demonstration {last - first:.1f} s"]
    parts += [f"back home {t[-1] - last:.1f} s"] if trajectory.duration > last else []
    return f"{', '.join(parts)}: {t[-1] - t[0]:.1f} s in all, then the arm holds"


def _motion_json(done: StreamResult, watch: Watch, bus: Bus, names: Sequence[str], dry_run: bool) -> dict[str, Any]:
    period_ms = 1e3 * done.periods
    return {
        "goals": 0 if dry_run else done.sent,
        "t_s": done.t,
        "period_ms": {
            "median": float(np.median(period_ms)) if len(period_ms) else None,
            "p99": float(np.percentile(period_ms, 99)) if len(period_ms) else None,
            "max": float(period_ms.max()) if len(period_ms) else None,
        },
        "asked_again": bus.asked_again,
        "error_deg": None if dry_run else dict(zip(names, watch.error_deg, strict=True)),
        "load": dict(zip(names, watch.load, strict=True)),
        "celsius": dict(zip(names, watch.celsius, strict=True)),
        "volts": float(watch.volts.min()),
        "stopped": "by hand" if done.by_hand else done.stopped and done.stopped.message,
        "held": done.held,
    }


def _report_end(done: StreamResult, watch: Watch, counts: EncoderCounts, args: argparse.Namespace, device: str) -> int:
    """Say how it ended; return the exit code."""
    lets_go = f"`pbd run --release --robot {args.robot} --port {device}` lets go of it"
    holds = "the arm holds where it stopped"
    if not done.held:
        holds = "its servos did not confirm the stop, so switch their power off if the arm still moves"
    elif args.dry_run:
        holds = "nothing moved"
    if done.stopped is not None:
        raise SensorError(f"stopped after {done.t:.2f} s: {done.stopped.message}; {holds}", **done.stopped.fields)
    if done.by_hand:
        say(f"stopped by hand after {done.t:.2f} s: {holds}; {lets_go}")
        return STOPPED_BY_HAND
    worst = int(np.argmax(watch.error_deg[:-1]))
    felt = f"load {100 * watch.load.max():.0f} %, {watch.celsius.max():.0f} °C, {watch.volts.min():.1f} V at least"
    if args.dry_run:
        say(f"dry run done: the servos answered {done.sent} times; {felt}")
    else:
        off = f"at most {watch.error_deg[worst]:.1f} degrees off ({counts.names[worst]})"
        say(f"done: {done.sent} goals, {off}, {felt}; the arm holds, {lets_go}")
    return 0
