"""A command's output: its result as JSON on stdout; notes, and at a terminal progress, on stderr."""

from __future__ import annotations

import json
import math
import sys
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rich.text import Text


def say(message: str) -> None:
    """Tell the user something that is not the result, in one line."""
    print(f"pbd: {' '.join(message.split())}", file=sys.stderr)


def print_json(result: dict[str, Any]) -> None:
    """Print the result as one JSON object; arrays are lists, and numbers that are not finite null."""
    print(json.dumps(_plain(result), allow_nan=False))


def _plain(value: Any) -> Any:
    if hasattr(value, "tolist"):  # numpy's arrays and numbers
        value = value.tolist()
    if isinstance(value, Mapping):
        return {key: _plain(each) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(each) for each in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


@contextmanager
def working(what: str, at_most_s: float | None = None) -> Iterator[None]:
    """Show `what` while it runs, and for how long at most; silent where stderr is no terminal."""
    if not sys.stderr.isatty():
        yield
        return
    from rich.text import Text

    from pbd.view.screen import Screen

    # Warnings that are printed meanwhile go above the line: rich takes them in.
    shown = Text(f"{what} ...") if at_most_s is None else _Countdown(what, at_most_s)
    with Screen(sys.stderr).status(shown):
        yield


@contextmanager
def listening(device: str, what: str, at_most_s: float) -> Iterator[None]:
    """Show that pbd is listening, and for how long at most; a plain line where stderr is no terminal."""
    if not sys.stderr.isatty():
        print(f"{what} {device} ...", file=sys.stderr, flush=True)
    with working(f"{what} {device}", at_most_s):
        yield


@dataclass
class _Countdown:
    """Drawn anew by rich several times a second."""

    what: str
    at_most_s: float
    began: float = field(default_factory=time.monotonic)

    def __rich__(self) -> Text:
        from rich.text import Text

        left = max(0.0, self.at_most_s - (time.monotonic() - self.began))
        return Text(f"{self.what} ... {left:.0f} s at most")
