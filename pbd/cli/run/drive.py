"""Runs a demonstration on an arm: plans from where it stands, shows the motion, asks, streams and watches."""

from __future__ import annotations

import argparse
import math
import sys
import time

import numpy as np

from pbd.cli.common import plan_demonstration
from pbd.cli.console import print_json, say
from pbd.cli.plan_report import torque_remark
from pbd.cli.recording.device import only_port
from pbd.cli.recording.keys import Keys
from pbd.cli.run.report import motion_json, preview_table, report_end, timetable
from pbd.data import Robot
from pbd.driving import bus as servo_bus
from pbd.driving import stream as streaming
from pbd.driving.arm import ServoArm
from pbd.driving.bus import Bus
from pbd.driving.encoder_counts import EncoderCounts, servo_names
from pbd.driving.stream import Clock, planned_start, sample_goals, stream
from pbd.driving.watch import Watch, check_health
from pbd.errors import SensorError
from pbd.files.servo_calibration import find_servo_calibration, read_servo_calibration
from pbd.planning.result import place_remark, size_remark
from pbd.view.terminal_tables import print_table

MOVED_DEG = 2.0
"""Largest motion of a joint by hand between the arm's measurement and its start, degrees."""

TIMED_ANSWERS = 10
"""Number of answers that are timed before the arm moves."""


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
        print_table(preview_table(counts, before, goals, t, plan.trajectory), sys.stderr)
        say(timetable(plan.trajectory, t, plan.retreat is not None))
        for remark in filter(None, (place_remark(plan, args.calibration), size_remark(plan), torque_remark(plan))):
            say(remark)
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
    code = report_end(done, watch, counts, args, device)  # before the JSON, whose reader may be gone
    if args.json:
        print_json(
            {
                "demo": plan.name,
                "robot": robot.name,
                "port": device,
                "servos": str(file),
                "dry_run": args.dry_run,
                "duration_s": plan.trajectory.duration,
                "scale": plan.scale,
                **motion_json(done, watch, bus, counts.names, args.dry_run),
                "warnings": args.warnings,
            }
        )
    return 128 + keys.signal if done.by_hand and keys.signal else code


def _check_pace(bus: Bus, arm: ServoArm) -> None:
    """Refuse a serial adapter that is too slow to stop the arm in time, by the median time of an answer."""
    took = []
    for _ in range(TIMED_ANSWERS):
        asked = time.monotonic()
        arm.state()
        took.append(time.monotonic() - asked)
    usual = float(np.median(took))
    if usual > servo_bus.ANSWER_S:
        what = (
            f"the servos' answers take {1e3 * usual:.0f} ms on {bus.device}, more than {1e3 * servo_bus.ANSWER_S:.0f}"
        )
        raise SensorError(f"{what}: lower the adapter's latency timer (docs/running.md), or close other programs")
