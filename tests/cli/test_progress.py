"""What a person sees while something takes its time, in a real pseudo-terminal; and what a pipe gets: nothing."""

from __future__ import annotations

import os
import pty
import subprocess
import sys

SCRIPT = """
import sys, time
from pbd.cli.progress import working
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


def test_a_pipe_gets_nothing_of_it() -> None:
    run = subprocess.run([sys.executable, "-c", SCRIPT], capture_output=True, text=True, check=True)
    assert run.stdout == "done\n"
    assert run.stderr == "pbd: warning: something\n"
