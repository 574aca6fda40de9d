"""The live viewer: the replay's page, fed over web sockets by a server on this machine's loopback."""

from __future__ import annotations

import json
import os
import select
import subprocess
import sys
import webbrowser
from contextlib import suppress
from types import TracebackType
from typing import TYPE_CHECKING, Any

import umsgpack

from pbd.errors import PbdError
from pbd.view.meshcat_encoding import ScenePath, Visualizer
from pbd.view.page import SCENE_ROOT
from pbd.view.server import TAKEN, packed

if TYPE_CHECKING:  # the recording's view needs no robot library
    from pbd.view.scene import ReplayScene

PATIENCE_MS = 30_000
PIPE_BYTES = 65536
"""Read at once."""


class LiveViewer:
    """A running viewer: its page's `url`, and the `visualizer` that draws into every page that is open.

    The server is a process of its own and ends with this one, whatever ends it.

    Args:
        waits: each command waits for the server's answer; otherwise look at `behind` before more are sent.
        otherwise: what to do where the server can't be started.

    Raises:
        PbdError: the server can't be started.
    """

    def __init__(self, waits: bool = True, otherwise: str = "use --html FILE instead") -> None:
        self._waits = waits
        self._process = subprocess.Popen(
            # -P: nothing in the folder in which the user happens to be is imported.
            [sys.executable, "-P", "-m", "pbd.view.server"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            start_new_session=True,  # Ctrl-C in the terminal is ours to handle
        )
        line = self._process.stdout.readline() if self._process.stdout else b""
        if not line:
            reason = self._process.communicate()[1].decode(errors="replace").strip().splitlines()[-1:]
            raise PbdError(f"the live viewer did not start ({' '.join(reason) or 'no reason given'}); {otherwise}")
        self.url: str = json.loads(line)["web"]
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._commands, self._answers = self._process.stdin.fileno(), self._process.stdout.fileno()
        os.set_blocking(self._commands, False)  # a server that has stopped doesn't stop us
        self._outgoing = bytearray()
        self._unanswered = 0
        self.visualizer = Visualizer.view_into(self, ScenePath((SCENE_ROOT,)))

    def send(self, command: Any) -> None:
        """Pass on one of meshcat's commands (this makes us a window in meshcat's sense).

        Raises:
            PbdError: the server has ended, or refuses it.
        """
        lowered = command.lower()
        self._outgoing += packed((lowered["type"].encode(), lowered["path"].encode(), umsgpack.packb(lowered)))
        self._unanswered += 1
        if self._waits:
            self.catch_up(PATIENCE_MS)
        else:
            self._exchange(0)

    def behind(self) -> bool:
        """Whether the server has still to answer, at this moment."""
        while self._unanswered and self._exchange(0):
            pass
        return self._unanswered > 0

    def catch_up(self, patience_ms: float) -> None:
        """Wait until the server has answered.

        Raises:
            PbdError: for so long there was no answer, or the server has ended, or refuses a command.
        """
        while self._unanswered:
            if not self._exchange(patience_ms):
                raise PbdError("the live viewer's server does not answer; run the command again")

    def _exchange(self, patience_ms: float) -> bool:
        """Send commands and take answers, as far as goes without waiting longer; whether any went."""
        ready = select.poll()
        ready.register(self._answers, select.POLLIN)
        if self._outgoing:
            ready.register(self._commands, select.POLLOUT)
        found = ready.poll(patience_ms)
        for pipe, _ in found:
            if pipe == self._commands:
                with suppress(BrokenPipeError, BlockingIOError):  # where it has ended its answers end, too
                    del self._outgoing[: os.write(self._commands, self._outgoing)]
                continue
            answers = os.read(self._answers, PIPE_BYTES)
            if not answers:
                raise PbdError("the live viewer's server has ended; run the command again")
            self._unanswered -= len(answers)
            if answers.strip(TAKEN):
                raise PbdError("the live viewer's server can't show this; use --html FILE instead")
        return bool(found)

    @property
    def alive(self) -> bool:
        """Whether the server runs."""
        return self._process.poll() is None

    def wait(self) -> None:
        """Wait until the server ends; Ctrl-C raises KeyboardInterrupt as ever."""
        self._process.wait()

    def close(self) -> None:
        """End the server; more than once is fine."""
        self._process.kill()
        self._process.wait()
        for pipe in (self._process.stdin, self._process.stdout, self._process.stderr):
            if pipe is not None:
                pipe.close()

    def __enter__(self) -> LiveViewer:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def show_replay(scene: ReplayScene, open_browser: bool = True, block: bool = True) -> LiveViewer:
    """Play a scene in a browser on this machine; the address goes to stderr.

    Args:
        scene: what to show.
        open_browser: open the address in the user's browser.
        block: stay until Ctrl-C, then close the viewer. Otherwise it is the caller's to close.

    Raises:
        PbdError: the server can't be started, or ends by itself, or the robot's files can't be read.
    """
    from pbd.view.scene import build

    viewer = LiveViewer()
    try:
        build(scene, viewer.visualizer)
        invite(f"replay at {viewer.url}" + (" (Ctrl-C ends it)" if block else ""), viewer.url, open_browser)
        if block:
            viewer.wait()
            raise PbdError("the live viewer's server was ended from outside; run the command again")
    except KeyboardInterrupt:
        viewer.close()
    except BaseException:
        viewer.close()
        raise
    return viewer


def invite(words: str, url: str, open_browser: bool) -> None:
    """Tell a page's address on stderr, and open it in the user's browser where that is wanted."""
    print(words, file=sys.stderr, flush=True)
    if open_browser and not webbrowser.open(url, new=2):
        print("no browser found; open the address yourself", file=sys.stderr, flush=True)
