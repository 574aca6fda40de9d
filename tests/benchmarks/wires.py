"""A clean stream of every protocol, from the encoders of tests/sensors, and what has a right checksum in any stream."""

import json
import random
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from pbd.pose import quat_from_rpy
from pbd.sensors.decoding import Decoder
from pbd.sensors.line_layout import layout_from_options
from pbd.sensors.lines import LineDecoder
from pbd.sensors.phyphox.answers import BUFFERS
from pbd.sensors.protocols import PROTOCOLS
from tests.sensors.decoder_checks import Checked, Make
from tests.sensors.encoders import gamepad, os5000, razor, vectornav, witmotion, ximu3, xsens

COLUMNS = "t,ax,ay,az,gx,gy,gz,mx,my,mz"


@dataclass(frozen=True)
class Wire:
    """One way in which a device speaks.

    Attributes:
        make: a decoder at its start.
        packets: so many groups of packets, each of which makes a sample.
        fastest_hz: that a device sends of these.
        checked: pieces of a stream that a decoder may believe by their checksum; None where the protocol has none.
    """

    make: Make
    packets: Callable[[int], Sequence[bytes]]
    fastest_hz: int
    checked: Checked | None = None


def _triple(rng: random.Random, scale: float) -> list[float]:
    return [rng.gauss(0.0, scale) for _ in range(3)]


def _os5000_packets(count: int) -> list[bytes]:
    rng, out = random.Random(0), []
    for k in range(count):
        angles = os5000.compass_from_rpy(quat_from_rpy(_triple(rng, 1.0)))
        acc, mag = _triple(rng, 1.0), _triple(rng, 500.0)
        out.append(os5000.by_commas(angles, acc, mag) if k % 4 == 3 else os5000.tagged(angles, acc, mag, "T28.4"))
    return out


def _os5000_checked(data: bytes) -> list[bytes]:
    """Every piece from a $ to a * with the XOR that is written behind it."""
    found = []
    for begin in (k for k, byte in enumerate(data) if byte == ord("$")):
        body, star, check = data[begin + 1 : begin + 300].partition(b"*")
        if star and body.isascii() and os5000.sentence(body.decode())[-4:-2] == check[:2].upper():
            found.append(b"$" + body + b"*" + check[:2] + b"\r\n")
    return found


def _witmotion_packets(count: int) -> list[bytes]:
    rng, out = random.Random(0), []
    for k in range(count):
        kinds = [witmotion.ACC, witmotion.GYR, witmotion.ANGLE, witmotion.MAG, witmotion.QUATERNION][
            : 4 + (k // 100) % 2
        ]
        out.append(witmotion.group({kind: [rng.randrange(-20_000, 20_000) for _ in range(3)] for kind in kinds}))
    return out


def _witmotion_checked(data: bytes) -> list[bytes]:
    """Every eleven bytes with the right sum, twice: a group is only complete when the next one begins."""
    pieces = [data[k : k + 11] for k, byte in enumerate(data) if byte == 0x55]
    return [2 * piece for piece in pieces if len(piece) == 11 and sum(piece[:10]) % 256 == piece[10]]


def _line_packets(count: int) -> list[bytes]:
    rng = random.Random(0)
    lines = [[k / 1000.0, *_triple(rng, 6.0), *_triple(rng, 1.0), *_triple(rng, 30.0)] for k in range(count)]
    return [",".join(f"{x:.4f}" for x in line).encode() + b"\r\n" for line in lines]


def _razor_packets(count: int) -> list[bytes]:
    rng = random.Random(0)
    return [razor.frame(_triple(rng, 0.6), _triple(rng, 90.0), _triple(rng, 200.0)) for _ in range(count)]


def _phyphox_rows(count: int, rows: int) -> list[bytes]:
    """Answers to `/get` with so many new samples of each sensor at 400 Hz."""
    rng, out = random.Random(0), []
    for first in range(0, count, rows):
        buffers = {}
        for names, scale in zip(BUFFERS.values(), (1.0, 6.0, 30.0), strict=True):
            t = [k / 400.0 for k in range(first, first + rows)]
            columns = [t, *([rng.gauss(0.0, scale) for _ in t] for _ in "xyz")]
            for name, column in zip(names, columns, strict=True):
                numbers = [float(f"{x:.7e}") for x in column]
                buffers[name] = {"size": 60000, "updateMode": "partial", "buffer": numbers}
        out.append(b"/get " + json.dumps({"buffer": buffers, "status": {"measuring": True}}).encode() + b"\n")
    return out


def _gamepad_reports(count: int) -> list[bytes]:
    rng = random.Random(0)
    return [gamepad.report(4000 * k, _triple(rng, 0.6), _triple(rng, 90.0)) for k in range(1, count + 1)]


def _line_decoder() -> Decoder:
    return LineDecoder(layout_from_options(COLUMNS))


def _xsens_fast(count: int) -> list[bytes]:
    """What fits at 2 kHz: time, acceleration and rate."""
    rng = random.Random(0)
    both = [(xsens.item(xsens.ACC, _triple(rng, 6.0)), xsens.item(xsens.GYR, _triple(rng, 1.0))) for _ in range(count)]
    return [xsens.message(xsens.clock(k, 5 * k), *items) for k, items in enumerate(both)]


def _ximu3_of(encode: Callable[[str, int, Sequence[float]], bytes]) -> Callable[[int], Sequence[bytes]]:
    def packets(count: int) -> list[bytes]:
        rng = random.Random(0)
        return [encode("I", 2500 * k, _triple(rng, 90.0) + _triple(rng, 0.6)) for k in range(count)]

    return packets


# For the fuzzer: all that a device sends, mixed.
MIXED = {
    "os5000": Wire(PROTOCOLS["os5000"].decoder, _os5000_packets, 40, _os5000_checked),
    "witmotion": Wire(PROTOCOLS["witmotion"].decoder, _witmotion_packets, 200, _witmotion_checked),
    "ximu3": Wire(PROTOCOLS["ximu3"].decoder, ximu3.packets, 400),
    "vectornav": Wire(PROTOCOLS["vectornav"].decoder, vectornav.packets, 800, vectornav.checked),
    "xsens": Wire(PROTOCOLS["xsens"].decoder, xsens.packets, 400, xsens.checked),
    "lines": Wire(_line_decoder, _line_packets, 1000),
    "razor": Wire(PROTOCOLS["razor"].decoder, _razor_packets, 50),
    "phyphox": Wire(PROTOCOLS["phyphox"].decoder, lambda count: _phyphox_rows(count, 4), 400),
    "gamepad": Wire(PROTOCOLS["gamepad"].decoder, _gamepad_reports, 250),
}

# For the speed: what comes at each device's fastest rate.
FASTEST = {
    "os5000": MIXED["os5000"],
    "witmotion": MIXED["witmotion"],
    "ximu3": Wire(PROTOCOLS["ximu3"].decoder, _ximu3_of(ximu3.binary), 400),
    "ximu3-ascii": Wire(PROTOCOLS["ximu3"].decoder, _ximu3_of(ximu3.text), 400),
    "vectornav": Wire(PROTOCOLS["vectornav"].decoder, lambda count: vectornav.packets(count, text=False), 800),
    "vectornav-ascii": Wire(PROTOCOLS["vectornav"].decoder, lambda count: vectornav.packets(count, text=True), 200),
    "xsens": Wire(PROTOCOLS["xsens"].decoder, _xsens_fast, 2000),
    "xsens-attitude": MIXED["xsens"],
    "lines": MIXED["lines"],
    "gamepad": MIXED["gamepad"],
    "razor": MIXED["razor"],
    # A tenth of a second at once, as it is asked ten times a second.
    "phyphox": Wire(PROTOCOLS["phyphox"].decoder, lambda count: _phyphox_rows(count, 40), 400),
}
