"""Units in which a table is printed."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike

LENGTHS = {"m": (1.0, 3), "cm": (100.0, 1), "mm": (1000.0, 0)}
ANGLES = {"deg": (180.0 / np.pi, 1), "rad": (1.0, 3)}
TIMES = {"s": (1.0, 2), "ms": (1000.0, 0)}
"""Unit -> how many of it make a metre, radian or second; how many decimals are significant for a hand or an arm."""

KINDS = {"length": LENGTHS, "angle": ANGLES, "time": TIMES}


@dataclass(frozen=True)
class Units:
    """A unit of length, one of angle and one of time, by their names in LENGTHS, ANGLES and TIMES.

    `asked` names the kinds (see KINDS) that the user chose. `exact` writes nine significant digits, for programs.
    """

    length: str = "m"
    angle: str = "deg"
    time: str = "s"
    asked: frozenset[str] = field(default=frozenset(), compare=False)
    exact: bool = False

    @property
    def finer(self) -> Units:
        """Units for uncertainties: millimetres where positions are in metres."""
        return replace(self, length="mm" if self.length == "m" else self.length)

    @property
    def angle_sign(self) -> str:
        """The angle's unit in a table's header."""
        return {"deg": "°"}.get(self.angle, self.angle)

    def lengths(self, metres: ArrayLike, finer: int = 0) -> list[str]:
        """Write lengths (n,) m in the unit of length; `finer` adds decimals."""
        return self._format(metres, *LENGTHS[self.length], finer)

    def times(self, seconds: ArrayLike) -> list[str]:
        """Write times (n,) s in the unit of time."""
        return self._format(seconds, *TIMES[self.time])

    def angles(self, radians: ArrayLike) -> list[str]:
        """Write angles (n,) rad in the unit of angle."""
        return self._format(radians, *ANGLES[self.angle])

    def _format(self, values: ArrayLike, factor: float, decimals: int, finer: int = 0) -> list[str]:
        """Write numbers with `decimals` + `finer` decimals and without -0.000; NaN, which is unknown, is blank."""
        given = factor * np.atleast_1d(np.asarray(values, dtype=np.float64))
        if self.exact:
            # A position below 1 m to 1e-9 m; of the sixteen of a double the last ones are rounding errors.
            return [repr(float(f"{x:.9g}")) if np.isfinite(x) else "" for x in (given + 0.0).tolist()]
        places = decimals + finer
        return [f"{x:.{max(places, 0)}f}" if np.isfinite(x) else "" for x in np.round(given, places) + 0.0]


def parse_units(text: str, usual: Units = Units()) -> Units:
    """Parse "cm,deg", "mm", "rad" or "ms"; kinds that are not named are as in `usual`.

    Raises:
        ValueError: a unit is unknown, or two are of one kind; the message lists the valid ones.
    """
    given: dict[str, str] = {}
    for word in text.split(","):
        unit = word.strip()
        kind = next((kind for kind, units in KINDS.items() if unit in units), None)
        if kind is None:
            known = ", ".join(f"{kind}s {' '.join(units)}" for kind, units in KINDS.items())
            raise ValueError(f"unknown unit '{unit}'; {known}")
        if kind in given:
            raise ValueError(f"'{given[kind]}' and '{unit}' are both units of {kind}; give one")
        given[kind] = unit
    words = {kind: given.get(kind, getattr(usual, kind)) for kind in KINDS}
    return Units(**words, asked=frozenset(given))
