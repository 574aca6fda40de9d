"""A small interpreter of URScript that simulates the controller, after Universal Robots' Script Manual.

Apart from `end`, blocks are as in Python, so a program is checked for its `end`s and run as Python.
"""

import math
import re
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from pbd.pose import Array


class HaltedError(Exception):
    """The program halted; the message is that of its popup."""


@dataclass
class Controller:
    """The simulated arm at joints q, rad, at time t, s, and what it has done."""

    q: Array
    t: float = 0.0
    moves: list[tuple[float, float, Array, Array, float, float]] = field(default_factory=list)
    """Each movej: start s, end s, joints at the start and the end, the leading joint's acceleration and velocity."""
    lag: float = 0.0
    """The arm has arrived once a servoj's joints were held for so long, s."""
    servoing: bool = False
    """A servoj has no stopj yet."""
    servoed: list[tuple[float, Array]] = field(default_factory=list)
    """Each servoj: its end, s, and the joints there."""
    calls: list[tuple[float, str]] = field(default_factory=list)
    """Each call of the program's functions: when, s, and its name."""
    said: str = ""

    def movej(self, q: list[float], a: float, v: float) -> None:
        """Move with a trapezoidal, or triangular, velocity of the leading joint, and the others in step."""
        before, self.q, since = self.q, np.array(q), self.t
        reach = float(np.abs(self.q - before).max())
        self.t += reach / v + v / a if v * v <= a * reach else 2.0 * math.sqrt(reach / a)
        self.moves.append((since, self.t, before, self.q, a, v))

    def servoj(self, q: list[float], _a: float, _v: float, t: float, lookahead_time: float, gain: float) -> None:
        assert 0.03 <= lookahead_time <= 0.2
        assert 100 <= gain <= 2000
        held = np.allclose(q, self.q, rtol=0.0, atol=1e-9)
        self.lag = max(self.lag - t, 0.0) if held else 2.0 * lookahead_time
        self.q, self.t, self.servoing = np.array(q), self.t + t, True
        self.servoed.append((self.t, self.q))

    def stopj(self, _a: float) -> None:
        assert self.lag < 1e-9, "the arm is stopped before it has arrived"
        self.servoing = False

    def sleep(self, seconds: float) -> None:
        assert seconds > 0.0
        assert not self.servoing, "the controller waits for the next servoj"
        self.t += seconds

    def popup(self, text: str, **_: Any) -> None:
        self.said = text

    def run(self, program: str) -> None:
        def halt() -> None:
            raise HaltedError(self.said)

        given = {name: getattr(self, name) for name in ("movej", "servoj", "stopj", "sleep", "popup")}
        exec(
            _python(program),
            {
                **given,
                "halt": halt,
                "norm": abs,
                "called": lambda name: self.calls.append((self.t, name)),
                "get_actual_joint_positions": lambda: self.q.tolist(),
            },
        )
        assert not self.servoing, "a servoj is the last command"


def _python(program: str) -> str:
    """Translate a program to Python: remove each `end`, which must close the innermost block."""
    lines: list[str] = []
    depth = 0
    for raw in program.splitlines():
        line = raw.split("#")[0].strip()
        if line == "end":
            depth -= 1
            continue
        if not line:
            continue
        assert re.match(r" *", raw)[0] == "  " * depth, raw  # type: ignore[index]
        lines.append("  " * depth + ("halt()" if line == "halt" else line))
        if line.endswith(":"):
            depth += 1
            if name := re.fullmatch(r"def (\w+)\(\):", line):
                lines.append(f"{'  ' * depth}called('{name[1]}')")
    assert depth == 0
    return "\n".join(lines)
