"""A small interpreter of URScript: what a controller does with the calls that an exported program makes.

Blocks are as in Python but for their `end`, so a program is checked for these and run as Python, against an arm that
moves as Universal Robots' Script Manual says.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from pbd.pose import Array


class HaltedError(Exception):
    """The program refused to go on; says why."""


@dataclass
class Controller:
    """Where the arm is (q, rad) and what it has done by when (t, s)."""

    q: Array
    t: float = 0.0
    moves: list[tuple[float, float, Array, Array, float, float]] = field(default_factory=list)
    """From when to when, from where to where, and the leading joint's acceleration and velocity."""
    servoed: list[tuple[float, Array]] = field(default_factory=list)
    calls: list[tuple[float, str]] = field(default_factory=list)
    """When each of the program's own functions was called."""
    said: str = ""

    def movej(self, q: list[float], a: float, v: float) -> None:
        """A trapezoid of the leading joint's velocity, or a triangle; the others in step."""
        before, self.q, since = self.q, np.array(q), self.t
        reach = float(np.abs(self.q - before).max())
        self.t += reach / v + v / a if v * v <= a * reach else 2.0 * math.sqrt(reach / a)
        self.moves.append((since, self.t, before, self.q, a, v))

    def servoj(self, q: list[float], _a: float, _v: float, t: float, lookahead_time: float, gain: float) -> None:
        assert 0.03 <= lookahead_time <= 0.2
        assert 100 <= gain <= 2000
        self.q, self.t = np.array(q), self.t + t
        self.servoed.append((self.t, self.q))

    def sleep(self, seconds: float) -> None:
        assert seconds > 0.0
        self.t += seconds

    def popup(self, text: str, **_: Any) -> None:
        self.said = text

    def run(self, program: str) -> None:
        def halt() -> None:
            raise HaltedError(self.said)

        given = {name: getattr(self, name) for name in ("movej", "servoj", "sleep", "popup")}
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


def _python(program: str) -> str:
    """The program in Python: without `end`, each of which must close the innermost block."""
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
