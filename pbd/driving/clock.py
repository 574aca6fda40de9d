"""Time as the motion takes it. Tests run it faster."""

from __future__ import annotations

import time


class Clock:
    """Seconds since some instant, and sleep."""

    def now(self) -> float:
        """The motion's time, s."""
        return time.monotonic()

    def sleep_until(self, t: float) -> None:
        """Sleep until `t` of the motion's time; not at all where it is past."""
        if (left := t - self.now()) > 0.0:
            time.sleep(left)
