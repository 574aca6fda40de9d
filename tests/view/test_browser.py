"""The page in a real browser, from a file and without a net."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from selenium.webdriver import Chrome, Keys
from selenium.webdriver.common.action_chains import ActionChains
from selenium.webdriver.common.by import By

from pbd.view.motion import Motion
from pbd.view.page import write_page
from pbd.view.scene import ReplayScene
from tests.view import scenes
from tests.view.browser import Replay, until

FINGER = (
    "pbd",
    "robot",
    *(f"panda_joint{i}" for i in range(1, 8)),
    "panda_finger_joint1",
)


@pytest.fixture(scope="module")
def scene() -> ReplayScene:
    return scenes.pouring()


@pytest.fixture(scope="module")
def opened(chrome: Chrome, replay_file: Path) -> Replay:
    return Replay(chrome, replay_file.as_uri())


@pytest.fixture
def replay(opened: Replay) -> Iterator[Replay]:
    opened("pbd.page.player.pause(); pbd.page.player.seek(0); pbd.page.player.loop = true; pbd.page.player.speed = 1")
    yield opened
    assert opened.errors() == []


def press(replay: Replay, keys: str) -> None:
    ActionChains(replay.chrome).send_keys(keys).perform()


def test_it_asks_for_nothing_but_itself(chrome: Chrome, replay_file: Path) -> None:
    replay = Replay(chrome, replay_file.as_uri())
    assert replay.requests() == {replay_file.as_uri()}
    assert replay.errors() == []  # a blocked request would be one


def test_links_are_where_pinocchio_says(replay: Replay, scene: ReplayScene) -> None:
    motion = Motion(scene.robot, scene.trajectory, 50.0)
    finger = motion.joint(motion.link("finger", "panda_leftfinger")[0])
    for i in (0, 90, 201, 433, len(motion.t) - 1):
        replay(f"pbd.page.player.seek({motion.t[i]})")
        np.testing.assert_allclose(replay.place(*FINGER), finger.p[i], atol=1e-5)


def test_keyframes_stand_where_they_were_put(replay: Replay, scene: ReplayScene) -> None:
    for i, keyframe in enumerate(scene.keyframes):
        np.testing.assert_allclose(replay.place("pbd", "keyframes", str(i), "triad"), keyframe.T_base_tool.p, atol=1e-6)


def test_each_part_is_seen(replay: Replay) -> None:
    whole = replay.picture()
    for part, share in {"robot": 0.03, "hand_path": 0.003, "keyframes": 0.002, "object": 0.002}.items():
        node = f'pbd.page.stage.node("pbd", "{part}")'
        replay(f"{node}.visible = false")
        without = replay.picture()
        replay(f"{node}.visible = true")
        changed = (np.abs(whole.astype(int) - without).max(axis=2) > 24).mean()
        assert changed > share, part


def test_playing_moves_and_ends_where_it_should(replay: Replay, scene: ReplayScene) -> None:
    before = replay.place(*FINGER)
    replay("pbd.page.player.loop = false; pbd.page.player.speed = 4; pbd.page.player.play()")
    until(lambda: replay.time > 1.0, "the clock to run")
    assert np.linalg.norm(replay.place(*FINGER) - before) > 0.02
    until(lambda: not replay("return pbd.page.player.playing"), "the end")
    assert replay.time == pytest.approx(scene.trajectory.duration)
    replay("pbd.page.player.loop = true; pbd.page.player.play()")
    until(lambda: 0.0 < replay.time < 5.0, "the second round")


def test_keys_work_as_in_video_players(replay: Replay, scene: ReplayScene) -> None:
    for keys, wanted in (
        (Keys.ARROW_RIGHT, 1.0),
        (Keys.ARROW_RIGHT * 2, 3.0),
        (Keys.ARROW_LEFT, 2.0),
        (".", 2.02),
        (",", 2.0),
        ("5", scene.trajectory.duration / 2),
        (Keys.END, scene.trajectory.duration),
        (Keys.HOME, 0.0),
        ("nn", scene.keyframes[2].t),
        ("p", scene.keyframes[1].t),
    ):
        press(replay, keys)
        assert replay.time == pytest.approx(wanted), repr(keys)
    press(replay, " ")
    assert replay("return pbd.page.player.playing")
    press(replay, " ")
    assert not replay("return pbd.page.player.playing")
    press(replay, ">")
    assert replay("return pbd.page.player.speed") == 2
    press(replay, "r")
    assert not replay("return pbd.page.player.loop")


def test_a_click_on_a_keyframe_goes_there(replay: Replay, scene: ReplayScene) -> None:
    rows = replay.chrome.find_elements(By.CSS_SELECTOR, "#keyframes tbody tr")
    assert [row.find_elements(By.TAG_NAME, "td")[1].text.split(" ")[0] for row in rows] == [
        keyframe.label.split(" ")[0] for keyframe in scene.keyframes
    ]
    rows[3].click()
    assert replay.time == pytest.approx(scene.keyframes[3].t)
    assert "now" in rows[3].get_attribute("class").split()
    replay.chrome.find_elements(By.CSS_SELECTOR, "#labels button")[4].click()
    assert replay.time == pytest.approx(scene.keyframes[4].t)


def test_buttons_and_switches(replay: Replay) -> None:
    replay.chrome.find_element(By.ID, "next").click()
    assert replay.time > 0.0
    (path,) = (row for row in replay.chrome.find_elements(By.CSS_SELECTOR, "#legend label") if "hand" in row.text)
    path.click()
    assert not replay('return pbd.page.stage.node("pbd", "hand_path").visible')
    path.click()
    assert replay('return pbd.page.stage.node("pbd", "hand_path").visible')


def test_the_camera_fits_every_window(replay: Replay) -> None:
    try:
        for width, height in ((1600, 1000), (900, 700), (420, 760)):
            replay.chrome.set_window_size(width, height)
            until(lambda width=width: replay("return innerWidth") == width, "the new size")  # type: ignore[misc]
            replay("document.body.classList.toggle('folded', innerWidth < 640); pbd.page.stage.resize()")
            seen = np.array(
                replay("""
                const { stage } = pbd.page, { scene } = stage.viewer;
                stage.render();
                return stage.extent.map((p) => scene.localToWorld(p.clone()).project(stage.camera).toArray());
                """)
            )
            x, y = (0.5 + 0.5 * seen[:, 0]) * width, (0.5 - 0.5 * seen[:, 1]) * replay("return innerHeight")
            panel = replay('return document.getElementById("panel").getBoundingClientRect().left')
            right = panel if width > 640 else width
            assert x.min() > 0.0
            assert x.max() < right
            assert y.min() > 0.0
            assert y.max() < replay('return document.getElementById("bar").getBoundingClientRect().top')
    finally:
        replay.chrome.set_window_size(1200, 750)
        replay("document.body.classList.remove('folded'); pbd.page.stage.resize()")


def test_dark_is_dark(replay: Replay) -> None:
    light = replay.picture()
    for scheme in ("dark", "light"):
        features = [{"name": "prefers-color-scheme", "value": scheme}]
        replay.chrome.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": features})
        if scheme == "dark":
            dark = replay.picture()
    assert dark.mean() < 90 < 170 < light.mean()


def test_words_from_files_are_words(chrome: Chrome, tmp_path: Path) -> None:
    evil = '</script><img src=x onerror="document.title=1"><b>'
    scene = scenes.ur5_moves()
    keyframes = tuple(replace(keyframe, label=evil) for keyframe in scene.keyframes)
    write_page(replace(scene, title=evil, notes=(evil,), keyframes=keyframes), tmp_path / "evil.html")
    replay = Replay(chrome, (tmp_path / "evil.html").as_uri())
    assert replay("return document.getElementById('title').textContent") == evil
    assert replay("return document.querySelectorAll('img, b:not(#time b, #joints b)').length") == 0
    assert replay("return document.title") == evil
    assert replay.errors() == []
