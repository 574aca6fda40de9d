"""The interface of all decoders: bytes of a wire protocol go in, in pieces of any size, and samples come out."""

import re
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar, NamedTuple, Protocol

Triple = tuple[float, float, float]


class Sample(NamedTuple):
    """One reading in SI units, in right-handed sensor axes; at rest the specific force is +g along the axis that is up.

    It is a tuple because a frozen dataclass takes three times as long to make.

    Attributes:
        acc: specific force, m/s2.
        gyr: angular rate, rad/s.
        mag: magnetic field, uT; in the device's own unit where its protocol names none.
        rpy: the device's own roll, pitch and yaw, rad (as `quat_from_rpy` takes them; yaw from east to north).
        t_device: time on the device's own clock without wrap-around, s; None without a clock.
    """

    acc: Triple | None = None
    gyr: Triple | None = None
    mag: Triple | None = None
    rpy: Triple | None = None
    t_device: float | None = None


@dataclass
class Tally:
    """Counts of good packets, of broken or impossible ones, and of presses of the device's own grip buttons.

    `last_fault` says what was wrong with the last bad packet and what to do, if a person chose how packets are read.
    """

    packets: int = 0
    bad_packets: int = 0
    grip_presses: int = 0
    last_fault: str = ""


class WrappingClock:
    """A clock that restarts from zero at `wrap` (any unit; 0: never). Steps are assumed shorter than half of `wrap`."""

    def __init__(self, wrap: float) -> None:
        self._wrap = wrap
        self._last: float | None = None
        self._turns = 0

    def unwrap(self, t: float) -> float:
        """Return the time without wrap-around."""
        if self._last is not None and self._wrap:
            self._turns -= round((t - self._last) / self._wrap)
        self._last = t
        return t + self._turns * self._wrap


class Decoder(Protocol):
    """Turns bytes into samples. It does no I/O, does not wait, and knows no host time."""

    tally: Tally

    def feed(self, data: bytes) -> list[Sample]:
        """Take the next bytes; return the samples that they complete, however the stream is cut."""


class PacketDecoder(ABC):
    """Finds packets in a stream: it tries each possible start, and goes on one byte later where no packet begins."""

    START: ClassVar[re.Pattern[bytes]]
    """Matches the start of a packet, even one that the end of the data cuts off."""

    def __init__(self) -> None:
        self.tally = Tally()
        self._rest = b""

    def feed(self, data: bytes) -> list[Sample]:
        """See `Decoder`."""
        data, at, samples = self._rest + data, 0, list[Sample]()
        while begin := self.START.search(data, at):
            at = begin.start()
            length = self._read_packet(data, at, samples)
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

    @abstractmethod
    def _read_packet(self, data: bytes, at: int, samples: list[Sample]) -> int:
        """Read the packet that begins at index `at` and append its sample.

        Returns:
            The packet's length; 0 if its end has not come yet; -1 if no packet begins here.
        """


def scaled(vector: tuple[float, ...], factor: float) -> Triple:
    """Multiply three numbers by a factor."""
    x, y, z = vector
    return x * factor, y * factor, z * factor
