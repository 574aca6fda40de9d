"""Where a command may write: tested before it plans, so that nobody waits for what can't be kept."""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path

from pbd.errors import PbdError
from pbd.files.whole import refuse_name, try_folder, unwritable
from pbd.paths import is_file, is_folder, is_taken, may_write

OF_A_DEMO = ("demo.toml", "imu.csv", "truth.csv", "keyframes.toml", "points.csv", "raw.bin")
"""What a demonstration's folder is made of: no result takes such a file's place."""


def refuse_place(file: Path, read: Iterable[str | None] = ()) -> None:
    """Refuse a file that can't be written, or must not be.

    Args:
        file: the result's.
        read: files that the command reads (other words are passed over).

    Raises:
        PbdError: it is a folder, its folder is missing or read-only, or what is there is no result: a file of a
            demonstration, a TOML file (a robot, a calibration), or what the command reads.
    """
    refuse_name(file)
    if not file.name or is_folder(file):
        raise PbdError(f"{file} is a folder: give a file's name", path=file)
    try:
        target = Path(os.path.realpath(file))  # what a link leads to would be replaced
        folder = target.parent if file.is_symlink() else file.parent
        if not is_folder(folder):
            if is_taken(folder):
                raise PbdError(f"{file} can't be written: {folder} is not a folder; give another place", path=file)
            raise PbdError(
                f"{file} can't be written: there is no folder {folder}; make it, or give another place", path=file
            )
        if is_taken(target) and not is_file(target):
            raise PbdError(f"{file} can't be written (not a regular file); give another place", path=file)
        if is_taken(target) and not may_write(target):
            raise PbdError(f"{file} is read-only; change its permissions, or give another place", path=file)
        try_folder(folder)
    except OSError as reason:
        raise unwritable(file, reason, PbdError) from None
    if target.name in OF_A_DEMO and is_file(target.parent / "demo.toml"):
        raise PbdError(f"{file} belongs to the demonstration {folder}, so it is not overwritten; give another name")
    if target.suffix.lower() == ".toml":
        raise PbdError(f"{file}: pbd does not write over .toml files, which people edit; give another name", path=file)
    if any(word and _same(target, word) for word in read):
        raise PbdError(f"{file} is what this command reads, so it is not overwritten; give another name", path=file)


def _same(target: Path, word: str) -> bool:
    try:
        return target.samefile(word)
    except (OSError, ValueError):
        return False
