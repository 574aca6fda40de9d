"""Change keyframes.toml and leave the rest, comments and all, as a person wrote it."""

from __future__ import annotations

import fcntl
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

import tomlkit
from tomlkit import TOMLDocument

from pbd.data import TouchUp
from pbd.errors import RecordingError
from pbd.files.keyframes import read_keyframes
from pbd.io.atomic import atomic_file
from pbd.io.opening import read_text


def add_touch_up(path: Path, touch_up: TouchUp) -> None:
    """Append a touch-up to keyframes.toml; raises as `read_keyframes`."""
    table = tomlkit.table()
    table.add(tomlkit.comment("of `pbd touch`: where the tool was seen to belong, from where it was"))
    table["t_s"] = round(touch_up.t, 3)
    table["by_nav_m"] = [round(x, 5) + 0.0 for x in touch_up.by_nav_m.tolist()]
    if touch_up.only:
        table["only"] = True
    with _edited(path) as document:
        if "touch_up" not in document:
            document.add(tomlkit.nl())
            document["touch_up"] = tomlkit.aot()
        document["touch_up"].append(table)


def undo_touch_up(path: Path) -> None:
    """Mark the last touch-up that counts as undone; raises as `read_keyframes`."""
    with _edited(path) as document:
        for table in [each for each in document.get("touch_up", []) if not each.get("undone", False)][-1:]:
            table["undone"] = True


def set_frames(path: Path, frames: Mapping[int, Sequence[str]]) -> None:
    """Say to which things keyframes belong, by their number; raises as `read_keyframes`."""
    with _edited(path) as document:
        for number, names in frames.items():
            document["keyframe"][number]["frames"] = list(names)


@contextmanager
def _edited(path: Path) -> Iterator[TOMLDocument]:
    folder = os.open(path.parent, os.O_RDONLY)
    try:
        with suppress(OSError):  # some network folders know no locks
            fcntl.flock(folder, fcntl.LOCK_EX)  # another command may be at it
        document = tomlkit.parse(read_text(path, RecordingError, "give a text file"))
        yield document
        with atomic_file(path) as unfinished:
            unfinished.write_text(tomlkit.dumps(document), encoding="utf-8")
            read_keyframes(unfinished)  # never leave behind what can't be read
    finally:
        os.close(folder)
