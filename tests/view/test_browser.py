"""The page in a real browser, from a file and without a network."""

import base64
import re
import zlib
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from selenium.webdriver import Keys
from selenium.webdriver.common.action_chains import ActionChains
from selenium.webdriver.common.by import By
from selenium.webdriver.support.ui import Select

from pbd.pose import Array
from pbd.view.page import write_page
from pbd.view.replay_scene import ReplayScene
from tests.view import scenes
from tests.view.browser import Replay, until
from tests.view.chromium import Chromium
from tests.view.firefox import Firefox

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
def opened(chrome: Chromium, replay_file: Path) -> Replay:
    """Opened once. The scene is hidden: without a graphics card it takes most of the time to draw."""
    replay = Replay(chrome, replay_file.as_uri())
    assert not replay.began
    replay("pbd.page.stage.node('pbd').visible = false")
    return replay


@pytest.fixture
def replay(opened: Replay) -> Iterator[Replay]:
    """The page as after loading, but paused."""
    opened("pbd.page.player.pause(); pbd.page.player.seek(0); pbd.page.player.loop = true; pbd.page.player.speed = 1")
    opened("for (const id of ['joints', 'panel']) pbd.page.fold(id, false); document.activeElement.blur()")
    opened.browser.set_media()
    yield opened
    assert opened.errors() == []


def finger_of(scene: ReplayScene) -> Array:
    """Positions of a finger over time, (n, 3) m."""
    return scene.motion.joint(scene.motion.link("panda_leftfinger")[0]).p


def press(replay: Replay, keys: str) -> None:
    ActionChains(replay.browser).send_keys(keys).perform()


def test_it_requests_nothing_but_itself(replay: Replay, replay_file: Path) -> None:
    assert replay.requests() <= {replay_file.as_uri()}
    assert replay.errors() == []  # a blocked request would be one


def test_links_are_where_pinocchio_says(replay: Replay, scene: ReplayScene) -> None:
    finger = finger_of(scene)
    for i in (0, 90, 201, 433, len(finger) - 1):
        replay(f"pbd.page.player.seek({scene.motion.t[i]})")
        np.testing.assert_allclose(replay.place(*FINGER), finger[i], atol=1e-5)


def test_keyframes_stand_where_they_were_put(replay: Replay, scene: ReplayScene) -> None:
    for i, pose in enumerate(scene.T_base_tool):
        np.testing.assert_allclose(replay.place("pbd", "keyframes", str(i), "triad"), pose.p, atol=1e-6)


def test_playing_moves_and_ends_where_it_should(replay: Replay, scene: ReplayScene) -> None:
    before = replay.place(*FINGER)
    replay("pbd.page.player.loop = false; pbd.page.player.speed = 4; pbd.page.player.play()")
    until(lambda: replay.time > 1.0, "the clock to run")
    assert np.linalg.norm(replay.place(*FINGER) - before) > 0.02
    replay(f"pbd.page.player.seek({scene.trajectory.duration - 1.0})")
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
        ("l", 5.0),
        ("j", 0.0),
        ("nn", scene.trajectory.keyframe_t[2]),
        ("p", scene.trajectory.keyframe_t[1]),
        (Keys.ARROW_DOWN * 2, scene.trajectory.keyframe_t[3]),
        (Keys.ARROW_UP, scene.trajectory.keyframe_t[2]),
    ):
        press(replay, keys)
        assert replay.time == pytest.approx(wanted), repr(keys)
    for key in (" ", "k"):
        press(replay, key)
        assert replay("return pbd.page.player.playing")
        press(replay, key)
        assert not replay("return pbd.page.player.playing")
    press(replay, ">")
    assert replay("return pbd.page.player.speed") == 2
    press(replay, "<<")
    assert replay("return pbd.page.player.speed") == 0.5
    press(replay, "r")
    assert not replay("return pbd.page.player.loop")


def test_help_lists_the_keys(replay: Replay) -> None:
    press(replay, "?")
    assert replay("return document.getElementById('help').open")
    listed = {cap.text.lower() for cap in replay.browser.find_elements(By.TAG_NAME, "kbd")}
    assert {"space", "k", "j", "l", "home", "end", ",", ".", "<", ">", "0", "9", "?"} <= listed
    press(replay, Keys.END)  # behind the help nothing moves
    assert replay.time == 0.0
    press(replay, Keys.ESCAPE)
    assert not replay("return document.getElementById('help').open")
    replay.browser.find_element(By.ID, "show-help").click()
    replay.browser.find_element(By.CSS_SELECTOR, "#help button").click()
    assert not replay("return document.getElementById('help').open")


def test_help_begins_at_its_top_in_a_small_window(replay: Replay) -> None:
    try:
        replay.browser.set_size(800, 300)
        press(replay, "?")
        assert replay("return element('help').scrollTop") == 0
        press(replay, Keys.ESCAPE)
    finally:
        replay.browser.set_size()


def test_a_click_on_a_keyframe_goes_there(replay: Replay, scene: ReplayScene) -> None:
    rows = replay.browser.find_elements(By.CSS_SELECTOR, "#keyframes tbody tr")
    cells = replay("""return [...document.querySelectorAll("#keyframes tbody tr")].map((row) =>
        [...row.querySelectorAll("td")].map((cell) => cell.innerText.trim()))""")
    signs = {None: "", True: "▸◂ ", False: "◂▸ "}  # before the label, whose end may be cut off
    assert [row[1] for row in cells] == [signs[keyframe.grip] + keyframe.label for keyframe in scene.keyframes]
    for k, row in enumerate(cells):
        position, rotation = (np.sqrt(np.linalg.eigvalsh(scene.cov[k, i : i + 3, i : i + 3]).max()) for i in (0, 3))
        shown = [float(text.replace("\u2212", "-")) for text in row[2:]]
        wanted = [scene.trajectory.keyframe_t[k], *(100.0 * scene.T_base_tool[k].p), 1000.0 * position]
        np.testing.assert_allclose(shown[:-1], [*wanted, np.degrees(rotation)], atol=0.0501)
        assert shown[-1] == round(100.0 * scene.inside[k])
    rows[3].find_element(By.TAG_NAME, "td").click()
    assert replay.time == pytest.approx(scene.trajectory.keyframe_t[3])
    assert [row.get_attribute("aria-current") for row in rows].index("true") == 3
    rows[5].find_element(By.TAG_NAME, "button").send_keys(Keys.ENTER)
    assert replay.time == pytest.approx(scene.trajectory.keyframe_t[5])
    replay.browser.find_elements(By.CSS_SELECTOR, "#labels button")[4].click()
    assert replay.time == pytest.approx(scene.trajectory.keyframe_t[4])


def test_buttons_and_switches(replay: Replay, scene: ReplayScene) -> None:
    def click(name: str) -> None:
        replay.browser.find_element(By.ID, name).click()

    times = scene.trajectory.keyframe_t
    click("next")
    click("next")
    assert replay.time == pytest.approx(times[2])
    click("previous")
    assert replay.time == pytest.approx(times[1])
    click("play")
    until(lambda: replay.time > times[1] + 0.2, "the clock to run")
    click("play")
    assert not replay("return pbd.page.player.playing")
    Select(replay.browser.find_element(By.ID, "speed")).select_by_visible_text("0.25\u00d7")
    assert replay("return pbd.page.player.speed") == 0.25
    for button, part in (("show-joints", "joints"), ("show-panel", "panel")):
        shown = replay.browser.find_element(By.ID, part)
        click(button)
        assert not shown.is_displayed()
        assert replay.browser.find_element(By.ID, button).get_attribute("aria-expanded") == "false"
        click(button)
        assert shown.is_displayed()
    (path,) = (row for row in replay.browser.find_elements(By.CSS_SELECTOR, "#legend label") if "hand" in row.text)
    path.click()
    assert not replay('return pbd.page.stage.node("pbd", "hand_path").visible')
    path.click()
    assert replay('return pbd.page.stage.node("pbd", "hand_path").visible')
    (thing,) = (row for row in replay.browser.find_elements(By.CSS_SELECTOR, "#legend label") if "object" in row.text)
    thing.click()
    assert not replay('return pbd.page.stage.node("pbd", "object").visible')
    thing.click()


def test_seeking_on_the_time_axis_and_in_the_plot(replay: Replay, scene: ReplayScene) -> None:
    for name in ("timeline", "plot"):
        place = replay.browser.find_element(By.ID, name)
        for share in (0.25, 0.7):
            ActionChains(replay.browser).move_to_element_with_offset(
                place, round((share - 0.5) * place.size["width"]), 5
            ).click().perform()
            assert replay.time == pytest.approx(share * scene.trajectory.duration, abs=0.04)
            assert float(replay.browser.find_element(By.ID, "seek").get_attribute("value") or 0) == pytest.approx(
                replay.time, abs=0.011
            )
            cursor = replay("return document.querySelector('#plot line.now').getBoundingClientRect().left")
            assert cursor == pytest.approx(place.rect["x"] + share * place.size["width"], abs=2.0)
    end = "const seek = element('seek'), { max } = seek; seek.max = 1.2345; seek.value = 9; const end = seek.value;"
    assert replay(f"{end} seek.max = max; return end") == "1.2345", "the slider reaches an end that is no whole frame"


def test_the_time_axis_shows_moves_and_grip(replay: Replay) -> None:
    moves, closed, duration = replay(
        "const { moves, closed, duration } = pbd.page.replay; return [moves, closed, duration]"
    )
    axis = replay.browser.find_element(By.ID, "timeline").rect
    for lane, spans in (("moves", moves), ("closed", closed)):
        drawn = [span.rect for span in replay.browser.find_elements(By.CSS_SELECTOR, f"#{lane} i")]
        edges = [((box["x"] - axis["x"]), (box["x"] + box["width"] - axis["x"])) for box in drawn]
        np.testing.assert_allclose(np.array(edges) / axis["width"] * duration, spans, atol=0.03)
    assert replay.browser.find_elements(By.CSS_SELECTOR, "#touching i") == []


def test_it_says_where_the_arm_is(replay: Replay, scene: ReplayScene) -> None:
    """When it arrives the arm is at a keyframe; at the end it is at home, or at the last one."""
    for k, t in enumerate(scene.trajectory.keyframe_t):
        replay(f"pbd.page.player.seek({t})")
        assert replay.read("#phase") == f"at keyframe {k}: {scene.keyframes[k].label}"
    replay(f"pbd.page.player.seek({scene.trajectory.keyframe_t[3] - 0.3})")
    assert replay.read("#phase") == "to keyframe 3: over the cup"
    home = """
        const { replay, keyframes } = pbd.page, last = replay.keyframes.length - 1, { t } = replay.keyframes[last];
        const returns = { ...replay, moves: [...replay.moves, [t + 0.5, t + 2.008]], duration: t + 2 };
        const words = (after) => pbd.page.words.call({ replay: returns, keyframes }, last, t + after);
        return [0, 0.4, 1, 2].map(words);"""
    assert replay(home) == ["at keyframe 7: away"] * 2 + ["going back", "at rest"]


def test_labels_stay_near_their_keyframes(replay: Replay) -> None:
    """Where there are too many for that, some are left out; the current one never is."""
    farthest, shown, current = replay("""
        const { stage, keyframes, replay } = pbd.page, old = [...element("labels").children];
        const look = (i) => ({ className: i === 99 ? "now" : "" });
        const many = Array.from({ length: 100 }, (_, i) => make("button", String(i), look(i)));
        const points = many.map((_, i) => [0.5 + 0.006 * (i % 10), 0.1, 0.3 + 0.006 * Math.floor(i / 10)]);
        element("labels").replaceChildren(...many);
        stage.label(many, points);
        stage.placeLabels();
        const seen = (p) => stage.viewer.scene.localToWorld(new MeshCat.THREE.Vector3(...p)).project(stage.camera);
        const off = (label, i) => {
          const { top, height } = label.getBoundingClientRect();
          return Math.abs(top + height / 2 + 22 - (0.5 - 0.5 * seen(points[i]).y) * innerHeight);
        };
        const shown = many.map((label) => label.style.visibility === "visible");
        const found = [Math.max(...many.map(off).filter((_, i) => shown[i])), shown.filter(Boolean).length, shown[99]];
        element("labels").replaceChildren(...old);
        stage.label(keyframes.labels, replay.keyframes.map((k) => k.p));
        stage.placeLabels();
        return found;""")
    assert farthest < 57.0  # 15 steps of 3 pixels, and 12 within a row
    assert 1 < shown < 100
    assert current


def test_labels_of_one_point_stay_in_the_window(replay: Replay) -> None:
    left, right = replay("""
        const { stage, keyframes, replay } = pbd.page, old = [...element("labels").children];
        const many = Array.from({ length: 100 }, (_, i) => make("button", String(i)));
        element("labels").replaceChildren(...many);
        stage.label(many, many.map(() => replay.keyframes[0].p));
        stage.placeLabels();
        const shown = many.filter(({ style }) => style.visibility === "visible").map((b) => b.getBoundingClientRect());
        const found = [Math.min(...shown.map((box) => box.left)), Math.max(...shown.map((box) => box.right))];
        element("labels").replaceChildren(...old);
        stage.label(keyframes.labels, replay.keyframes.map((k) => k.p));
        stage.placeLabels();
        return found;""")
    assert 0 < left < right < 1200


def test_the_subtitle_has_the_largest_share_of_a_torque_limit(replay: Replay) -> None:
    assert replay.read("#subtitle").replace("\u00a0", " ").endswith(" \u00b7 torques up to 67 % of the limits")


def test_a_joint_between_its_limits(replay: Replay, scene: ReplayScene) -> None:
    replay("pbd.page.player.seek(3.21)")
    (q,) = scene.trajectory.at(np.array([3.21])).q
    chips = replay.browser.find_elements(By.CSS_SELECTOR, "#angles button")
    shown = [float(chip.text.split()[-1].replace("\u2212", "-").rstrip("\u00b0")) for chip in chips]
    np.testing.assert_allclose(shown, np.degrees(q), atol=0.2)  # drawn at 25 Hz
    chips[3].click()
    assert replay.read("#lowest") == "\u2212172\u00b0"  # its limits are 3 rad either way
    assert replay.read("#highest") == "172\u00b0"
    assert len(replay.browser.find_elements(By.CSS_SELECTOR, "#plot line.limit")) == 2
    assert len(replay.browser.find_elements(By.CSS_SELECTOR, "#plot polyline.faint")) == len(chips) - 1
    chips[3].click()
    assert replay.browser.find_elements(By.CSS_SELECTOR, "#plot .faint") == []


def test_ellipsoids_can_be_magnified(replay: Replay, scene: ReplayScene) -> None:
    extent = """
        const ball = pbd.page.stage.node("pbd", "keyframes", "3", "two_sigma");
        pbd.page.stage.viewer.scene.updateMatrixWorld(true);
        const { min, max } = new MeshCat.THREE.Box3().setFromObject(ball);
        return max.sub(min).toArray();"""
    true = 4.0 * np.sqrt(np.diag(scene.cov[3])[:3])[[0, 2, 1]]  # three.js has y up
    np.testing.assert_allclose(replay(extent), true, rtol=0.01)
    for times in (5.0, 1.0):
        replay.browser.find_element(By.CSS_SELECTOR, "#switches button").click()
        np.testing.assert_allclose(replay(extent), times * true, rtol=0.01)


def test_a_small_window_begins_with_the_scene(replay: Replay) -> None:
    """Panel and joints are folded in a small window, and open again in a large one."""
    shut = "return ['panel', 'joints'].map((id) => document.body.classList.contains(`no-${id}`))"
    try:
        for width, height, wanted in (
            (400, 657, [True, True]),
            (1000, 700, [False, False]),
            (800, 420, [False, True]),
            (1000, 700, [False, False]),
        ):
            replay.browser.set_size(width, height)
            until(lambda wanted=wanted: replay(shut) == wanted, f"{width} x {height}")  # type: ignore[misc]
        replay.browser.set_size(400, 657)
        free = 'return document.getElementById("bar").getBoundingClientRect().top / innerHeight'
        until(lambda: replay(shut) == [True, True], "the small window")
        assert replay(free) > 0.75
    finally:
        replay.browser.set_size()


CONTROLS = {"button", "checkbox", "combobox", "slider"}


def test_all_controls_have_an_accessible_name(replay: Replay) -> None:
    nodes = replay.browser.execute_cdp_cmd("Accessibility.getFullAXTree", {})["nodes"]  # without what is not shown
    controls = [node for node in nodes if not node["ignored"] and node["role"]["value"] in CONTROLS]
    assert {node["role"]["value"] for node in controls} == CONTROLS
    for node in controls:
        assert node["name"]["value"].strip(), node
    assert "uncertainty, 2 \u03c3" in [node["name"]["value"] for node in controls]  # without the button beside it
    assert replay.browser.find_element(By.ID, "play").accessible_name == "Play"
    value = replay.browser.find_element(By.ID, "seek").get_attribute("aria-valuetext")
    assert value == "0.00 seconds, at keyframe 0: dock"


def test_the_keyboard_comes_to_the_player_first(replay: Replay) -> None:
    """Long tables have a button for each keyframe."""
    replay("document.body.tabIndex = -1; document.body.focus(); document.body.removeAttribute('tabindex')")
    press(replay, Keys.TAB)
    assert replay("return document.activeElement.id") == "previous"


def test_the_head_of_the_table_covers_no_focused_keyframe(replay: Replay) -> None:
    """In a small window the panel scrolls, in a large one the list."""
    covered = """
        const { top } = document.activeElement.getBoundingClientRect();
        return document.querySelector("#keyframes th").getBoundingClientRect().bottom - top;"""
    try:
        for width, height in ((1000, 500), (1000, 650)):
            replay.browser.set_size(width, height)
            replay("pbd.page.fold('joints', innerHeight < 560); pbd.page.fold('panel', false)")
            replay("document.querySelector('#keyframes tr:last-child button').focus()")
            for _ in range(7):
                ActionChains(replay.browser).key_down(Keys.SHIFT).send_keys(Keys.TAB).key_up(Keys.SHIFT).perform()
                assert replay(covered) <= 0, f"{width} x {height}"
    finally:
        replay.browser.set_size()


LAID_OUT = """
    const shown = (selector) => [...document.querySelectorAll(selector)].filter((node) => node.checkVisibility());
    const box = (node) => node.getBoundingClientRect();
    const both = (a, b, low, high) => Math.min(a[high], b[high]) - Math.max(a[low], b[low]) > 1;
    const cut = (a, b) => both(box(a), box(b), "left", "right") && both(box(a), box(b), "top", "bottom");
    const outside = ({ left, right, top, bottom }) => left < 0 || right > innerWidth || top < 0 || bottom > innerHeight;
    const name = (node) => node.id || node.textContent;
    const pairs = (nodes) => nodes.flatMap((a, i) =>
      nodes.slice(i + 1).filter((b) => cut(a, b)).map((b) => [a, b].map(name)));
    return [
      ["#panel, #bar", "#controls > *", "#timeline, #curves, #angles button", "#panel > *", ".gutter",
        "#numbers span:not(.mute)", "#labels button"].flatMap((group) => pairs(shown(group))),
      shown("#bar, #panel, #controls > *, #angles button").filter((node) => outside(box(node))).map(name),
    ];"""


def test_nothing_overlaps(replay: Replay) -> None:
    try:
        for width, height in ((1400, 900), (1000, 700), (390, 844), (320, 568), (800, 420)):
            replay.browser.set_size(width, height)
            for panel in ("true", "false"):
                replay(
                    f"pbd.page.fold('joints', innerWidth <= 640 || innerHeight < 560); pbd.page.fold('panel', {panel})"
                )
                assert replay(LAID_OUT) == [[], []], f"{width} x {height}"
                cut_off = replay(
                    "const { scrollWidth, clientWidth } = element('list'); return scrollWidth - clientWidth"
                )
                assert cut_off == 0, f"{width} x {height}: the table scrolls sideways"
    finally:
        replay.browser.set_size()


def test_a_tall_window_gives_its_room_to_the_joints(replay: Replay) -> None:
    heights = []
    try:
        for height in (700, 1080):
            replay.browser.set_size(1400, height)
            replay("pbd.page.fold('joints', false)")
            heights.append(replay("return element('curves').clientHeight"))
    finally:
        replay.browser.set_size()
    assert heights[0] < 80
    assert heights[1] > 160


def test_a_long_label_pushes_no_column_out(replay: Replay) -> None:
    table = """
        const { page } = pbd, { keyframes } = page.replay;
        page.keyframes = new KeyframeTable(%s, (time) => page.player.seek(time));
        page.stage.label(page.keyframes.labels, keyframes.map((k) => k.p));"""
    try:
        replay(table % 'keyframes.map((k) => ({ ...k, inside: null, label: "over the cup, slowly and with care" }))')
        replay.browser.set_size(320, 568)
        replay("pbd.page.fold('panel', false)")
        assert replay("const { scrollWidth, clientWidth } = element('panel'); return scrollWidth - clientWidth") == 0
    finally:
        replay.browser.set_size()
        replay(table % "keyframes")


def test_a_long_label_that_is_read_from_right_to_left_shows_its_beginning(replay: Replay) -> None:
    first = """
        const { page } = pbd, keyframes = page.replay.keyframes.map((k) => ({ ...k, grip: null, label: %s }));
        const cell = new KeyframeTable(keyframes, () => {}).rows[1].cells[1], range = new Range();
        range.setStart(cell.lastChild, 0);
        range.setEnd(cell.lastChild, 1);
        const [shown, letter] = [cell, range].map((each) => each.getBoundingClientRect());
        page.keyframes = new KeyframeTable(page.replay.keyframes, (time) => page.player.seek(time));
        page.stage.label(page.keyframes.labels, page.replay.keyframes.map((k) => k.p));
        return letter.left >= shown.left && letter.right <= shown.right;"""
    assert replay(first % '"\u05d0\u05d1\u05d2\u05d3 ".repeat(20)')


def test_fingers_find_large_targets(replay: Replay) -> None:
    """Where the pointer is a finger every control is 40 pixels high and, on 360 and more, as wide."""
    sizes = """
        const bar = "#controls button, #speed, #seek, #angles button";
        const panel = "#keyframes tbody tr, #switches :is(label, button)";
        return [...document.querySelectorAll(`${bar}, ${panel}`)].filter((node) => node.checkVisibility())
          .map((node) => [node.offsetHeight, node.offsetWidth]);"""
    touch = "Emulation.setTouchEmulationEnabled"
    try:
        replay.browser.execute_cdp_cmd(touch, {"enabled": True})
        for width, height in ((360, 640), (800, 1000)):
            replay.browser.set_size(width, height)
            replay("for (const id of ['joints', 'panel']) pbd.page.fold(id, false)")
            assert np.min(replay(sizes)) >= 40, f"{width} x {height}"
            assert replay("return element('view').checkVisibility()"), "without it a lost scene is not found again"
    finally:
        replay.browser.execute_cdp_cmd(touch, {"enabled": False})
        replay.browser.set_size()


def test_only_the_list_follows_the_current_keyframe(replay: Replay) -> None:
    """In a small window all of the panel scrolls: it must not move under its reader."""
    try:
        replay.browser.set_size(683, 384)
        replay("pbd.page.fold('panel', false); element('panel').scrollTop = 3; pbd.page.player.seek(1e9)")
        assert replay("return element('panel').scrollTop") == 3
        replay.browser.set_size(1000, 560)
        for end in ("1e9", "1.3"):
            replay(f"pbd.page.fold('joints', true); pbd.page.player.seek({end})")
            top, bottom, head, list_bottom = replay("""
                const box = (selector) => document.querySelector(selector).getBoundingClientRect();
                const { top, bottom } = box("#keyframes [aria-current=true]");
                return [top, bottom, box("#keyframes th").bottom, box("#list").bottom];""")
            assert head - 1 <= top < bottom <= list_bottom + 1
    finally:
        replay.browser.set_size()


def test_the_table_can_be_scrolled_to_under_many_joints(replay: Replay) -> None:
    """An arm of 14 joints on a telephone."""
    names = replay("""
        const all = [...element("angles").children], more = all.map((chip) => chip.cloneNode(true));
        for (const chip of [...all, ...more]) chip.firstChild.textContent = "long joint name number 10";
        element("angles").append(...more);
        return more.length;""")
    try:
        replay.browser.set_size(400, 700)
        replay("pbd.page.fold('joints', false); pbd.page.fold('panel', false)")
        last, panel = replay("""
            document.querySelector("#keyframes tbody tr:last-child").scrollIntoView();
            const box = (selector) => document.querySelector(selector).getBoundingClientRect();
            return [box("#keyframes tbody tr:last-child").bottom, box("#panel").bottom];""")
        assert names == 7
        assert last <= panel
        assert replay("return element('angles').clientHeight") < 0.25 * 700
    finally:
        replay.browser.set_size()
        replay("pbd.page.joints = new Joints(pbd.page.replay, (time) => pbd.page.player.seek(time))")


def test_all_columns_and_notes_are_reachable_in_a_small_window(replay: Replay) -> None:
    try:
        for width, height in ((800, 600), (400, 800)):
            replay.browser.set_size(width, height)
            replay("pbd.page.fold('joints', innerWidth <= 640); pbd.page.fold('panel', false)")
            columns = (
                "return [...document.querySelectorAll('#keyframes th')].filter((th) => th.checkVisibility()).length"
            )
            assert replay(columns) == 5, f"{width} x {height}"
            hidden = "return ['panel', 'list', 'notes'].map(element).filter((e) => e.scrollHeight > e.clientHeight + 1"
            assert replay(f"{hidden} && getComputedStyle(e).overflowY !== 'auto').length") == 0, f"{width} x {height}"
    finally:
        replay.browser.set_size()


def test_the_camera_fits_every_window(replay: Replay) -> None:
    try:
        for width, height in ((1600, 1000), (900, 700), (420, 760)):
            replay.browser.set_size(width, height)
            replay("pbd.page.fold('panel', innerWidth < 640)")
            seen = np.array(
                replay("""
                const { stage } = pbd.page, { scene } = stage.viewer;
                stage.render();
                return stage.bounds.map((p) => scene.localToWorld(p.clone()).project(stage.camera).toArray());
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
        replay.browser.set_size()


@pytest.mark.usefixtures("small")
def test_dark_is_dark(replay: Replay) -> None:
    light = replay.picture()
    replay.browser.set_media("dark")
    dark = replay.picture()
    assert dark.mean() < 90 < 170 < light.mean()


def test_the_scene_turns_and_is_framed_again(replay: Replay) -> None:
    place = "return pbd.page.stage.camera.position.toArray()"
    at_first = replay(place)
    pane = replay.browser.find_element(By.ID, "pane")
    drag = ActionChains(replay.browser).move_to_element_with_offset(pane, -550, -330).click_and_hold()
    drag.move_by_offset(120, 40).release().perform()
    assert np.linalg.norm(np.subtract(replay(place), at_first)) > 0.1
    press(replay, "v")
    np.testing.assert_allclose(replay(place), at_first, atol=1e-6)
    angle = "return pbd.page.stage.viewer.controls.getAzimuthalAngle()"
    before = replay(angle)
    press(replay, "e")
    assert np.degrees(replay(angle) - before) == pytest.approx(15.0)
    distance = "const { camera, viewer } = pbd.page.stage; return camera.position.distanceTo(viewer.controls.target)"
    far = replay(distance)
    press(replay, "+")
    assert replay(distance) == pytest.approx(0.8 * far)
    press(replay, "v")


def test_without_webgl_it_says_so_and_has_all_but_the_scene(fox: Firefox, replay_file: Path) -> None:
    with fox.preference("webgl.disabled", True):
        fox.get(replay_file.as_uri())
        until(lambda: fox.execute_script("return window.pbd && pbd.ready"), "the page to start")
        assert "This browser has no WebGL" in fox.execute_script("return document.body.innerText")
        assert fox.execute_script("return document.querySelectorAll('#keyframes tbody tr').length") == 8
        fox.press(Keys.END)
        assert fox.execute_script("return document.getElementById('phase').textContent") == "at keyframe 7: away"
    assert fox.errors() == []


def test_it_plays_in_firefox(fox: Firefox, replay_file: Path, scene: ReplayScene) -> None:
    fox.set_size(400, 300)
    replay = Replay(fox, replay_file.as_uri())
    assert replay.picture().std() > 10.0
    fox.press(Keys.END)
    np.testing.assert_allclose(replay.place(*FINGER), finger_of(scene)[-1], atol=1e-5)
    assert replay.errors() == []


# --- a page of an unusual scene ---

EVIL = '</script><img src=x onerror="document.title=1"><b>'
LOWER = np.array([-3.0, -2.0, -1.0, -4.0, -np.inf, 1.0, -2.5])
UPPER = np.array([1.0, 1.0, 2.5, -1.0, np.inf, 3.0, 3.0])


@pytest.fixture(scope="module")
def odd_scene(scene: ReplayScene) -> ReplayScene:
    """Contacts, labels that look like code, uncertain keyframes, a doubted stop, missed rotations, odd joints."""
    uncertain = np.diag([0.25, 1e-6, 1e-6, 1e-4, 1e-4, 1e-4])
    keyframes = tuple(
        replace(each, label=EVIL, weight=0.6 if k == 2 else 0.9) for k, each in enumerate(scene.keyframes)
    )
    cov = np.array([uncertain if k in (2, 5) else each for k, each in enumerate(scene.cov)])
    in_the_way = scenes.in_the_way()
    robot = replace(scene.robot, limits=replace(scene.robot.limits, lower=LOWER, upper=UPPER))
    said = replace(in_the_way, title=EVIL, notes=(EVIL,), warnings=(EVIL, *in_the_way.warnings))
    off_rad = np.zeros((len(keyframes), 2))
    off_rad[2] = np.radians((1.8, 2.3))
    return replace(said, keyframes=keyframes, cov=cov, off_rad=off_rad, robot=robot, slides=(True, *[False] * 6))


@pytest.fixture(scope="module")
def odd(odd_scene: ReplayScene, chrome: Chromium, tmp_path_factory: pytest.TempPathFactory) -> Replay:
    file = tmp_path_factory.mktemp("odd") / "odd.html"
    write_page(odd_scene, file)
    return Replay(chrome, file.as_uri())


def test_without_javascript_the_page_says_so(chrome: Chromium, replay_file: Path) -> None:
    chrome.execute_cdp_cmd("Emulation.setScriptExecutionDisabled", {"value": True})
    try:
        chrome.get(replay_file.as_uri())
        said = chrome.find_element(By.CSS_SELECTOR, "noscript .message")
        assert said.is_displayed()
        assert "JavaScript" in said.text
    finally:
        chrome.execute_cdp_cmd("Emulation.setScriptExecutionDisabled", {"value": False})


def test_text_from_files_is_never_code(odd: Replay) -> None:
    assert odd.read("#title") == EVIL
    assert odd("return document.title") == f"{EVIL} \u2013 {scenes.panda().description}"
    assert odd("return document.querySelectorAll('img, b:not(#time b, #joints b)').length") == 0
    assert odd.errors() == []


def test_warnings_stand_out_from_notes(odd: Replay) -> None:
    colours = "return [...document.querySelectorAll('#notes li:not(.alarm)')].map((li) => getComputedStyle(li).color)"
    warning, note = odd(colours)
    assert warning != note


def test_contacts_are_shown(odd: Replay, odd_scene: ReplayScene) -> None:
    alarms = odd.browser.find_elements(By.CSS_SELECTOR, "#notes .alarm button")
    assert [alarm.text for alarm in alarms] == [each.message for each in odd_scene.contacts]
    assert odd.read("#subtitle").endswith(f" \u00b7 {len(alarms)}\u00a0contacts")
    axis = odd.browser.find_element(By.ID, "timeline").rect
    red = [each.rect for each in odd.browser.find_elements(By.CSS_SELECTOR, "#touching i")]
    spans = [[each["x"] - axis["x"], each["x"] - axis["x"] + each["width"]] for each in red]
    wanted = [(each.start, each.end) for each in odd_scene.contacts]
    np.testing.assert_allclose(np.array(spans) / axis["width"] * odd_scene.trajectory.duration, wanted, atol=0.03)
    alarms[1].click()
    assert odd.time == pytest.approx(odd_scene.contacts[1].start)
    assert "the post, the wall" in odd.read("#switches")


def test_an_ellipsoid_that_would_hide_the_scene_is_not_drawn(odd: Replay, odd_scene: ReplayScene) -> None:
    shown = """
        const ball = (_, i) => pbd.page.stage.node("pbd", "keyframes", String(i), "two_sigma");
        return pbd.page.replay.keyframes.map(ball).map((node) => node.visible);"""
    visible = [k not in (2, 5) for k in range(len(odd_scene.keyframes))]
    assert odd(shown) == visible
    assert "uncertainty, 2 σ; 2 too large to draw" in odd.read("#switches")
    for wanted in ([False] * len(visible), visible):
        odd("document.querySelectorAll('#switches input')[3].click()")
        assert odd(shown) == wanted


def test_a_doubted_stop_has_a_question_mark(odd: Replay) -> None:
    for place in ("#keyframes button.doubted", "#labels button.doubted", "#numbers .doubted"):
        assert [each.text.split()[0] for each in odd.browser.find_elements(By.CSS_SELECTOR, place)] == ["2?"]


def test_rotations_that_the_arm_misses_have_a_column(odd: Replay) -> None:
    rows = odd("return [...element('keyframes').tBodies[0].rows].map((row) => row.cells[8].textContent)")
    assert rows[1:3] == ["0.0", "2.3"]


def test_switching_between_dark_and_light_takes_no_memory(odd: Replay) -> None:
    odd(
        "const { stage } = pbd.page; window.drawn = () => stage.quality.draw(stage.viewer.scene, stage.camera, 1, true)"
    )
    taken = []
    for scheme in ("dark", "light", "dark", "light"):
        odd.browser.set_media(scheme)
        taken.append(odd("drawn(); return pbd.page.stage.quality.renderer.info.memory.geometries"))
    odd.browser.set_media()
    assert set(taken) == {taken[0]}


def test_high_contrast_leaves_the_time_axis_and_the_switches(odd: Replay) -> None:
    high_contrast = {"features": [{"name": "forced-colors", "value": "active"}]}
    odd.browser.execute_cdp_cmd("Emulation.setEmulatedMedia", high_contrast)
    places = ("#bar", "#moves i", "#closed i", "#touching i", "#switches label:nth-child(2) input")
    look = "return getComputedStyle(document.querySelector('{}')).{}"
    card, *marks = (odd(look.format(place, "backgroundColor")) for place in places)
    pressed = odd(look.format("#loop", "outlineStyle"))
    odd.browser.set_media()
    assert card not in marks
    assert pressed == "solid"


def test_paper_shows_the_scene_and_all_of_the_table(odd: Replay) -> None:
    """The paper has room for the scene and a few rows: the others are on the next sheets."""
    printed = odd.browser.execute_cdp_cmd("Page.printToPDF", {"paperHeight": 6.0, "printBackground": False})
    pdf = base64.b64decode(printed["data"])
    assert len(re.findall(rb"/Type /Page\b", pdf)) > 1
    width, height = (2 * pixels for pixels in odd("return pbd.page.stage.constructor.paper"))
    drawn = re.search(rb"/Width %d\s/Height %d\s.*?/Length \d+>> stream\n" % (width, height), pdf, re.DOTALL)
    assert drawn is not None
    picture = np.frombuffer(zlib.decompressobj().decompress(pdf[drawn.end() :]), np.uint8)
    assert len(picture) == 3 * width * height
    assert picture.std() > 10.0
    assert odd("return pbd.page.stage.quality.size") == odd("return [innerWidth, innerHeight]")


def test_paper_shows_every_column_of_the_table(odd: Replay) -> None:
    """A small window leaves out positions where keyframes have tolerances; a sheet is as narrow, but has room."""
    hidden = "return [...document.querySelectorAll('#keyframes :is(td, th)')].filter((c) => c.offsetWidth === 0).length"
    odd.browser.set_size(700, 900)
    on_screen = odd(hidden)
    odd.browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": "print"})
    on_paper = odd(hidden)
    odd.browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": ""})
    odd.browser.set_media()
    odd.browser.set_size()
    assert (on_screen > 0, on_paper) == (True, 0)


def test_a_sliding_joint_is_in_metres(odd: Replay, odd_scene: ReplayScene) -> None:
    odd("pbd.page.player.seek(0)")
    first, second = (chip.text for chip in odd.browser.find_elements(By.CSS_SELECTOR, "#angles button")[:2])
    metres, degrees = odd_scene.trajectory.q[0, 0], np.degrees(odd_scene.trajectory.q[0, 1])
    assert first.endswith(f"{metres:.3f} m".replace("-", "\u2212"))
    assert second.endswith(f"{degrees:.1f}\u00b0".replace("-", "\u2212"))


def test_each_joint_is_drawn_between_its_own_limits(odd: Replay, odd_scene: ReplayScene) -> None:
    """A joint without limits is dotted, and shows no limits when it is chosen."""
    curves = odd.browser.find_elements(By.CSS_SELECTOR, "#plot polyline")
    samples = odd_scene.trajectory.sample(25.0)
    for j, curve in enumerate(curves):
        points = np.array([point.split(",") for point in str(curve.get_attribute("points")).split()], dtype=float)
        q, free = samples.q[:, j], not np.isfinite(UPPER[j])
        middle = 0.5 * (q.min() + q.max())
        share = 0.5 + (q - middle) / (2.0 * np.pi) if free else (q - LOWER[j]) / (UPPER[j] - LOWER[j])
        np.testing.assert_allclose(points[:, 1], 1000.0 * (1.0 - share), atol=0.06)
        np.testing.assert_allclose(points[:, 0], 1000.0 * samples.t / odd_scene.trajectory.duration, atol=0.06)
        assert ("free" in str(curve.get_attribute("class"))) == free
    ends = [line.get_attribute("y1") for line in odd.browser.find_elements(By.CSS_SELECTOR, "#plot line.limit")]
    assert ends == ["0", "1000"]
    odd.browser.find_elements(By.CSS_SELECTOR, "#angles button")[4].click()
    assert odd.browser.find_elements(By.CSS_SELECTOR, "#plot line.limit") == []
