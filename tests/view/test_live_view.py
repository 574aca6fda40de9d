"""The view of a running recording, in a real browser; it never blocks the recording."""

import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from urllib.parse import urlsplit

import numpy as np
import pytest

from pbd.data import Keyframe
from pbd.files.demo import read_demo
from pbd.pose import Array, Pose
from pbd.simulation.simulate import simulate
from pbd.tracking.online.tracker import LiveTracker
from pbd.view.live_view import PIECES_AT_ONCE, SMALLEST_M, LivePicture, LiveView
from tests.not_none import not_none
from tests.view.browser import Page, until
from tests.view.chromium import Chromium

EVERY = 10
"""Samples, at 100 Hz, from one picture to the next: as often as a recording draws."""

EVIL = '</script><img src=x onerror="document.title=1">'


def picture(tracker: LiveTracker, t: float) -> LivePicture:
    return LivePicture(
        t,
        tracker.p_nav_sensor,
        tracker.v_nav_sensor,
        tracker.wxyz_nav_sensor,
        tracker.keyframes,
        "moves" if tracker.moving else "still",
        "moves" if tracker.moving else "stands still",
        EVIL,
        (f"{len(tracker.keyframes)} stops", f"{t:.1f} s"),
    )


@pytest.fixture(scope="module")
def pictures() -> list[LivePicture]:
    """The tracker's states for a simulated hand that stops four times."""
    recording = simulate("pick-and-place-stops", "modern", 1).recording
    tracker, seen = LiveTracker(), []
    for k in range(len(recording)):
        tracker.feed(recording.t[k], recording.acc[k], not_none(recording.gyr)[k])
        if k % EVERY == 0:
            seen.append(picture(tracker, float(recording.t[k])))
    return seen


@pytest.fixture(scope="module")
def view() -> Iterator[LiveView]:
    with closing(LiveView()) as view:
        view.open("tea <i>", "a hand", open_browser=False)
        yield view


@pytest.fixture(scope="module")
def opened(view: LiveView, chrome: Chromium) -> Iterator[Page]:
    chrome.set_media(motion="no-preference")  # the camera glides
    chrome.set_size(480, 360)
    yield Page(chrome, view._viewer.url)
    chrome.set_size()
    chrome.set_media()


@pytest.fixture
def page(view: LiveView, opened: Page, chrome: Chromium) -> Page:
    """The view's page; opened again where a worker ran `test_a_recording_is_seen_and_ends_as_it_should` before."""
    return opened if chrome.current_url == view._viewer.url else Page(chrome, view._viewer.url)


def draw(view: LiveView, shown: LivePicture) -> None:
    """Show a picture once the server is ready for it."""
    until(lambda: not view._viewer.behind(), "the server")
    view.show(shown)


def settled(page: Page, shown: LivePicture) -> None:
    until(lambda: page.read("#live ul").endswith(shown.figures[-1]), "the page")


def assert_stops(page: Page, shown: LivePicture) -> None:
    for i, keyframe in enumerate(shown.keyframes):
        drawn = page.place("pbd", "stops", str(i), "triad")
        np.testing.assert_allclose(drawn, keyframe.T_nav_sensor.p, atol=SMALLEST_M)


@pytest.fixture(scope="module")
def shown_positions(view: LiveView, opened: Page, pictures: list[LivePicture]) -> list[Array]:
    """Show the whole recording; return some of the hand's positions on the page."""
    places = []
    for k, shown in enumerate(pictures):
        draw(view, shown)
        if k % 20 == 19 or k == len(pictures) - 1:
            settled(opened, shown)
            here = opened.place("pbd", "hand")
            assert np.linalg.norm(here - shown.p_nav_sensor) < 2.0 * SMALLEST_M
            assert opened.read("#live strong") == shown.badge
            assert int(opened("return pbd.page.stops")) == len(shown.keyframes)
            places.append(here)
    return places


def test_the_hand_moves_and_stops_appear(shown_positions: list[Array], page: Page, pictures: list[LivePicture]) -> None:
    assert np.ptp(shown_positions, axis=0).max() > 0.1
    assert len(pictures[-1].keyframes) > 3
    assert_stops(page, pictures[-1])
    labels = page('return Array.from(document.querySelectorAll("#labels span"), (node) => node.textContent)')
    assert labels == [str(i) for i in range(len(pictures[-1].keyframes))]


@pytest.mark.usefixtures("shown_positions")
def test_the_path_leads_from_stop_to_stop(view: LiveView, page: Page, pictures: list[LivePicture]) -> None:
    for _ in range(20):  # what is left of it
        draw(view, pictures[-1])
    spans = page("""
        const { THREE } = MeshCat, nodes = pbd.page.stage.viewer.scene_tree.children.pbd.children.path.children;
        pbd.page.stage.viewer.scene.updateMatrixWorld(true);
        return Object.entries(nodes).map(([move, node]) => {
          const box = new THREE.Box3().setFromObject(node.object);
          return [Number(move), [box.min.x, -box.max.z, box.min.y], [box.max.x, -box.min.z, box.max.y]];
        });""")
    stops = [keyframe.T_nav_sensor.p for keyframe in pictures[-1].keyframes]
    assert [move for move, _, _ in spans] == [0, 1, 2]  # the last one only turns the hand
    for move, low, high in spans:
        ends = np.array(stops[move : move + 2])
        # the tube's radius, and how far a move may swing out
        assert (np.array(low) < ends.min(axis=0) + 0.002).all()
        assert (np.array(high) > ends.max(axis=0) - 0.002).all()
        assert (np.array(low) > ends.min(axis=0) - 0.02).all()
        assert (np.array(high) < ends.max(axis=0) + 0.02).all()


@pytest.mark.usefixtures("shown_positions")
def test_stops_add_nothing_to_the_panel_that_nobody_sees(page: Page) -> None:
    """It grew by dozens of elements for each stop, without end."""
    titles = page("return [...document.querySelectorAll('.dg .title')].map((title) => title.textContent)")
    assert "Scene" in titles
    assert "pbd" not in titles


@pytest.mark.usefixtures("shown_positions")
def test_the_whole_scene_is_in_sight_without_parts_of_the_replay(page: Page) -> None:
    for part in ("panel", "bar"):
        assert not page(f'return document.getElementById("{part}").checkVisibility()')
    seen = np.array(
        page("""
        const { stage } = pbd.page, { scene } = stage.viewer;
        stage.render();
        return stage.labels.map(({ point }) => scene.localToWorld(point.clone()).project(stage.camera).toArray());""")
    )
    below = 1.0 - 2.0 * page("return element('live').getBoundingClientRect().top / innerHeight")
    assert (np.abs(seen[:, 0]) < 1.0).all()
    assert (seen[:, 1] < 1.0).all()
    assert (seen[:, 1] > below).all()


@pytest.mark.usefixtures("shown_positions")
def test_hand_and_path_are_seen(page: Page) -> None:
    whole = page.picture()
    for part in ("hand", "path"):
        page(f'pbd.page.stage.node("pbd", "{part}").visible = false')
        without = page.picture()
        page(f'pbd.page.stage.node("pbd", "{part}").visible = true')
        assert (np.abs(whole.astype(int) - without).max(axis=2) > 24).mean() > 3e-4, part


@pytest.mark.usefixtures("shown_positions")
def test_it_requests_nothing_from_elsewhere_and_text_is_never_code(view: LiveView, page: Page) -> None:
    mine = urlsplit(view._viewer.url).netloc
    assert {urlsplit(asked).netloc for asked in page.requests()} == {mine}
    assert page.read("#live span") == EVIL
    assert page.read("#recording h1") == "tea <i>"
    assert page("return document.querySelectorAll('img, h1 i').length") == 0
    assert page.errors() == []


@pytest.mark.usefixtures("shown_positions")
def test_a_page_that_is_opened_later_shows_the_same(view: LiveView, page: Page, pictures: list[LivePicture]) -> None:
    later = Page(page.browser, view._viewer.url)
    settled(later, pictures[-1])
    assert np.linalg.norm(later.place("pbd", "hand") - pictures[-1].p_nav_sensor) < 2.0 * SMALLEST_M
    until(lambda: later("return pbd.page.stage.labels.length") == 3 + len(pictures[-1].keyframes), "the stops")
    assert_stops(later, pictures[-1])


@pytest.mark.usefixtures("shown_positions")
def test_ellipsoids_are_two_sigma(view: LiveView, page: Page, pictures: list[LivePicture]) -> None:
    """The covariance read back from the ellipsoid's axes is the keyframe's."""
    turn = Pose.from_rpy(np.zeros(3), (0.4, -0.7, 1.1)).matrix()[:3, :3]
    cov = np.zeros((6, 6))
    cov[:3, :3] = turn @ np.diag([0.03, 0.01, 0.002]) ** 2 @ turn.T
    last = pictures[-1].keyframes[-1]
    there = Keyframe(99.0, 1.0, Pose(last.T_nav_sensor.p + 0.05, last.T_nav_sensor.wxyz), cov)
    shown = replace(pictures[-1], t=99.9, keyframes=(*pictures[-1].keyframes, there), figures=("99 s",))
    draw(view, shown)
    settled(page, shown)
    node = f'pbd.page.stage.node("pbd", "stops", "{len(shown.keyframes) - 1}", "two_sigma")'
    axes = np.array(page(f"const m = {node}; m.updateMatrix(); return m.matrix.elements")).reshape(4, 4).T[:3, :3]
    np.testing.assert_allclose(axes @ axes.T, 4.0 * cov[:3, :3], atol=1e-9)
    assert np.linalg.det(axes) > 0.0


def test_it_says_that_the_recording_ended(view: LiveView, page: Page, pictures: list[LivePicture]) -> None:
    """It closes the view, so it must be the last test with it."""
    view.end(replace(pictures[-1], state="ended", badge="ended", line="kept in demos/tea"))
    view.close()
    until(lambda: page.read("#live strong") == "ended", "the last word")
    assert page.read("#live span") == "kept in demos/tea"
    until(lambda: page("return pbd.page.stage.viewer.connection.readyState") == 3, "the connection to end")
    assert page.read("#live span") == "kept in demos/tea"
    assert not page('return document.getElementById("message").checkVisibility()')


def test_nan_is_not_drawn(pictures: list[LivePicture]) -> None:
    with closing(LiveView()) as view:
        view.show(replace(pictures[-1], p_nav_sensor=np.full(3, np.nan)))
        draw(view, pictures[-1])


def test_a_stop_that_is_known_better_moves(pictures: list[LivePicture]) -> None:
    """At the end all is drawn, however many pieces of path one picture takes."""
    *before, last = pictures[-1].keyframes
    better = replace(last, T_nav_sensor=Pose(last.T_nav_sensor.p + 0.01, last.T_nav_sensor.wxyz))
    with closing(LiveView()) as view:
        sent: list[Any] = []
        window = view._scene.window

        def send(command: Any) -> None:
            sent.append(command)
            window.send(command)

        view._scene.window = SimpleNamespace(send=send)
        for shown in pictures:
            view._follow(shown)  # the server is busy all the time
        view.end(pictures[-1])
        pieces = sum("path" in command.path.entries for command in sent if hasattr(command, "object"))
        assert pieces > 2 * PIECES_AT_ONCE
        sent.clear()
        view._follow(replace(pictures[-1], keyframes=(*before, better)))
        view.end(pictures[-1])
        moved = {str(command.path.entries): command.matrix for command in sent if hasattr(command, "matrix")}
        assert len(moved) == 2
        for matrix in moved.values():
            np.testing.assert_allclose(np.asarray(matrix)[:3, 3], better.T_nav_sensor.p)


class Recording:
    """A process that runs `pbd record --live` with a simulated sensor."""

    def __init__(self, folder: Path) -> None:
        words = ("record", "tea", "--sensor", "sim:pour", "--live", "--no-open")
        self.process = subprocess.Popen(
            [sys.executable, "-m", "pbd", *words],
            cwd=folder,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        self.url = self.line("http://").split()[-1]

    def line(self, wanted: str) -> str:
        for line in not_none(self.process.stderr):
            if wanted in line:
                return line.strip()
        raise AssertionError(f"it ended without {wanted!r}")


@pytest.fixture
def recording(tmp_path: Path) -> Iterator[Recording]:
    recording = Recording(tmp_path)
    yield recording
    recording.process.kill()
    recording.process.communicate()


def test_a_recording_is_seen_and_ends_as_it_should(recording: Recording, tmp_path: Path, small: Chromium) -> None:
    page = Page(small, recording.url)
    began = page.place("pbd", "hand")
    until(lambda: np.linalg.norm(page.place("pbd", "hand") - began) > 0.05, "the hand to move")
    until(lambda: page("return pbd.page.stops") > 1, "a stop")
    line = re.compile(r"stop \d+ at \(.*\) cm, sigma .* cm: you may move on")
    until(lambda: line.fullmatch(page.read("#live span")), "a word of it")
    recording.process.send_signal(signal.SIGINT)
    assert recording.process.wait(10.0) == 0
    until(lambda: page.read("#live strong") == "ended", "the last word")
    assert page.read("#live span") == "stopped by you; kept in demos/tea"
    assert len(read_demo(tmp_path / "demos" / "tea").recording) > 100
