"""The 48 ways to read three axes, in words and as options of `pbd import`."""

from dataclasses import dataclass
from itertools import permutations, product

import numpy as np

from pbd.data.source_columns import SourceColumns
from pbd.lazy import cached_property
from pbd.pose import Array


@dataclass(frozen=True, order=True)
class AxisMapping:
    """A way to read three axes: for each, the index and sign of the axis from which it should have been read."""

    order: tuple[int, ...]
    signs: tuple[int, ...]

    @property
    def matrix(self) -> Array:
        """(3, 3), from the channel as it was read to the channel as it should be."""
        matrix: Array = np.eye(3)[list(self.order)] * np.array(self.signs)[:, None]
        return matrix

    @cached_property
    def causes(self) -> int:
        """Number of mistakes that explain it. One sign, two swapped columns, or all three signs, count as one."""
        moved = sum(axis != k for k, axis in enumerate(self.order))
        flipped = sum(sign < 0 for sign in self.signs)
        return (moved + 1) // 2 + (1 if flipped == 3 else flipped)

    def remedy(self, channel: str, source: SourceColumns) -> str:
        """The options of `pbd import` that correct it."""
        return " ".join(
            source.column_option(f"{channel}{axis}", f"{channel}{'xyz'[its]}", reverse=sign < 0)
            for axis, its, sign in zip("xyz", self.order, self.signs, strict=True)
            if sign < 0 or "xyz"[its] != axis
        )

    def fault(self, channel: str) -> str:
        """The mistake in words."""
        moved = [f"{channel}{'xyz'[k]}" for k, axis in enumerate(self.order) if axis != k]
        flipped = [f"{channel}{'xyz'[k]}" for k, sign in enumerate(self.signs) if sign < 0]
        said = [f"{moved[0]} and {moved[1]} are swapped"] if len(moved) == 2 else []
        said += [f"{', '.join(moved)} are in another order"] if len(moved) == 3 else []
        said += [f"{', '.join(flipped)} {'has' if len(flipped) == 1 else 'have'} the wrong sign"] if flipped else []
        return " and ".join(said)


AXIS_MAPPINGS = tuple(AxisMapping(o, s) for o, s in product(permutations(range(3)), product((1, -1), repeat=3)))
"""All 48 mappings; the first changes nothing."""
