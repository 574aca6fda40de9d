"""Find out what a port speaks, by listening: baud rates are tried, and decoders that make something of the bytes."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

from pbd.errors import SensorError
from pbd.sensors.decoding import Decoder
from pbd.sensors.port import Port, open_port
from pbd.sensors.protocols import PROTOCOLS

LISTEN_S = 0.7
"""The slowest devices send several packets within this time."""

ENOUGH = 3
"""So many whole packets are no accident."""

GUESSED = tuple(name for name in PROTOCOLS if name != "lines")
"""What can be told from the bytes alone."""


@dataclass(frozen=True)
class Found:
    """What a port speaks, at which baud rate, and how many packets and bytes came while it was listened to."""

    sensor: str | None
    baud: int
    packets: int
    bytes_seen: int


def listen(port: Port, decoders: dict[str, Decoder], seconds: float = LISTEN_S) -> int:
    """Feed what comes to all decoders; return how many bytes came. Ends once one of them has ENOUGH packets."""
    end, count = time.monotonic() + seconds, 0
    while time.monotonic() < end:
        data = port.read()
        count += len(data)
        for decoder in decoders.values():
            decoder.feed(data)
        if any(is_sure(decoder) for decoder in decoders.values()):
            break
    return count


def is_sure(decoder: Decoder) -> bool:
    """Whether the bytes were this decoder's: enough packets, few of them bad, little beside them."""
    tally = decoder.tally
    return tally.packets >= ENOUGH and tally.packets > 2 * tally.bad_packets


def find_baud(device: str, make: Callable[[], Decoder], bauds: tuple[int, ...]) -> int:
    """Return the first of the baud rates at which whole packets come.

    Raises:
        SensorError: none of them; it says whether bytes came at all.
    """
    count = 0
    for baud in bauds:
        with open_port(device, baud) as port:
            decoder = make()
            count += listen(port, {"": decoder}, 2.0 * LISTEN_S)
            if is_sure(decoder):
                return baud
    tried = ", ".join(map(str, bauds))
    if count == 0:
        raise SensorError(
            f"{device} is silent (tried {tried} baud); check that the sensor is on and sends by itself", path=device
        )
    raise SensorError(
        f"{count} bytes came from {device}, but no whole packet of that sensor (tried {tried} baud); give --baud, or "
        "see what it speaks with `pbd sensors --probe`",
        path=device,
    )


def probe(device: str) -> Found:
    """Listen at each baud rate that any device has; the most packets win.

    Raises:
        SensorError: the port can't be opened.
    """
    best = Found(None, 0, 0, 0)
    for baud in dict.fromkeys(baud for name in GUESSED for baud in PROTOCOLS[name].bauds):
        decoders = {name: PROTOCOLS[name].decoder() for name in GUESSED if baud in PROTOCOLS[name].bauds}
        with open_port(device, baud) as port:
            count = listen(port, decoders)
        name = max(decoders, key=lambda name: decoders[name].tally.packets)
        if is_sure(decoders[name]):
            return Found(name, baud, decoders[name].tally.packets, count)
        if count > best.bytes_seen:
            best = Found(None, baud, 0, count)
    return best
