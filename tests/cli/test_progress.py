"""Progress is shown in a terminal, and not in a pipe."""

import os
import pty
import subprocess
import sys
from pathlib import Path

import pytest

from pbd.cli.console import _Countdown, working
from pbd.files.demo import write_demo
from pbd.simulation.simulate import simulate
from tests.cli.pbd_process import Terminal
from tests.cli.run_command import Capture

SCRIPT = """
import sys, time
from pbd.cli.console import working
with working("planning for panda"):
    time.sleep(0.3)
    print("pbd: warning: something", file=sys.stderr)
print("done")
"""


def test_a_terminal_shows_it_and_is_left_clean() -> None:
    ours, theirs = pty.openpty()
    process = subprocess.Popen(
        [sys.executable, "-c", SCRIPT],
        stdout=subprocess.PIPE,
        stderr=theirs,
        env=os.environ | {"TERM": "xterm-256color"},
    )
    os.close(theirs)
    shown = b""
    try:
        while chunk := os.read(ours, 4096):
            shown += chunk
    except OSError:  # the other end is closed
        pass
    os.close(ours)
    assert process.wait() == 0
    assert process.stdout is not None
    assert process.stdout.read() == b"done\n"
    process.stdout.close()
    assert b"planning for panda ..." in shown
    assert b"pbd: warning: something" in shown
    assert b"\x1b[2K" in shown.split(b"something")[-1]  # the line is erased


def test_each_step_is_named_and_no_escape_code_is_printed_as_text(tmp_path: Path) -> None:
    """Neither by the bar of `check`, nor in the table that an import prints before it refuses a file."""
    (tmp_path / "ms.csv").write_text("t,ax,ay,az\n" + "".join(f"{10 * k},0,0,9.81\n" for k in range(400)))
    write_demo(simulate("pick-and-place-direct", "ideal", 0), tmp_path / "mine")
    good = ("reading mine/imu.csv ...", "checking it ...", "writing demos/tea ...")
    for code, words, steps in (
        (0, ("import", "mine/imu.csv", "tea"), good),
        (0, ("check", "mine"), ("checking",)),
        (1, ("import", "ms.csv", "tea"), ("decided",)),
    ):
        terminal = Terminal(*words, cwd=tmp_path)
        text = terminal.rest()
        assert sorted(steps, key=text.index) == list(steps)
        assert "\\x" not in text
        assert terminal.exit_code() == code


def test_what_may_last_counts_down() -> None:
    """The seconds left as rich draws them, never below zero."""
    countdown = _Countdown("listening to /dev/ttyUSB0", 9.0)
    assert countdown.__rich__().plain == "listening to /dev/ttyUSB0 ... 9 s at most"
    countdown.began -= 5.0
    assert countdown.__rich__().plain.endswith("... 4 s at most")
    countdown.began -= 60.0
    assert countdown.__rich__().plain.endswith("... 0 s at most")


def test_a_pipe_gets_nothing_of_it(capsys: Capture) -> None:
    exec(SCRIPT.replace("0.3", "0.0"))
    assert capsys.readouterr() == ("done\n", "pbd: warning: something\n")


def test_a_terminal_shows_a_device_once(capsys: Capture, monkeypatch: pytest.MonkeyPatch) -> None:
    for terminal in (False, True):
        monkeypatch.setattr(sys.stderr, "isatty", lambda terminal=terminal: terminal)
        with working("listening to /dev/x", 2.0):
            pass
        assert (capsys.readouterr().err == "listening to /dev/x ...\n") is not terminal
