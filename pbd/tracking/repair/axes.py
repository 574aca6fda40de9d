"""Which reading of a channel's axes, or of the gyro's unit, makes gyro, gravity, field and device turn alike.

A direction that is fixed in the world (up, the field, the device's own up and north) must turn in the sensor's axes as
the gyro says. Where it doesn't, each channel in turn is read with its axes in another order or with other signs, and
the gyro in another unit. The reading that mends every contradiction names what is wrong.

A gyro carries a direction as well as its opposite, so gravity and gyro alone tell only 24 readings of the accelerometer
apart. Turns about one axis leave several readings; all of the simplest are named.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from itertools import permutations, product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pbd.data.units import DEG
from pbd.pose import Array
from pbd.tracking.moving_windows import median

CONTRADICTION_DEG = 12.0
"""Median angle (degrees) between a direction and where the gyro carries it, above which they contradict each other. The
steady moments of a hand that moves on are up to 9 degrees off (BROAD's trial 14)."""

UNIT_DEG = 20.0
"""The same, where the unit is asked: it is 57 times off, and a second of a gyro's noise is not to seem so."""

IMPROVEMENT = 4.0
"""Another reading is believed if it divides that angle by this number."""

SIMPLE_PAIRS, ANY_PAIRS = 3, 8
"""Least number of pairs of moments that tell: for a unit, a sign or two swapped axes; for any of the 48, of which one
may agree by chance."""

AS_GOOD_DEG = 4.0
"""Readings within this angle (degrees) of the best fit as well."""

MOST_NAMED = 5
"""Most readings that a message names."""

UNITS = (
    (DEG, "its values are in deg/s; import the file with --unit gyr=deg/s"),
    (1.0 / DEG, "its values were in rad/s, but were read as deg/s; import the file with --unit gyr=rad/s"),
)
"""What a gyro in another unit is to be multiplied by, and what to say of it."""


@dataclass(frozen=True, order=True)
class Reading:
    """What each of three axes should have been read from: its index and its sign."""

    order: tuple[int, ...]
    signs: tuple[int, ...]

    @property
    def matrix(self) -> Array:
        """(3, 3): multiplied by a vector of the channel as it is, gives the channel as it should be."""
        matrix: Array = np.eye(3)[list(self.order)] * np.array(self.signs)[:, None]
        return matrix

    @cached_property
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

    def off(self, turn: Array) -> Array:
        """Angles (k,), degrees, by which it is off where (k, 3, 3) carry it."""
        return np.degrees(angles(self.second, _carried(self.first, turn)))


class Contradiction(NamedTuple):
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


def find_other_axes(witnesses: Sequence[Witness], turn: Callable[[float], Array]) -> Contradiction | None:
    """Find the reading that mends what contradicts, by all witnesses or by the first ones.

    The last may be spoilt: a device's own attitude lags, a field is bent by iron.

    Args:
        witnesses: what is seen at the pairs of moments; the first is gravity.
        turn: gives (k, 3, 3) rotations from the first moment's axes to the second's, by the gyro times a factor.

    Returns:
        None where nothing contradicts, or no reading mends it.
    """
    as_read = turn(1.0)
    apart = [each.off(as_read) for each in witnesses]
    seen = [_differ(each.first, each.second) for each in witnesses]
    told = [
        rows | _differ(each.first, _carried(each.first, as_read)) for each, rows in zip(witnesses, seen, strict=True)
    ]

    def costs(k: int, by: Array, matrices: Array) -> Array:
        """Median angles, degrees, by which a witness is off that is read by each of (r, 3, 3)."""
        cosines = _cosines(witnesses[k], by, matrices)
        return np.maximum(_median_angles(cosines[seen[k]]), _median_angles(cosines[told[k]]))

    each_witness = range(len(witnesses))
    off = np.array([max(_median(apart[k][seen[k]]), _median(apart[k][told[k]])) for k in each_witness])
    # Where nothing is seen to move, a gyro that turns is biased or noisy: any reading that turns it to where it isn't
    # seen would seem to mend that.
    counted = [k for k in each_witness if seen[k].sum() >= SIMPLE_PAIRS]
    found = None
    if counted and off[counted].max() > CONTRADICTION_DEG:
        matrices = np.array([reading.matrix for reading in readings()])
        of_own = np.array([costs(k, as_read, matrices) for k in each_witness])
        # To turn the gyro's axes is to turn all witnesses' the other way. A mirror image turns the gyro round.
        inverse = [int(np.argmax((matrices == one.T).all(axis=(1, 2)))) for one in matrices]
        mirrored, back, of_gyro = np.linalg.det(matrices) < 0.0, turn(-1.0), of_own[:, inverse]
        of_gyro[:, mirrored] = [costs(k, back, matrices[mirrored].transpose(0, 2, 1)) for k in each_witness]
        left = {c: np.where([[each.channel == c] for each in witnesses], of_own, off[:, None]) for c in "am"}
        left["g"] = of_gyro
        fits = [(channel, reading, left[channel][:, k]) for k, reading in enumerate(readings()) for channel in "gam"]
        used = ([k for k in counted if k < n] for n in range(len(witnesses), 0, -1))
        found = next(filter(None, (_mended(witnesses, told, fits, k) for k in used if k)), None)
    up = witnesses[0]
    telling = _differ(up.first, up.second, UNIT_DEG) | _differ(up.first, _carried(up.first, as_read), UNIT_DEG)
    off_deg = _median(apart[0][telling])
    if telling.sum() >= SIMPLE_PAIRS and off_deg > UNIT_DEG:
        pair = int(np.argmax(telling))
        for factor, what in UNITS:
            fit = _median(up.off(turn(factor))[telling])
            if fit < min(off_deg / IMPROVEMENT, found.fit_deg if found else np.inf):
                return Contradiction("a", off_deg, fit, pair, what)
        if found is None and not np.ptp(as_read, axis=0).any():
            dead = "it reads the same all the time, so it is dead; check the columns gx, gy, gz"
            return Contradiction("a", off_deg, off_deg, pair, dead)
    return found


Fit = tuple[str, Reading, Array]
"""A channel, how to read it, and how far each witness is then off, degrees."""


def _mended(
    witnesses: Sequence[Witness], told: Sequence[NDArray[np.bool_]], fits: Sequence[Fit], used: Sequence[int]
) -> Contradiction | None:
    """Find the readings of one channel that mend what contradicts, by some of the witnesses; the first leaves all."""
    as_it_is = fits[0][2]
    wrong = [k for k in used if as_it_is[k] > CONTRADICTION_DEG]
    if not wrong:
        return None
    simple = min(told[k].sum() for k in wrong) < ANY_PAIRS
    able = [
        (float(off[used].max()), reading.causes, channel, reading)
        for channel, reading, off in fits
        if reading.causes == 1 or not simple
    ]
    off, best = float(as_it_is[used].max()), min(able)[0]
    if best > min(off / IMPROVEMENT, CONTRADICTION_DEG):
        return None
    good = [fit for fit in able if fit[0] <= best + AS_GOOD_DEG and fit[1] > 0]
    fewest = min(fit[1] for fit in good)
    # Those first that a program's own convention explains: all signs turned, or two columns swapped.
    named = sorted(((c, r) for _, causes, c, r in good if causes == fewest), key=lambda each: -len(set(each[1].signs)))
    message = _message(named[:MOST_NAMED])
    return Contradiction(witnesses[wrong[0]].channel, off, best, int(np.argmax(told[wrong[0]])), message)


def _carried(directions: Array, turn: Array) -> Array:
    """Directions (k, 3) turned by (k, 3, 3)."""
    carried: Array = np.einsum("kij,kj->ki", turn, directions)
    return carried


def _differ(a: Array, b: Array, by_deg: float = CONTRADICTION_DEG) -> NDArray[np.bool_]:
    """Whether each direction of (k, 3) is another one."""
    differ: NDArray[np.bool_] = np.degrees(angles(a, b)) > by_deg
    return differ


def _cosines(witness: Witness, by: Array, matrices: Array) -> Array:
    """Of the angles (k, r) by which a witness, read by each of (r, 3, 3), is off where `by` (k, 3, 3) carries it."""
    # All readings' cosines are sums of the same 81 products.
    products = np.einsum("ka,kb,kij->kaibj", witness.second, witness.first, by).reshape(-1, 81)
    cosines: Array = products @ np.einsum("ria,rjb->aibjr", matrices, matrices).reshape(81, -1)
    return np.clip(cosines, -1.0, 1.0)


def _median(values: Array) -> float:
    """0 without any."""
    return float(median(values)) if len(values) else 0.0


def _median_angles(cosines: Array) -> Array:
    """In degrees (r,), of angles whose cosines (k, r) are given; 0 without any."""
    if not len(cosines):
        return np.zeros(cosines.shape[1])
    middle = [(len(cosines) - 1) // 2, len(cosines) // 2]
    angles: Array = np.arccos(np.partition(cosines, middle, axis=0)[middle]).mean(axis=0)
    return np.degrees(angles)


def _message(named: Sequence[tuple[str, Reading]]) -> str:
    each = [f"{reading.fault(channel)}: import the file with {reading.remedy(channel)}" for channel, reading in named]
    if len(each) == 1:
        return each[0]
    return f"{'; or '.join(each)} (the hand turned too little to tell which)"


def angles(a: Array, b: Array) -> Array:
    """Angles (k,) rad between unit vectors (k, 3)."""
    between: Array = np.arccos(np.clip((a * b).sum(axis=1), -1.0, 1.0))
    return between
