"""The screen while recording, as text: wide, narrow, low, without a terminal, and in the browser."""

import io
from dataclasses import replace

import numpy as np
import pytest
from rich.console import Console

from pbd.cli.recording.live import LiveScreen
from pbd.cli.recording.screen import KEYS_LINE, TRACKING_LINE, PanelScreen, PlainScreen, bar
from pbd.data import Keyframe
from pbd.errors import PbdError
from pbd.pose import Pose
from pbd.record import Message, Outcome, Status
from pbd.view.live_view import LivePicture

LEVEL = np.array([1.0, 0.0, 0.0, 0.0])
STOP = Keyframe(3.0, 0.5, Pose(np.array([0.1, 0.0, -0.02]), LEVEL), 4e-6 * np.eye(6))
SAID = Message(3.1, "stop 1 at (10.0, 0.0, -2.0) cm, sigma 0.2 cm: you may move on", bell=True)
STILL = Status(
    t=4.0,
    rate_hz=99.6,
    samples=400,
    lost=3,
    bad_packets=2,
    waiting="",
    moving=False,
    stops=2,
    keyframes=(STOP, STOP),
    p_nav_sensor=np.array([0.1, 0.0, -0.02]),
    v_nav_sensor=np.zeros(3),
    wxyz_nav_sensor=LEVEL,
    sigma_m=0.005,
    sigma_of_move_m=0.0,
    tremor=0.034,
    closed=True,
    messages=(SAID,),
)
MOVING = replace(STILL, moving=True, messages=())
LONG = replace(MOVING, sigma_of_move_m=0.02, sigma_m=0.021)
WAITING = replace(
    STILL, waiting="hold still for 1 s: the hand shakes with 0.31 m/s2", stops=0, keyframes=(), messages=()
)


class Drawn(PanelScreen):
    """A panel on a terminal of this size."""

    def __init__(self, width: int, height: int = 40) -> None:
        super().__init__("recording demos/tea from witmotion", 0.01)
        self._console = Console(file=io.StringIO(), width=width, height=height, force_terminal=False)

    def text(self, status: Status) -> str:
        with self._console.capture() as capture:
            self._console.print(self.panel(status))
        return capture.get()


def words(text: str) -> str:
    """The text without frame and line breaks."""
    return " ".join(text.replace("│", " ").split())


@pytest.mark.parametrize("width", [30, 50, 80, 200])
def test_all_of_it_is_there_at_any_width(width: int) -> None:
    screen = Drawn(width)
    screen.show(STILL)
    text = screen.text(STILL)
    assert max(map(len, text.splitlines())) <= width
    for expected in (
        "stands still (tremor 0.03 m/s2)",
        "place (10.0, 0.0, -2.0) cm",
        "stops 1, the last at (10.0, 0.0, -2.0) cm, sigma 0.2 cm",
        "4.0 s, 100 Hz, 400 samples, 3 lost, 2 bad packets",
        "grip closed",
        SAID.text,
        KEYS_LINE,
    ):
        assert expected in words(text)


def test_a_low_terminal_shows_the_latest_and_the_keys() -> None:
    screen = Drawn(80, height=14)
    for k in range(9):
        screen.show(replace(STILL, messages=(Message(float(k), f"line {k}"),)))
    text = screen.text(STILL)
    assert "line 8" in text
    assert KEYS_LINE in text
    assert len(text.splitlines()) <= 14


def test_what_the_hand_does() -> None:
    screen = Drawn(80)
    assert "hand moving" in words(screen.text(MOVING))
    assert "hand pause now: 2 cm" in words(screen.text(LONG))
    assert WAITING.waiting in words(screen.text(WAITING))
    assert "stops none yet" in words(screen.text(WAITING))


def test_a_question_takes_the_place_of_the_keys() -> None:
    screen = Drawn(80)
    screen.ask("sure?")
    assert "sure?" in screen.text(STILL)
    assert KEYS_LINE not in screen.text(STILL)
    screen.ask("")
    assert KEYS_LINE in screen.text(STILL)


def test_the_final_tracking_takes_the_place_of_the_keys() -> None:
    text = Drawn(80).text(replace(STILL, ended=True))
    assert TRACKING_LINE in text
    assert KEYS_LINE not in text


def test_a_bar_is_full_at_the_tolerance() -> None:
    assert [bar(share).count("█") for share in (0.0, 0.5, 1.0, 7.0)] == [0, 10, 20, 20]


def test_plain_lines(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    """The host's time counts: a device's own may be in ms where `--unit t=ms` was forgotten."""
    now_s = 100.0
    monkeypatch.setattr("time.monotonic", lambda: now_s)
    screen = PlainScreen("recording demos/tea from witmotion")
    for t in np.arange(0.0, 5.0, 0.5):
        now_s = 100.0 + 0.5 * float(t)
        screen.show(replace(STILL, t=float(t), messages=(SAID,) if t == 3.0 else ()))
    screen.ask("sure?")
    screen.ask("")
    out, err = capsys.readouterr()
    assert out == ""
    assert err.splitlines() == [
        "recording demos/tea from witmotion; hold still",
        f"    3.1 s  {SAID.text}",
        "    4.0 s  stands still (tremor 0.03 m/s2); 4.0 s, 100 Hz, 400 samples, 3 lost, 2 bad packets",
        "sure?",
    ]


class Browser:
    """A browser view that keeps its pictures, and fails on demand."""

    def __init__(self, fails: bool = False) -> None:
        self.shown: list[LivePicture] = []
        self.fails, self.closed = fails, False

    def show(self, picture: LivePicture) -> None:
        if self.fails:
            raise PbdError("the browser's page is gone; recording goes on")
        self.shown.append(picture)

    def end(self, picture: LivePicture) -> None:
        self.shown.append(picture)

    def close(self) -> None:
        self.closed = True


def test_the_browser_says_the_same() -> None:
    browser, shown = Browser(), list[Status]()
    live = LiveScreen(browser, shown.append, 0.01)  # type: ignore[arg-type]
    for status in (WAITING, STILL, MOVING, LONG):
        live.show(status)
    live.end(Outcome(None, 400, 4.0, 3, 2, 2, "you"))
    assert [picture.state for picture in browser.shown] == ["waits", "still", "moves", "pause", "ended"]
    assert browser.shown[3].badge == "pause now: 2 cm"
    assert browser.shown[2].line == SAID.text
    assert shown == [WAITING, STILL, MOVING, LONG]


def test_without_the_browser_recording_goes_on() -> None:
    browser, shown = Browser(fails=True), list[Status]()
    live = LiveScreen(browser, shown.append, 0.01)  # type: ignore[arg-type]
    live.show(STILL)
    live.show(MOVING)
    live.end(Outcome(None, 400, 4.0, 3, 2, 2, "you"))
    assert browser.closed
    assert [say.text for say in shown[0].messages] == [SAID.text, "the browser's page is gone; recording goes on"]
    assert shown[1] is MOVING
