"""What takes its time says so: on stderr, where that is a terminal."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def working(what: str) -> Iterator[None]:
    """Show `what` and that it goes on; it leaves nothing behind, and is silent where stderr is a file or a pipe."""
    if not sys.stderr.isatty():
        yield
        return
    from rich.console import Console

    # Warnings that are printed meanwhile go above the line: rich takes them in.
    with Console(stderr=True).status(f"{what} ..."):
        yield
