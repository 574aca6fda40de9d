"""Reading regular files of bounded size."""

import errno
import os
import stat
from collections.abc import Sequence
from pathlib import Path

from pbd.errors import PbdError, RecordingError, amount, in_words

MOST_DATA_BYTES = 1_000_000_000
"""Largest file of samples, bytes: ten hours of nine channels at 200 Hz as CSV."""

MOST_COMPRESSION = 50
"""Largest factor by which a recording may be compressed. The samples of a moving sensor are by up to 5."""


def refuse_bomb(path: Path, what: str, packed: int, unpacked: int, harmless: int = 50_000_000) -> None:
    """Refuse (RecordingError) to decompress `what`, of `packed` bytes, into far more bytes than samples need.

    Up to `harmless` bytes are never too many.
    """
    if unpacked > min(MOST_DATA_BYTES, max(MOST_COMPRESSION * packed, harmless)):
        what = f"{what} of {amount(packed, 'byte')} decompresses to {unpacked / 1e6:.0f} MB, which is refused"
        raise RecordingError.at(path, f"{what}; record it again", value=unpacked)


def read_bytes(path: Path, error: type[PbdError], next_step: str, most: int = MOST_DATA_BYTES, name: str = "") -> bytes:
    """Read a regular file.

    Args:
        next_step: the end of the error's message.
        most: the largest size, bytes.
        name: the file's name in the message; default: its path.

    Raises:
        error: the file is missing, not regular (a folder, a pipe, a device) or too large, or can't be read.
    """
    try:
        _size_of(path.stat(), most)  # before opening, which resets some devices
        with os.fdopen(os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC), "rb") as file:
            return file.read(_size_of(os.fstat(file.fileno()), most))  # another file may have replaced it
    except (OSError, ValueError, MemoryError) as reason:  # ValueError: a path with a zero byte
        why = "it needs more memory than there is" if isinstance(reason, MemoryError) else in_words(reason)
        raise error(f"{name or path}: can't be read ({why}); {next_step}", path=path) from None


def read_text(path: Path, error: type[PbdError], next_step: str, most: int = 4_000_000, name: str = "") -> str:
    """Read a text file (`read_bytes`, `decoded`), by default one that a person writes; the bundled ones have 10 kB."""
    return decoded(read_bytes(path, error, next_step, most, name), name or path, error, next_step)


def decoded(
    data: bytes, path: str | Path, error: type[PbdError], next_step: str, encodings: Sequence[str] = ("utf-8",)
) -> str:
    """Decode a file's bytes by the first encoding that fits. Remove a byte order mark, and make line ends "\\n"."""
    for encoding in encodings:
        try:
            text = data.decode(encoding)
        except UnicodeDecodeError as fault:
            reason = fault
        else:
            text = text.removeprefix("\ufeff")
            return text.replace("\r\n", "\n").replace("\r", "\n") if "\r" in text else text
    tried = ", ".join(encodings)
    raise error.at(path, f"can't be read as text (tried {tried}; byte {reason.start} does not fit); {next_step}")


def _size_of(status: os.stat_result, most: int) -> int:
    """Return a regular file's size, bytes; OSError: it is not regular, or larger than `most`."""
    if stat.S_ISDIR(status.st_mode):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
    if not stat.S_ISREG(status.st_mode):
        raise OSError("it is not a regular file")
    if status.st_size > most:
        raise OSError(f"it has {status.st_size / 1e6:.3g} MB, more than the {most / 1e6:.3g} MB that are read")
    return status.st_size
