"""What an x-IMU3 sends, written from its user manual ("Communication protocol")."""

import random
import struct
from collections.abc import Sequence


def text(letter: str, us: int, numbers: Sequence[float], ending: str = "\r\n") -> bytes:
    """An ASCII message; the device prints four decimals."""
    return ",".join([letter, str(us), *(f"{number:.4f}" for number in numbers)]).encode() + ending.encode()


def binary(letter: str, us: int, numbers: Sequence[float]) -> bytes:
    """A binary message: the letter with its highest bit set, stuffed, and ended by LF."""
    plain = bytes([0x80 + ord(letter)]) + struct.pack(f"<Q{len(numbers)}f", us, *numbers)
    stuffed = b"".join({0x0A: b"\xdb\xdc", 0xDB: b"\xdb\xdd"}.get(byte, bytes([byte])) for byte in plain)
    return stuffed + b"\n"


def packets(count: int, seed: int = 0, hz: float = 400.0) -> list[bytes]:
    """So many inertial messages at this rate, with magnetometer (20 Hz), quaternions and others between them."""
    rng, out = random.Random(seed), []
    for k in range(count):
        encode = binary if k // 50 % 2 else text
        us = 1_000_000 + round(k * 1e6 / hz)
        if k % 20 == 0:
            out.append(encode("M", us - 100, [rng.gauss(0.0, 0.6) for _ in range(3)]))
            out.append(encode("T", us - 50, [25.0]))
        out.append(encode("I", us, [rng.gauss(0.0, 90.0) for _ in range(3)] + [rng.gauss(0.0, 0.6) for _ in range(3)]))
        if k % 4 == 0:
            turn = [rng.gauss(0.0, 1.0) for _ in range(4)]
            length = sum(x * x for x in turn) ** 0.5
            out.append(encode("Q", us, [x / length for x in turn]))
    return out
