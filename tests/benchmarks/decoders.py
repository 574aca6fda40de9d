"""Speed and sturdiness of the decoders: python tests/benchmarks/decoders.py [--json] [--quick] [--only NAME ...].

`speed`: samples a second that a decoder makes of a clean stream that comes in pieces of 64 and of 4096 bytes, and how
many times the device's fastest rate the slower of the two is (aim: 100).
`fuzz`: a million pieces of a stream (10,000 with --quick), seven in ten of them with mishaps (bits flipped, bytes lost,
doubled or swapped, noise), all through one decoder: exceptions that are not the project's and that are, numbers that
are not finite, vectors that came of no packet with a right checksum, pieces that took over a second, and by how much
the process grew between the first tenth and the end. A protocol without a checksum can give wrong numbers: `altered`
counts the vectors that were not sent, for all.
"""

import os
import random
import sys
import time
from collections import deque
from math import isfinite
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[2]))

from pbd.errors import PbdError
from pbd.sensors.protocols import PROTOCOLS
from tests.benchmarks.report import arguments, finish
from tests.benchmarks.wires import FASTEST, MIXED, Wire
from tests.sensors.decoder_checks import mutated, parts_of, unexplained

HANG_S = 1.0
WINDOW = 64  # pieces that a sample may have come from
SEED = 20130404


def main() -> None:
    """Measure, print."""
    parser = arguments(str(__doc__))
    parser.add_argument("--only", nargs="+", default=sorted(MIXED), metavar="NAME", help="these protocols")
    args = parser.parse_args()
    missing = PROTOCOLS.keys() - MIXED.keys()
    if missing:
        sys.exit(f"no stream for {', '.join(sorted(missing))}: add them to tests/benchmarks/wires.py")
    figures: dict[str, Any] = {
        "speed": {
            name: speed(wire, 0.2 if args.quick else 1.0)
            for name, wire in FASTEST.items()
            if name.partition("-")[0] in args.only
        },
        "fuzz": {name: fuzz(name, MIXED[name], 10_000 if args.quick else 1_000_000) for name in args.only},
    }
    finish(figures, args.json)


def speed(wire: Wire, seconds: float) -> dict[str, float]:
    """Samples a second of processor time, the best of many runs, in small and in large pieces."""
    data = b"".join(wire.packets(2000))
    figures = {}
    for size in (64, 4096):
        pieces = [data[at : at + size] for at in range(0, len(data), size)]
        best, until = 0.0, time.monotonic() + seconds
        while time.monotonic() < until:
            decoder = wire.make()
            start = time.process_time()  # others may be using the machine
            samples = sum(len(decoder.feed(piece)) for piece in pieces)
            best = max(best, samples / (time.process_time() - start))
        figures[f"samples_per_s_{size}"] = best
    return figures | {"times_fastest": min(figures.values()) / wire.fastest_hz}


def fuzz(name: str, wire: Wire, pieces: int) -> dict[str, Any]:
    """Feed so many pieces of a stream with mishaps to one decoder and count what should not be."""
    rng = random.Random(SEED)
    packets = wire.packets(2000)
    clean = parts_of(wire.make().feed(b"".join(packets) + b"".join(packets[:2])))
    decoder, recent = wire.make(), deque[bytes](maxlen=WINDOW)
    figures = dict.fromkeys(("exceptions", "project_errors", "not_finite", "wrong_checksum", "hangs"), 0)
    samples = altered = grown_from = at = 0
    slowest = 0.0
    began = time.monotonic()
    for k in range(pieces):
        count = rng.randint(1, 2)
        piece = b"".join(packets[at : at + count])
        at = (at + count) % (len(packets) - 2)
        piece = mutated(piece, rng) if rng.random() < 0.7 else piece
        recent.append(piece)
        start = time.perf_counter()
        try:
            found = decoder.feed(piece)
        except PbdError:
            figures["project_errors"] += 1
            found = []
        except Exception as error:
            if not figures["exceptions"]:
                print(f"{name}: {error!r} from {b''.join(recent).hex()}", file=sys.stderr)
            figures["exceptions"] += 1
            decoder, found = wire.make(), []
        took = time.perf_counter() - start
        slowest = max(slowest, took)
        figures["hangs"] += took > HANG_S
        samples += len(found)
        parts = parts_of(found)
        figures["not_finite"] += sum(not all(map(isfinite, value)) for _, value in parts)
        if not parts <= clean:
            altered += len(parts - clean)
            if wire.checked is not None:
                wrong = unexplained(wire.make, wire.checked, b"".join(recent), found, clean)
                if wrong and not figures["wrong_checksum"]:
                    print(f"{name}: {wrong} from {b''.join(recent).hex()}", file=sys.stderr)
                figures["wrong_checksum"] += len(wrong)
        if k == pieces // 10:
            grown_from = resident_kb()
        if (k + 1) % max(1, pieces // 10) == 0:
            print(f"{name}: {k + 1} pieces, {time.monotonic() - began:.0f} s, {figures}", file=sys.stderr, flush=True)
    sizes = {"grown_kb": resident_kb() - grown_from, "slowest_ms": 1e3 * slowest}
    return {"pieces": pieces, "samples": samples, "altered": altered, **figures, **sizes}


def resident_kb() -> int:
    """Memory of this process, kB."""
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") // 1024


if __name__ == "__main__":
    main()
