"""Files and folders appear whole or not at all, and what the system refuses is told as an error of ours."""

from __future__ import annotations

import errno
import os
import shutil
import warnings
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from pathlib import Path

from pbd.errors import PbdError, PbdWarning, RecordingError, in_words
from pbd.paths import DELETED, in_deleted_folder, is_file, is_folder, is_plain, is_taken, made, replacing, unfinished


@contextmanager
def written_whole(path: Path, parents: bool = False) -> Iterator[Path]:
    """Give a file to write beside `path`; it takes `path`'s place when all went well, and is gone otherwise.

    A link stays a link: what it leads to is replaced. With `parents` missing folders are made.

    Raises:
        PbdError: the place can't be written, or holds something that is no file (a folder, a device).
    """
    refuse_name(path)
    if not path.name or is_folder(path):
        raise PbdError(f"{path} can't be written (it is a folder); give another place", path=path)
    if os.path.exists(path) and not is_file(path):  # noqa: PTH110 (Path.exists raises where no one may look)
        raise PbdError(f"{path} can't be written (not a regular file); give another place", path=path)
    with _told(path, PbdError), replacing(path, parents) as new:
        yield new


@contextmanager
def folder_written_whole(folder: Path) -> Iterator[Path]:
    """Give a folder to fill beside `folder`; it takes that name when all went well, and is gone otherwise.

    What has the name is renamed (`name_aside`) before that and removed after it. Where that is a link the link goes,
    and what it leads to stays.

    Raises:
        RecordingError: the place can't be written.
    """
    refuse_name(folder)
    with _told(folder, RecordingError), made(folder.parent), unfinished(folder.parent) as new:
        new.mkdir()
        yield new
        aside = folder.rename(name_aside(folder, "before")) if os.path.lexists(folder) else None
        try:
            new.rename(folder)
        except OSError:
            if aside is not None:
                aside.rename(folder)
            raise
        if aside is not None and (left := remove_folder(aside)):
            warnings.warn(f"{folder} is replaced, but {left}", PbdWarning, stacklevel=3)


@contextmanager
def written_together(folder: Path, names: Collection[str]) -> Iterator[Path]:
    """Give a folder in which to write files of these names; they take their places in `folder` when all went well.

    The folder is made where it is missing, and is gone again otherwise.

    Raises:
        PbdError: the place can't be written.
    """
    refuse_folder(folder)
    with _told(folder, PbdError), made(folder), unfinished(folder) as new:
        for place in (folder / name for name in names):
            if is_folder(place):
                raise PbdError(f"{place} can't be written (it is a folder); give another place", path=place)
        new.mkdir()
        yield new
        for name in names:
            (new / name).replace(folder / name)


def refuse_folder(folder: Path, other: str = "place") -> None:
    """Refuse a folder in which nothing can be written, or that can't be made; the error asks for another `other`.

    Raises:
        PbdError: for the system's reason, or as no text can hold its name.
    """
    refuse_name(folder)
    try:
        is_taken(folder)
        try_folder(folder)
    except OSError as reason:
        raise unwritable(folder, reason, PbdError, other) from None


def name_aside(folder: Path, word: str) -> Path:
    """NAME.word, or the first of NAME.word-2, NAME.word-3 that is free: no earlier one is overwritten."""
    free, n = folder.with_name(f"{folder.name}.{word}"), 1
    while os.path.lexists(free):
        n += 1
        free = folder.with_name(f"{folder.name}.{word}-{n}")
    return free


def remove_folder(aside: Path) -> str:
    """Remove a folder, or a link to one; return "", or what to tell where it can't be."""
    try:
        if aside.is_symlink():
            aside.unlink()  # what a link leads to is not ours to remove
        else:
            shutil.rmtree(aside)
    except OSError as reason:
        return f"what is left of the old one is in {aside}: it can't be removed ({in_words(reason)})"
    return ""


def try_folder(folder: Path) -> None:
    """Refuse a folder in which nothing can be made; nothing is left there.

    Raises:
        OSError: the system's reason.
    """
    with made(folder, keep=False), unfinished(folder) as new:
        new.mkdir()


def refuse_name(path: Path) -> None:
    """Refuse a name that no text can hold.

    Raises:
        PbdError: it is not UTF-8, or has a control character.
    """
    if not is_plain(str(path)):
        raise PbdError(
            f"'{path}' can't be a name here (it has control characters, or is not UTF-8); give another", path=path
        )


def unwritable(path: Path, reason: OSError, error: type[PbdError], other: str = "place") -> PbdError:
    """Make the error that says why nothing can be written there, and what to give instead."""
    if reason.errno == errno.ENOENT and not path.is_absolute() and in_deleted_folder():
        return error(f"{path} can't be written: {DELETED}", path=path)
    return error(f"{path} can't be written ({in_words(reason)}); give another {other}", path=path)


@contextmanager
def _told(path: Path, error: type[PbdError]) -> Iterator[None]:
    try:
        yield
    except OSError as reason:
        raise unwritable(path, reason, error) from None
