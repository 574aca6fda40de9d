"""The live viewer serves this machine and our own page only, and ends with its program."""

import errno
import http.client
import re
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from urllib.parse import urlsplit

import pytest
from selenium.webdriver.common.by import By

from pbd.errors import PbdError
from pbd.view import server
from pbd.view.replay_scene import ReplayScene
from pbd.view.scene import build
from pbd.view.server import LiveViewer, invite, show_replay
from tests.view import scenes
from tests.view.browser import Replay, until
from tests.view.chromium import Chromium

linux = pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")

SHOW = """
from pbd.view.server import show_replay
from tests.view import scenes
show_replay(scenes.ur5_moves(), open_browser=False)
"""


@pytest.fixture(scope="module")
def viewer() -> Iterator[LiveViewer]:
    with closing(LiveViewer()) as viewer:
        build(scenes.pouring(), viewer.visualizer)
        yield viewer


@pytest.fixture
def chrome(chrome: Chromium) -> Iterator[Chromium]:
    """With a small window, which is drawn faster."""
    chrome.set_size(640, 480)
    yield chrome
    chrome.set_size()


def by_hand() -> ReplayScene:
    """A scene without an object."""
    return replace(scenes.pouring(), title="By hand", grasped=None, phases=())


def has_object(page: Replay) -> bool:
    return bool(page("return 'object' in pbd.page.stage.viewer.scene_tree.children.pbd.children"))


def listening(port: int) -> set[str]:
    """The local addresses, in hexadecimal, that listen at a port."""
    rows = [
        line.split()[1:4:2]
        for table in ("tcp", "tcp6")
        for line in Path(f"/proc/net/{table}").read_text().splitlines()[1:]
    ]
    return {place.split(":")[0] for place, state in rows if state == "0A" and int(place.split(":")[1], 16) == port}


def ask(url: str, path: str, **headers: str) -> http.client.HTTPResponse:
    address = urlsplit(url)
    connection = http.client.HTTPConnection(str(address.hostname), address.port, timeout=60)
    try:
        connection.request("GET", path, headers={name.replace("_", "-"): value for name, value in headers.items()})
        return connection.getresponse()
    finally:
        connection.close()


@linux
def test_it_listens_on_loopback_only(viewer: LiveViewer) -> None:
    assert listening(urlsplit(viewer.url).port or 0) == {"0100007F"}


def test_the_page_is_served_to_this_machine_and_never_in_a_frame(viewer: LiveViewer) -> None:
    port = urlsplit(viewer.url).port
    assert ask(viewer.url, "/pbd", Host=f"elsewhere.example:{port}").status == 404
    mine = ask(viewer.url, "/pbd", Host=f"127.0.0.1:{port}")
    assert mine.status == 200
    assert mine.headers["X-Frame-Options"] == "DENY"
    assert mine.headers["X-Content-Type-Options"] == "nosniff"
    assert mine.headers["Content-Security-Policy"] == "frame-ancestors 'none'"


HANDSHAKE = {
    "Upgrade": "websocket",
    "Connection": "Upgrade",
    "Sec-WebSocket-Version": "13",
    "Sec-WebSocket-Key": "dGhlIHNhbXBsZSBub25jZQ==",
}


@pytest.mark.parametrize(
    ("origin", "host", "status"),
    [
        (None, "127.0.0.1:{port}", 403),  # no browser: another process on this machine
        ("http://localhost:{port}", "localhost:{port}", 101),
        ("http://elsewhere.example", "127.0.0.1:{port}", 403),
        ("http://127.0.0.1:1", "127.0.0.1:{port}", 403),  # another server on this machine
        ("null", "127.0.0.1:{port}", 403),  # a file, or a frame in a sandbox
        ("http://elsewhere.example:{port}", "elsewhere.example:{port}", 404),  # a name pointed at this machine
    ],
)
def test_other_pages_get_no_socket(viewer: LiveViewer, origin: str | None, host: str, status: int) -> None:
    port = urlsplit(viewer.url).port
    asked_by = {} if origin is None else {"Origin": origin.format(port=port)}
    assert ask(viewer.url, "/", Host=host.format(port=port), **HANDSHAKE, **asked_by).status == status


def test_nothing_that_a_page_sends_is_kept(viewer: LiveViewer) -> None:
    """Any page in the same browser may post without asking: the server closes before the 100 MB have come."""
    with socket.create_connection(("127.0.0.1", urlsplit(viewer.url).port), timeout=60) as post:
        post.sendall(b"POST /pbd HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: 100000000\r\n\r\n")
        assert b"400" in post.recv(100)


def test_it_ends_though_a_page_was_sent_nothing_yet() -> None:
    viewer = LiveViewer()
    address = urlsplit(viewer.url).netloc
    with closing(http.client.HTTPConnection(address, timeout=60)) as page:
        page.request("GET", "/", headers=HANDSHAKE | {"Origin": f"http://{address}"})
        assert page.getresponse().status == 101
        ending = threading.Thread(target=viewer.close, daemon=True)
        ending.start()
        ending.join(60.0)
    assert not ending.is_alive()


def test_it_plays_in_a_browser(viewer: LiveViewer, small: Chromium) -> None:
    replay = Replay(small, viewer.url)
    assert {urlsplit(asked).netloc for asked in replay.requests()} == {urlsplit(viewer.url).netloc}
    replay("pbd.page.player.seek(5)")
    before = replay.place("pbd", "object")
    replay("pbd.page.player.seek(9)")
    assert abs(before - replay.place("pbd", "object")).max() > 0.05
    # A second scene replaces the first in the open page.
    small.set_media(motion="no-preference")
    build(by_hand(), viewer.visualizer)
    until(lambda: replay("return pbd.page.replay.title") == "By hand", "the second scene")
    assert replay("return pbd.page.player.playing")  # by itself, unless the user prefers less motion
    replay("pbd.page.player.pause()")
    small.set_media()
    assert not has_object(replay)
    assert replay.errors() == []


def test_a_later_page_gets_the_last_scene_and_command_and_says_that_the_server_has_ended(small: Chromium) -> None:
    viewer = LiveViewer()
    build(scenes.pouring(), viewer.visualizer)
    build(by_hand(), viewer.visualizer)
    replay = Replay(small, viewer.url)
    assert replay("return pbd.page.replay.title") == "By hand"
    assert not has_object(replay)
    assert replay.errors() == []
    for k in range(100):
        viewer.visualizer["tool_path"].set_property("visible", bool(k % 2 == 0))
    viewer.close()
    until(lambda: "has ended" in replay.read("#message"), "the last word")
    assert replay('return pbd.page.stage.node("pbd", "tool_path").visible') is False
    assert replay.browser.find_element(By.ID, "message").is_displayed()
    viewer.close()
    small.get("about:blank")
    small.errors()  # of the connection that broke


@linux
def test_it_ends_with_ctrl_c() -> None:
    # A process in a shell's background ignores Ctrl-C, and its children inherit that.
    enabled = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler)\n"
    process = subprocess.Popen([sys.executable, "-c", enabled + SHOW], stderr=subprocess.PIPE, text=True)
    try:
        assert process.stderr is not None
        found = re.search(r"http://\S+", process.stderr.readline())
        assert found
        process.send_signal(signal.SIGINT)
        assert process.wait(10.0) == 0
        with pytest.raises(ConnectionError):
            socket.create_connection((urlsplit(found[0]).hostname, urlsplit(found[0]).port), 1.0)
    finally:
        process.kill()
        process.communicate()


def test_no_port_is_an_error_of_ours(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(port: int, address: str) -> None:
        raise OSError(errno.EMFILE, "Too many open files")

    monkeypatch.setattr(server, "bind_sockets", refuse)
    with pytest.raises(PbdError, match=r"did not start \(Too many open files\); use --html FILE instead"):
        LiveViewer()


@pytest.mark.parametrize("wanted", [False, True])
def test_the_browser_is_opened_or_not(
    wanted: bool, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    opened: list[str] = []
    monkeypatch.setattr("webbrowser.open", lambda url, new: opened.append(url))

    def invited(words: str, url: str, open_browser: bool) -> None:
        invite(words, url, open_browser)
        raise KeyboardInterrupt

    monkeypatch.setattr(server, "invite", invited)
    show_replay(scenes.ur5_moves(), open_browser=wanted)
    out, err = capfd.readouterr()
    assert out == ""
    url = re.findall(r"replay at (http://\S+) \(Ctrl-C ends it\)", err)
    assert opened == (url if wanted else [])
    assert url


@pytest.mark.parametrize(("chosen", "opened"), [(None, False), ("%s", True)])
def test_a_text_browser_opens_only_if_chosen(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, chosen: str | None, opened: bool
) -> None:
    """lynx over ssh took the terminal, and nothing was recorded until it ended."""
    lynx = tmp_path / "lynx"
    lynx.write_text('#!/bin/sh\necho "$1" > "$0.opened"\n')
    lynx.chmod(0o755)
    for name in ("DISPLAY", "WAYLAND_DISPLAY", "BROWSER"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("PATH", str(tmp_path))
    if chosen is not None:
        monkeypatch.setenv("BROWSER", chosen.replace("%s", f"{lynx} %s"))
    monkeypatch.setattr("webbrowser._tryorder", None)
    monkeypatch.setattr("webbrowser._browsers", {})
    invite("live view", "http://127.0.0.1:1/pbd", open_browser=True)
    assert (tmp_path / "lynx.opened").exists() == opened
