"""Standard streams: control characters are shown as escapes, failures of the streams are handled."""

import io
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any, TextIO, cast

_BIDI = (*range(0x202A, 0x202F), *range(0x2066, 0x206A))
_ESCAPES = (
    {code: f"\\x{code:02x}" for code in (*range(0x20), *range(0x7F, 0xA0)) if chr(code) not in "\a\t\n"}
    | {code: f"\\u{code:04x}" for code in (*_BIDI, *range(0xD800, 0xE000))}
    | {0xDC00 + byte: f"\\x{byte:02x}" for byte in range(0x80, 0x100)}
)
"""Escapes of control characters, and of bytes of a file name that are not UTF-8. The recorder needs the bell (\\a)."""


def escaped(text: str) -> str:
    """Replace control characters, which may move the cursor or clear the terminal, by escapes such as \\x1b."""
    return text.translate(_ESCAPES)


class SafeStream:
    """A standard stream that shows control characters as escapes.

    Args:
        needed: the output is the command's result, so a failure to write is an error; else it is ignored.
        drawn: rich writes here, whose control sequences are passed on.
    """

    def __init__(self, stream: TextIO, needed: bool, drawn: bool = False) -> None:
        self.stream, self.needed, self.drawn = stream, needed, drawn

    def __getattr__(self, name: str) -> Any:
        return getattr(self.stream, name)

    def write(self, text: str) -> int:
        """Write, and return the number of characters."""
        self._try(lambda: self.stream.write(text if self.drawn else escaped(text)))
        return len(text)

    def flush(self) -> None:
        """Write what is buffered."""
        self._try(self.stream.flush)

    def _try(self, action: Callable[[], object]) -> None:
        try:
            action()
        except OSError:
            if self.needed:
                raise
            discard_rest(self.stream)


def discard_rest(stream: TextIO) -> None:
    """Send the rest of a stream to the null device, so that the interpreter doesn't complain at its end."""
    with suppress(OSError), open(os.devnull, "wb") as nowhere:  # noqa: PTH123
        os.dup2(nowhere.fileno(), stream.fileno())


def is_closed(stream: TextIO) -> bool:
    """Whether the parent process closed a standard stream, so that nothing written to it arrives."""
    return getattr(stream, "name", None) == os.devnull  # by `standard_streams`; `discard_rest` keeps the name


def for_rich(stream: TextIO) -> TextIO:
    """Return the same standard stream for a writer of control sequences, such as rich: they are passed on."""
    if not isinstance(stream, SafeStream):
        return stream
    return cast(TextIO, SafeStream(stream.stream, stream.needed, drawn=True))


@contextmanager
def standard_streams() -> Iterator[None]:
    """Wrap stdout and stderr. A standard stream that was closed at the start becomes the null device."""
    _reserve_standard_descriptors()
    before = sys.stdin, sys.stdout, sys.stderr
    with ExitStack() as stack:

        def nowhere(mode: str) -> TextIO:
            return cast(TextIO, stack.enter_context(Path(os.devnull).open(mode)))

        sys.stdin = sys.stdin or nowhere("r")
        stdout, stderr = sys.stdout or nowhere("w"), sys.stderr or nowhere("w")
        if isinstance(stdout, io.TextIOWrapper):
            stdout.reconfigure(errors="replace")  # a character that the terminal lacks is a question mark
        sys.stdout = cast(TextIO, SafeStream(stdout, needed=True))
        sys.stderr = cast(TextIO, SafeStream(stderr, needed=False))
        try:
            yield
        finally:
            sys.stdin, sys.stdout, sys.stderr = before


def _reserve_standard_descriptors() -> None:
    """Open descriptors 0 to 2 if they are closed: libraries print to 2, which else might be a file opened later."""
    while True:
        number = os.open(os.devnull, os.O_RDWR)
        if number > 2:
            os.close(number)
            return
