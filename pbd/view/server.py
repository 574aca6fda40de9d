"""The live viewer's server, a process of its own: meshcat's bridge, bound to loopback, that ends with its parent.

`python -m pbd.view.server` prints one line of JSON with its address. Then it takes commands from its standard input and
answers each with a byte on its standard output, until its standard input closes.
"""

from __future__ import annotations

import ctypes
import json
import os
import signal
import sys
import threading
import warnings
from collections.abc import Iterable, Sequence
from contextlib import suppress
from typing import Any, BinaryIO

from tornado.web import Application, HTTPError, RequestHandler
from tornado.websocket import WebSocketClosedError

from pbd.view.page import page_html

with warnings.catch_warnings():
    warnings.simplefilter("ignore", DeprecationWarning)  # meshcat's own import of zmq raises one
    from meshcat.servers.zmqserver import MESHCAT_COMMANDS, WebSocketHandler, ZMQWebSocketBridge

LOOPBACK = "127.0.0.1"
PR_SET_PDEATHSIG = 1
"""Linux: prctl(2)."""
TAKEN, REFUSED = b"1", b"0"
"""Answers to a command."""
FRAMES = 3
"""Of a command: its type, its path, its message."""


def packed(frames: Iterable[bytes]) -> bytes:
    """Frames as they are sent: each led by its length (uint32, little-endian)."""
    return b"".join(len(frame).to_bytes(4, "little") + frame for frame in frames)


def read_command(stream: BinaryIO) -> list[bytes]:
    """Read a command's frames.

    Raises:
        EOFError: the other end is closed.
    """
    return [_read(stream, int.from_bytes(_read(stream, 4), "little")) for _ in range(FRAMES)]


def _read(stream: BinaryIO, size: int) -> bytes:
    data = stream.read(size)
    if len(data) < size:
        raise EOFError
    return data


class Answers:
    """Stands in for meshcat's message queue: each command is answered by a byte on standard output."""

    def send(self, answer: bytes) -> None:
        """Say whether the command was taken."""
        os.write(1, TAKEN if answer == b"ok" else REFUSED)


class LoopbackBridge(ZMQWebSocketBridge):  # type: ignore[misc]  # meshcat has no types
    """Meshcat's bridge to web sockets, with our page, for this machine alone.

    Commands come through standard input, which nobody has but who started us. Requests must name the loopback host: a
    page elsewhere that points its own name at 127.0.0.1 gets nothing.
    """

    def __init__(self) -> None:
        super().__init__(zmq_url="", host=LOOPBACK)
        self.web_url = f"http://{LOOPBACK}:{self.fileserver_port}/pbd"

    def setup_zmq(self, url: str) -> tuple[Answers, None, str]:
        """Open no message queue: any process of this machine could send to it."""
        return Answers(), None, url

    def make_app(self) -> Application:
        """Build the application; meshcat would have it listen on every interface."""
        page = page_html("pbd", b"", connect=f"ws://{LOOPBACK}:* ws://localhost:*")
        app = Application()
        handlers = [(r"/pbd", PageHandler, {"page": page}), (r"/", SceneSocket, {"bridge": self})]
        app.add_handlers(r"(127\.0\.0\.1|localhost)", handlers)
        listen = app.listen

        def listen_on_loopback(port: int, **options: Any) -> Any:
            return listen(port, **{**options, "address": LOOPBACK})

        app.listen = listen_on_loopback
        return app

    def take(self, frames: Sequence[bytes]) -> None:
        """Carry out a command: its type, its path and its message. Whatever it is, it is answered."""
        try:
            if frames[0].decode() not in MESHCAT_COMMANDS:
                raise ValueError(frames[0])
            self.handle_zmq(frames)
        except Exception:  # meshcat's, of a frame that it doesn't understand: whoever draws would wait for ever
            self.zmq_socket.send(b"error")

    def forward_to_websockets(self, frames: Sequence[bytes]) -> None:
        """Pass a command on to all pages that are open.

        One may be closing at this moment. Meshcat would raise, and whoever draws would wait for its answer for ever.
        """
        _, _, data = frames
        for websocket in tuple(self.websocket_pool):
            with suppress(WebSocketClosedError):
                websocket.write_message(data, binary=True)


class SceneSocket(WebSocketHandler):  # type: ignore[misc]
    """Sends the scene to our own page.

    A browser always tells the Origin of the page that asks, and tornado compares it with the Host; what tells none is
    no browser.
    """

    def prepare(self) -> None:
        """Refuse what tells no Origin."""
        if "Origin" not in self.request.headers:
            raise HTTPError(403)

    def on_message(self, message: str | bytes) -> None:
        """Pass over it: our page says nothing."""

    def on_close(self) -> None:
        """Forget it, if it was open at all."""
        self.bridge.websocket_pool.discard(self)


class PageHandler(RequestHandler):  # type: ignore[misc]  # tornado is not followed
    """Serves one page from memory."""

    def initialize(self, page: str) -> None:
        """Take the page's text."""
        self.page = page

    def set_default_headers(self) -> None:
        """Set what keeps other pages from showing this one in a frame, and browsers from guessing what it is."""
        self.set_header("Cache-Control", "no-store")
        self.set_header("Content-Security-Policy", "frame-ancestors 'none'")
        self.set_header("X-Frame-Options", "DENY")
        self.set_header("X-Content-Type-Options", "nosniff")

    def get(self) -> None:
        """Answer with the page."""
        self.finish(self.page)


def take_commands(bridge: LoopbackBridge) -> None:
    """Take commands from standard input; leave when the parent does, even if it was killed: its end then closes."""
    if sys.platform == "linux":  # sooner, and also where some other process holds the pipe open
        ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)

    def read() -> None:
        with suppress(EOFError):
            while True:
                bridge.ioloop.add_callback(bridge.take, read_command(sys.stdin.buffer))
        os._exit(0)

    threading.Thread(target=read, daemon=True).start()


def main() -> None:
    """Serve until the parent ends."""
    sys.stderr = open(os.devnull, "w")  # noqa: PTH123, SIM115  # meshcat tells of every port it tries and every visitor
    bridge = LoopbackBridge()
    print(json.dumps({"web": bridge.web_url}), flush=True)
    sys.stdout = sys.stderr  # from now on its bytes are answers
    take_commands(bridge)
    bridge.run()


if __name__ == "__main__":
    main()
