"""Tables that the commands print."""

from __future__ import annotations

import csv
import sys
from collections.abc import Mapping, Sequence
from io import StringIO
from typing import Any, TextIO

import numpy as np
from rich import box
from rich.cells import cell_len
from rich.console import RenderableType
from rich.table import Column, Table
from rich.text import Text

from pbd.data import Keyframe, Robot, Segment
from pbd.data.sigma import keyframe_sigmas
from pbd.data.tracking import DOUBTED_WEIGHT
from pbd.errors import printable
from pbd.pose import Array, quat_to_rpy
from pbd.view.screen import Screen
from pbd.view.units import Units

SI = Units()

PIPE_WIDTH = 200
"""Width of the output, in columns, where it is no terminal. So rows are not broken for programs that read them."""


COLUMN_GAP = 3
"""Spaces between two columns of a table."""


def print_csv(*tables: Table) -> None:
    """Print tables of the same rows as one, side by side, without what the first has already (the row's number)."""
    columns = [column for k, table in enumerate(tables) for column in table.columns[1 if k else 0 :]]
    rows = csv.writer(sys.stdout, lineterminator="\n")
    rows.writerow([str(column.header) for column in columns])
    rows.writerows(zip(*(column.cells for column in columns), strict=True))


def print_table(table: Table, stream: TextIO | None = None) -> None:
    """Print to stdout (or `stream`), in colour only at a terminal. A table too wide for it continues below."""
    stream = stream or sys.stdout
    if stream.isatty():
        console = Screen(stream)
        for k, part in enumerate(_fitting(table, console.width)):
            console.print(part, new_line_start=k > 0)
        return
    text = StringIO()
    Screen(text, width=PIPE_WIDTH).print(table)
    print("\n".join(line.rstrip() for line in text.getvalue().splitlines()), file=stream)


def _fitting(table: Table, width: int) -> list[Table]:
    """Cut a table between columns into parts that fit; each begins with the first column."""
    cells = [list(column.cells) for column in table.columns]

    def part(columns: list[int]) -> Table:
        cut = Table(box=table.box, pad_edge=table.pad_edge, show_edge=table.show_edge)
        for i in columns:
            column = table.columns[i]
            cut.add_column(column.header, justify=column.justify, no_wrap=column.no_wrap)
        for row in zip(*(cells[i] for i in columns), strict=True):
            cut.add_row(*row)
        return cut

    needed = [_narrowest(column, texts) for column, texts in zip(table.columns, cells, strict=True)]
    parts = [[0]]
    for i in range(1, len(table.columns)):
        columns = [*parts[-1], i]
        fits = sum(needed[k] for k in columns) + COLUMN_GAP * (len(columns) - 1) <= width
        if fits or len(parts[-1]) == 1:
            parts[-1].append(i)
        else:
            parts.append([0, i])
    return [part(columns) for columns in parts]


def _narrowest(column: Column, cells: Sequence[RenderableType]) -> int:
    texts = [str(text) for text in (column.header, *cells)]
    return max(cell_len(word) for text in texts for word in ([text] if column.no_wrap else [*text.split(), ""]))


def make_table(*columns: str, left: tuple[str, ...] = ()) -> Table:
    """An empty table in our style; columns are aligned to the right, and not wrapped, except those `left`."""
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, show_edge=False)
    for column in columns:
        table.add_column(column, justify="left" if column in left else "right", no_wrap=column not in left)
    return table


def segments_table(segments: Sequence[Segment], units: Units = SI) -> Table:
    """The paper's Table I: samples first to last, what happens, how long from the first to the last."""
    table = make_table("samples", "what happens", f"time ({units.time})", left=("what happens",))
    for segment in segments:
        table.add_row(f"{segment.start}-{segment.stop - 1}", segment.description, *units.times(1e-3 * segment.ms))
    return table


def keyframes_table(keyframes: Sequence[Keyframe], units: Units = SI, inside: Array | None = None) -> Table:
    """The sensor's pose in nav at each stop; sigma is the largest over the axes, blank where unknown.

    Where the tracker doubts that the hand stood still, a column says how sure it is; another one, with `inside` (k,),
    how likely the tool is within its tolerance; and one names the things that keyframes belong to.
    """
    m, deg, fine = units.length, units.angle_sign, units.finer
    position, turn = (f"x ({m})", f"y ({m})", f"z ({m})"), (f"roll ({deg})", f"pitch ({deg})", f"yaw ({deg})")
    label = ("label",) if any(keyframe.label for keyframe in keyframes) else ()
    sigmas = (f"σ ({fine.length})", f"σ ({deg})")
    doubted = ("a stop?",) if any(keyframe.weight < DOUBTED_WEIGHT for keyframe in keyframes) else ()
    within = () if inside is None else ("within (%)",)
    thing = ("belongs to",) if any(keyframe.frames for keyframe in keyframes) else ()
    table = make_table(
        *("#", f"t ({units.time})", f"dwell ({units.time})", *position, *turn, *sigmas, *doubted, *within, "grip"),
        *(*label, *thing),
        left=(*label, *thing),
    )
    by_keyframe = keyframe_sigmas([keyframe.cov for keyframe in keyframes])
    for index, (keyframe, sigma) in enumerate(zip(keyframes, by_keyframe, strict=True)):
        table.add_row(
            str(index),
            *units.times((keyframe.t, keyframe.dwell_s)),
            *units.lengths(keyframe.T_nav_sensor.p),
            *units.angles(quat_to_rpy(keyframe.T_nav_sensor.wxyz)),
            *fine.lengths(np.fmax.reduce(sigma[:3]), finer=1),
            *units.angles(np.fmax.reduce(sigma[3:])),
            *((f"{100.0 * keyframe.weight:.0f} %" if keyframe.weight < DOUBTED_WEIGHT else "",) if doubted else ()),
            *(() if inside is None else (f"{100.0 * inside[index]:.0f}",)),
            {True: "closes", False: "opens", None: ""}[keyframe.grip],
            *((keyframe.label,) if label else ()),
            *((" on ".join(keyframe.frames),) if thing else ()),
        )
    return table


def joints_table(joint_names: Sequence[str], rows: Sequence[Mapping[str, Any]], units: Units = SI) -> Table:
    """The tool's position in base and the joints, at each keyframe."""
    m, deg = units.length, units.angle_sign
    table = make_table(
        "#", f"tool x ({m})", f"tool y ({m})", f"tool z ({m})", *(f"{name} ({deg})" for name in joint_names)
    )
    for row in rows:
        table.add_row(str(row["index"]), *units.lengths(row["base_position_m"]), *units.angles(row["joints"]))
    return table


def robots_table(robots: Sequence[Robot], reach_m: Sequence[float], units: Units = SI) -> Table:
    """Table of robots: name, joints, reach, gripper, assumed limits, description."""
    table = make_table(
        "name",
        "joints",
        f"reach ({units.length})",
        "gripper",
        "assumed limits",
        "what it is",
        left=("name", "gripper", "assumed limits", "what it is"),
    )
    for robot, reach in zip(robots, reach_m, strict=True):
        gripper = "none" if robot.gripper is None else ", ".join(robot.gripper.joints) or "not in the model"
        assumed = ", ".join(robot.limits.assumed) or "none"
        table.add_row(
            robot.name, str(len(robot.joints)), *units.lengths(reach, finer=-1), gripper, assumed, robot.description
        )
    return table


def left_out_table(pairs: Sequence[tuple[str, str, str]]) -> Table:
    """Pairs of links that aren't checked against each other, each with the reason."""
    columns = ("link", "and link", "why")
    table = make_table(*columns, left=columns)
    for pair in pairs:
        table.add_row(*pair)
    return table


def columns_table(read: Sequence[Mapping[str, str]], unread: Mapping[str, str]) -> Table:
    """What an import made of each column, and the columns that it left out."""
    columns = ("column", "read as", "quantity", "unit", "decided by")
    table = make_table(*columns, left=columns)
    for row in read:
        cells = (printable(row["column"]), row["read_as"], row["quantity"], row["unit"], row["decided_by"])
        table.add_row(*map(Text, cells))
    for name, why in unread.items():
        table.add_row(Text(printable(name)), "not read", "", "", why)
    return table


def ports_table(rows: Sequence[Mapping[str, Any]]) -> Table:
    """Serial ports, and what was heard there."""
    heard = any("sensor" in row for row in rows)
    columns = ("port", "device", "USB id", *(("speaks", "baud", "") if heard else ()))
    table = make_table(*columns, left=columns)
    for row in rows:
        said = (row["sensor"] or "", str(row["baud"] or ""), row["note"]) if heard else ()
        table.add_row(row["port"], row["title"], row["usb"], *said)
    return table


def sensors_table(rows: Sequence[Mapping[str, Any]]) -> Table:
    """Kinds of sensors, by the name that `pbd record --sensor` takes."""
    columns = ("--sensor", "device", "gives")
    table = make_table(*columns, left=columns)
    for row in rows:
        table.add_row(row["sensor"], row["title"], row["gives"])
    return table
