"""Atomic writing: a file or folder appears complete or not at all. Errors say what to do next."""

import errno
import fcntl
import itertools
import os
import secrets
import shutil
import unicodedata
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, nullcontext, suppress
from pathlib import Path

from pbd.errors import PbdError, RecordingError, in_words, warn
from pbd.io.made_by_pbd import refuse_others_file

DELETED = "the folder that you are in has been deleted; go to another"

DEMONSTRATION_FILES = ("demo.toml", "imu.csv", "truth.csv", "keyframes.toml", "points.csv", "raw.bin")
"""Files of a demonstration's folder. No command's result may replace one of them."""

is_file, is_folder, exists = os.path.isfile, os.path.isdir, os.path.exists
"""Tests for a regular file, a folder, or anything. Unlike pathlib's, they return False for a name that is too long."""


@contextmanager
def atomic_file(path: Path, parents: bool = False, why_kept: str = "") -> Iterator[Path]:
    """Yield a temporary path beside `path`. On success it replaces `path`, on an error it is removed.

    A link stays a link: its target is replaced. An existing file keeps its permissions. With `parents`, missing folders
    are made, and removed again on an error. With `why_kept`, an existing file is renamed (`name_aside`) and kept.

    Raises:
        PbdError: the path can't be written.
    """
    refuse_file(path)
    with _os_errors_as(PbdError, path):
        target = Path(os.path.realpath(path))
        with _new_folder(target.parent) if parents else nullcontext(), _temporary(target) as new:
            yield new
            if is_file(target):
                shutil.copymode(target, new)
            if aside := _take_name(new, target, rename_old=bool(why_kept)):
                warn(f"the old {path}, {why_kept}, is kept in {aside}")


@contextmanager
def atomic_folder(
    folder: Path,
    replace: bool = True,
    why_kept: Callable[[Path, Path], str] = lambda old, new: "",
    locked: bool = False,
) -> Iterator[Path]:
    """Yield a temporary folder beside `folder`. On success it takes the name `folder`, on an error it is removed.

    With `replace`, an existing folder is first renamed (`name_aside`), and then removed unless `why_kept` says why not;
    of a link only the link is removed. Without `replace`, a folder that another program makes meanwhile is an error.
    With `locked`, for a block that reads the existing folder, one `pbd` at a time is in the block; others wait.

    Raises:
        RecordingError: the folder can't be written.
    """
    refuse_name(folder)
    lock = lock_folder(folder.parent) if locked else nullcontext()
    with _os_errors_as(RecordingError, folder), _new_folder(folder.parent), lock, _temporary(folder) as new:
        new.mkdir()
        yield new
        aside = _take_name(new, folder, rename_old=replace)
        if aside is not None and (why := why_kept(aside, folder)):
            warn(f"the old {folder}, {why}, is kept in {aside}")
        elif aside is not None and (left := remove_folder(aside)):
            warn(f"{folder} is replaced, but {left}")


def write_text(path: Path, text: str, parents: bool = False, why_kept: str = "") -> None:
    """Write a text file (`atomic_file`)."""
    with atomic_file(path, parents, why_kept) as unfinished:
        unfinished.write_text(text, encoding="utf-8")


def refuse_name(path: Path) -> None:
    """Refuse (PbdError) a name that is not UTF-8 or has a control character."""
    if any(unicodedata.category(character) in ("Cc", "Cs") for character in str(path)):
        what = f"'{path}' can't be a name here (it has control characters, or is not UTF-8); give another"
        raise PbdError(what, path=path)


def refuse_file(path: Path) -> None:
    """Refuse (PbdError) a path at which no file can be written: a folder, a device, or a read-only file is there."""
    refuse_name(path)
    if not path.name or is_folder(path):
        raise PbdError(f"{path} is a folder: give a file's name", path=path)
    if exists(path) and not is_file(path):
        raise PbdError(f"{path} can't be written (not a regular file); give another place", path=path)
    if is_file(path) and not may_write(path):
        raise PbdError(f"{path} is read-only; change its permissions, or give another place", path=path)


def refuse_folder(folder: Path, error: type[PbdError] = PbdError, other: str = "place") -> None:
    """Refuse a folder that can't be made or written in; the `error` ends with "give another `other`"."""
    refuse_name(folder)
    with _os_errors_as(error, folder, other), _new_folder(folder, keep=False), _temporary(folder / "folder") as new:
        new.mkdir()


def refuse_output(file: Path, inputs: Iterable[str | None] = ()) -> None:
    """Refuse the path of a command's result before the command starts to work.

    Raises:
        PbdError: the path can't be written, belongs to a demonstration, or has a file of others, or one of the
            command's `inputs`, of which those that are not the paths of files are ignored.
    """
    refuse_file(file)
    with _os_errors_as(PbdError, file):
        target = Path(os.path.realpath(file))  # the file that is replaced if `file` is a link
        folder = target.parent if file.is_symlink() else file.parent
        if not is_folder(folder):
            why = f"{folder} is not a folder;" if exists(folder) else f"there is no folder {folder}; make it, or"
            raise PbdError(f"{file} can't be written: {why} give another place", path=file)
        with suppress(FileNotFoundError):
            target.lstat()  # raises if the name is too long
        with _temporary(target) as new:
            new.touch()
    if target.name in DEMONSTRATION_FILES and is_file(target.parent / "demo.toml"):
        raise PbdError(f"{file} belongs to the demonstration {folder}, so it is not overwritten; give another name")
    if is_file(target) and any(word and is_file(word) and target.samefile(word) for word in inputs):
        raise PbdError(f"{file} is what this command reads, so it is not overwritten; give another name", path=file)
    if is_file(target):
        refuse_others_file(file)


def name_aside(folder: Path, word: str) -> Path:
    """Return the first path of NAME.word, NAME.word-2, NAME.word-3, ... at which nothing is."""
    names = itertools.chain([word], (f"{word}-{n}" for n in itertools.count(2)))
    return next(free for name in names if not os.path.lexists(free := folder.with_name(f"{folder.name}.{name}")))


def _take_name(new: Path, path: Path, rename_old: bool) -> Path | None:
    """Rename `new` to `path`; with `rename_old` first rename what is there (`name_aside`), and return its new path."""
    aside = path.rename(name_aside(path, "before")) if rename_old and os.path.lexists(path) else None
    try:
        new.rename(path)
    except BaseException:  # Ctrl-C too
        if aside is not None:
            aside.rename(path)
        raise
    return aside


def remove_folder(aside: Path) -> str:
    """Remove a folder, or a link to one. Return "", or the end of a message if it can't be removed."""
    try:
        if aside.is_symlink():
            aside.unlink()  # the link's target stays
        else:
            shutil.rmtree(aside)
    except OSError as reason:
        return f"what is left of the old one is in {aside}: it can't be removed ({in_words(reason)})"
    return ""


def unwritable(path: Path, reason: OSError, error: type[PbdError], other: str = "place") -> PbdError:
    """Make the error for a path that can't be written; it ends with "give another `other`"."""
    if reason.errno == errno.ENOENT and not path.is_absolute() and in_deleted_folder():
        return error(f"{path} can't be written: {DELETED}", path=path)
    why = "another program made it meanwhile" if reason.errno == errno.ENOTEMPTY else in_words(reason)
    if reason.errno in (errno.EEXIST, errno.ENOTDIR):
        in_the_way = next((each for each in (path, *path.parents) if exists(each) and not is_folder(each)), None)
        if in_the_way is not None:
            why = f"{'it' if in_the_way == path else in_the_way} is a file, and a folder is needed there"
    return error(f"{path} can't be written ({why}); give another {other}", path=path)


def in_deleted_folder() -> bool:
    """Whether the working folder has been deleted."""
    try:
        Path.cwd()
    except FileNotFoundError:
        return True
    return False


def may_write(path: Path) -> bool:
    """Whether the permissions allow writing."""
    return os.access(path, os.W_OK, effective_ids=os.access in os.supports_effective_ids)


@contextmanager
def _new_folder(folder: Path, keep: bool = True) -> Iterator[None]:
    """Make a folder and its missing parents. Remove them again after an error, or without `keep`."""
    missing = list(itertools.takewhile(lambda each: not os.path.lexists(each), (folder, *folder.parents)))
    try:
        folder.mkdir(parents=True, exist_ok=True)
        yield
    except BaseException:
        keep = False
        raise
    finally:
        for each in () if keep else missing:
            with suppress(OSError):  # it was not made, or is no longer empty
                each.rmdir()


@contextmanager
def lock_folder(folder: Path) -> Iterator[None]:
    """Keep other `pbd` commands that lock this folder out, while a block reads and writes what is in it."""
    handle = os.open(folder, os.O_RDONLY)
    try:
        with suppress(OSError):  # some network file systems have no locks
            fcntl.flock(handle, fcntl.LOCK_EX)
        yield
    finally:
        os.close(handle)


@contextmanager
def _temporary(target: Path) -> Iterator[Path]:
    """Yield a free path beside `target`; remove whatever is there at the end.

    Nobody can guess it: in a folder that others may write to, a link to a file of the user's could wait there.
    """
    path = target.parent / f".pbd-{secrets.token_hex(16)}.tmp"  # target's name plus a suffix may be too long
    try:
        yield path
    finally:
        if is_folder(path):
            shutil.rmtree(path, ignore_errors=True)
        else:
            with suppress(OSError):
                path.unlink(missing_ok=True)


@contextmanager
def _os_errors_as(error: type[PbdError], path: Path, other: str = "place") -> Iterator[None]:
    try:
        yield
    except OSError as reason:
        raise unwritable(path, reason, error, other) from None
