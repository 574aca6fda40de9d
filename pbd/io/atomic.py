"""Atomic writing: files and folders appear whole or not at all. Errors of the system name the next step."""

from __future__ import annotations

import errno
import itertools
import os
import shutil
import unicodedata
import warnings
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, nullcontext, suppress
from pathlib import Path

from pbd.errors import PbdError, PbdWarning, RecordingError, in_words, warn

DELETED = "the folder that you are in has been deleted; go to another"

DEMONSTRATION_FILES = ("demo.toml", "imu.csv", "truth.csv", "keyframes.toml", "points.csv", "raw.bin")
"""What a demonstration's folder is made of: no result takes such a file's place."""

_COUNTER = itertools.count()

is_file, is_folder, exists = os.path.isfile, os.path.isdir, os.path.exists
"""Whether a regular file, a folder, or anything is there. Unlike pathlib's they never raise: a name may be too long."""


@contextmanager
def atomic_file(path: Path, parents: bool = False) -> Iterator[Path]:
    """Give a file to write beside `path`; it takes `path`'s place when all went well, and is gone otherwise.

    A link stays a link: what it leads to is replaced. A file keeps its permissions. With `parents` missing folders are
    made, and removed again where not all went well.

    Raises:
        PbdError: the place can't be written.
    """
    refuse_file(path)
    with _refused_as(PbdError, path):
        target = Path(os.path.realpath(path))
        with made(target.parent) if parents else nullcontext(), _temporary(target) as new:
            yield new
            if is_file(target):
                shutil.copymode(target, new)
            new.replace(target)


@contextmanager
def atomic_folder(folder: Path, replace: bool = True) -> Iterator[Path]:
    """Give a folder to fill beside `folder`; it takes that name when all went well, and is gone otherwise.

    What has the name is renamed (`name_aside`) before that and removed after it. Where that is a link the link goes,
    and what it leads to stays. Without `replace` it is not written over what another program made meanwhile.

    Raises:
        RecordingError: the place can't be written.
    """
    refuse_name(folder)
    with _refused_as(RecordingError, folder), made(folder.parent), _temporary(folder) as new:
        new.mkdir()
        yield new
        aside = folder.rename(name_aside(folder, "before")) if replace and os.path.lexists(folder) else None
        try:
            new.rename(folder)
        except OSError:
            if aside is not None:
                aside.rename(folder)
            raise
        if aside is not None and (left := remove_folder(aside)):
            warn(f"{folder} is replaced, but {left}")


def write_text(path: Path, text: str, parents: bool = False, read: Callable[[Path], object] | None = None) -> None:
    """Write a file of text, as `atomic_file`; nothing is written that `read` refuses (with the error of that)."""
    with atomic_file(path, parents) as unfinished:
        unfinished.write_text(text, encoding="utf-8")
        if read is None:
            return
        try:
            with warnings.catch_warnings():  # whoever reads it gets them
                warnings.simplefilter("ignore", PbdWarning)
                read(unfinished)
        except PbdError as error:
            said = error.message.replace(str(unfinished), str(path))
            raise type(error)(said, **error.fields | {"path": path}) from None


def refuse_name(path: Path) -> None:
    """Refuse (PbdError) a name that no text can hold: it is not UTF-8, or has a control character."""
    if any(unicodedata.category(character) in ("Cc", "Cs") for character in str(path)):
        what = f"'{path}' can't be a name here (it has control characters, or is not UTF-8); give another"
        raise PbdError(what, path=path)


def refuse_file(path: Path) -> None:
    """Refuse (PbdError) the place of a file where a folder or a device is, or a file that is read-only."""
    refuse_name(path)
    if not path.name or is_folder(path):
        raise PbdError(f"{path} is a folder: give a file's name", path=path)
    if exists(path) and not is_file(path):
        raise PbdError(f"{path} can't be written (not a regular file); give another place", path=path)
    if is_file(path) and not may_write(path):
        raise PbdError(f"{path} is read-only; change its permissions, or give another place", path=path)


def refuse_folder(folder: Path, error: type[PbdError] = PbdError, other: str = "place") -> None:
    """Refuse a folder in which nothing can be made, or that can't be made; the `error` asks for another `other`."""
    refuse_name(folder)
    with _refused_as(error, folder, other), made(folder, keep=False), _temporary(folder / "folder") as new:
        new.mkdir()


def refuse_output(file: Path, inputs: Iterable[str | None] = ()) -> None:
    """Refuse the place of a command's result before the command starts to work.

    Args:
        file: the result's.
        inputs: files that the command reads; other words are passed over.

    Raises:
        PbdError: the place can't be written, or what is there is no result: a file of a demonstration, a TOML file (a
            robot, a calibration), or an input.
    """
    refuse_file(file)
    with _refused_as(PbdError, file):
        target = Path(os.path.realpath(file))  # what a link leads to would be replaced
        folder = target.parent if file.is_symlink() else file.parent
        if not is_folder(folder):
            why = (
                f"{folder} is not a folder; give"
                if exists(folder)
                else f"there is no folder {folder}; make it, or give"
            )
            raise PbdError(f"{file} can't be written: {why} another place", path=file)
        with suppress(FileNotFoundError):
            target.lstat()  # its name may be too long
        with _temporary(target) as new:
            new.touch()
    if target.name in DEMONSTRATION_FILES and is_file(target.parent / "demo.toml"):
        raise PbdError(f"{file} belongs to the demonstration {folder}, so it is not overwritten; give another name")
    if target.suffix.lower() == ".toml":
        raise PbdError(f"{file}: pbd does not write over .toml files, which people edit; give another name", path=file)
    if is_file(target) and any(word and is_file(word) and target.samefile(word) for word in inputs):
        raise PbdError(f"{file} is what this command reads, so it is not overwritten; give another name", path=file)


def name_aside(folder: Path, word: str) -> Path:
    """NAME.word, or the first of NAME.word-2, NAME.word-3 that is free: no earlier one is overwritten."""
    names = itertools.chain([word], (f"{word}-{n}" for n in itertools.count(2)))
    return next(free for name in names if not os.path.lexists(free := folder.with_name(f"{folder.name}.{name}")))


def remove_folder(aside: Path) -> str:
    """Remove a folder, or a link to one; return "", or what to say where it can't be removed."""
    try:
        if aside.is_symlink():
            aside.unlink()  # what a link leads to is not ours to remove
        else:
            shutil.rmtree(aside)
    except OSError as reason:
        return f"what is left of the old one is in {aside}: it can't be removed ({in_words(reason)})"
    return ""


def unwritable(path: Path, reason: OSError, error: type[PbdError], other: str = "place") -> PbdError:
    """Make the error that says why nothing can be written there, and what to give instead."""
    if reason.errno == errno.ENOENT and not path.is_absolute() and in_deleted_folder():
        return error(f"{path} can't be written: {DELETED}", path=path)
    return error(f"{path} can't be written ({in_words(reason)}); give another {other}", path=path)


def in_deleted_folder() -> bool:
    """Whether the working folder is gone."""
    try:
        Path.cwd()
    except FileNotFoundError:
        return True
    return False


def may_write(path: Path) -> bool:
    """Whether what is there may be written, by its permissions."""
    return os.access(path, os.W_OK, effective_ids=os.access in os.supports_effective_ids)


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
def _temporary(target: Path) -> Iterator[Path]:
    """Give a free name beside `target`; whatever has that name at the end is removed."""
    path = target.parent / f".pbd-{os.getpid()}-{next(_COUNTER)}.tmp"  # short: target's may be the longest there is
    try:
        yield path
    finally:
        if is_folder(path):
            shutil.rmtree(path, ignore_errors=True)
        else:
            with suppress(OSError):
                path.unlink(missing_ok=True)


@contextmanager
def _refused_as(error: type[PbdError], path: Path, other: str = "place") -> Iterator[None]:
    try:
        yield
    except OSError as reason:
        raise unwritable(path, reason, error, other) from None
