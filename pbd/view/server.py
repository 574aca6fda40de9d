"""The live viewer: a server for this machine only, which serves the page and sends the scene to each open page.

The server runs in its own thread and ends with the program. Drawing never waits for it.
"""

from __future__ import annotations

import asyncio
import os
import sys
import threading
import webbrowser
from contextlib import closing, suppress
from typing import TYPE_CHECKING, Any

import umsgpack
from tornado.httpserver import HTTPServer
from tornado.netutil import bind_sockets
from tornado.web import Application, HTTPError, RequestHandler
from tornado.websocket import WebSocketClosedError, WebSocketHandler

from pbd.errors import PbdError
from pbd.view.meshcat_encoding import ScenePath, Visualizer
from pbd.view.page import SCENE_ROOT, page_html

if TYPE_CHECKING:  # the live view of a recording must not import a robot library
    from pbd.view.replay_scene import ReplayScene

LOOPBACK = "127.0.0.1"


class LiveViewer:
    """A running viewer: its page's `url`, and the `visualizer` that draws into every open page.

    Args:
        advice: for the error message if the server can't be started.

    Raises:
        PbdError: the server can't be started.
    """

    def __init__(self, advice: str = "use --html FILE instead") -> None:
        try:
            sockets = bind_sockets(0, LOOPBACK)
        except OSError as error:
            raise PbdError(f"the live viewer did not start ({error.strerror}); {advice}") from None
        self.url = f"http://{LOOPBACK}:{sockets[0].getsockname()[1]}/pbd"
        self.visualizer = Visualizer.view_into(self, ScenePath((SCENE_ROOT,)))
        self._scene: dict[tuple[str, str, str], bytes] = {}  # the commands that a new page needs, in order
        self._pages: set[_Socket] = set()
        self._sent = self._taken = 0
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._serve, args=(sockets,), daemon=True)
        self._thread.start()

    def send(self, command: Any) -> None:
        """Pass on one of meshcat's commands: this is the interface of meshcat's window."""
        lowered = command.lower()
        key = (lowered["type"], lowered["path"], lowered.get("property", ""))
        self._sent += 1
        with suppress(RuntimeError):  # closed
            self._loop.call_soon_threadsafe(self._take, key, umsgpack.packb(lowered))

    def behind(self) -> bool:
        """Whether the server has not yet taken all commands."""
        return self._taken < self._sent

    def close(self) -> None:
        """End the server once every page has received all commands; a second call does nothing."""
        if self._thread.is_alive():
            self._loop.call_soon_threadsafe(lambda: self._loop.create_task(self._end()))
            self._thread.join()

    # --- in the server's thread ---

    def _serve(self, sockets: list[Any]) -> None:
        asyncio.set_event_loop(self._loop)
        page = page_html("pbd", b"", connect=f"ws://{LOOPBACK}:* ws://localhost:*")
        app = Application(log_function=lambda handler: None)
        # A foreign page whose host name resolves to 127.0.0.1 gets nothing (DNS rebinding).
        hosts = r"(127\.0\.0\.1|localhost)"
        app.add_handlers(hosts, [(r"/pbd", _Page, {"page": page}), (r"/", _Socket, {"viewer": self})])
        server = HTTPServer(app, max_body_size=0)  # else any page of the browser may send 100 MB at a time, to be kept
        server.add_sockets(sockets)
        self._loop.run_forever()
        server.stop()
        self._loop.close()

    def _take(self, key: tuple[str, str, str], command: bytes) -> None:
        kind, path, _ = key
        if kind == "delete":
            below = [each for each in self._scene if f"{each[1]}/".startswith(f"{path}/")]
            for each in below:
                del self._scene[each]
        else:
            self._scene.pop(key, None)
            self._scene[key] = command
        for page in tuple(self._pages):
            page.pass_on(command)
        self._taken += 1

    def join(self, page: _Socket) -> None:
        """Send a page the scene, and all commands from now on."""
        for command in self._scene.values():
            page.pass_on(command)
        self._pages.add(page)

    def leave(self, page: _Socket) -> None:
        """Stop sending commands to a page."""
        self._pages.discard(page)

    async def _end(self) -> None:
        last = [page.last for page in self._pages if page.last is not None]
        if last:
            await asyncio.wait(last, timeout=2.0)
        for page in tuple(self._pages):
            page.close()
        await asyncio.sleep(0.05)
        self._loop.stop()


class _Socket(WebSocketHandler):  # type: ignore[misc]  # tornado is not followed
    """Sends the scene to our own page only.

    A browser always sends the Origin of the page that asks, and tornado compares it with the Host. A client without an
    Origin is not a browser and is refused.
    """

    def initialize(self, viewer: LiveViewer) -> None:
        self.viewer = viewer
        self.last: asyncio.Future[None] | None = None

    def prepare(self) -> None:
        if "Origin" not in self.request.headers:
            raise HTTPError(403)

    def open(self) -> None:
        self.viewer.join(self)

    def pass_on(self, command: bytes) -> None:
        with suppress(WebSocketClosedError):
            self.last = asyncio.ensure_future(self.write_message(command, binary=True))
            self.last.add_done_callback(lambda written: written.exception())  # a page may have closed meanwhile

    def on_message(self, message: str | bytes) -> None:
        """Our page sends no messages."""

    def on_close(self) -> None:
        self.viewer.leave(self)


class _Page(RequestHandler):  # type: ignore[misc]
    """Serves the page. Its headers forbid other pages to show it in a frame."""

    def initialize(self, page: str) -> None:
        self.page = page

    def get(self) -> None:
        self.set_header("Cache-Control", "no-store")
        self.set_header("Content-Security-Policy", "frame-ancestors 'none'")
        self.set_header("X-Frame-Options", "DENY")
        self.set_header("X-Content-Type-Options", "nosniff")
        self.finish(self.page)


def show_replay(scene: ReplayScene, open_browser: bool = True) -> None:
    """Play a scene in a browser on this machine until Ctrl-C; the address goes to stderr.

    Raises:
        PbdError: the server can't be started, or the robot's files can't be read.
    """
    from pbd.view.scene import build

    with closing(LiveViewer()) as viewer, suppress(KeyboardInterrupt):
        build(scene, viewer.visualizer)
        invite(f"replay at {viewer.url} (Ctrl-C ends it)", viewer.url, open_browser)
        threading.Event().wait()


def invite(words: str, url: str, open_browser: bool) -> None:
    """Print a page's address on stderr, and open it in the user's browser if wanted."""
    print(words, file=sys.stderr, flush=True)
    if open_browser and (_is_text_browser() or not webbrowser.open(url, new=2)):
        print("no browser found; open the address yourself", file=sys.stderr, flush=True)


def _is_text_browser() -> bool:
    """Whether the browser, which the user did not choose, is a program such as lynx: it waits in this terminal."""
    with suppress(webbrowser.Error):
        return "BROWSER" not in os.environ and type(webbrowser.get()) is webbrowser.GenericBrowser
    return False
