"""Reads single keys from a terminal, and signals, without blocking, and turns them into commands."""

import os
import select
import signal
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from typing import Any, Self

from pbd.errors import PbdError
from pbd.record.session_types import Command

POLL_S = 0.02
"""Period at which a key is looked for, s."""


class Keys:
    """A context in which keys are read one by one. The key END is Ctrl-C, Ctrl-\\, a hang-up or a termination too.

    If standard input is no terminal, there are no keys, and the end of the input means nothing.

    Attributes:
        signal: the number of the signal that came, or 0.
    """

    END, ENTER = "\x03", "\r\n"

    def __init__(self) -> None:
        self.terminal = sys.stdin.isatty()
        self.signal = 0
        self._settings: list[Any] | None = None
        self._handlers: dict[int, Any] = {}

    def __enter__(self) -> Self:
        for number in (signal.SIGINT, signal.SIGQUIT, signal.SIGTERM, signal.SIGHUP):
            if number == signal.SIGHUP and not self.terminal and signal.getsignal(number) is signal.SIG_IGN:
                continue  # nohup
            self._handlers[number] = signal.signal(number, self._signal)
        if self.terminal:
            import termios
            import tty

            self._settings = termios.tcgetattr(sys.stdin)
            tty.setcbreak(sys.stdin)
        return self

    def __exit__(self, *raised: object) -> None:
        if self._settings is not None:
            import termios

            with suppress(termios.error):  # the terminal is gone
                termios.tcsetattr(sys.stdin, termios.TCSADRAIN, self._settings)
        for number, handler in self._handlers.items():
            signal.signal(number, handler)

    def next(self) -> str:
        """Return the next key, or "" if there is none."""
        if self.signal:
            return self.END
        with suppress(OSError):
            if not self.terminal or not select.select([sys.stdin], [], [], 0.0)[0]:
                return ""
            if key := os.read(sys.stdin.fileno(), 1):
                return key.decode(errors="replace")
        self.signal = signal.SIGHUP  # the terminal is gone, whoever got its hang-up signal
        return self.END

    def ask(self, question: str) -> None:
        """Wait for Enter; PbdError for any other key, KeyboardInterrupt for a signal."""
        print(question, file=sys.stderr, flush=True)
        while not (key := self.next()):
            time.sleep(POLL_S)
        self.require_enter(key)

    def require_enter(self, key: str) -> None:
        """Raise PbdError for any key but Enter, KeyboardInterrupt with the signal's number if a signal came."""
        if self.signal:
            raise KeyboardInterrupt(self.signal)
        if key not in self.ENTER:
            raise PbdError("cancelled: run it again when you are ready")

    def _signal(self, number: int, _: object) -> None:
        self.signal = number


class KeyboardCommands:
    """Turns keys into commands, and asks before it discards. `ask` shows a question; "" clears it."""

    def __init__(self, keys: Keys, ask: Callable[[str], None]) -> None:
        self._keys, self._ask = keys, ask
        self._asked = False

    def __call__(self) -> Command | None:
        """Return the next command, or None, without waiting."""
        key = self._keys.next()
        if self._asked and key:
            self._asked = False
            self._ask("")
            if key in "yY":
                return Command.DISCARD
            return None if key != self._keys.END else Command.END
        if key and key in (*self._keys.ENTER, self._keys.END):
            return Command.END
        if key == " ":
            return Command.GRIP
        if key in ("q", "Q"):
            self._asked = True
            self._ask("discard this recording? y discards, any other key goes on")
        return None
