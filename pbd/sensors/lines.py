"""Lines of numbers from any device: an Arduino, SparkFun's Razor, a script. line_layout.py describes the columns.

Lines have no checksum. A line counts only if it has the expected number of columns, all finite and plausible. Without a
prefix that marks its start, the first line may be incomplete and is skipped. A line that lost a digit may still pass:
prefer a device with a checksum.
"""

import re
from collections.abc import Iterable
from math import isfinite, pi
from operator import itemgetter

from pbd.sensors.attitude import from_north_east_down
from pbd.sensors.decoding import Sample, Tally, Triple, WrappingClock
from pbd.sensors.line_layout import QUANTITIES, Line, LineLayout

LONGEST_LINE = 1024
"""Longest line, bytes. Of a longer one only the end is kept."""

LARGEST_READING = {"acc": 2000.0, "gyr": 200.0, "mag": 1e9, "angle": 4.0 * pi}
"""Largest plausible reading, m/s2, rad/s, uT and rad. The field's bound is loose because its unit may be unknown."""

CORRECT = "correct --columns, --separator or --prefix"


class LineDecoder:
    """Makes a sample from each line, or from each group of lines.

    A group ends when all its lines have come. If a line was lost, the group ends when the first kind of line comes, or
    a kind that the group already has.
    """

    def __init__(self, layout: LineLayout) -> None:
        self.tally = Tally()
        self._readers = {line.prefix.encode(): _LineReader(line, layout) for line in layout.lines}
        self._first = next(iter(self._readers))
        self._prefix = re.compile(b"|".join(map(re.escape, self._readers)))
        self._has_prefix = b"" not in self._readers
        self._group: dict[bytes, Sample] = {}
        self._clock = WrappingClock(layout.wrap_s)
        self._rest = b""
        self._incomplete = not self._has_prefix  # the start of the present line may be missing

    def feed(self, data: bytes) -> list[Sample]:
        """See `Decoder`."""
        *lines, rest = (self._rest + data).replace(b"\r", b"\n").split(b"\n")
        samples: list[Sample] = []
        for line in lines:
            text = self._shorten(line)
            if self._incomplete:
                self._incomplete = False
            elif text:
                self._read(text, samples)
        self._rest = self._shorten(rest)
        return samples

    def _shorten(self, line: bytes) -> bytes:
        """Keep the last LONGEST_LINE bytes. Without a prefix the start of the rest is then unknown."""
        if len(line) > LONGEST_LINE:
            self._incomplete = not self._has_prefix
        return line[-LONGEST_LINE:]

    def _read(self, line: bytes, samples: list[Sample]) -> None:
        prefix, start = b"", 0
        if self._has_prefix:
            starts = list(self._prefix.finditer(line))
            if not starts:
                return
            prefix, start = starts[-1][0], starts[-1].end()  # an earlier prefix begins a line whose end was lost
        try:
            sample = self._readers[prefix].read(line[start:], self._clock)
        except ValueError as error:
            self.tally.bad_packets += 1
            self.tally.last_fault = str(error)
            return
        self.tally.packets += 1
        if len(self._readers) == 1:
            samples.append(sample)
            return
        if prefix == self._first or prefix in self._group:
            self._emit(samples)
        self._group[prefix] = sample
        if len(self._group) == len(self._readers):
            self._emit(samples)

    def _emit(self, samples: list[Sample]) -> None:
        if self._group:
            samples.append(_merged(self._group.values()))
            self._group = {}


class _LineReader:
    """Reads one kind of line. It picks the columns by quantity: three each of acc, gyr, mag and angle, then t."""

    def __init__(self, line: Line, layout: LineLayout) -> None:
        names = [name.removeprefix("-") for name in line.columns]
        self._columns = len(names)
        self._separator = None if layout.separator == " " else layout.separator.encode()
        self._compass = "heading" in names
        used: list[int] = []
        self._vectors = []
        for index, quantity in enumerate(("acc", "gyr", "mag", "angle")):
            columns = [names.index(name) for name in QUANTITIES[quantity] if name in names]
            if columns:
                signs = (-1.0 if line.columns[i].startswith("-") else 1.0 for i in columns)
                fx, fy, fz = (sign * layout.factor(quantity) for sign in signs)
                self._vectors.append((index, len(used), fx, fy, fz, LARGEST_READING[quantity]))
                used += columns
        self._wrap_s = layout.wrap_s
        self._t_factor = layout.factor("t") if "t" in names else None
        if self._t_factor is not None:
            used.append(names.index("t"))
        self._pick = itemgetter(*used)

    def read(self, text: bytes, clock: WrappingClock) -> Sample:
        """Read a line without its prefix; ValueError if it does not match the layout."""
        cells = text.split(self._separator)
        if len(cells) == self._columns + 1 and not cells[-1].strip():
            cells.pop()  # many sketches print a separator after each number
        if len(cells) != self._columns:
            raise ValueError(f"it has {len(cells)} column{'s' * (len(cells) != 1)}, not {self._columns}; {CORRECT}")
        picked = self._pick(cells)
        try:
            values = tuple(map(float, picked))
        except ValueError:
            raise ValueError(f"a column that --columns names is no number; {CORRECT}") from None
        if b"_" in text and b"_" in b" ".join(picked):  # float() accepts 1_000
            raise ValueError("not a number")
        read: list[Triple | None] = [None, None, None, None]
        for index, start, fx, fy, fz, limit in self._vectors:
            x, y, z = values[start] * fx, values[start + 1] * fy, values[start + 2] * fz
            if not (-limit <= x <= limit and -limit <= y <= limit and -limit <= z <= limit):  # NaN fails too
                name = tuple(QUANTITIES)[index]
                raise ValueError(f"its {name} is too large (raw counts?); give --unit {name}=..., or correct --columns")
            read[index] = (x, y, z)
        acc, gyr, mag, rpy = read
        if rpy is not None and self._compass:
            rpy = from_north_east_down(rpy)
        t = None
        if self._t_factor is not None:
            t = values[-1] * self._t_factor
            if not isfinite(t) or t < 0.0 or (self._wrap_s and t >= self._wrap_s):
                raise ValueError("its t is no time of this clock; correct --columns, --wrap or --unit t=...")
            t = clock.unwrap(t)
        return Sample(acc, gyr, mag, rpy, t)


def _merged(parts: Iterable[Sample]) -> Sample:
    """Merge the samples of a group's lines. Of each quantity, and of the time, the first value counts."""
    return Sample(*(next((value for value in given if value is not None), None) for given in zip(*parts, strict=True)))
