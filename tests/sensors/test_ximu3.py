"""x-IMU3: the maker's own decoder agrees, what is encoded is decoded, streams are joined, nonsense is thrown away."""

import random
import struct
import threading
from collections.abc import Callable, Sequence
from math import pi, radians
from pathlib import Path

import numpy as np
import pytest
import ximu3
from hypothesis import given
from hypothesis import strategies as st

from pbd.data import GRAVITY
from pbd.pose import quat_about_z, quat_from_rpy, quat_multiply, quat_to_matrix
from pbd.sensors.decoding import Sample, Tally
from pbd.sensors.ximu3 import XImu3Decoder
from tests.not_none import not_none
from tests.sensors.decoder_checks import mutated
from tests.sensors.encoders.ximu3 import binary, packets, text

PUBLISHED = bytes.fromhex("c94a420f0000000000 0000c03f 000010c0 00002041 cdcccc3d cdcc4cbe 48e17a3f 0a")
PACKETS = packets(200)
STILL = [0.0, 0.0, 0.0, 0.0, 0.0, 1.0]

Encode = Callable[[str, int, Sequence[float]], bytes]
encoders: st.SearchStrategy[Encode] = st.sampled_from([text, binary])
gyrs = st.tuples(*3 * [st.floats(-2000.0, 2000.0, width=32)])
accs = st.tuples(*3 * [st.floats(-16.0, 16.0, width=32)])
mags = st.tuples(*3 * [st.floats(-8.0, 8.0, width=32)])
times = st.integers(0, 2**48)
rpys = st.tuples(st.floats(-pi, pi), st.floats(-1.5, 1.5), st.floats(-pi, pi))


def one(data: bytes) -> Sample:
    samples = XImu3Decoder().feed(data)
    assert len(samples) == 1
    return samples[0]


def test_published_message() -> None:
    sample = one(PUBLISHED)
    assert sample.t_device == 1.00001
    assert sample.gyr == pytest.approx([radians(x) for x in (1.5, -2.25, 10.0)])
    assert sample.acc == pytest.approx([x * GRAVITY for x in (0.1, -0.2, 0.98)])
    assert sample.mag is None
    assert sample.rpy is None


def test_examples_of_the_manual() -> None:
    """All its examples for one second; the field comes before the sample that takes it."""
    numbers = {"M": [1.0, 0.0, 0.0], "Q": [1.0, 0.0, 0.0, 0.0], "I": [0.0, 0.0, 0.0, 0.0, 0.0, 1.0]}
    as_hex = "cd40420f00000000000000803f0000000000000000 0a d140420f00000000000000803f000000000000000000000000 0a"
    as_hex += "c940420f000000000000000000000000000000000000000000000000000000803f0a"
    assert b"".join(binary(letter, 1_000_000, n) for letter, n in numbers.items()) == bytes.fromhex(as_hex)
    in_text = b"M,1000000,1.0000,0.0000,0.0000\nQ,1000000,1.0000,0.0000,0.0000,0.0000\n"
    in_text += b"I,1000000,0.0000,0.0000,0.0000,0.0000,0.0000,1.0000\n"
    expected = Sample((0.0, 0.0, GRAVITY), (0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, pi / 2.0), 1.0)
    assert one(bytes.fromhex(as_hex)) == expected
    assert one(in_text) == expected


Heard = list[tuple[str, int, tuple[float, ...]]]


def euler(message: ximu3.EulerAnglesMessage) -> tuple[float, ...]:
    return message.roll, message.pitch, message.yaw


def by_its_maker(data: bytes, folder: Path) -> Heard:
    """What x-io's own library decodes from a file of the bytes."""
    path, heard, done = folder / "stream.ximu3", Heard(), threading.Event()
    path.write_bytes(data + b"N,0,end\r\n")
    connection = ximu3.Connection(ximu3.FileConnectionConfig(str(path)))
    connection.add_inertial_callback(
        lambda m: heard.append(
            (
                "I",
                m.timestamp,
                (m.gyroscope_x, m.gyroscope_y, m.gyroscope_z, m.accelerometer_x, m.accelerometer_y, m.accelerometer_z),
            )
        )
    )
    connection.add_magnetometer_callback(lambda m: heard.append(("M", m.timestamp, (m.x, m.y, m.z))))
    connection.add_quaternion_callback(lambda m: heard.append(("Q", m.timestamp, euler(m.to_euler_angles_message()))))
    connection.add_notification_callback(lambda m: done.set())
    connection.open()
    assert done.wait(10.0)
    connection.close()
    return heard


def joined(heard: Heard) -> list[Sample]:
    """The samples that the library's messages make, by the rule of the decoder's docstring."""
    samples = []
    for k, (letter, us, n) in enumerate(heard):
        if letter != "I":
            continue
        before = [m for m in heard[:k] if 0 <= us - m[1] <= 200_000]
        mag = max((m for m in before if m[0] == "M"), key=lambda m: m[1], default=None)
        turn = max((m for m in before if m[0] == "Q"), key=lambda m: m[1], default=None)
        samples.append(
            Sample(
                acc=(n[3] * GRAVITY, n[4] * GRAVITY, n[5] * GRAVITY),
                gyr=(radians(n[0]), radians(n[1]), radians(n[2])),
                mag=None if mag is None else (mag[2][0], mag[2][1], mag[2][2]),
                rpy=None if turn is None else (radians(turn[2][0]), radians(turn[2][1]), radians(turn[2][2] + 90.0)),
                t_device=us / 1e6,
            )
        )
    return samples


def assert_agrees(samples: list[Sample], other: list[Sample]) -> None:
    assert len(samples) == len(other)
    for ours, theirs in zip(samples, other, strict=True):
        assert ours.t_device == theirs.t_device
        assert ours.acc == pytest.approx(theirs.acc, abs=1e-5)
        assert ours.gyr == pytest.approx(theirs.gyr, abs=1e-5)
        assert (ours.mag is None) == (theirs.mag is None)
        assert (ours.rpy is None) == (theirs.rpy is None)
        if ours.mag is not None:
            assert ours.mag == pytest.approx(theirs.mag, abs=1e-6)
        if ours.rpy is not None:
            matrices = [quat_to_matrix(quat_from_rpy(rpy)) for rpy in (ours.rpy, not_none(theirs.rpy))]
            assert matrices[0] == pytest.approx(matrices[1], abs=1e-3)


def test_the_makers_own_decoder_agrees(tmp_path: Path) -> None:
    data = PUBLISHED + b"".join(PACKETS)
    assert_agrees(XImu3Decoder().feed(data), joined(by_its_maker(data, tmp_path)))


def test_the_makers_own_decoder_agrees_on_numbers_full_of_stuffing(tmp_path: Path) -> None:
    rng = random.Random(7)
    alphabet = [0x0A, 0xDB, 0xDC, 0xDD, 0x40, 0xBF]
    data = b""
    for k in range(300):
        floats = [struct.unpack("<f", bytes(rng.choice(alphabet) for _ in range(3)) + b"\x40")[0] for _ in range(6)]
        data += binary("I", 0x0ADB0ADC00 + 2500 * k, floats)
    samples = XImu3Decoder().feed(data)
    assert len(samples) == 300
    assert_agrees(samples, joined(by_its_maker(data, tmp_path)))


def test_it_believes_no_broken_message_that_its_maker_does_not(tmp_path: Path) -> None:
    """Of a broken stream we may believe less (absurd numbers) and more only what stood behind a lost end."""
    rng = random.Random(9)
    broken = [mutated(packet, rng) if rng.random() < 0.3 else packet for packet in PACKETS]
    data = b"".join(broken)
    theirs = {us / 1e6 for letter, us, _ in by_its_maker(data, tmp_path) if letter == "I"}
    samples = XImu3Decoder().feed(data)
    sent = {sample.t_device for sample in XImu3Decoder().feed(b"".join(PACKETS))}
    ours = {sample.t_device for sample in samples}
    assert ours - theirs <= sent
    assert len(ours & sent) > 0.6 * len(sent)


@given(encoders, times, gyrs, accs, mags, rpys)
def test_round_trip(
    encode: Encode,
    us: int,
    gyr: tuple[float, float, float],
    acc: tuple[float, float, float],
    mag: tuple[float, float, float],
    rpy: tuple[float, float, float],
) -> None:
    q = quat_from_rpy(rpy)
    resolution = 0.0 if encode is binary else 0.00005001
    east = quat_to_matrix(quat_multiply(quat_about_z(pi / 2.0), q))
    for letter, numbers in (("Q", q.tolist()), ("A", np.degrees(rpy).tolist())):
        decoder = XImu3Decoder()
        data = encode("M", us, mag) + encode(letter, us, numbers) + encode("I", us, [*gyr, *acc])
        (sample,) = decoder.feed(data)
        assert decoder.tally == Tally(packets=3)
        assert sample.gyr == pytest.approx(np.radians(gyr), abs=radians(resolution))
        assert sample.acc == pytest.approx(GRAVITY * np.asarray(acc), abs=GRAVITY * resolution)
        assert sample.mag == pytest.approx(mag, abs=resolution)
        assert sample.t_device == us / 1e6
        assert quat_to_matrix(quat_from_rpy(not_none(sample.rpy))) == pytest.approx(east, abs=5e-4)


@pytest.mark.parametrize("encode", [text, binary])
def test_field_and_attitude_are_the_last_before_the_sample(encode: Encode) -> None:
    def field(us: int, value: float) -> bytes:
        return bytes(encode("M", us, [value, 0.0, 0.0]))

    def mags_at(*messages: bytes | int) -> list[float | None]:
        data = b"".join(m if isinstance(m, bytes) else encode("I", m, STILL) for m in messages)
        return [sample.mag[0] if sample.mag else None for sample in XImu3Decoder().feed(data)]

    assert mags_at(500_000, field(510_000, 1.0), 520_000) == [None, 1.0]
    assert mags_at(field(500_000, 1.0), 500_000, 700_000, 700_001) == [1.0, 1.0, None]  # 0.2 s and no longer
    assert mags_at(field(500_000, 1.0), field(503_000, 2.0), 502_500, 505_000) == [1.0, 2.0]  # came before, taken after
    assert mags_at(field(500_000, 1.0), field(550_000, 2.0), 560_000) == [2.0]


def test_messages_that_no_sample_needs_are_not_broken() -> None:
    others = [text(letter, 1, [1.0] * n) for letter, n in zip("RLEHTBWU", (9, 7, 7, 3, 1, 3, 2, 4), strict=True)]
    others += [
        binary(letter, 0x0A0A, [1.0] * n) for letter, n in zip("RLEHTBWU", (9, 7, 7, 3, 1, 3, 2, 4), strict=True)
    ]
    others += [b"N,1,Button pressed.\r\n", b"S,5,abc123???\r\n", b'{"ping":{"name":"x-IMU3"}}\r\n']
    others += [b"\xce" + bytes(8) + b"Button pressed.\n", b"\xd3" + bytes(8) + b"abc\xf1\xf2\n"]
    decoder = XImu3Decoder()
    assert decoder.feed(b"".join(others)) == []
    assert decoder.tally == Tally()


@pytest.mark.parametrize(
    "message",
    [
        b"I,1,nan,0.0,0.0,0.0,0.0,1.0\r\n",
        b"I,1,1_0,0.0,0.0,0.0,0.0,1.0\r\n",
        b"I,1,0.0,0.0,0.0,0.0,1.0\r\n",  # one too few
        b"I,1,0.0,0.0,0.0,0.0,0.0,0.0,1.0\r\n",
        b"I,1,3000.1,0.0,0.0,0.0,0.0,1.0\r\n",
        b"I,-1,0.0,0.0,0.0,0.0,0.0,1.0\r\n",
        b"Q,1,0.5,0.5,0.5,0.0\r\n",  # no rotation
        b"A,1,0.0,91.0,0.0\r\n",
        binary("I", 1, [0.0, 0.0, float("nan"), 0.0, 0.0, 1.0]),
        binary("I", 1, [0.0, 0.0, float("inf"), 0.0, 0.0, 1.0]),
        binary("I", 1, [0.0, 0.0, 0.0, 0.0, 25.0, 1.0]),
        binary("M", 1, [1e30, 0.0, 0.0]),
        binary("I", 1, STILL[:5]),
        b"\xc9\xdb\xdb" + bytes(30) + b"\n",  # stuffing that means nothing
    ],
)
def test_nonsense_is_thrown_away_and_counted(message: bytes) -> None:
    decoder = XImu3Decoder()
    assert decoder.feed(message) == []
    assert decoder.tally == Tally(bad_packets=1)
