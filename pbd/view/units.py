"""In which units a table is printed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

LENGTHS = {"m": (1.0, 3), "cm": (100.0, 1), "mm": (1000.0, 0)}
ANGLES = {"deg": (180.0 / np.pi, 1), "rad": (1.0, 3)}
"""Unit -> how many of them make a metre or a radian, and how many decimals mean something to a hand or an arm."""


@dataclass(frozen=True)
class Units:
    """A unit of length and one of angle, by their names in LENGTHS and ANGLES."""

    length: str = "m"
    angle: str = "deg"

    @property
    def angle_sign(self) -> str:
        """As it stands in a header."""
        return {"deg": "°"}.get(self.angle, self.angle)

    def lengths(self, metres: ArrayLike, finer: int = 0) -> list[str]:
        """Write lengths, with so many decimals more than usual."""
        factor, decimals = LENGTHS[self.length]
        return _fixed(factor * np.asarray(metres), decimals + finer)

    def angles(self, radians: ArrayLike) -> list[str]:
        """Write angles."""
        factor, decimals = ANGLES[self.angle]
        return _fixed(factor * np.asarray(radians), decimals)


def parse_units(text: str) -> Units:
    """Parse "cm,deg", "mm" or "rad".

    Raises:
        ValueError: with the valid ones.
    """
    given: dict[str, str] = {}
    for word in text.split(","):
        unit = word.strip()
        kind = "length" if unit in LENGTHS else "angle" if unit in ANGLES else None
        if kind is None or kind in given:
            raise ValueError(f"must be one of {', '.join(LENGTHS)} and one of {', '.join(ANGLES)}, got '{text}'")
        given[kind] = unit
    return Units(**given)


def _fixed(values: ArrayLike, decimals: int) -> list[str]:
    """Write numbers with so many decimals, and spare the reader a -0.000."""
    return [f"{x:.{decimals}f}" for x in np.atleast_1d(np.round(np.asarray(values), decimals) + 0.0)]
