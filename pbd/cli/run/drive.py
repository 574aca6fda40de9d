"""Runs a demonstration on an arm: plans from where it stands, shows the motion, asks, streams, watches, reports."""

import argparse
import math
import shlex
import signal
import sys
import time
from collections.abc import Sequence
from typing import Any

import numpy as np
from rich.table import Table

from pbd.cli.common import plan_demonstration
from pbd.cli.console import print_json, say
from pbd.cli.plan_report import plan_json, unfollowed, whole_motion_remarks
from pbd.cli.recording.device import only_port
from pbd.cli.recording.keys import Keys
from pbd.data import JointTrajectory, Robot
from pbd.driving import bus as servo_bus
from pbd.driving.bus import Bus
from pbd.driving.encoders import Encoders, servo_names
from pbd.driving.motion_monitor import MotionMonitor, check_health
from pbd.driving.servo_arm import ServoArm, ServoState
from pbd.driving.stream import Clock, StreamResult, planned_start, sample_goals, stream
from pbd.errors import SensorError, noting, warn
from pbd.files.servo_calibration import find_servo_calibration, read_servo_calibration
from pbd.pose import Array
from pbd.view.terminal_tables import make_table, print_table

UNCHANGED_NOTE = "the servos are as they were: stiff ones still hold"
"""Note on the message if the person cancels before the servos get a goal."""


def drive_arm(args: argparse.Namespace, robot: Robot) -> int:
    """Run the demonstration on the arm; return the exit code."""
    assert robot.servos is not None
    device = args.port or only_port("arm", "")
    file = find_servo_calibration(args.servos, robot.name, robot.servos.robot_type)
    encoders = Encoders(robot, read_servo_calibration(file, servo_names(robot)))
    with Bus.open(device) as bus:
        arm = ServoArm(bus, encoders)
        _check_pace(bus, arm)
        before = arm.state()
        check_health(encoders.names, arm.bounds, before)
        start = planned_start(encoders, before, robot.limits)
        plan = plan_demonstration(args, start)
        t, goals = sample_goals(encoders, plan.trajectory, before, args.rate)
        say(f"'{plan.name}' on {robot.name} at {device}, its servos calibrated in {file}")
        print_table(_preview_table(encoders, before, goals, t, plan.trajectory), sys.stderr)
        say(timetable(plan.trajectory, t, plan.retreat is not None))
        for remark in whole_motion_remarks(plan, args.calibration):
            say(remark)
        for what in unfollowed(plan):
            warn(what)
        with Keys() as keys:
            if not (args.dry_run or args.yes):
                with noting(UNCHANGED_NOTE):
                    way = "Clear the arm's way; keep a hand at its power switch."
                    if plan.options.speed == 1.0 and plan.options.time == "limits":
                        way = f"{way} It moves as fast as the arm may: the first time, take --speed 0.2."
                    keys.ask(f"{way} Enter starts it; any other key cancels.")
            if args.dry_run:
                say("dry run: the servos are read, and given no goals")
            else:
                now = _unmoved_state(arm, encoders, before)
                t, goals = sample_goals(encoders, plan.trajectory, now, args.rate)
                arm.enable_torque(now.counts)
                say("the arm moves: any key stops it")
            bus.answer_s = servo_bus.ANSWER_S
            tolerance = math.inf if args.dry_run else args.tolerance
            monitor = MotionMonitor(encoders.names, arm.bounds, before, tolerance, args.rate)
            done = stream(arm, goals, args.rate, monitor, Clock(), lambda: bool(keys.next()), args.dry_run)
    code = _report_end(done, monitor, encoders, args, device)  # before the JSON, whose reader may be gone
    if args.json:
        arm_json = {"port": device, "servos": str(file), "dry_run": args.dry_run}
        motion = _motion_json(done, monitor, bus, encoders.names, args.dry_run)
        made = plan_json(plan, args.calibration, args.demo)
        print_json({**made, **arm_json, **motion, "warnings": args.warnings})
    return 128 + keys.signal if done.by_hand and keys.signal else code


def _unmoved_state(arm: ServoArm, encoders: Encoders, before: ServoState) -> ServoState:
    """Measure the arm again; refuse one that was moved by more than 2 degrees since it was measured before."""
    now = arm.state()
    by = np.degrees(np.abs(encoders.to_joints(now.counts) - encoders.to_joints(before.counts)).max())
    if by > 2.0:  # degrees
        what = f"the arm was moved by {by:.1f} degrees since it was measured"
        raise SensorError(f"{what}, so the motion doesn't begin there: run it again")
    return now


def _check_pace(bus: Bus, arm: ServoArm) -> None:
    """Refuse a serial adapter that is too slow to stop the arm in time, by the median time of ten answers."""
    took = []
    for _ in range(10):
        asked = time.monotonic()
        arm.state()
        took.append(time.monotonic() - asked)
    usual = float(np.median(took))
    if usual > servo_bus.ANSWER_S:
        what = f"the servos' answers take {1e3 * usual:.1f} ms on {bus.device}, more than {1e3 * servo_bus.ANSWER_S:g}"
        raise SensorError(f"{what}: lower the adapter's latency timer (docs/running.md), or close other programs")


def _preview_table(encoders: Encoders, state: ServoState, goals: Array, t: Array, trajectory: JointTrajectory) -> Table:
    """Tabulate each joint's present position, the start, and the range of the motion and of the servo."""
    table = make_table("joint", "now", "start", "lowest", "highest", "servo's range", left=("joint",))

    def shown(counts: Array) -> Array:
        """Degrees of the joints and percent of the gripper: some fall where the counts rise."""
        return np.column_stack([np.degrees(encoders.to_joints(counts)), encoders.gripper_percent(counts)])

    at = goals[int(np.searchsorted(t, trajectory.keyframe_t[0]))]
    path, ends = shown(goals), shown(np.array([encoders.lower, encoders.upper]))
    rows = [*shown(np.array([state.counts, at]))]
    rows += [path.min(axis=0), path.max(axis=0), ends.min(axis=0), ends.max(axis=0)]
    gripper = encoders.names[-1]
    for name, *values, least, most in zip(encoders.names, *rows, strict=True):
        form, unit = (".0f", " %") if name == gripper else (".1f", "°")
        table.add_row(name, *(f"{value:{form}}{unit}" for value in values), f"{least:.0f} to {most:.0f}{unit}")
    return table


def timetable(trajectory: JointTrajectory, t: Array, retreats: bool) -> str:
    """Say how long each part of the motion takes; goals are sent at times (n,) s. `retreats`: the arm returns home."""
    first, last = float(trajectory.keyframe_t[0]), float(trajectory.keyframe_t[-1] if retreats else t[-1])
    parts = [f"to the start {first - t[0]:.1f} s", f"the demonstration {last - first:.1f} s"]
    parts += [f"back home {t[-1] - last:.1f} s"] if retreats else []
    return f"{', '.join(parts)}: {t[-1] - t[0]:.1f} s in all, then the arm holds"


def _motion_json(
    done: StreamResult, monitor: MotionMonitor, bus: Bus, names: Sequence[str], dry_run: bool
) -> dict[str, Any]:
    """Return the motion's goals, their timing, and the largest values that the servos reported, for JSON."""
    period_ms = 1e3 * done.periods if len(done.periods) else np.array([np.nan])
    return {
        "goals": 0 if dry_run else done.sent,
        "t_s": done.t,
        "period_ms": {
            "median": np.median(period_ms),
            "p99": np.percentile(period_ms, 99),
            "max": period_ms.max(),
        },
        "asked_again": bus.asked_again,
        "error_deg": None if dry_run else dict(zip(names, monitor.error_deg, strict=True)),
        "load": dict(zip(names, monitor.load, strict=True)),
        "celsius": dict(zip(names, monitor.celsius, strict=True)),
        "volts": float(monitor.volts.min()),
        "stopped": "by hand" if done.by_hand else done.stopped and done.stopped.message,
        "held": done.held,
    }


def _report_end(
    done: StreamResult, monitor: MotionMonitor, encoders: Encoders, args: argparse.Namespace, device: str
) -> int:
    """Say how the motion ended; return the exit code."""
    lets_go = f"`pbd run --release --robot {shlex.quote(args.robot)} --port {shlex.quote(device)}` lets go of it"
    holds = f"the arm holds where it stopped; {lets_go}"
    if not done.held:
        holds = "its servos did not confirm that they hold: support the arm, switch their power off if it still moves"
    elif args.dry_run:
        holds = "nothing moved"
    if done.stopped is not None:
        say(f"stopped after {done.t:.2f} s: {done.stopped.message}; {holds}")
        return done.stopped.exit_code
    if done.by_hand:
        say(f"stopped by hand after {done.t:.2f} s: {holds}")
        return 128 + signal.SIGINT  # as after Ctrl-C
    worst = int(np.argmax(monitor.error_deg[:-1]))
    load, celsius, volts = monitor.load.max(), monitor.celsius.max(), monitor.volts.min()
    felt = f"load up to {100 * load:.0f} %, up to {celsius:.0f} °C, at least {volts:.1f} V"
    if args.dry_run:
        say(f"dry run done: the servos answered {done.sent} times; {felt}")
    else:
        off = f"at most {monitor.error_deg[worst]:.1f} degrees off ({encoders.names[worst]})"
        say(f"done: {done.sent} goals, {off}, {felt}; the arm holds, {lets_go}")
    return 0
