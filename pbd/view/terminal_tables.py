"""Tables that the commands print."""

import csv
import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from io import StringIO
from typing import Any, TextIO

import numpy as np
from rich import box
from rich.cells import cell_len
from rich.table import Column, Table
from rich.text import Text

from pbd.data import HandSegment, Keyframe, Robot
from pbd.data.covariance import keyframe_sigmas
from pbd.data.tracking import DOUBTED_WEIGHT
from pbd.errors import printable
from pbd.pose import Array, quat_to_rpy
from pbd.view.safe_console import SafeConsole
from pbd.view.terminal import escaped
from pbd.view.units import Units

COLUMN_GAP, NARROW_GAP = 3, 2
"""Characters between two columns of a table, and of one that is made narrow for the terminal."""


def print_csv(*tables: Table) -> None:
    """Print tables of the same rows side by side, as one; the row's number, their first column, is printed once."""
    columns = [column for k, table in enumerate(tables) for column in table.columns[1 if k else 0 :]]
    rows = csv.writer(sys.stdout, lineterminator="\n")
    rows.writerow([str(column.header) for column in columns])
    rows.writerows(zip(*(column.cells for column in columns), strict=True))


def print_table(table: Table, stream: TextIO | None = None) -> None:
    """Print to stdout (or `stream`), in colour only at a terminal. A table wider than the terminal continues below."""
    stream = stream or sys.stdout
    for column in table.columns:
        column.header = _writable(str(column.header), stream)
    if stream.isatty():
        console = SafeConsole(stream)
        for k, part in enumerate(_fitting(table, console.width)):
            console.print(part, new_line_start=k > 0)
        return
    text = StringIO()
    SafeConsole(text, width=200).print(table)  # rows stay on one line for programs that read them
    print(_writable("\n".join(line.rstrip() for line in text.getvalue().splitlines()), stream), file=stream)


def _writable(text: str, stream: TextIO) -> str:
    try:
        text.encode(stream.encoding or "utf-8")
    except UnicodeEncodeError:
        spelled = str.maketrans({"σ": "sigma", "°": "deg", "±": "+-", "─": "-"})
        return text.translate(spelled)
    return text


def _fitting(table: Table, width: int) -> list[Table]:
    """Return a table that fits unwrapped, or a narrow one, split between columns into parts that fit.

    Each part begins with the first column. A column whose longest word leaves no room for others is folded.
    """
    if sum(max(map(cell_len, _lines(column))) + COLUMN_GAP for column in table.columns) - COLUMN_GAP <= width:
        return [table]
    # Each word of a header may have a line of its own.
    first, *others = (replace(column, header=str(column.header).replace(" ", "\n")) for column in table.columns)
    widest = max(width - NARROW_GAP - max(map(_narrowest, others), default=0), (width - NARROW_GAP) // 2)
    parts = [[first]]
    for column in others:
        wider = [*parts[-1], column]
        if len(wider) == 2 or sum(min(_narrowest(each), widest) + NARROW_GAP for each in wider) - NARROW_GAP <= width:
            parts[-1] = wider
        else:
            parts.append([first, column])
    return [_rebuilt(part, [min(_narrowest(column), widest) for column in part], width) for part in parts]


def _rebuilt(columns: Sequence[Column], least: Sequence[int], width: int) -> Table:
    """Return a table of these columns. Each has its least width, and its share of what is left of the terminal's."""
    lines = [_lines(column) for column in columns]
    wanted = [max(map(cell_len, each)) - narrowest for each, narrowest in zip(lines, least, strict=True)]
    left_over = width - sum(least) - NARROW_GAP * (len(columns) - 1)
    share = min(left_over / max(sum(wanted), 1), 1.0)
    headers, left = [str(column.header) for column in columns], [str(c.header) for c in columns if not c.no_wrap]
    cells: list[list[Any]] = [list(column.cells) for column in columns]
    table = make_table(*headers, left=left, rows=zip(*cells, strict=True))
    table.collapse_padding = True  # NARROW_GAP
    for column, narrowest, more in zip(table.columns, least, wanted, strict=True):
        column.overflow, column.no_wrap = "fold", False
        column.width = narrowest + int(share * more)
        one_line = str(column.header).replace("\n", " ")
        column.header = one_line if cell_len(one_line) <= column.width else column.header
    return table


def _narrowest(column: Column) -> int:
    return max(
        cell_len(word) for line in _lines(column) for word in ([line] if column.no_wrap else [*line.split(), ""])
    )


def _lines(column: Column) -> list[str]:
    return [escaped(line) for text in (column.header, *column.cells) for line in str(text).split("\n")]


def make_table(*columns: str, left: Sequence[str] = (), rows: Iterable[Iterable[str | Text]] = ()) -> Table:
    """A table in our style. Columns are right-aligned and not wrapped; those in `left` are left-aligned and wrapped."""
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, show_edge=False)
    for column in columns:
        table.add_column(column, justify="left" if column in left else "right", no_wrap=column not in left)
    for row in rows:
        table.add_row(*row)
    return table


def words_table(columns: Sequence[str], rows: Iterable[Iterable[str | Text]]) -> Table:
    """A table of words: all columns are left-aligned."""
    return make_table(*columns, left=columns, rows=rows)


def segments_table(segments: Sequence[HandSegment], units: Units) -> Table:
    """The paper's Table I: first and last sample, kind of motion, and duration of each segment."""
    rows = ((f"{each.start}-{each.stop - 1}", each.description, *units.times(1e-3 * each.ms)) for each in segments)
    return make_table("samples", "what happens", f"time ({units.time})", left=("what happens",), rows=rows)


def keyframes_table(keyframes: Sequence[Keyframe], units: Units, inside: Array | None) -> Table:
    """The sensor's pose in nav at each stop. Sigma is the largest over the axes, blank where it is unknown.

    Columns that apply to no keyframe are left out: the probability of a stop where the tracker doubts it, that of the
    tool within its tolerance, `inside` (k,), the label, and the objects that keyframes belong to.
    """
    deg, fine = units.angle_sign, units.finer
    sigma = keyframe_sigmas([each.cov for each in keyframes])
    grips = {True: "closes", False: "opens", None: ""}
    columns = {"#": [str(k) for k in range(len(keyframes))]}
    columns[f"t ({units.time})"] = units.times([each.t for each in keyframes])
    columns[f"dwell ({units.time})"] = units.times([each.dwell_s for each in keyframes])
    for axis, values in zip("xyz", np.array([each.T_nav_sensor.p for each in keyframes]).reshape(-1, 3).T, strict=True):
        columns[f"{axis} ({units.length})"] = units.lengths(values)
    rpy = np.array([quat_to_rpy(each.T_nav_sensor.wxyz) for each in keyframes]).reshape(-1, 3)
    for turn, values in zip(("roll", "pitch", "yaw"), rpy.T, strict=True):
        columns[f"{turn} ({deg})"] = units.angles(values)
    columns[f"σ ({fine.length})"] = fine.lengths(np.fmax.reduce(sigma[:, :3], axis=1), finer=1)
    columns[f"σ ({deg})"] = units.angles(np.fmax.reduce(sigma[:, 3:], axis=1))
    weights = (each.weight for each in keyframes)
    columns["a stop?"] = [f"{100.0 * weight:.0f} %" if weight < DOUBTED_WEIGHT else "" for weight in weights]
    columns["within (%)"] = [] if inside is None else [f"{100.0 * share:.0f}" for share in inside]
    columns["grip"] = [grips[each.grip] for each in keyframes]
    columns["label"] = [each.label for each in keyframes]
    columns["belongs to"] = [" on ".join(each.frames) for each in keyframes]
    for name in ("a stop?", "within (%)", "label", "belongs to"):
        if not any(columns[name]):
            del columns[name]
    return make_table(*columns, left=("label", "belongs to"), rows=zip(*columns.values(), strict=True))


def joints_table(
    joint_names: Sequence[str], rows: Sequence[Mapping[str, Any]], units: Units, slides: Sequence[bool]
) -> Table:
    """The tool's position in base and the joints, at each keyframe; `slides` says which joints are sliding ones."""
    columns = {"#": [str(row["index"]) for row in rows]}
    for axis, values in zip("xyz", np.array([row["base_position_m"] for row in rows]).reshape(-1, 3).T, strict=True):
        columns[f"tool {axis} ({units.length})"] = units.lengths(values)
    joints = np.array([row["joints"] for row in rows]).reshape(-1, len(joint_names)).T
    for name, values, sliding in zip(joint_names, joints, slides, strict=True):
        unit, written = (units.length, units.lengths) if sliding else (units.angle_sign, units.angles)
        columns[f"{name} ({unit})"] = written(values)
    return make_table(*columns, rows=zip(*columns.values(), strict=True))


def robots_table(robots: Sequence[Robot], reach_m: Sequence[float], files: Sequence[str], units: Units) -> Table:
    """Robots: name, number of joints, reach, gripper, assumed limits, description; the file of one not bundled."""
    own = ["" if file == "bundled" else file for file in files]
    words = ("gripper", "assumed limits", "what it is", *(("file",) if any(own) else ()))
    rows = []
    for robot, reach, file in zip(robots, reach_m, own, strict=True):
        gripper = "none" if robot.gripper is None else ", ".join(robot.gripper.joints) or "not in the model"
        assumed = ", ".join(robot.limits.assumed) or "none"
        size = str(len(robot.joints)), *units.lengths(reach, finer=-1)
        rows.append((robot.name, *size, gripper, assumed, robot.description, *((file,) if any(own) else ())))
    return make_table("name", "joints", f"reach ({units.length})", *words, left=("name", *words), rows=rows)


def columns_table(read: Sequence[Mapping[str, str]], unread: Mapping[str, str]) -> Table:
    """How an import read each column, and which columns it did not read."""
    rows = [(printable(row["column"]), row["read_as"], row["quantity"], row["unit"], row["decided_by"]) for row in read]
    rows += [(printable(name), "not read", "", "", why) for name, why in unread.items()]
    return words_table(("column", "read as", "quantity", "unit", "decided by"), (map(Text, row) for row in rows))


def ports_table(rows: Sequence[Mapping[str, Any]]) -> Table:
    """Serial ports, and the sensors that were found there."""
    shown = {"port": "port", "device": "title", "USB id": "usb"}
    if any("sensor" in row for row in rows):
        shown |= {"speaks": "sensor", "baud": "baud", "remarks": "note"}
    return words_table(list(shown), ([str(row[key] or "") for key in shown.values()] for row in rows))
