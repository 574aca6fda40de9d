"""What a person sees while recording: a panel that is kept up to date, or plain lines where there is no terminal."""

from __future__ import annotations

import sys
from types import TracebackType
from typing import TYPE_CHECKING, Self

from pbd.record.told import Say, Status

if TYPE_CHECKING:
    from rich.console import RenderableType

LINES_KEPT = 6
PLAIN_EVERY_S = 2.0
BAR = 20


class PlainScreen:
    """A line for what is said, and one for the state every two seconds, on stderr."""

    def __init__(self, title: str) -> None:
        self._title = title
        self._shown_t = 0.0

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        pass

    def ask(self, question: str) -> None:
        """Nobody is there to answer."""

    def show(self, status: Status) -> None:
        """Print what is new."""
        if self._title:
            print(f"{self._title}; hold still", file=sys.stderr, flush=True)
            self._title = ""
        for say in status.said:
            print(f"{say.t:7.1f} s  {say.text}", file=sys.stderr, flush=True)
        if status.t - self._shown_t >= PLAIN_EVERY_S:
            self._shown_t = status.t
            print(f"{status.t:7.1f} s  {state(status)}; {health(status)}", file=sys.stderr, flush=True)


class PanelScreen:
    """A panel on stderr; it rings the bell."""

    def __init__(self, title: str, tolerance_m: float) -> None:
        from rich.console import Console
        from rich.live import Live

        self._title, self._tolerance_m = title, tolerance_m
        self._lines: list[Say] = []
        self._question = ""
        self._console = Console(stderr=True)
        self._live = Live(console=self._console, auto_refresh=False, transient=False)

    def __enter__(self) -> Self:
        self._live.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._live.stop()

    def ask(self, question: str) -> None:
        """Show a question in the place of the keys; "" takes it back."""
        self._question = question

    def show(self, status: Status) -> None:
        """Draw."""
        self._lines = [*self._lines, *status.said][-LINES_KEPT:]
        if any(say.bell for say in status.said):
            self._console.bell()
        self._live.update(self._panel(status), refresh=True)

    def _panel(self, status: Status) -> RenderableType:
        from rich.console import Group
        from rich.panel import Panel
        from rich.table import Table
        from rich.text import Text

        table = Table.grid(padding=(0, 2))
        colour = "yellow" if status.waiting else "cyan" if status.moving else "green"
        table.add_row("hand", Text(state(status), style=f"bold {colour}"))
        x, y, z = 100.0 * status.p_nav_sensor
        table.add_row("place", f"{x:6.1f} {y:6.1f} {z:6.1f} cm   stops {max(status.stops - 1, 0)}")
        over = status.sigma_m > self._tolerance_m
        table.add_row("sigma", Text(f"{100.0 * status.sigma_m:6.1f} cm  {bar(status.sigma_m / self._tolerance_m)}"))
        table.columns[0].style = "dim"
        table.rows[-1].style = "yellow" if over else ""
        table.add_row("sensor", health(status))
        table.add_row("grip", "closed" if status.closed else "open")
        lines = [Text(f"{say.t:6.1f} s  {say.text}", style="bold" if say.bell else "") for say in self._lines]
        keys = Text(self._question or "Enter ends · space grips or lets go · q discards", style="dim")
        return Panel(Group(table, Text(), *lines, Text(), keys), title=self._title, title_align="left", width=78)


def state(status: Status) -> str:
    """Say what the hand does."""
    if status.waiting:
        return status.waiting
    return "moves" if status.moving else f"stands still (trembles by {status.tremble:.2f} m/s2)"


def health(status: Status) -> str:
    """Say how the sensor does."""
    bad = f", {status.bad_packets} bad packets" if status.bad_packets else ""
    return f"{status.t:.1f} s, {status.rate_hz:.0f} Hz, {status.samples} samples, {status.lost} lost{bad}"


def bar(share: float) -> str:
    """Draw a share of the tolerance."""
    full = min(BAR, round(BAR * share))
    return "█" * full + "·" * (BAR - full)
