"""What the commands print for people."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from io import StringIO
from typing import Any

import numpy as np
from rich import box
from rich.console import Console
from rich.table import Table

from pbd.data import Keyframe, Robot, Segment
from pbd.pose import quat_to_rpy

PIPE_WIDTH = 200
"""Columns where the output is no terminal: rows are never broken for a program that reads them."""


def print_table(table: Table) -> None:
    """Print to stdout, in colour only where that is a terminal."""
    if sys.stdout.isatty():
        Console(highlight=False).print(table)
        return
    text = StringIO()
    Console(file=text, width=PIPE_WIDTH, highlight=False).print(table)
    print("\n".join(line.rstrip() for line in text.getvalue().splitlines()))


def _table(*columns: str, left: tuple[str, ...] = ()) -> Table:
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, show_edge=False)
    for column in columns:
        table.add_column(column, justify="left" if column in left else "right", no_wrap=column not in left)
    return table


def segments_table(segments: Sequence[Segment]) -> Table:
    """The paper's Table I: samples first to last, what happens, how long from the first to the last."""
    table = _table("samples", "what happens", "time (ms)", left=("what happens",))
    for segment in segments:
        table.add_row(f"{segment.start}-{segment.stop - 1}", segment.description, f"{segment.ms:.0f}")
    return table


def keyframes_table(keyframes: Sequence[Keyframe]) -> Table:
    """The sensor's pose in nav at each stop; sigma is the largest over the axes."""
    position, turn = ("x (m)", "y (m)", "z (m)"), ("roll (°)", "pitch (°)", "yaw (°)")
    table = _table("#", "t (s)", "dwell (s)", *position, *turn, "σ (mm)", "σ (°)", "grip")
    for index, keyframe in enumerate(keyframes):
        sigma = np.sqrt(np.diagonal(keyframe.cov))
        table.add_row(
            str(index),
            f"{keyframe.t:.2f}",
            f"{keyframe.dwell_s:.2f}",
            *_fixed(keyframe.T_nav_sensor.p, 3),
            *_fixed(np.degrees(quat_to_rpy(keyframe.T_nav_sensor.wxyz)), 1),
            f"{1e3 * sigma[:3].max():.1f}",
            f"{np.degrees(sigma[3:].max()):.1f}",
            {True: "closes", False: "opens", None: ""}[keyframe.grip],
        )
    return table


def joints_table(joint_names: Sequence[str], rows: Sequence[Mapping[str, Any]]) -> Table:
    """The tool's position in base and the joints, at each keyframe."""
    table = _table("#", "tool x (m)", "y (m)", "z (m)", *(f"{name} (°)" for name in joint_names))
    for row in rows:
        table.add_row(str(row["index"]), *_fixed(row["base_position_m"], 3), *_fixed(np.degrees(row["joints"]), 1))
    return table


def robots_table(robots: Sequence[Robot], reach_m: Sequence[float]) -> Table:
    """Name, joints, reach, gripper, which limits are assumed, what it is."""
    table = _table(
        "name",
        "joints",
        "reach (m)",
        "gripper",
        "assumed limits",
        "what it is",
        left=("name", "gripper", "assumed limits", "what it is"),
    )
    for robot, reach in zip(robots, reach_m, strict=True):
        gripper = "none" if robot.gripper is None else ", ".join(robot.gripper.joints) or "not in the model"
        assumed = ", ".join(robot.limits.assumed) or "none"
        table.add_row(robot.name, str(len(robot.joints)), f"{reach:.2f}", gripper, assumed, robot.description)
    return table


def ports_table(rows: Sequence[Mapping[str, Any]]) -> Table:
    """Serial ports, and what was heard there."""
    heard = any("sensor" in row for row in rows)
    columns = ("port", "device", "USB id", *(("speaks", "baud", "") if heard else ()))
    table = _table(*columns, left=columns)
    for row in rows:
        said = (row["sensor"] or "", str(row["baud"] or ""), row["note"]) if heard else ()
        table.add_row(row["port"], row["title"], row["usb"], *said)
    return table


def sensors_table(rows: Sequence[Mapping[str, Any]]) -> Table:
    """Kinds of sensors, by the name that `pbd record --sensor` takes."""
    columns = ("--sensor", "device", "gives")
    table = _table(*columns, left=columns)
    for row in rows:
        table.add_row(row["sensor"], row["title"], row["gives"])
    return table


def _fixed(values: Any, decimals: int) -> list[str]:
    """Write numbers with so many decimals, and spare the reader a -0.000."""
    return [f"{x:.{decimals}f}" for x in np.round(np.asarray(values), decimals) + 0.0]
