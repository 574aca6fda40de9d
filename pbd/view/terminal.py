"""Standard streams: control characters are made visible, failures of the streams are handled."""

from __future__ import annotations

import io
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any, TextIO, cast

_BIDI = (*range(0x202A, 0x202F), *range(0x2066, 0x206A))
_VISIBLE = (
    {code: f"\\x{code:02x}" for code in (*range(0x20), *range(0x7F, 0xA0)) if chr(code) not in "\a\t\n"}
    | {code: f"\\u{code:04x}" for code in (*_BIDI, *range(0xD800, 0xE000))}
    | {0xDC00 + byte: f"\\x{byte:02x}" for byte in range(0x80, 0x100)}
)
"""How a control character, and a byte of a name that is not UTF-8, is shown. The bell is the recorder's own."""


def visible(text: str) -> str:
    """Show control characters, which may move a terminal's cursor or clear it, as a programmer would write them."""
    return text.translate(_VISIBLE)


class Stream:
    """A standard stream that makes control characters visible.

    Args:
        needed: what is written is the result, so that a failure is an error; otherwise it is passed over.
        drawn: what is written is drawn by rich, control characters and all.
    """

    def __init__(self, stream: TextIO, needed: bool, drawn: bool = False) -> None:
        self.stream, self.needed, self.drawn = stream, needed, drawn

    def __getattr__(self, name: str) -> Any:
        return getattr(self.stream, name)

    def write(self, text: str) -> int:
        """Write; return how many characters were taken."""
        self._try(lambda: self.stream.write(text if self.drawn else visible(text)))
        return len(text)

    def flush(self) -> None:
        """Write what is kept back."""
        self._try(self.stream.flush)

    def _try(self, action: Callable[[], object]) -> None:
        try:
            action()
        except OSError:
            if self.needed:
                raise
            drop(self.stream)


def drop(stream: TextIO) -> None:
    """Send what is left of a stream nowhere, so that the interpreter doesn't complain at its end."""
    with suppress(OSError), open(os.devnull, "wb") as nowhere:  # noqa: PTH123
        os.dup2(nowhere.fileno(), stream.fileno())


def is_closed(stream: TextIO) -> bool:
    """Whether a standard stream was closed by who started us, so that nothing written to it arrives."""
    return getattr(stream, "name", None) == os.devnull  # ours: one that was sent there is '<stdout>'


def drawing(stream: TextIO) -> TextIO:
    """A standard stream for what rich draws."""
    return cast(TextIO, Stream(stream.stream, stream.needed, drawn=True)) if isinstance(stream, Stream) else stream


@contextmanager
def standard_streams() -> Iterator[None]:
    """Wrap stdout and stderr; one that was closed at the start leads to nowhere."""
    _occupy()
    before = sys.stdin, sys.stdout, sys.stderr
    with ExitStack() as stack:

        def nowhere(mode: str) -> TextIO:
            return cast(TextIO, stack.enter_context(Path(os.devnull).open(mode)))

        sys.stdin = sys.stdin or nowhere("r")
        stdout, stderr = sys.stdout or nowhere("w"), sys.stderr or nowhere("w")
        if isinstance(stdout, io.TextIOWrapper):
            stdout.reconfigure(errors="replace")  # a terminal that has no sigma gets a question mark
        sys.stdout = cast(TextIO, Stream(stdout, needed=True))
        sys.stderr = cast(TextIO, Stream(stderr, needed=False))
        try:
            yield
        finally:
            sys.stdin, sys.stdout, sys.stderr = before


def _occupy() -> None:
    """Keep the numbers 0 to 2 from files that are opened later: libraries print to 2, whatever it is by then."""
    while True:
        number = os.open(os.devnull, os.O_RDWR)
        if number > 2:
            os.close(number)
            return
