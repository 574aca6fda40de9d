"""Find swapped or flipped axes, or a wrong unit of the gyro, by whether the sensors turn alike.

A direction that is fixed in the world (up, the magnetic field, the device's own up and north) must turn in sensor axes
as the gyro says. If one doesn't, each channel in turn is read with other axes and signs, and the gyro in another unit.
The mapping that removes every contradiction shows the mistake.

A gyro turns a direction and its opposite alike, so gravity and gyro can only tell 24 of the 48 mappings of the
accelerometer apart. If the hand turned about one axis only, several mappings fit; all of the simplest are named.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pbd.data.source_columns import IMU_CSV, SourceColumns
from pbd.data.units import DEG, unit_factor
from pbd.pose import Array
from pbd.tracking.repair.axis_mappings import AXIS_MAPPINGS, AxisMapping

CONTRADICTION_DEG = 12.0
"""Median angle, degrees, between a direction and the gyro's prediction above which the two contradict each other. What
the hand's acceleration may explain (`Witness.unsure_deg`) is subtracted from each angle first."""

MAPPED_SHARE = 0.75
"""Of the angles with a mapping this quantile counts, not the median, which hides an axis that few turns are about."""

IMPROVEMENT = 4.0
"""Smallest factor by which another mapping must reduce the median angle to be accepted."""

SIMPLE_PAIRS, ANY_PAIRS = 3, 8
"""Smallest number of pairs of moments between which a direction turns.
SIMPLE_PAIRS: for a unit, a sign or two swapped axes. ANY_PAIRS: for any of the 48 mappings; one may fit by chance."""

AS_GOOD_DEG = 4.0
"""Readings whose angle is within this (degrees) of the best fit equally well."""

UNITS = (
    (DEG, "rad/s", "its values are in deg/s; import the file with --unit gyr=deg/s"),
    (1.0 / DEG, "deg/s", "its values were in rad/s, but were read as deg/s; import the file with --unit gyr=rad/s"),
    (1e-3 * DEG, "rad/s", "its values are in mdeg/s; import the file with --unit gyr=mdeg/s"),
)
"""Factor that corrects a gyro in a wrong unit, the unit as which it was read, and the advice."""

FACTORS, CLEAR_FACTOR = 1.05 ** np.arange(-60, 61), 1.5
"""Factors on the gyro that are tried, from 1/19 to 19. (Beyond them, turns by whole circles fit by chance.)
CLEAR_FACTOR: a smaller factor either way is no fault, since the gyro's range may have cut off the turns."""


@dataclass(frozen=True, eq=False)
class Witness:
    """A direction that is fixed in the world, in sensor axes: unit vectors (k, 3) at both moments of k pairs.

    `channel` is a (gravity), m (magnetic field), or empty for the device's attitude, whose columns are trusted.
    `unsure_deg` (k,) is how much the angle between the two may be off, because the hand accelerates.
    """

    channel: str
    first: Array
    second: Array
    unsure_deg: Array | float = 0.0

    def off(self, turn: Array) -> Array:
        """Angles (k,), degrees, between the second direction and the first one rotated by `turn` (k, 3, 3).

        Only what is sure counts.
        """
        return self._sure(angles(self.second, self.rotated(turn)))

    def off_with_mappings(self, turn: Array, matrices: Array) -> Array:
        """The same (k, r) with each of the mappings (r, 3, 3)."""
        # The cosines of all mappings are sums of the same 81 products.
        products = np.einsum("ka,kb,kij->kaibj", self.second, self.first, turn).reshape(-1, 81)
        cosines: Array = products @ np.einsum("ria,rjb->aibjr", matrices, matrices).reshape(81, -1)
        return self._sure(np.arccos(np.clip(cosines, -1.0, 1.0)).T).T

    def rotated(self, turn: Array) -> Array:
        """The first direction (k, 3), rotated by `turn` (k, 3, 3)."""
        return (turn @ self.first[:, :, None])[:, :, 0]

    def turns_to(self, direction: Array) -> NDArray[np.bool_]:
        """Whether the first direction and another (k, 3) surely are more than CONTRADICTION_DEG apart."""
        return self._sure(angles(self.first, direction)) > CONTRADICTION_DEG

    def _sure(self, angle: Array) -> Array:
        return np.maximum(np.degrees(angle) - self.unsure_deg, 0.0)


class Contradiction(NamedTuple):
    """A witness that does not turn as the gyro says.

    Attributes:
        witness: the witness' channel.
        off_deg: median angle by which it is off, degrees.
        fit_deg: the same with the best mapping.
        pair: index of the first pair of moments that shows it.
        message: what is wrong and how to import the file.
    """

    witness: str
    off_deg: float
    fit_deg: float
    pair: int
    message: str


def find_axis_error(
    witnesses: Sequence[Witness], turn: Callable[[float], Array], source: SourceColumns = IMU_CSV
) -> Contradiction | None:
    """Find the mapping that removes all contradictions, by all witnesses or only the first ones.

    The last witnesses may be wrong: the device's own attitude lags, iron bends the field. None: nothing contradicts the
    gyro, or no mapping removes the contradictions.

    Args:
        witnesses: gravity first.
        turn: factor on the gyro -> its rotations (k, 3, 3) from the first moment's axes to the second's.
        source: the file's columns, which the message names.
    """
    search = _Search(witnesses, turn, source)
    found = search.find_mapping()
    if not search.gravity_contradicts:
        return found
    found = search.find_unit(found.fit_deg if found else np.inf) or found or search.find_dead_gyro()
    # A rate that a person gave is as likely wrong as axes or units are. Name what fits best, or both if they fit alike.
    # (The search takes as long as tracking, so without that reason gravity must be off by 20 degrees.)
    if 0 in search.counted and (source.has_no_times or (found is None and search.off[0] > 20.0)):
        likely = sorted(filter(None, (search.find_scale(), found)), key=lambda each: each.fit_deg)
        message = "; or ".join(each.message for each in likely if each.fit_deg <= likely[0].fit_deg + AS_GOOD_DEG)
        return likely[0]._replace(message=message) if likely else None
    return found


Fit = tuple[str, AxisMapping, Array]
"""A channel, a mapping of it, and the degrees by which each witness is then off."""


class _Search:
    """The search of `find_axis_error`, with its arguments.

    Attributes:
        off (n,): median angle by which each witness is off, degrees.
        counted: the witnesses that turn. If no direction turns but the gyro does, the gyro is biased or noisy, and a
            mapping that turns it about that direction would seem to remove the contradiction.
        gravity_contradicts: whether gravity surely contradicts the gyro.
    """

    def __init__(self, witnesses: Sequence[Witness], turn: Callable[[float], Array], source: SourceColumns) -> None:
        self._witnesses, self._turn, self._source = witnesses, turn, source
        self._by_gyro = turn(1.0)
        self._moved = [each.turns_to(each.second) for each in witnesses]
        self._telling = [
            rows | each.turns_to(each.rotated(self._by_gyro)) for each, rows in zip(witnesses, self._moved, strict=True)
        ]
        self._each = range(len(witnesses))
        self.off = np.array([self._cost(k, witnesses[k].off(self._by_gyro)) for k in self._each])
        self.counted = [k for k in self._each if self._moved[k].sum() >= SIMPLE_PAIRS]
        self.gravity_contradicts = bool(self._telling[0].sum() >= SIMPLE_PAIRS and self.off[0] > CONTRADICTION_DEG)

    def _cost(self, k: int, off: Array, share: float = 0.5) -> Array:
        """Quantile of the angles (k, ...) by which witness k is off, where it turns or where it should, the larger."""
        return np.maximum(_quantile(off[self._moved[k]], share), _quantile(off[self._telling[k]], share))

    def _costs(self, by: Array, matrices: Array) -> Array:
        """The same (n, r) for every witness with each of the mappings (r, 3, 3), for MAPPED_SHARE."""
        angles = [each.off_with_mappings(by, matrices) for each in self._witnesses]
        return np.array([self._cost(k, angles[k], MAPPED_SHARE) for k in self._each])

    def find_mapping(self) -> Contradiction | None:
        """Find another order, or other signs, of a channel's axes that remove the contradictions of some witnesses."""
        off = self._costs(self._by_gyro, np.eye(3)[None])
        if not self.counted or off[self.counted].max() <= CONTRADICTION_DEG:
            return None
        matrices = np.array([mapping.matrix for mapping in AXIS_MAPPINGS])
        of_own = self._costs(self._by_gyro, matrices)
        # Another mapping of the gyro is the inverse mapping of all witnesses. A mirrored one reverses its rotation.
        inverse = [int(np.argmax((matrices == one.T).all(axis=(1, 2)))) for one in matrices]
        mirrored, of_gyro = np.linalg.det(matrices) < 0.0, of_own[:, inverse]
        of_gyro[:, mirrored] = self._costs(self._turn(-1.0), matrices[mirrored].transpose(0, 2, 1))
        own = np.array([[each.channel == c for each in self._witnesses] for c in "am"])[:, :, None]
        left = dict(zip("gam", (of_gyro, *np.where(own, of_own, off)), strict=True))
        fits = [(channel, mapping, left[channel][:, k]) for k, mapping in enumerate(AXIS_MAPPINGS) for channel in left]
        used = ([k for k in self.counted if k < n] for n in range(len(self._witnesses), 0, -1))
        remedies = (self._find_remedy(fits, k) for k in used if k)
        return next(filter(None, remedies), None)

    def _find_remedy(self, fits: Sequence[Fit], used: Sequence[int]) -> Contradiction | None:
        """Find a channel's mappings that remove all contradictions of the `used` witnesses; fits[0] is as read."""
        as_it_is = fits[0][2]
        wrong = [k for k in used if as_it_is[k] > CONTRADICTION_DEG]
        if not wrong:
            return None
        simple = min(self._telling[k].sum() for k in wrong) < ANY_PAIRS
        able = [
            (float(off[used].max()), mapping.causes, channel, mapping)
            for channel, mapping, off in fits
            if mapping.causes == 1 or not simple
        ]
        off, best = float(as_it_is[used].max()), min(able)[0]
        if best > min(off / IMPROVEMENT, CONTRADICTION_DEG):
            return None
        good = [fit for fit in able if fit[0] <= best + AS_GOOD_DEG]
        fewest = min(fit[1] for fit in good)
        named = [(channel, mapping) for _, causes, channel, mapping in good if causes == fewest]
        # Gravity and gyro together allow one mapping of the gyro, unless the hand turned about too few axes.
        sure = not simple and sum(channel == "g" for *_, channel, _ in good) < 2
        message = _message(named[:5], sure, self._source)  # more would be no advice
        pair = int(np.argmax(self._telling[wrong[0]]))
        return Contradiction(self._witnesses[wrong[0]].channel, off, best, pair, message)

    def find_unit(self, better_than_deg: float) -> Contradiction | None:
        """Find a unit of the gyro that leaves gravity off by less than that."""
        # Where gravity hardly turns, any factor that stops the gyro removes the contradiction.
        order = "gx, gy, gz are in another order (gravity turns too little to tell), or "
        read_as = next((unit_factor("gyr", column.unit) for column in self._source.of("gyr")), None)
        for factor, unit, what in UNITS:
            if read_as not in (None, unit_factor("gyr", unit)):
                continue
            fit = self._fit_of(factor)
            if fit < min(self.off[0] / IMPROVEMENT, better_than_deg):
                return self._of_gravity(fit, what if 0 in self.counted else order + what)
        return None

    def find_dead_gyro(self) -> Contradiction | None:
        """Find that the gyro reads the same all the time."""
        if np.ptp(self._by_gyro, axis=0).any():
            return None
        dead = f"it reads the same all the time, so it is dead; check the columns {self._source.names('gyr')}"
        return self._of_gravity(self.off[0], dead)

    def find_scale(self) -> Contradiction | None:
        """Find the factor nearest to 1 that makes the gyro agree with gravity."""
        fits = np.array([self._fit_of(float(factor)) for factor in FACTORS])
        good = np.flatnonzero(fits <= min(fits.min() + AS_GOOD_DEG, self.off[0] / IMPROVEMENT))
        if not len(good):
            return None
        nearest = good[np.argmin(np.abs(np.log(FACTORS[good])))]
        beside = good[np.abs(good - nearest) < 6]  # six places on, a third more, is another minimum
        best = int(beside[np.argmin(fits[beside])])
        if 1.0 / CLEAR_FACTOR < FACTORS[best] < CLEAR_FACTOR:
            return None
        far = f"about {1.0 / FACTORS[best]:.2g} times"
        why = "its unit or its full scale is wrong (--unit gyr=...)"
        what = f"it turns {far} as far: {why}, or the times are, and with them every distance (--unit t=..., --rate)"
        if self._source.has_no_times:
            rate = f"the rate is likely wrong, and the true one {far} as high: {self._source.time_advice()}"
            what = f"it turns {far} as far: {rate}; else {why}"
        return self._of_gravity(fits[best], what)

    def _fit_of(self, factor: float) -> float:
        """Degrees by which gravity is off with that factor on the gyro, where it turns and where it doesn't."""
        return float(self._cost(0, self._witnesses[0].off(self._turn(factor))))

    def _of_gravity(self, fit_deg: float, message: str) -> Contradiction:
        pair = int(np.argmax(self._telling[0]))
        return Contradiction("a", float(self.off[0]), float(fit_deg), pair, message)


def _quantile(values: Array, share: float) -> Array:
    """A quantile along the first axis; 0 without values."""
    return np.asarray(np.quantile(values, share, axis=0) if len(values) else np.zeros(values.shape[1:]))


def _message(named: Sequence[tuple[str, AxisMapping]], sure: bool, source: SourceColumns) -> str:
    each = [f"{one.fault(channel)}: import the file with {one.remedy(channel, source)}" for channel, one in named]
    message = "; or ".join(each)
    if len(each) > 1 or not sure:
        message += f" (the hand turned too little to {'tell which' if len(each) > 1 else 'be sure'})"
    if any(mapping.signs == (-1, -1, -1) and mapping.order == (0, 1, 2) for _, mapping in named):
        both = " ".join(source.column_option(f"{sensor}y", f"{sensor}y", reverse=True) for sensor in "ag")
        return f"both may have left-handed axes (then {both}; only left and right in the replay tell), or {message}"
    return message


def angles(a: Array, b: Array) -> Array:
    """Angles (k,) rad between unit vectors (k, 3)."""
    between: Array = np.arccos(np.clip((a * b).sum(axis=1), -1.0, 1.0))
    return between
