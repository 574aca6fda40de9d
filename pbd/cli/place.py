"""Where a command may write: tested before it plans, so that nobody waits for what can't be kept."""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path

from pbd.errors import PbdError

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
    if not file.name or file.is_dir():
        raise PbdError(f"{file} is a folder: give a file's name", path=file)
    target = Path(os.path.realpath(file))  # what a link leads to would be replaced
    if os.path.lexists(target) and not target.is_file():
        raise PbdError(f"{file} can't be written (it is no regular file); give another place", path=file)
    folder = file.parent if not file.is_symlink() else target.parent
    if not folder.is_dir():
        if os.path.lexists(folder):
            raise PbdError(f"{file} can't be written: {folder} is no folder; give another place", path=file)
        raise PbdError(
            f"{file} can't be written: there is no folder {folder}; make it, or give another place", path=file
        )
    if not os.access(target.parent, os.W_OK | os.X_OK):
        raise PbdError(f"{file} can't be written: {folder} is read-only; give another place", path=file)
    if target.name in OF_A_DEMO and (target.parent / "demo.toml").is_file():
        raise PbdError(f"{file} belongs to the demonstration {folder}, so it is not written over; give another name")
    if target.suffix.lower() == ".toml":
        raise PbdError(f"{file}: a .toml is what pbd reads and people edit; give another name", path=file)
    if any(word and _same(target, word) for word in read):
        raise PbdError(f"{file} is what this command reads, so it is not written over; give another name", path=file)


def _same(target: Path, word: str) -> bool:
    try:
        return target.samefile(word)
    except (OSError, ValueError):
        return False
