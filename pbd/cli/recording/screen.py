"""The screen while recording: a live panel at a terminal, plain lines elsewhere."""

import sys
import time
from contextlib import suppress
from typing import Self

from rich.console import Console, Group
from rich.live import Live
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from pbd.errors import amount
from pbd.record.person_messages import describe_stop, in_cm, position_text
from pbd.record.session_types import Message, Status
from pbd.view.safe_console import SafeConsole

LINES_KEPT = 6
"""Largest number of messages in the panel."""

KEYS_LINE = "Enter ends · space grips or lets go · q discards"
TRACKING_LINE = "on disk; now the whole recording is tracked ..."


class PlainScreen:
    """Prints each message, and the state every two seconds, on stderr. At a terminal, some messages ring the bell."""

    def __init__(self, title: str) -> None:
        self._title = title
        self._shown_s = time.monotonic()  # of the host: a device's time may be in ms, by mistake
        self._bell = "\a" if sys.stderr.isatty() else ""

    def ask(self, question: str) -> None:
        """Print a question; "" clears it, which lines can't show."""
        if question:
            _print(question)

    def show(self, status: Status) -> None:
        """Print the new messages and, when due, the state."""
        if self._title:
            _print(f"{self._title}; hold still")
            self._title = ""
        for message in status.messages:
            _print(f"{message.t:7.1f} s  {message.text}{self._bell if message.bell else ''}")
        if time.monotonic() - self._shown_s >= 2.0:
            self._shown_s = time.monotonic()
            _print(f"{status.t:7.1f} s  {state(status)}; {health(status)}")


def _print(line: str) -> None:
    with suppress(OSError):  # the terminal is closed, but recording continues
        print(line, file=sys.stderr, flush=True)


class PanelScreen:
    """Draws a panel on stderr; some messages ring the bell."""

    def __init__(self, title: str, tolerance_m: float) -> None:
        self._title, self._tolerance_m = title, tolerance_m
        self._lines: list[Message] = []
        self._question = ""
        self._console: Console = SafeConsole(sys.stderr)
        self._live = Live(console=self._console, auto_refresh=False)

    def __enter__(self) -> Self:
        with suppress(OSError):
            self._live.start()
        return self

    def __exit__(self, *raised: object) -> None:
        with suppress(OSError):
            self._live.stop()

    def ask(self, question: str) -> None:
        """Show a question in the place of the keys; "" shows the keys again."""
        self._question = question

    def show(self, status: Status) -> None:
        """Draw the panel for a status."""
        self._lines = [*self._lines, *status.messages][-LINES_KEPT:]
        with suppress(OSError):  # the terminal is gone, but recording continues
            if any(message.bell for message in status.messages):
                self._console.bell()
            self._live.update(self.panel(status), refresh=True)

    def panel(self, status: Status) -> Panel:
        """Make the panel for a status."""
        table = Table.grid(padding=(0, 2))
        pause = status.moving and status.sigma_of_move_m > self._tolerance_m
        hand = f"pause now: {in_cm(status.sigma_of_move_m)}" if pause else state(status)
        colour = "yellow" if status.waiting or pause else "cyan" if status.moving else "green"
        table.add_row("hand", Text(hand, style=f"bold {colour}"))
        table.add_row("place", position_text(status.p_nav_sensor))
        last = "none yet"
        if status.stops > 1:
            last = f"{status.stops - 1}, the last at {describe_stop(status.keyframes[-1])}"
        table.add_row("stops", last)
        over = status.sigma_m > self._tolerance_m
        table.add_row("sigma", Text(f"{100.0 * status.sigma_m:6.1f} cm  {bar(status.sigma_m / self._tolerance_m)}"))
        table.columns[0].style = "dim"
        table.rows[-1].style = "yellow" if over else ""
        table.add_row("sensor", health(status))
        table.add_row("grip", "closed" if status.closed else "open")
        kept = self._lines[-max(1, min(LINES_KEPT, self._console.height - 11)) :]  # eleven others
        lines = [Text(f"{say.t:6.1f} s  {say.text}", style="bold" if say.bell else "") for say in kept]
        question = TRACKING_LINE if status.ended else self._question
        keys = Text(question or KEYS_LINE, style="bold" if question else "dim")
        return Panel(
            Group(table, Text(), *lines, Text(), keys),
            title=Text(self._title),
            title_align="left",
            width=min(78, self._console.width),
        )


def state(status: Status) -> str:
    """Say whether the hand moves."""
    if status.waiting:
        return status.waiting
    return "moving" if status.moving else f"stands still (tremor {status.tremor:.2f} m/s2)"


def health(status: Status) -> str:
    """Say how well the samples arrive."""
    bad = f", {status.bad_packets} bad packets" if status.bad_packets else ""
    return f"{status.t:.1f} s, {status.rate_hz:.0f} Hz, {amount(status.samples, 'sample')}, {status.lost} lost{bad}"


def bar(share: float) -> str:
    """Draw a bar of 20 characters for a share of the tolerance."""
    return f"{'█' * min(20, round(20 * share)):·<20}"
