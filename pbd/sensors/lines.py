"""Lines of numbers from any device: an Arduino, SparkFun's Razor, a script. line_layout.py gives their meaning.

There is no checksum, so a line counts only if it has the expected number of columns, all of them finite and none
absurd. Without a prefix that marks its start, the first line may be incomplete and is left out. A digit lost on the
way can still pass for another number: prefer a device with a checksum.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from math import isfinite, pi
from operator import itemgetter

from pbd.sensors.attitude import from_north_east_down
from pbd.sensors.decoding import Sample, Tally, Triple, WrappingClock
from pbd.sensors.line_layout import QUANTITIES, Line, LineLayout

LONGEST_LINE = 1024
"""Longest line, bytes."""

LARGEST_READING = {"acc": 2000.0, "gyr": 200.0, "mag": 1e9, "angle": 4.0 * pi}
"""m/s2, rad/s, uT and rad: no hand or sensor exceeds these. The field's bound is loose, as its unit may be unknown."""


class LineDecoder:
    """Each line, or each group of lines, gives a sample.

    A group ends when it has all its lines; where one was lost, when the next group's first line comes or one of its
    own comes again.
    """

    def __init__(self, layout: LineLayout) -> None:
        self.tally = Tally()
        self._readers = {line.prefix.encode(): _LineReader(line, layout) for line in layout.lines}
        self._first = next(iter(self._readers))
        self._prefix = re.compile(b"|".join(map(re.escape, self._readers)))
        self._marked = b"" not in self._readers
        self._group: dict[bytes, Sample] = {}
        self._clock = WrappingClock(layout.wrap_s)
        self._rest = b""
        self._cut = not self._marked  # the start of the line under way is unknown

    def feed(self, data: bytes) -> list[Sample]:
        """See `Decoder`."""
        *lines, rest = (self._rest + data).replace(b"\r", b"\n").split(b"\n")
        samples: list[Sample] = []
        for line in lines:
            text = self._end_of(line)
            if self._cut:
                self._cut = False
            elif text:
                self._read(text, samples)
        self._rest = self._end_of(rest)
        return samples

    def _end_of(self, line: bytes) -> bytes:
        """Leave out what is too long for a line; without a prefix what is left of it has no known start."""
        if len(line) > LONGEST_LINE:
            self._cut = not self._marked
        return line[-LONGEST_LINE:]

    def _read(self, line: bytes, samples: list[Sample]) -> None:
        prefix, start = b"", 0
        if self._marked:
            starts = list(self._prefix.finditer(line))
            if not starts:
                return
            prefix, start = starts[-1][0], starts[-1].end()  # what stands before it lost its end
        try:
            sample = self._readers[prefix].read(line[start:], self._clock)
        except ValueError:
            self.tally.bad_packets += 1
            return
        self.tally.packets += 1
        if len(self._readers) == 1:
            samples.append(sample)
            return
        if prefix == self._first or prefix in self._group:
            self._give(samples)
        self._group[prefix] = sample
        if len(self._group) == len(self._readers):
            self._give(samples)

    def _give(self, samples: list[Sample]) -> None:
        if self._group:
            samples.append(_joined(self._group.values()))
            self._group = {}


class _LineReader:
    """One kind of line. Its columns are sorted by quantity: three each of what there is, then t."""

    def __init__(self, line: Line, layout: LineLayout) -> None:
        names = [name.removeprefix("-") for name in line.columns]
        self._columns = len(names)
        self._separator = None if layout.separator == " " else layout.separator.encode()
        self._compass = "heading" in names
        used: list[int] = []
        self._threes = []
        for place, quantity in enumerate(("acc", "gyr", "mag", "angle")):
            where = [names.index(name) for name in QUANTITIES[quantity] if name in names]
            if where:
                x, y, z = (layout.factor(quantity) * (-1.0 if line.columns[i].startswith("-") else 1.0) for i in where)
                self._threes.append((place, len(used), x, y, z, LARGEST_READING[quantity]))
                used += where
        self._wrap_s = layout.wrap_s
        self._t_factor = layout.factor("t") if "t" in names else None
        if self._t_factor is not None:
            used.append(names.index("t"))
        self._pick = itemgetter(*used)

    def read(self, text: bytes, clock: WrappingClock) -> Sample:
        """Read a line without its prefix; ValueError where it is not as described."""
        cells = text.split(self._separator)
        if len(cells) == self._columns + 1 and not cells[-1].strip():
            cells.pop()  # many sketches print a separator after each number
        if len(cells) != self._columns:
            raise ValueError("not the columns expected")
        picked = self._pick(cells)
        if b"_" in text and b"_" in b" ".join(picked):  # float() takes 1_000 for a number
            raise ValueError("not a number")
        values = tuple(map(float, picked))
        read: list[Triple | None] = [None, None, None, None]
        for place, start, fx, fy, fz, absurd in self._threes:
            x, y, z = values[start] * fx, values[start + 1] * fy, values[start + 2] * fz
            if not (-absurd <= x <= absurd and -absurd <= y <= absurd and -absurd <= z <= absurd):  # nor is a NaN
                raise ValueError("an absurd number")
            read[place] = (x, y, z)
        acc, gyr, mag, rpy = read
        if rpy is not None and self._compass:
            rpy = from_north_east_down(rpy)
        t = None
        if self._t_factor is not None:
            t = values[-1] * self._t_factor
            if not isfinite(t) or t < 0.0 or (self._wrap_s and t >= self._wrap_s):
                raise ValueError("no time of this clock")
            t = clock.straight(t)
        return Sample(acc, gyr, mag, rpy, t)


def _joined(parts: Iterable[Sample]) -> Sample:
    """Join the parts of a group: of each quantity, and of the time, the first that is there."""
    return Sample(*(next((value for value in given if value is not None), None) for given in zip(*parts, strict=True)))
