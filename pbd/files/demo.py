"""A demonstration's folder: demo.toml, imu.csv and, where they are there, truth.csv and keyframes.toml."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path
from types import MappingProxyType

import numpy as np

from pbd.data import Contact, Demonstration, GraspedObject, GripEvent, Place, Recording, RecordingInfo, Truth
from pbd.errors import RecordingError
from pbd.files import keyframes
from pbd.files.columns import ACC, DEVICE, GYR, MAG, compass_angles, device_rpy
from pbd.files.library import find
from pbd.files.table import Table, read_table, write_table
from pbd.files.toml import Section, read_toml
from pbd.files.whole import folder_written_whole, try_folder, unwritable
from pbd.paths import is_file, is_folder, is_plain, is_taken, may_write
from pbd.pose import Array

FORMAT = 1
SHAPES = {"box": 3, "cylinder": 2, "sphere": 1}
"""Shapes of a grasped object and how many sizes each takes."""

RATES_HZ = (1e-6, 1e6)
"""Slowest and fastest rate of a recording: a sample in eleven days; faster than any sensor."""

TRUTH = ("t", "px", "py", "pz", "qw", "qx", "qy", "qz")


def load_demo(name: str) -> Demonstration:
    """Load a demonstration: a name (./demos, then the bundled ones), a folder, or a file that an importer knows.

    Raises:
        RecordingError: nothing of that name (the valid ones are listed), or what is there can't be read.
    """
    path = find("demos", name, "", RecordingError)
    if path.is_dir():
        return read_demo(path)
    from pbd.files.importers import import_file

    return import_file(path)


def newest_demo() -> str:
    """Name the demonstration meant where none is named: the newest in ./demos, else the bundled `pouring`."""
    own = [folder.parent for folder in Path("demos").glob("*/demo.toml")]
    recorded = [demo for demo in map(_created, own) if demo is not None]
    return max(recorded)[1] if recorded else "pouring"


def _created(folder: Path) -> tuple[str, str] | None:
    """When a demonstration was made, and its name; None where it is bundled or unreadable."""
    try:
        top = read_toml(folder / "demo.toml", RecordingError)
        return None if "bundled" in top and top.flag("bundled") else (top.text("created"), folder.name)
    except RecordingError:
        return None


def read_demo(folder: Path) -> Demonstration:
    """Read a demonstration's folder.

    Raises:
        RecordingError: with the file, and line and column where they are known.
    """
    for name in ("demo.toml", "imu.csv"):
        if not (folder / name).is_file():
            raise RecordingError(f"{folder} is not a demonstration: it has no {name}; name another", path=folder)
    top = read_toml(folder / "demo.toml", RecordingError)
    if top.number("format") != FORMAT:
        top.fail("format", f"must be {FORMAT}, the only format that this version reads")
    info = RecordingInfo(
        name=top.text("name"),
        sensor=top.text("sensor"),
        rate_hz=_rate(top) if "rate_hz" in top else None,
        created=top.text("created") if "created" in top else None,
        clock=top.text("clock") if "clock" in top else "",
    )
    grip = tuple(GripEvent(event.number("t_s"), event.flag("closed")) for event in top.tables("grip"))
    notes = top.text("notes") if "notes" in top else ""
    is_bundled = top.flag("bundled") if "bundled" in top else False
    closed = top.flag("closed") if "closed" in top else False
    places = tuple(map(_read_place, top.tables("place")))
    contacts = tuple(map(_read_contact, top.tables("contact")))
    grasped = _read_object(top.section("object")) if "object" in top else None
    top.done()

    truth, edited = folder / "truth.csv", folder / keyframes.NAME
    return Demonstration(
        recording=_read_recording(read_table(folder / "imu.csv"), grip, info),
        truth=_read_truth(read_table(truth)) if is_taken(truth) else None,
        keyframes=keyframes.read_keyframes(edited) if is_taken(edited) else None,
        notes=notes,
        bundled=is_bundled,
        closed=closed,
        places=places,
        contacts=contacts,
        grasped=grasped,
        folder=folder,
    )


def write_demo(
    demo: Demonstration, folder: Path, force: bool = False, beside: Mapping[str, str] = MappingProxyType({})
) -> None:
    """Write a demonstration's folder; nothing is there under its name before it is complete.

    Args:
        demo: what is written.
        folder: where.
        force: replace a demonstration of that name.
        beside: files of the folder that tracking doesn't read, as text by name.

    Raises:
        RecordingError: the folder exists (unless `force`), or can't be written.
    """
    may_be_written(folder, force)
    with folder_written_whole(folder) as new:
        (new / "demo.toml").write_text(demo_toml(demo, folder.name), encoding="utf-8")
        write_table(new / "imu.csv", *_imu_columns(demo.recording))
        for name, text in beside.items():
            (new / name).write_text(text, encoding="utf-8")
        if demo.truth is not None:
            values = np.column_stack((demo.truth.t, demo.truth.p_nav_sensor, demo.truth.wxyz_nav_sensor))
            write_table(new / "truth.csv", TRUTH, values, (6,) * 4 + (8,) * 4)


def may_be_written(folder: Path, force: bool) -> None:
    """Refuse to write over what is there, and where nothing can be written.

    Raises:
        RecordingError: the folder exists (unless `force`), or holds something that is no demonstration, or the system
            refuses it.
    """
    try:
        if is_taken(folder):
            _may_be_replaced(folder, force)
        try_folder(folder.parent)
    except OSError as reason:
        raise unwritable(folder, reason, RecordingError) from None


def _may_be_replaced(folder: Path, force: bool) -> None:
    if not force:
        raise RecordingError(f"{folder} exists; give another name, or --force to replace it", path=folder)
    if is_file(folder):
        raise RecordingError(f"{folder} can't be written (a file is there); give another place", path=folder)
    if is_folder(folder) and not may_write(folder):
        raise RecordingError(f"{folder} is read-only; change its permissions, or give another name", path=folder)
    if is_folder(folder) and not (folder / "demo.toml").is_file():
        raise RecordingError(f"{folder} is not a demonstration, so it is not replaced; give another name", path=folder)


def demo_folder(name: str) -> Path:
    """Say where a new demonstration goes: ./demos/NAME, or the path that was given.

    Raises:
        RecordingError: nothing could have that name.
    """
    path = Path(name)
    if path.name in ("", "..") or name.startswith("~") or not is_plain(name):
        raise RecordingError(f"'{name}' can't be a demonstration's name; give a word, or a folder's path", value=name)
    return path if len(path.parts) > 1 else Path("demos") / path


def utc_now() -> str:
    """Say when it is, in UTC, as demo.toml has it."""
    return datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")


def check_rate(path: Path, rate_hz: float, what: str) -> None:
    """Refuse a rate that no sensor has; `what` begins the message.

    Raises:
        RecordingError: it lies beyond RATES_HZ.
    """
    slowest, fastest = RATES_HZ
    if not slowest <= rate_hz <= fastest:
        bound = "above zero" if not rate_hz > 0.0 else f"{slowest:g} to {fastest:g} Hz"
        raise RecordingError(f"{path}: {what} {rate_hz:g}; it must be {bound}", path=path, value=rate_hz)


def _rate(section: Section) -> float:
    rate_hz = section.number("rate_hz", positive=True)
    if not RATES_HZ[0] <= rate_hz <= RATES_HZ[1]:
        section.fail("rate_hz", f"must be {RATES_HZ[0]:g} to {RATES_HZ[1]:g} Hz, got {rate_hz:g}")
    return rate_hz


def _read_recording(table: Table, grip: tuple[GripEvent, ...], info: RecordingInfo) -> Recording:
    def given(names: tuple[str, ...]) -> bool:
        return any(name in table.header for name in names)

    return Recording(
        t=table.columns("t")[:, 0],
        acc=table.columns(*ACC),
        gyr=table.columns(*GYR) if given(GYR) else None,
        mag=table.columns(*MAG) if given(MAG) else None,
        device_rpy=device_rpy(table.columns(*DEVICE)) if given(DEVICE) else None,
        grip=grip,
        info=info,
    )


def _imu_columns(recording: Recording) -> tuple[tuple[str, ...], Array, tuple[int, ...]]:
    header, parts, decimals = ["t"], [recording.t[:, None]], [6]

    def add(names: tuple[str, ...], values: Array | None, places: int) -> None:
        if values is not None:
            header.extend(names)
            parts.append(values)
            decimals.extend([places] * 3)

    add(GYR, recording.gyr, 7)
    add(ACC, recording.acc, 6)
    add(MAG, recording.mag, 4)
    if recording.device_rpy is not None:
        add(DEVICE, compass_angles(recording.device_rpy), 6)
    return tuple(header), np.hstack(parts), tuple(decimals)


def _read_truth(table: Table) -> Truth:
    values = table.columns(*TRUTH)
    return Truth(values[:, 0], values[:, 1:4], values[:, 4:])


def _read_object(section: Section) -> GraspedObject:
    shape = section.text("shape")
    if shape not in SHAPES:
        section.fail("shape", f"must be one of {', '.join(SHAPES)}, got '{shape}'")
    return GraspedObject(shape, section.numbers("size", SHAPES[shape], positive=True))


def _read_place(section: Section) -> Place:
    t, position = section.numbers("t_s", None), None
    if "position_m" in section:
        x, y, z = section.numbers("position_m", 3)
        position = (x, y, z)
    try:
        return Place(t, position, _optional(section, "sigma_m", positive=True))
    except ValueError as reason:
        section.fail("t_s", str(reason))


def _read_contact(section: Section) -> Contact:
    t, as_at, height = section.number("t_s"), _optional(section, "as_at_s"), _optional(section, "height_m")
    try:
        return Contact(t, as_at, height, _optional(section, "sigma_m", positive=True))
    except ValueError as reason:
        section.fail("t_s", str(reason))


def _optional(section: Section, key: str, positive: bool = False) -> float | None:
    return section.number(key, positive=positive) if key in section else None


def demo_toml(demo: Demonstration, name: str) -> str:
    """Write demo.toml's text."""
    import tomlkit

    recording = demo.recording
    document = tomlkit.document()
    document["format"] = FORMAT
    document["name"] = name
    if recording.info.created:
        document["created"] = recording.info.created
    document["sensor"] = recording.info.sensor if recording.info.sensor.strip() else "unknown"
    if recording.info.clock:
        document["clock"] = recording.info.clock
    if recording.info.rate_hz or len(recording) > 1:
        document["rate_hz"] = float(f"{recording.info.rate_hz or recording.rate_hz:.6g}")
    if demo.notes.strip():
        document["notes"] = demo.notes
    for key, value in (("bundled", demo.bundled), ("closed", demo.closed)):
        if value:
            document[key] = value
    if demo.grasped is not None:
        document["object"] = {"shape": demo.grasped.shape, "size": list(demo.grasped.size)}
    if recording.grip:
        document["grip"] = [{"t_s": round(event.t, 4), "closed": event.closed} for event in recording.grip]
    if demo.places:
        document["place"] = [_given(t_s=p.t, position_m=p.p_base_tool, sigma_m=p.sigma_m) for p in demo.places]
    if demo.contacts:
        document["contact"] = [
            _given(t_s=c.t, as_at_s=c.as_at, height_m=c.height, sigma_m=c.sigma_m) for c in demo.contacts
        ]
    return tomlkit.dumps(document)


def _given(**values: object) -> dict[str, object]:
    """Those that there are; TOML has no tuples."""
    given = {key: value for key, value in values.items() if value is not None}
    return {key: list(value) if isinstance(value, tuple) else value for key, value in given.items()}
