"""The live viewer's server, a process of its own: meshcat's bridge, bound to loopback, that ends with its parent.

`python -m pbd.view.server` prints one line of JSON with its two addresses and serves until its standard input closes.
"""

from __future__ import annotations

import ctypes
import json
import os
import signal
import sys
import threading
from collections.abc import Sequence
from contextlib import suppress
from typing import Any

from tornado.web import Application, RequestHandler
from tornado.websocket import WebSocketClosedError
from zmq.constants import LAST_ENDPOINT

from pbd.view.meshcat_api import WebSocketHandler, ZMQWebSocketBridge
from pbd.view.page import page_html

LOOPBACK = "127.0.0.1"
PR_SET_PDEATHSIG = 1
"""Linux: prctl(2)."""


class LoopbackBridge(ZMQWebSocketBridge):  # type: ignore[misc]  # meshcat has no types
    """Meshcat's bridge from ZMQ to web sockets, with our page, for this machine alone.

    Requests must name the loopback host: a page elsewhere that points its own name at 127.0.0.1 gets nothing. The web
    socket is for our own page alone: tornado compares the Origin that a browser sends with the Host.
    """

    def __init__(self) -> None:
        super().__init__(zmq_url=f"tcp://{LOOPBACK}:*", host=LOOPBACK)
        self.zmq_url = self.zmq_socket.getsockopt_string(LAST_ENDPOINT)
        self.web_url = f"http://{LOOPBACK}:{self.fileserver_port}/pbd"

    def make_app(self) -> Application:
        """Build the application; meshcat would have it listen on every interface."""
        page = page_html("pbd", b"", connect=f"ws://{LOOPBACK}:* ws://localhost:*")
        app = Application()
        handlers = [(r"/pbd", PageHandler, {"page": page}), (r"/", WebSocketHandler, {"bridge": self})]
        app.add_handlers(r"(127\.0\.0\.1|localhost)", handlers)
        listen = app.listen

        def listen_on_loopback(port: int, **options: Any) -> Any:
            return listen(port, **{**options, "address": LOOPBACK})

        app.listen = listen_on_loopback
        return app

    def forward_to_websockets(self, frames: Sequence[bytes]) -> None:
        """Pass a command on to all pages that are open.

        One may be closing at this moment. Meshcat would raise, and whoever draws would wait for its answer for ever.
        """
        _, _, data = frames
        for websocket in tuple(self.websocket_pool):
            with suppress(WebSocketClosedError):
                websocket.write_message(data, binary=True)


class PageHandler(RequestHandler):  # type: ignore[misc]  # tornado is not followed
    """Serves one page from memory."""

    def initialize(self, page: str) -> None:
        """Take the page's text."""
        self.page = page

    def get(self) -> None:
        """Answer with the page."""
        self.set_header("Cache-Control", "no-store")
        self.finish(self.page)


def end_with_parent() -> None:
    """Leave when the parent does, even if it was killed: its end of our standard input then closes."""
    if sys.platform == "linux":  # sooner, and also where some other process holds the pipe open
        ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)

    def watch() -> None:
        while sys.stdin.buffer.read(1024):
            pass
        os._exit(0)

    threading.Thread(target=watch, daemon=True).start()


def main() -> None:
    """Serve until the parent ends."""
    end_with_parent()
    sys.stderr = open(os.devnull, "w")  # noqa: PTH123, SIM115  # meshcat tells of every port it tries and every visitor
    bridge = LoopbackBridge()
    print(json.dumps({"zmq": bridge.zmq_url, "web": bridge.web_url}), flush=True)
    bridge.run()


if __name__ == "__main__":
    main()
