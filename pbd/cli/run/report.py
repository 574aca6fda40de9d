"""What `pbd run` prints before and after the motion."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from typing import Any

import numpy as np
from rich.table import Table

from pbd.cli.console import say
from pbd.data import JointTrajectory
from pbd.driving.arm import State
from pbd.driving.bus import Bus
from pbd.driving.encoder_counts import EncoderCounts
from pbd.driving.stream import StreamResult
from pbd.driving.watch import Watch
from pbd.pose import Array
from pbd.view.terminal_tables import make_table

STOPPED_BY_HAND = 130
"""Exit code after a key stopped the arm: the same as after Ctrl-C."""


def preview_table(counts: EncoderCounts, state: State, goals: Array, t: Array, trajectory: JointTrajectory) -> Table:
    """Tabulate each joint's present position, the start, and the range of the motion and of the servo."""
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


def timetable(trajectory: JointTrajectory, t: Array, retreats: bool) -> str:
    """Say how long each part of the motion takes; goals are sent at times (n,) s. `retreats`: the arm returns home."""
    first, last = float(trajectory.keyframe_t[0]), float(trajectory.keyframe_t[-1] if retreats else t[-1])
    parts = [f"to the start {first - t[0]:.1f} s", f"the demonstration {last - first:.1f} s"]
    parts += [f"back home {t[-1] - last:.1f} s"] if retreats else []
    return f"{', '.join(parts)}: {t[-1] - t[0]:.1f} s in all, then the arm holds"


def motion_json(done: StreamResult, watch: Watch, bus: Bus, names: Sequence[str], dry_run: bool) -> dict[str, Any]:
    """Return the motion's goals, their timing, and the largest values that the servos reported, for JSON."""
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


def report_end(done: StreamResult, watch: Watch, counts: EncoderCounts, args: argparse.Namespace, device: str) -> int:
    """Say how the motion ended; return the exit code."""
    lets_go = f"`pbd run --release --robot {args.robot} --port {device}` lets go of it"
    holds = "the arm holds where it stopped"
    if not done.held:
        holds = "its servos did not confirm that they hold: support the arm, switch their power off if it still moves"
    elif args.dry_run:
        holds = "nothing moved"
    if done.stopped is not None:
        say(f"stopped after {done.t:.2f} s: {done.stopped.message}; {holds}")
        return done.stopped.exit_code
    if done.by_hand:
        say(f"stopped by hand after {done.t:.2f} s: {holds}; {lets_go}")
        return STOPPED_BY_HAND
    worst = int(np.argmax(watch.error_deg[:-1]))
    load, celsius, volts = watch.load.max(), watch.celsius.max(), watch.volts.min()
    felt = f"load up to {100 * load:.0f} %, up to {celsius:.0f} °C, at least {volts:.1f} V"
    if args.dry_run:
        say(f"dry run done: the servos answered {done.sent} times; {felt}")
    else:
        off = f"at most {watch.error_deg[worst]:.1f} degrees off ({counts.names[worst]})"
        say(f"done: {done.sent} goals, {off}, {felt}; the arm holds, {lets_go}")
    return 0
