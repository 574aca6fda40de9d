"""Reading and writing a demonstration's folder: demo.toml, imu.csv and, optionally, truth.csv and keyframes.toml."""

import fcntl
import os
import shlex
from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from pbd.data import Contact, Demonstration, GraspedObject, GripEvent, Place, Recording, RecordingInfo, Truth
from pbd.data.imu_columns import ACC, IMU_COLUMNS, compass_from_rpy, rpy_from_compass
from pbd.errors import RecordingError, UsageError
from pbd.files.calibration import read_shape
from pbd.files.find_by_name import find
from pbd.files.keyframes import KEYFRAMES_FILE, read_keyframes, read_touch_ups
from pbd.files.set_aside_demos import is_set_aside, why_kept
from pbd.files.table import Table, open_sheet, write_table
from pbd.io.atomic import atomic_folder, is_file, is_folder, may_write, refuse_folder, refuse_name
from pbd.io.toml import FORMAT, Section, instant_of, read_toml
from pbd.pose import Array

UNDATED = "0001-01-01"
"""Date that stands for a missing one. Demonstrations without a date come after those with one."""
RATE_BOUNDS_HZ = (1e-6, 1e6)
"""Lowest and highest rate of a recording that a file may give, Hz: a sample in eleven days; faster than any sensor."""
TRUTH_COLUMNS = ("t", "px", "py", "pz", "qw", "qx", "qy", "qz")
"""Columns of truth.csv: s, m, and a unit quaternion."""

Claim = TypeVar("Claim", Place, Contact)


def load_demo(name: str | Path, edited: bool = True) -> Demonstration:
    """Load a demonstration: a name (./demos, then the bundled ones), a folder, or a file that an importer knows.

    Args:
        edited: read keyframes.toml too, whose keyframes replace those that tracking finds.

    Raises:
        RecordingError: none has that name (the valid names are listed), or it can't be read.
    """
    path = find("demos", name, RecordingError)
    if path.is_dir():
        return read_demo(path, edited)
    from pbd.files.importers import import_file

    return import_file(path)


def newest_demo(failed: bool = False) -> str:
    """Return the name of the default demonstration: the newest recorded one in ./demos, else the bundled `pouring`.

    One that was set aside is never the default; one whose recording failed, only with `failed`.
    """
    recorded: list[tuple[datetime, str]] = []
    for file in Path("demos").glob("*/demo.toml"):
        with suppress(RecordingError):
            top = read_toml(file, RecordingError)
            left_out = top.flag("bundled", False) or (top.flag("failed", False) and not failed)
            if not left_out and not is_set_aside(file.parent):
                recorded.append((instant_of(top.date("created", UNDATED)), file.parent.name))
    return max(recorded)[1] if recorded else "pouring"


def read_demo(folder: Path, edited: bool = True) -> Demonstration:
    """Read a demonstration's folder, with keyframes.toml if `edited`; a RecordingError tells file, line, column."""
    info, grip, optional = read_demo_toml(folder)
    if takes := optional["takes"]:
        recording = replace(takes[0].recording, info=info)
    else:
        _refuse_without(folder, "imu.csv")
        recording = _read_recording(open_sheet(folder / "imu.csv").read(), grip, info)
    if os.path.lexists(truth := folder / "truth.csv"):
        values = open_sheet(truth).read().columns(*TRUTH_COLUMNS)
        optional["truth"] = Truth(values[:, 0], values[:, 1:4], values[:, 4:])
    if edited and os.path.lexists(file := folder / KEYFRAMES_FILE):
        optional |= {"keyframes": read_keyframes(file), "touch_ups": read_touch_ups(file)}
    return Demonstration(recording, folder=folder, **optional)


def read_demo_toml(folder: Path) -> tuple[RecordingInfo, tuple[GripEvent, ...], dict[str, Any]]:
    """Read demo.toml alone: the recording's info, the grip's events, and other arguments of `Demonstration`."""
    _refuse_without(folder, "demo.toml")
    top = read_toml(folder / "demo.toml", RecordingError)
    top.require_format()
    top.text("name")  # the folder's name is used: a copy has another one
    info = RecordingInfo(
        name=utf8_name(os.path.basename(os.path.abspath(folder))),  # noqa: PTH100, PTH119 (a link's own name, "." too)
        sensor=top.text("sensor"),
        rate_hz=top.number("rate_hz", None, positive=True, within=RATE_BOUNDS_HZ[1]),
        created=top.date("created", None),
        clock=top.text("clock", ""),
    )
    grip = tuple(GripEvent(event.number("t_s"), event.flag("closed")) for event in top.tables("grip"))
    grasped = top.section("object", None)
    optional: dict[str, Any] = {
        "notes": top.text("notes", ""),
        "bundled": top.flag("bundled", False),
        "closed": top.flag("closed", False),
        "failed": top.flag("failed", False),
        "places": tuple(
            _claim(each, Place, each.numbers("t_s", None), each.lengths("position_m", 3, None))
            for each in top.tables("place")
        ),
        "contacts": tuple(
            _claim(each, Contact, each.number("t_s"), each.number("as_at_s", None), each.length("height_m"))
            for each in top.tables("contact")
        ),
        "grasped": grasped and GraspedObject(*read_shape(grasped), grasped.number("mass_kg", None, positive=True)),
    }
    takes = _read_takes(top.tables("take"), folder)
    if takes and grip:
        step = f"remove it; correct theirs, or save and edit {KEYFRAMES_FILE}"
        top.tables("grip")[0].fail("t_s", "is not used, only its takes' are", step)
    top.refuse_unread()
    return info, grip, optional | {"takes": takes}


def _refuse_without(folder: Path, name: str) -> None:
    if not (folder / name).is_file():
        inside = min(folder.glob("*/demo.toml"), default=None)
        other = "name another" if inside is None else f"name one that is in it, such as {inside.parent}"
        if inside is None and name == "demo.toml":
            bring = f"bring it in with pbd import {shlex.quote(str(folder))} NAME"
            other = f"if another program recorded it, {bring}; else name another"
        raise RecordingError(f"{folder} is not a demonstration: it has no {name}; {other}", path=folder)


def _read_takes(sections: Sequence[Section], folder: Path) -> tuple[Demonstration, ...]:
    """Read the takes of a fused demonstration; `demo` is a take's path relative to `folder`."""
    takes: list[Demonstration] = []
    for section in sections:
        take = folder / section.text("demo")
        if not (take / "demo.toml").is_file():
            section.fail("demo", f"names {take}, where there is no demonstration", "copy it there, or correct this")
        if "take" in read_toml(take / "demo.toml", RecordingError):
            section.fail("demo", f"names {take}, which is made of takes itself", "list its takes here instead")
        takes.append(read_demo(take))
    if len(takes) == 1:
        sections[0].fail("demo", "is the only [[take]]", "add another, or use that demonstration as it is")
    return tuple(takes)


def write_demo(
    demo: Demonstration, folder: Path, force: bool = False, extra_files: Mapping[str, str] | None = None
) -> None:
    """Write a demonstration's folder atomically.

    Args:
        force: replace a demonstration of that name. If something of a person would be lost (`why_kept`), it is kept
            under another name.
        extra_files: name -> text of further files, which tracking does not read.

    Raises:
        RecordingError: the folder exists (without `force`), is one of the demonstration's takes, or can't be written;
            or a take has no folder.
    """
    refuse_unwritable_fused(demo, folder)
    refuse_demo_folder(folder, force)
    with atomic_folder(folder, replace=force, why_kept=why_kept) as new:
        for name, text in ({"demo.toml": demo_toml(demo, folder)} | dict(extra_files or {})).items():
            (new / name).write_text(text, encoding="utf-8")
        if not demo.takes:
            header, decimals = imu_header(channels := demo.recording.channels)
            write_table(new / "imu.csv", header, imu_rows(demo.recording, channels), decimals)
        if demo.truth is not None:
            values = np.column_stack((demo.truth.t, demo.truth.p_nav_sensor, demo.truth.wxyz_nav_sensor))
            write_table(new / "truth.csv", TRUTH_COLUMNS, values, (6,) * 4 + (8,) * 4)


def refuse_demo_folder(folder: Path, force: bool) -> None:
    """Refuse (RecordingError) a path that can't be written or exists. With `force`, a demonstration may exist there."""
    if not os.path.lexists(folder):
        return refuse_folder(folder, RecordingError)
    if not force:
        raise RecordingError(f"{folder} exists; give another name, or --force to replace it", path=folder)
    if is_file(folder):
        raise RecordingError(f"{folder} can't be written (a file is there); give another place", path=folder)
    if is_folder(folder) and not may_write(folder):
        raise RecordingError(f"{folder} is read-only; change its permissions, or give another name", path=folder)
    if is_folder(folder) and not (folder / "demo.toml").is_file():
        raise RecordingError(f"{folder} is not a demonstration, so it is not replaced; give another name", path=folder)
    with suppress(OSError), (folder / "imu.csv").open() as imu:
        try:
            fcntl.flock(imu, fcntl.LOCK_SH | fcntl.LOCK_NB)
        except BlockingIOError:  # RecordingWriter holds the lock while it records
            what = f"{folder} is being recorded; end that first, or give another name"
            raise RecordingError(what, path=folder) from None
    return refuse_folder(folder.parent, RecordingError)


def refuse_unwritable_fused(demo: Demonstration, folder: Path) -> None:
    """Refuse (RecordingError) to write a fused demonstration over a recording, or with a take that has no folder."""
    if (alone := next((take for take in demo.takes if take.folder is None), None)) is not None:
        name = alone.recording.info.name
        raise RecordingError(f"'{name}' is no demonstration's folder, so it can't be a take; `pbd import` it first")
    if demo.takes and is_file(folder / "imu.csv"):
        what = f"{folder} is a recording, which would be lost; give the fused demonstration another name"
        raise RecordingError(what, path=folder)


def demo_folder(name: str) -> Path:
    """Return the path of a new demonstration: ./demos/NAME, or a given path, which has a slash.

    Raises:
        RecordingError: it can't be a name.
    """
    path = Path(name)
    if path.name in ("", "..") or name.startswith(("~", "-")):
        raise RecordingError(f"'{name}' can't be a demonstration's name; give a word, or a folder's path", value=name)
    return path if "/" in name else Path("demos") / path


def shell_word(folder: Path) -> str:
    """Return a demonstration's name, or its path outside ./demos, quoted for a shell."""
    word = folder.name if folder.parent == Path("demos") else str(folder)
    return shlex.quote(f"./{folder}" if word[0] in "-~" or len(folder.parts) == 1 else word)


def utf8_name(name: str) -> str:
    """Return a file's name as text; bytes that are not UTF-8 become escapes."""
    return os.fsencode(name).decode("utf-8", "backslashreplace")


def demo_toml(demo: Demonstration, folder: Path) -> str:
    """Return the text of demo.toml, in which the takes' paths are relative to the `folder` that it will be in."""
    import tomlkit

    recording, info, grasped = demo.recording, demo.recording.info, demo.grasped
    rate_hz = info.rate_hz or (recording.rate_hz if len(recording) > 1 else None)
    values: dict[str, Any] = {
        "format": FORMAT,
        "name": folder.name,
        "created": info.created,
        "sensor": info.sensor if info.sensor.strip() else "unknown",
        "clock": info.clock,
        "rate_hz": rate_hz and float(f"{rate_hz:.6g}"),
        "notes": demo.notes.strip() and demo.notes,
        "bundled": demo.bundled,
        "closed": demo.closed,
        "failed": demo.failed,
        "object": grasped and _without_none(shape=grasped.shape, size=grasped.size, mass_kg=grasped.mass),
        "take": [{"demo": _relative_path(folder, take)} for take in demo.takes],
        "grip": [{"t_s": round(event.t, 4), "closed": event.closed} for event in recording.grip if not demo.takes],
        "place": [_without_none(t_s=p.t, position_m=p.p_base_tool, sigma_m=p.sigma_m) for p in demo.places],
        "contact": [
            _without_none(t_s=c.t, as_at_s=c.as_at, height_m=c.height, sigma_m=c.sigma_m) for c in demo.contacts
        ],
    }
    return tomlkit.dumps({key: value for key, value in values.items() if value})


def _relative_path(folder: Path, take: Demonstration) -> str:
    assert take.folder is not None
    refuse_name(take.folder)  # demo.toml can't hold it
    return Path(os.path.relpath(take.folder.resolve(), folder.resolve())).as_posix()


def _without_none(**values: Any) -> dict[str, Any]:
    """Remove None, and turn tuples, which TOML doesn't have, into lists."""
    return {key: list(x) if isinstance(x, tuple) else x for key, x in values.items() if x is not None}


def _read_recording(table: Table, grip: tuple[GripEvent, ...], info: RecordingInfo) -> Recording:
    t = table.columns("t")[:, 0]
    given = {name: columns for name, (columns, _) in IMU_COLUMNS.items() if {*columns} & {*table.header}}
    channels = {name: table.columns(*columns) for name, columns in ({"acc": ACC} | given).items()}
    if "device_rpy" in channels:
        channels["device_rpy"] = rpy_from_compass(channels["device_rpy"])
    return Recording(t, grip=grip, info=info, **channels)


def imu_header(channels: Collection[str]) -> tuple[tuple[str, ...], tuple[int, ...]]:
    """Return the columns of an imu.csv with these channels: names, and numbers of decimals."""
    written = [IMU_COLUMNS[name] for name in IMU_COLUMNS if name in channels]
    header = ("t", *(column for columns, _ in written for column in columns))
    return header, (6, *(decimals for columns, decimals in written for _ in columns))


def imu_rows(recording: Recording, channels: Collection[str]) -> Array:
    """Return the rows (n, columns) of an imu.csv with these channels; NaN for a channel that the recording lacks."""
    values = dict.fromkeys(channels, np.full((len(recording), 3), np.nan)) | recording.channels
    if recording.device_rpy is not None:
        values["device_rpy"] = compass_from_rpy(recording.device_rpy)
    return np.hstack((recording.t[:, None], *(values[name] for name in IMU_COLUMNS if name in channels)))


def _claim(section: Section, kind: Callable[..., Claim], *values: Any) -> Claim:
    """Make a Place or a Contact. Its UsageError becomes the file's error, with the file's keys."""
    sigma_m = section.number("sigma_m", None, positive=True)
    try:
        return kind(*values, sigma_m)
    except UsageError as reason:
        words = reason.message.partition(" ")[2].replace("p_base_tool", "position_m")
        section.fail("t_s", words.replace("as_at", "as_at_s").replace("height", "height_m"))
