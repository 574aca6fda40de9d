"""The live viewer: on this machine only, and never longer than its parent."""

from __future__ import annotations

import http.client
import os
import re
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import urlsplit

import pytest
from selenium.webdriver.common.by import By
from tornado.websocket import WebSocketClosedError

from pbd.errors import PbdError
from pbd.view.scene import build
from pbd.view.server import LoopbackBridge, packed
from pbd.view.viewer import LiveViewer, show_replay
from tests.view import scenes
from tests.view.browser import Replay, until
from tests.view.chromium import Chromium

linux = pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")

SHOW = """
from pbd.view.viewer import show_replay
from tests.view import scenes
show_replay(scenes.ur5_moves(), open_browser=False)
"""


@pytest.fixture(scope="module")
def viewer() -> Iterator[LiveViewer]:
    with show_replay(scenes.pouring(), open_browser=False, block=False) as viewer:
        yield viewer


@pytest.fixture
def parent() -> Iterator[tuple[subprocess.Popen[str], int, str]]:
    """A program that shows a replay; its server's process id and address."""
    process = subprocess.Popen([sys.executable, "-c", SHOW], stderr=subprocess.PIPE, text=True)
    try:
        assert process.stderr is not None
        found = re.search(r"http://\S+", process.stderr.readline())
        assert found
        yield process, child_of(process.pid), found[0]
    finally:
        process.kill()
        process.wait()
        if process.stderr is not None:
            process.stderr.close()


def child_of(pid: int) -> int:
    (child,) = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
    return int(child)


def alive(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except (FileNotFoundError, ProcessLookupError):
        return False


def listening(pid: int) -> list[str]:
    """The local addresses, in hexadecimal, that a process listens on."""
    sockets = set()
    for descriptor in Path(f"/proc/{pid}/fd").iterdir():
        try:
            sockets.add(str(descriptor.readlink()))
        except FileNotFoundError:
            continue
    addresses = []
    for table in ("tcp", "tcp6"):
        for line in Path(f"/proc/net/{table}").read_text().splitlines()[1:]:
            words = line.split()
            if words[3] == "0A" and f"socket:[{words[9]}]" in sockets:
                addresses.append(words[1].partition(":")[0])
    return addresses


def answer(url: str, host: str) -> int:
    address = urlsplit(url)
    connection = http.client.HTTPConnection(str(address.hostname), address.port, timeout=5)
    try:
        connection.request("GET", address.path, headers={"Host": host})
        return connection.getresponse().status
    finally:
        connection.close()


@linux
def test_it_listens_on_loopback_only(viewer: LiveViewer) -> None:
    """And for nothing but the page: commands come through a pipe that no other process has."""
    assert listening(viewer._process.pid) == ["0100007F"]


def test_it_answers_to_its_own_name_only(viewer: LiveViewer) -> None:
    port = urlsplit(viewer.url).port
    assert answer(viewer.url, f"127.0.0.1:{port}") == 200
    assert answer(viewer.url, f"elsewhere.example:{port}") == 404


def test_no_page_shows_it_in_a_frame(viewer: LiveViewer) -> None:
    address = urlsplit(viewer.url)
    connection = http.client.HTTPConnection(str(address.hostname), address.port, timeout=5)
    connection.request("GET", address.path)
    headers = connection.getresponse().headers
    connection.close()
    assert headers["X-Frame-Options"] == "DENY"
    assert headers["X-Content-Type-Options"] == "nosniff"
    assert headers["Content-Security-Policy"] == "frame-ancestors 'none'"


@pytest.mark.parametrize(
    "frames",
    [
        (b"\xff", b"/pbd", b"\xff"),
        (b"delete", b"\xff", b"\xff"),
        (b"wait", b"", b""),
        (b"capture_image", b"", b""),
        (b"", b"", b""),
    ],
)
def test_one_frame_that_makes_no_sense_does_not_wedge_it(frames: tuple[bytes, ...]) -> None:
    with LiveViewer() as viewer:
        viewer._outgoing += packed(frames)
        viewer._unanswered += 1
        with pytest.raises(PbdError, match="can't show this"):
            viewer.catch_up(5000.0)
        viewer.visualizer["after"].delete()
        assert not viewer.behind()


def test_a_server_that_has_stopped_does_not_stop_the_recording() -> None:
    with LiveViewer(waits=False) as viewer:
        os.kill(viewer._process.pid, signal.SIGSTOP)
        viewer.visualizer["much"].set_property("name", "x" * 1_000_000)
        assert viewer.behind()
        os.kill(viewer._process.pid, signal.SIGCONT)
        viewer.catch_up(5000.0)
        assert not viewer.behind()


@pytest.mark.parametrize(
    ("origin", "host", "status"),
    [
        (None, "127.0.0.1:{port}", 403),  # no browser: another process on this machine
        ("http://127.0.0.1:{port}", "127.0.0.1:{port}", 101),
        ("http://localhost:{port}", "localhost:{port}", 101),
        ("http://elsewhere.example", "127.0.0.1:{port}", 403),
        ("http://127.0.0.1:1", "127.0.0.1:{port}", 403),  # another server on this machine
        ("null", "127.0.0.1:{port}", 403),  # a file, or a frame in a sandbox
        ("http://elsewhere.example:{port}", "elsewhere.example:{port}", 404),  # a name pointed at this machine
    ],
)
def test_other_pages_get_no_socket(viewer: LiveViewer, origin: str | None, host: str, status: int) -> None:
    port = urlsplit(viewer.url).port
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=5)
    headers = {
        "Host": host.format(port=port),
        "Upgrade": "websocket",
        "Connection": "Upgrade",
        "Sec-WebSocket-Version": "13",
        "Sec-WebSocket-Key": "dGhlIHNhbXBsZSBub25jZQ==",
    }
    if origin is not None:
        headers["Origin"] = origin.format(port=port)
    try:
        connection.request("GET", "/", headers=headers)
        assert connection.getresponse().status == status
    finally:
        connection.close()


def test_each_viewer_finds_a_port_of_its_own(viewer: LiveViewer) -> None:
    with LiveViewer() as other:
        assert urlsplit(other.url).port != urlsplit(viewer.url).port
        for each in (viewer, other):
            assert answer(each.url, f"127.0.0.1:{urlsplit(each.url).port}") == 200


def test_a_page_that_closes_keeps_nobody_waiting() -> None:
    """Whoever draws is answered though a page has just gone, and the other pages see it."""
    seen = []

    class Going:
        def write_message(self, data: bytes, binary: bool) -> None:
            bridge.websocket_pool.discard(self)
            raise WebSocketClosedError

    class Open:
        def write_message(self, data: bytes, binary: bool) -> None:
            seen.append((data, binary))

    bridge = LoopbackBridge.__new__(LoopbackBridge)
    bridge.websocket_pool = {Going(), Open(), Going()}
    bridge.forward_to_websockets([b"delete", b"/pbd", b"command"])
    assert seen == [(b"command", True)]


def test_it_plays_in_a_browser(viewer: LiveViewer, chrome: Chromium) -> None:
    build(scenes.pouring(), viewer.visualizer)
    replay = Replay(chrome, viewer.url)
    address = urlsplit(viewer.url)
    assert {urlsplit(asked).netloc for asked in replay.requests()} == {address.netloc}
    replay("pbd.page.player.seek(5)")
    before = replay.place("pbd", "object")
    replay("pbd.page.player.seek(9)")
    assert abs(before - replay.place("pbd", "object")).max() > 0.05
    # a second scene takes the place of the first, in the page that is open
    build(scenes.ur5_moves(), viewer.visualizer)
    until(lambda: replay("return pbd.page.replay.robot") == "UR5", "the second scene")
    assert replay("return 'object' in pbd.page.stage.viewer.scene_tree.children.pbd.children") is False
    assert replay.errors() == []


@linux
def test_it_ends_with_a_killed_parent(parent: tuple[subprocess.Popen[str], int, str]) -> None:
    process, server, _ = parent
    assert alive(server)
    process.kill()
    process.wait()
    until(lambda: not alive(server), "the server's end", 5.0)


@linux
def test_ctrl_c_ends_it(parent: tuple[subprocess.Popen[str], int, str]) -> None:
    process, server, url = parent
    process.send_signal(signal.SIGINT)
    assert process.wait(10.0) == 0
    assert not alive(server)
    with pytest.raises(ConnectionError):
        socket.create_connection((urlsplit(url).hostname, urlsplit(url).port), 1.0)


@linux
def test_a_server_that_ends_by_itself_is_told(parent: tuple[subprocess.Popen[str], int, str]) -> None:
    process, server, _ = parent
    os.kill(server, signal.SIGKILL)
    assert process.wait(10.0) == 1
    assert process.stderr is not None
    assert "the live viewer's server was ended from outside" in process.stderr.read()


def test_a_page_whose_server_has_ended_says_so(chrome: Chromium) -> None:
    viewer = show_replay(scenes.ur5_moves(), open_browser=False, block=False)
    replay = Replay(chrome, viewer.url)
    viewer.close()
    until(lambda: "has ended" in replay.read("#message"), "the last word")
    assert replay.browser.find_element(By.ID, "message").is_displayed()
    chrome.get("about:blank")
    chrome.errors()  # of the connection that broke


@linux
def test_standard_input_alone_ends_it() -> None:
    viewer = LiveViewer()
    assert viewer._process.stdin is not None
    viewer._process.stdin.close()
    until(lambda: not alive(viewer._process.pid), "the server's end", 5.0)
    viewer.close()


def test_the_browser_is_opened_or_not(monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]) -> None:
    opened: list[str] = []
    monkeypatch.setattr("webbrowser.open", lambda url, new: opened.append(url))
    show_replay(scenes.ur5_moves(), open_browser=False, block=False).close()
    assert opened == []
    viewer = show_replay(scenes.ur5_moves(), open_browser=True, block=False)
    viewer.close()
    assert opened == [viewer.url]
    out, err = capfd.readouterr()
    assert out == ""
    assert viewer.url in err
