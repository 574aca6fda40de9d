"""What every decoder of a wire protocol is: bytes go in, in any pieces, and samples come out."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, Protocol

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
    """What went by: whole packets, those that were thrown away, and bytes that belonged to none."""

    packets: int = 0
    bad_packets: int = 0
    skipped_bytes: int = 0


class Decoder(Protocol):
    """The state between two pieces of the stream. Nothing here reads, waits or knows the time."""

    tally: Tally

    def feed(self, data: bytes) -> list[Sample]:
        """Take the next bytes; return the samples that they complete. Any chunking gives the same samples."""
