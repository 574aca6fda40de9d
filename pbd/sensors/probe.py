"""Identify a sensor by listening: try each baud rate, and each decoder on the bytes."""

import re
import shlex
import time
from collections.abc import Callable, Collection
from typing import NamedTuple

from pbd.errors import SensorError, amount
from pbd.sensors.decoding import Decoder
from pbd.sensors.lines import CORRECT
from pbd.sensors.port import Port
from pbd.sensors.protocols import PROTOCOLS

LISTEN_S = 0.7
"""Time to listen at each baud rate, s. The slowest devices send several packets in it."""

BOOT_S = 3.0
"""Time that an Arduino is silent after its port is opened, because it restarts, s."""

ENOUGH_PACKETS = 3
"""Number of good packets that identify a protocol."""

GUESSED_PROTOCOLS = tuple(name for name, known in PROTOCOLS.items() if known.bauds and name != "lines")
"""Protocols that can be identified from a serial port's bytes alone."""

LONGEST_SHOWN = 72
"""Longest line that a message quotes whole, characters: fourteen numbers of five characters."""

NUMBER = re.compile(r"(?<![\w.])[-+]?(?:\d+\.?\d*|\.\d+)(?:e[-+]?\d+)?(?:[/:-][\d.]+)*(?![\w.])", re.IGNORECASE)
"""A number in a line of text, as sketches print it. A date or a time of day counts as one, because it is one column."""

BAUDS = tuple(dict.fromkeys(baud for name in GUESSED_PROTOCOLS for baud in PROTOCOLS[name].bauds))
"""Baud rates that `probe` tries, in this order."""

FIRST_BAUD = BAUDS[0]
LONGEST_PROBE_S = BOOT_S + LISTEN_S * len(BAUDS)
"""Longest time that `probe` takes, s."""


class ProbeResult(NamedTuple):
    """A port's protocol (None: unknown) and baud rate, the number of bytes that came, and one line if they are text."""

    sensor: str | None
    baud: int
    bytes_seen: int
    line: str | None = None


class Listener:
    """A new decoder, and the number of samples that it has made."""

    def __init__(self, make: Callable[[], Decoder]) -> None:
        self._decoder = make()
        self._samples = 0

    def feed(self, data: bytes) -> None:
        """Decode the next bytes."""
        self._samples += len(self._decoder.feed(data))

    @property
    def hears_packets(self) -> bool:
        """Whether good packets come, and few broken ones."""
        tally = self._decoder.tally
        return tally.packets >= ENOUGH_PACKETS and tally.packets > 2 * tally.bad_packets

    @property
    def hears_samples(self) -> bool:
        """Whether the packets are certainly of this protocol: good packets without data may be another device's."""
        return self._samples >= ENOUGH_PACKETS and self.hears_packets


def listen(port: Port, listeners: Collection[Listener], seconds: float, patience: float = 0.0) -> bytes:
    """Pass the port's bytes to all listeners, and return them. It ends early once a listener hears samples.

    It waits for the first byte for `seconds` or `patience`, whichever is longer, and then listens for `seconds`.
    """
    heard, end = b"", time.monotonic() + max(seconds, patience)
    while time.monotonic() < end and not any(each.hears_samples for each in listeners):
        data = port.read()
        if data and not heard:
            end = time.monotonic() + seconds
        heard += data
        for each in listeners:
            each.feed(data)
    return heard


def identify_protocol(data: bytes) -> str | None:
    """Identify the protocol of some bytes; None if no decoder reads them."""
    for name in GUESSED_PROTOCOLS:
        listener = Listener(PROTOCOLS[name].decoder)
        listener.feed(data)
        if listener.hears_samples:
            return name
    return None


def printed_line(data: bytes) -> str | None:
    """Return one complete line if the bytes are plain text with numbers; else None."""
    lines = data.split(b"\n")[1:-1]
    plain = [line.strip() for line in lines if line.strip() and line.strip().isascii()]
    if len(plain) < ENOUGH_PACKETS or len(plain) < 0.9 * len(lines):
        return None
    text = plain[-1].decode("ascii")
    return text if text.replace("\t", " ").isprintable() and any(letter.isdigit() for letter in text) else None


def quote_line(line: str) -> str:
    """Quote a printed line for a message, with how many numbers it has: that many names belong into --columns."""
    shown = line if len(line) <= LONGEST_SHOWN else f"{line[: LONGEST_SHOWN - 3]}..."
    return f"{shown!r} ({amount(len(NUMBER.findall(line)), 'number')})"


def describe_bytes(
    data: bytes, baud: int | None, sensor: str | None = None, why: str = "", device: str = "PORT"
) -> str:
    """Describe for a message bytes that are no packets of `sensor`, and say what to do; `why` is its tally's."""
    known, line = identify_protocol(data), printed_line(data)
    if known is not None and known != sensor:
        return f"they are {known}'s: give --sensor {known}"
    if line is not None:
        if sensor == "lines" or (known is not None and why):
            return f"a line is {quote_line(line)}: {why or CORRECT}"
        return f'they are lines such as {quote_line(line)}: give --sensor lines --columns "..."'
    at = "" if baud is None else f"{baud} baud is wrong, or "
    return f"{at}it is another kind of sensor: {look_at(device)}"


def look_at(device: str) -> str:
    """Advise to find out what a port speaks. Without --port, only the ports that the system lists are tried."""
    return f"look with `pbd sensors --probe --port {shlex.quote(device)}`"


def find_baud(port: Port, make: Callable[[], Decoder], sensor: str) -> int:
    """Return the first of the sensor's baud rates at which good packets come. The port stays open at that rate.

    Raises:
        SensorError: no packets came. It says whether bytes came, and of which sensor if they can be identified.
    """
    heard: dict[int, bytes] = {}
    for baud in PROTOCOLS[sensor].bauds:
        if not port.set_baud(baud):
            continue
        listener = Listener(make)
        heard[baud] = listen(port, [listener], 2.0 * LISTEN_S, 0.0 if heard else BOOT_S)
        if listener.hears_packets:
            return baud
    tried, count = ", ".join(map(str, heard)), sum(map(len, heard.values()))
    if count == 0:
        what = f"{port.device} is silent (tried {tried} baud); check that the sensor is on and sends by itself"
        raise SensorError(what, path=port.device)
    identified = next((data for data in heard.values() if identify_protocol(data) or printed_line(data)), b"")
    decoder = make()
    decoder.feed(identified)
    what = f"{amount(count, 'byte')} came from {port.device}, but no whole packet of {sensor} (tried {tried} baud)"
    what = f"{what}: {describe_bytes(identified, None, sensor, decoder.tally.last_fault, port.device)}"
    raise SensorError(what, path=port.device)


def probe(port: Port) -> ProbeResult:
    """Listen at each known baud rate until a decoder identifies the sensor."""
    best = ProbeResult(None, 0, 0)
    for baud in BAUDS:
        if not port.set_baud(baud):
            continue
        # All decoders at every rate: a USB device may ignore the port's baud rate.
        listeners = {name: Listener(PROTOCOLS[name].decoder) for name in GUESSED_PROTOCOLS}
        heard = listen(port, listeners.values(), LISTEN_S, BOOT_S if baud == FIRST_BAUD else 0.0)
        name = next((name for name, each in listeners.items() if each.hears_samples), None)
        found = ProbeResult(name, baud, len(heard), None if name else printed_line(heard))
        if found.sensor or found.line:
            return found
        best = max(best, found, key=lambda each: each.bytes_seen)
    return best
