"""Paths as a user gives them: asking about one never raises, and a file takes its place whole or not at all."""

from __future__ import annotations

import errno
import itertools
import os
import shutil
import stat
import unicodedata
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext, suppress
from pathlib import Path

DELETED = "the folder that you are in has been deleted; go to another"

_NUMBERS = itertools.count()


def is_file(path: Path) -> bool:
    """Whether a regular file is there; False too where the name is too long, or no one may look."""
    mode = _mode(path)
    return mode is not None and stat.S_ISREG(mode)


def is_folder(path: Path) -> bool:
    """Whether a folder is there; False too where the name is too long, or no one may look."""
    mode = _mode(path)
    return mode is not None and stat.S_ISDIR(mode)


def _mode(path: Path) -> int | None:
    try:
        return path.stat().st_mode
    except (OSError, ValueError):  # ValueError: a null character
        return None


def is_taken(path: Path) -> bool:
    """Whether something has that name, be it a link that leads nowhere.

    Raises:
        OSError: nothing could have it (it is too long, or inside a file), or no one may look.
    """
    try:
        path.lstat()
    except FileNotFoundError:
        return False
    return True


def in_deleted_folder() -> bool:
    """Whether the working folder is gone."""
    try:
        Path.cwd()
    except FileNotFoundError:
        return True
    return False


def is_plain(name: str) -> bool:
    """Whether a name can stand in a file and on a screen: UTF-8 and without control characters."""
    return all(unicodedata.category(character) not in ("Cc", "Cs") for character in name)


def as_text(name: str) -> str:
    """A file's name as text: the bytes of it that are not UTF-8 are written out."""
    return os.fsencode(name).decode("utf-8", "backslashreplace")


def may_write(path: Path) -> bool:
    """Whether what is there may be written, by its permissions."""
    effective = os.access in os.supports_effective_ids
    return os.access(path, os.W_OK, effective_ids=effective)


@contextmanager
def replacing(path: Path, parents: bool = False) -> Iterator[Path]:
    """Give a file to write beside `path`; it takes `path`'s place when all went well, and is gone otherwise.

    A link stays a link: what it leads to is replaced. A file keeps its permissions, and one that may not be written is
    not replaced. With `parents` missing folders are made, and removed again where all didn't go well.

    Raises:
        OSError: the place can't be written.
    """
    target = Path(os.path.realpath(path))
    with made(target.parent) if parents else nullcontext(), unfinished(target.parent) as new:
        there = is_taken(target)
        if there and not may_write(target):
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(path))
        yield new
        if there:
            shutil.copymode(target, new)
        new.replace(target)


@contextmanager
def made(folder: Path, keep: bool = True) -> Iterator[None]:
    """Make a folder and those above it; what was made is removed again after an error, or where it is not to `keep`."""
    missing = list(itertools.takewhile(lambda each: not os.path.lexists(each), (folder, *folder.parents)))
    try:
        folder.mkdir(parents=True, exist_ok=True)
        yield
    except BaseException:
        keep = False
        raise
    finally:
        for each in () if keep else missing:
            with suppress(OSError):  # not made, or no longer empty
                each.rmdir()


@contextmanager
def unfinished(folder: Path) -> Iterator[Path]:
    """Give a free name in a folder; whatever has that name at the end is removed."""
    path = folder / f".pbd-{os.getpid()}-{next(_NUMBERS)}.tmp"  # short: the name to come may be the longest there is
    try:
        yield path
    finally:
        if is_folder(path):
            shutil.rmtree(path, ignore_errors=True)
        else:
            with suppress(OSError):
                path.unlink(missing_ok=True)
