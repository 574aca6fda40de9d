"""Shows a recording in the browser and on the screen: `pbd record --live`."""

from collections.abc import Callable
from dataclasses import replace

from pbd.data.one_line_repr import counted
from pbd.errors import PbdError
from pbd.record.person_messages import in_cm
from pbd.record.session_types import Message, Outcome, Status
from pbd.view.live_view import LivePicture, LiveView, State


class LiveScreen:
    """Shows each status in the browser, then on the screen; on the screen alone after the browser failed."""

    def __init__(self, view: LiveView, show: Callable[[Status], None], tolerance_m: float) -> None:
        self._view: LiveView | None = view
        self._show, self._tolerance_m = show, tolerance_m
        self._line = ""
        self._last: LivePicture | None = None

    def show(self, status: Status) -> None:
        """Show a status in both."""
        if status.messages:
            self._line = status.messages[-1].text
        if self._view is not None:
            self._last = self._picture(status)
            try:
                self._view.show(self._last)
            except PbdError as error:
                self._view.close()
                self._view = None
                status = replace(status, messages=(*status.messages, Message(status.t, error.message)))
        self._show(status)

    def end(self, outcome: Outcome) -> None:
        """Show in the browser how the recording ended."""
        if self._view is None or self._last is None:
            return
        where = "discarded" if outcome.folder is None else f"kept in {outcome.folder}"
        self._view.end(replace(self._last, state="ended", badge="ended", line=f"{outcome.ended_by}; {where}"))

    def _picture(self, status: Status) -> LivePicture:
        state: State
        if status.waiting:
            state, badge, line = "waits", "hold still", status.waiting
        elif not status.moving:
            state, badge, line = "still", "stands still", self._line
        elif status.sigma_of_move_m > self._tolerance_m:
            state, badge = "pause", f"pause now: {in_cm(status.sigma_of_move_m)}"
            line = "hold still for a moment: a long move makes its end uncertain"
        else:
            state, badge, line = "moves", "moving", self._line
        stops = max(status.stops - 1, 0)
        return LivePicture(
            status.t,
            status.p_nav_sensor,
            status.v_nav_sensor,
            status.wxyz_nav_sensor,
            status.keyframes,
            state,
            badge,
            line,
            (
                counted(stops, "stop"),
                f"{status.t:.0f} s",
                f"{status.rate_hz:.0f} Hz",
                "grip closed" if status.closed else "grip open",
            ),
        )
