"""Starts `pbd` as a process, with or without a terminal."""

import fcntl
import os
import pty
import select
import struct
import subprocess
import sys
import termios
import time
from contextlib import suppress
from pathlib import Path

PBD = [sys.executable, "-m", "pbd"]


def run_pbd(*words: str, cwd: Path) -> subprocess.Popen[str]:
    """Start `pbd` without a terminal."""
    return subprocess.Popen(
        [*PBD, *words], cwd=cwd, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )


class Terminal:
    """A pseudo-terminal of 80 columns in which `pbd` runs."""

    def __init__(self, *words: str, cwd: Path) -> None:
        self.text = ""
        self.process, self._handle = pty.fork()
        if self.process == 0:
            os.chdir(cwd)
            os.environ |= {"TERM": "xterm-256color", "COLUMNS": "80", "LINES": "40", "PYTHONIOENCODING": "utf-8"}
            os.execv(PBD[0], [*PBD, *words])
        fcntl.ioctl(self._handle, termios.TIOCSWINSZ, struct.pack("HHHH", 40, 80, 0, 0))

    def until(self, text: str, seconds: float = 60.0) -> None:
        """Read until this text appears; drop everything up to it."""
        end = time.monotonic() + seconds
        while text not in self.text:
            assert time.monotonic() < end, f"no {text!r} in {self.text!r}"
            if select.select([self._handle], [], [], 0.1)[0]:
                try:
                    self.text += os.read(self._handle, 65536).decode(errors="replace")
                except OSError:  # it has ended
                    assert text in self.text, self.text
        self.text = self.text.partition(text)[2]

    def rest(self) -> str:
        """Read until `pbd` ends; return what was not read before."""
        with suppress(OSError):  # it has ended
            while read := os.read(self._handle, 65536):
                self.text += read.decode(errors="replace")
        return self.text

    def type(self, keys: str) -> None:
        """Press keys."""
        os.write(self._handle, keys.encode())

    def echoes(self) -> bool:
        """Whether the terminal echoes keys, as it does unless its settings were changed."""
        return bool(termios.tcgetattr(self._handle)[3] & termios.ECHO)

    def hang_up(self) -> None:
        """Hang up the terminal, as when its window is closed."""
        os.close(self._handle)

    def exit_code(self) -> int:
        """Wait for `pbd` to end; return its exit code."""
        return os.waitstatus_to_exitcode(os.waitpid(self.process, 0)[1])
