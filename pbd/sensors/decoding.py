"""What every decoder of a wire protocol is: bytes go in, in any pieces, and samples come out."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import ClassVar, NamedTuple, Protocol

Triple = tuple[float, float, float]


class Sample(NamedTuple):
    """One reading, in the project's units and the sensor's own axes made right-handed with +g up at rest.

    A tuple, because making one takes a third of what a frozen dataclass does.

    Attributes:
        acc: m/s2, specific force.
        gyr: rad/s.
        mag: uT, or whatever the device calls its field where it gives no unit.
        rpy: rad, the device's own roll, pitch and yaw (`quat_from_rpy`, yaw from east to north).
        t_device: s on the device's own clock, wrap-around taken out; None where it has none.
    """

    acc: Triple | None = None
    gyr: Triple | None = None
    mag: Triple | None = None
    rpy: Triple | None = None
    t_device: float | None = None


@dataclass
class Tally:
    """Number of whole packets, of broken or impossible ones, and of presses of the device's own grip buttons."""

    packets: int = 0
    bad_packets: int = 0
    presses: int = 0


class WrappingClock:
    """A clock that starts anew at `wrap`, in any unit; 0 never. Each step is the one of less than half a turn."""

    def __init__(self, wrap: float) -> None:
        self._wrap = wrap
        self._last: float | None = None
        self._turns = 0

    def straight(self, t: float) -> float:
        """Return the time without its wrap-around."""
        if self._last is not None and self._wrap:
            self._turns -= round((t - self._last) / self._wrap)
        self._last = t
        return t + self._turns * self._wrap


class Decoder(Protocol):
    """The state between two pieces of the stream. Nothing here reads, waits or knows the time."""

    tally: Tally

    def feed(self, data: bytes) -> list[Sample]:
        """Take the next bytes; return the samples that they complete. Any chunking gives the same samples."""


class PacketDecoder:
    """Finds packets in a stream: what looks like a beginning is tried, and where no packet is, the next byte on."""

    BEGIN: ClassVar[re.Pattern[bytes]]
    """How a packet begins, cut off by the end of the data or not."""

    def __init__(self) -> None:
        self.tally = Tally()
        self._rest = b""

    def feed(self, data: bytes) -> list[Sample]:
        """See `Decoder`."""
        data, at, samples = self._rest + data, 0, list[Sample]()
        while begin := self.BEGIN.search(data, at):
            at = begin.start()
            length = self._packet(data, at, samples)
            if length == 0:
                break
            if length > 0:
                self.tally.packets += 1
                at += length
            else:
                self.tally.bad_packets += 1
                at += 1
        else:
            at = len(data)
        self._rest = data[at:]
        return samples

    def _packet(self, data: bytes, at: int, samples: list[Sample]) -> int:
        """Read the packet that begins there and add its sample.

        Returns:
            its length; 0 if its end has not come yet; -1 if none begins there. A whole one may begin within.
        """
        raise NotImplementedError


def scaled(vector: tuple[float, ...], factor: float) -> Triple:
    """Three numbers, each times a factor."""
    x, y, z = vector
    return x * factor, y * factor, z * factor
