"""A command's output: JSON goes to stdout; messages, and progress at a terminal, go to stderr."""

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
    """Print a message on stderr, in one line."""
    print(f"pbd: {' '.join(message.split())}", file=sys.stderr)


def print_json(result: Mapping[str, Any]) -> None:
    """Print the result as one JSON object; arrays become lists, and NaN and infinity become null."""
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
    """Show `what` while the block runs, and the most time left.

    If stderr is no terminal, print one plain line, and only for what may last `at_most_s`.
    """
    if not sys.stderr.isatty():
        if at_most_s is not None:
            print(f"{what} ...", file=sys.stderr, flush=True)
        yield
        return
    from rich.text import Text

    from pbd.view.safe_console import SafeConsole

    # rich prints warnings above this line.
    shown = Text(f"{what} ...") if at_most_s is None else _Countdown(what, at_most_s)
    with SafeConsole(sys.stderr).status(shown):
        yield


@dataclass
class _Countdown:
    """A line with the time left, which rich draws several times a second."""

    what: str
    at_most_s: float
    began: float = field(default_factory=time.monotonic)

    def __rich__(self) -> Text:
        from rich.text import Text

        left = max(0.0, self.at_most_s - (time.monotonic() - self.began))
        return Text(f"{self.what} ... {left:.0f} s at most")
