"""Which of the 48 assignments of axes and signs makes gyro, gravity, field and the device's attitude turn alike.

A direction that is fixed in the world (up, the field, the device's own up and north) must turn in the sensor's axes as
the gyro says. Where it doesn't, each channel in turn is read with its axes in another order or with other signs. The
reading that mends every contradiction names the columns that are wrong.

A gyro carries a direction as well as its opposite, so gravity and gyro alone tell only 24 readings of the accelerometer
apart. Turns about one axis leave several readings; all of the simplest are named.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import permutations, product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pbd.pose import Array
from pbd.tracking.moving_windows import median

CONTRADICTION_DEG = 12.0
"""Median angle (degrees) between a direction and where the gyro carries it, above which they contradict each other. The
steady moments of a hand that moves on are up to 9 degrees off (BROAD's trial 14)."""

IMPROVEMENT = 4.0
"""Another reading is believed if it divides that angle by this number."""

SIMPLE_PAIRS, ANY_PAIRS = 3, 8
"""Least number of pairs of moments that tell: for a sign or two swapped axes; for any of the 48, of which one may agree
by chance."""

AS_GOOD, AS_GOOD_DEG = 1.5, 2.0
"""Readings within this factor and this angle (degrees) of the best fit as well."""

MOST_NAMED = 5
"""Most readings that a message names."""


class Reading(NamedTuple):
    """What each of three axes should have been read from: its index and its sign."""

    order: tuple[int, ...]
    signs: tuple[int, ...]

    @property
    def matrix(self) -> Array:
        """(3, 3): multiplied by a vector of the channel as it is, gives the channel as it should be."""
        matrix: Array = np.eye(3)[list(self.order)] * np.array(self.signs)[:, None]
        return matrix

    @property
    def causes(self) -> int:
        """How many mistakes it takes: a sign, two columns swapped, or all signs, is one."""
        moved = sum(axis != k for k, axis in enumerate(self.order))
        turned = sum(sign < 0 for sign in self.signs)
        return (moved + 1) // 2 + (1 if turned == 3 else turned)

    def remedy(self, channel: str) -> str:
        """The options of `pbd import`, with our names for the columns as they were read."""
        return " ".join(
            f"--column {channel}{axis}={'-' if sign < 0 else ''}{channel}{'xyz'[its]}"
            for axis, its, sign in zip("xyz", self.order, self.signs, strict=True)
            if sign < 0 or "xyz"[its] != axis
        )

    def fault(self, channel: str) -> str:
        """What is wrong, in words."""
        moved = [f"{channel}{'xyz'[k]}" for k, axis in enumerate(self.order) if axis != k]
        turned = [f"{channel}{'xyz'[k]}" for k, sign in enumerate(self.signs) if sign < 0]
        said = [f"{moved[0]} and {moved[1]} are swapped"] if len(moved) == 2 else []
        said += [f"{', '.join(moved)} are in another order"] if len(moved) == 3 else []
        said += [f"{', '.join(turned)} {'has' if len(turned) == 1 else 'have'} the wrong sign"] if turned else []
        return " and ".join(said)


@cache
def readings() -> tuple[Reading, ...]:
    """All 48; the first leaves everything as it is."""
    return tuple(Reading(o, s) for o, s in product(permutations(range(3)), product((1, -1), repeat=3)))


@dataclass(frozen=True, eq=False)
class Witness:
    """A fixed direction at both moments of each pair, (k, 3) unit, in the sensor's axes.

    `channel` is a (gravity), m (the field) or empty: the device's attitude, whose columns aren't questioned here.
    """

    channel: str
    first: Array
    second: Array


@dataclass(frozen=True)
class Contradiction:
    """A witness that turns otherwise than the gyro says.

    Attributes:
        witness: its channel.
        off_deg: by how far, degrees.
        fit_deg: what is left of that by the reading that mends it.
        pair: the first pair of moments that tells.
        message: what is wrong and how to import the file.
    """

    witness: str
    off_deg: float
    fit_deg: float
    pair: int
    message: str


def find_other_axes(witnesses: Sequence[Witness], turn: Array, turn_back: Callable[[], Array]) -> Contradiction | None:
    """Find the reading that mends what contradicts, by all witnesses or by the first ones.

    The last may be spoilt: a device's own attitude lags, a field is bent by iron.

    Args:
        witnesses: what is seen at the pairs of moments.
        turn: (k, 3, 3) rotations from the first moment's axes to the second's, by the gyro.
        turn_back: gives (k, 3, 3) the same by the gyro with all signs turned.

    Returns:
        None where nothing contradicts, or no reading mends it.
    """
    # Where nothing is seen to move, a gyro that turns is biased or noisy: any reading that turns it to where it isn't
    # seen would seem to mend that.
    seen = [np.degrees(angles(witness.first, witness.second)) > CONTRADICTION_DEG for witness in witnesses]
    told = [rows | _carried_away(witness, turn) for witness, rows in zip(witnesses, seen, strict=True)]
    counted = np.array([rows.sum() >= SIMPLE_PAIRS for rows in seen], dtype=bool)
    each = [*zip(witnesses, seen, told, strict=True)]
    as_it_is = [_costs(w, rows, readings()[:1], turn, turn)[0] for w, *rows in each]
    if not (counted & (np.array(as_it_is) > CONTRADICTION_DEG)).any():
        return None
    back = turn_back()
    costs = np.array([_costs(w, rows, readings(), turn, back) for w, *rows in each])
    by_first = (_mended(witnesses[:n], told[:n], counted[:n], costs[:n]) for n in range(len(witnesses), 0, -1))
    return next(filter(None, by_first), None)


def _mended(
    witnesses: Sequence[Witness], told: Sequence[NDArray[np.bool_]], counted: NDArray[np.bool_], costs: Array
) -> Contradiction | None:
    """Find the reading of one channel that mends what contradicts: `counted` witnesses by their costs (w, 48)."""
    wrong = counted & (costs[:, 0] > CONTRADICTION_DEG)
    if not wrong.any():
        return None
    costs, pairs = costs[counted], min(int(rows.sum()) for rows, off in zip(told, wrong, strict=True) if off)
    channels = [witness.channel for witness, count in zip(witnesses, counted, strict=True) if count]
    fits = []
    for k, reading in enumerate(readings()):
        if reading.causes > 1 and pairs < ANY_PAIRS:
            continue
        fits.append((float(costs[:, k].max()), reading.causes, "g", reading))
        for channel in {"a", "m"} & set(channels):
            # To turn a channel's axes is to turn the gyro's the other way; a mirror image turns the gyro round too.
            as_gyro = _index(np.linalg.det(reading.matrix) * reading.matrix.T)
            rest = [costs[i, as_gyro if its == channel else 0] for i, its in enumerate(channels)]
            fits.append((float(max(rest)), reading.causes, channel, reading))
    off, best = float(costs[:, 0].max()), min(fits)[0]
    if best > min(off / IMPROVEMENT, CONTRADICTION_DEG):
        return None
    good = [fit for fit in fits if fit[0] <= AS_GOOD * best + AS_GOOD_DEG and fit[1] > 0]
    fewest = min(fit[1] for fit in good)
    # Those first that a program's own convention explains: all signs turned, or two columns swapped.
    named = sorted(((c, r) for _, causes, c, r in good if causes == fewest), key=lambda each: -len(set(each[1].signs)))
    worst = int(np.flatnonzero(wrong)[0])
    pair = int(np.flatnonzero(told[worst])[0])
    return Contradiction(witnesses[worst].channel, off, best, pair, _message(named[:MOST_NAMED]))


def _carried_away(witness: Witness, turn: Array) -> NDArray[np.bool_]:
    """Whether the gyro moves the direction in each pair: (k,) bool."""
    carried = (turn @ witness.first[:, :, None])[:, :, 0]
    away: NDArray[np.bool_] = np.degrees(angles(witness.first, carried)) > CONTRADICTION_DEG
    return away


def _costs(
    witness: Witness, parts: Sequence[NDArray[np.bool_]], of: Sequence[Reading], turn: Array, turn_back: Array
) -> Array:
    """Median angle (n,), degrees, of n readings of the gyro: the largest over the parts of the pairs."""
    used = np.logical_or.reduce(parts)
    parts = [part[used] for part in parts if part.any()]
    first, second, by, back = (
        np.ascontiguousarray(values[used].T) for values in (witness.first, witness.second, turn, turn_back)
    )
    medians = []
    for reading in of:
        rotation = reading.matrix.T
        # A mirror image turns the gyro round. By rows that are contiguous this is the sum of second_i R_ij first_j.
        turned = np.einsum(
            "jik,ik,jk->k", back if np.linalg.det(rotation) < 0.0 else by, rotation @ second, rotation @ first
        )
        off = np.degrees(np.arccos(np.clip(turned, -1.0, 1.0)))
        medians.append(max((float(median(off[part])) for part in parts), default=0.0))
    return np.array(medians)


def _index(matrix: Array) -> int:
    order, signs = np.abs(matrix).argmax(axis=1), np.rint(matrix.sum(axis=1)).astype(int)
    return readings().index(Reading(tuple(order.tolist()), tuple(signs.tolist())))


def _message(named: Sequence[tuple[str, Reading]]) -> str:
    each = [f"{reading.fault(channel)}: import the file with {reading.remedy(channel)}" for channel, reading in named]
    if len(each) == 1:
        return each[0]
    return f"{'; or '.join(each)} (the hand turned too little to tell which)"


def angles(a: Array, b: Array) -> Array:
    """Angles (k,) rad between unit vectors (k, 3)."""
    between: Array = np.arccos(np.clip((a * b).sum(axis=1), -1.0, 1.0))
    return between
