"""What a VN-100 sends, written from its user manual ("Asynchronous output", "Binary output packets")."""

import random
import struct
from collections.abc import Mapping, Sequence


def crc16(data: bytes, crc: int = 0) -> int:
    """The manual's own loop (CRC16-CCITT, beginning with zero)."""
    for byte in data:
        crc = (crc >> 8 | crc << 8) & 0xFFFF
        crc ^= byte
        crc ^= (crc & 0xFF) >> 4
        crc ^= crc << 12 & 0xFFFF
        crc ^= (crc & 0x00FF) << 5
    return crc


def sentence(body: str | bytes, wide: bool = False) -> bytes:
    """A sentence with its checksum of eight bits, or sixteen where the device is set so."""
    plain, check = body.encode() if isinstance(body, str) else body, 0
    for byte in plain:
        check ^= byte
    return b"$" + plain + b"*" + (b"%04X" % crc16(plain) if wide else b"%02X" % check) + b"\r\n"


def ymr(ypr: Sequence[float], mag: Sequence[float], acc: Sequence[float], gyr: Sequence[float]) -> bytes:
    """Yaw, pitch, roll in deg, gauss, m/s2, rad/s in the manual's formats."""
    return sentence(",".join(["VNYMR", *(f"{x:+08.3f}" for x in ypr), *_mar(mag, acc, gyr)]))


def mar(mag: Sequence[float], acc: Sequence[float], gyr: Sequence[float], header: str = "VNMAR") -> bytes:
    """Gauss, m/s2, rad/s."""
    return sentence(",".join([header, *_mar(mag, acc, gyr)]))


def imu(mag: Sequence[float], acc: Sequence[float], gyr: Sequence[float], temp: float, pressure: float) -> bytes:
    """The uncompensated ones, deg C and kPa."""
    return sentence(",".join(["VNIMU", *_mar(mag, acc, gyr), f"{temp:+05.1f}", f"{pressure:+08.3f}"]))


def _mar(mag: Sequence[float], acc: Sequence[float], gyr: Sequence[float]) -> list[str]:
    return [f"{x:+08.4f}" for x in mag] + [f"{x:+07.3f}" for x in acc] + [f"{x:+010.6f}" for x in gyr]


def binary(fields: Mapping[int, Mapping[int, bytes]]) -> bytes:
    """A packet of the bytes of each field, by group (0 to 6) and bit."""
    groups = sum(1 << group for group in fields)
    masks = b"".join(struct.pack("<H", sum(1 << bit for bit in fields[group])) for group in sorted(fields))
    data = b"".join(fields[group][bit] for group in sorted(fields) for bit in sorted(fields[group]))
    inner = bytes([groups]) + masks + data
    return b"\xfa" + inner + struct.pack(">H", crc16(inner))


def floats(*numbers: float) -> bytes:
    """Little-endian float32."""
    return struct.pack(f"<{len(numbers)}f", *numbers)


def packets(count: int, seed: int = 0, hz: float = 800.0, text: bool | None = None) -> list[bytes]:
    """So many packets: time, attitude, acceleration, rate and field, binary, in ASCII, or (None) some of each."""
    rng, out = random.Random(seed), []
    for k in range(count):
        ypr = rng.uniform(-180.0, 180.0), rng.uniform(-90.0, 90.0), rng.uniform(-180.0, 180.0)
        mag, acc, gyr = ([rng.gauss(0.0, s) for _ in range(3)] for s in (0.3, 6.0, 1.0))
        if text or (text is None and k % 3 == 0):
            out.append(ymr(ypr, mag, acc, gyr))
        else:
            time = struct.pack("<Q", 1_000_000_000 + round(k * 1e9 / hz))
            common = {0: time, 3: floats(*ypr), 5: floats(*gyr), 8: floats(*acc), 10: floats(*mag, 25.0, 101.3)}
            out.append(binary({0: common}))
    return out


def checked(data: bytes) -> list[bytes]:
    """All pieces of a stream with a right checksum at their end, however long: what a sample may have come from."""
    found = []
    for begin, first in enumerate(data):
        if first == 0xFA:
            crc = 0
            for end in range(begin + 1, min(begin + 700, len(data))):
                crc = crc16(data[end : end + 1], crc)
                if crc == 0 and end > begin + 4:
                    found.append(data[begin : end + 1])
        elif first == ord("$"):
            line = data[begin : begin + 256].partition(b"\n")[0] + b"\n"
            body = line[1:].partition(b"*")[0]
            plain = line.replace(b"\r", b"").upper()
            found += [line for wide in (False, True) if plain == sentence(body, wide).replace(b"\r", b"").upper()]
    return found
