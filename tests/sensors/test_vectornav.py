"""VectorNav: the manual's vectors, what is encoded is decoded, and nothing comes of a wrong checksum."""

import struct
from math import pi, radians

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pbd.pose import quat_from_rpy, quat_to_matrix
from pbd.sensors.decoding import Sample, Tally
from pbd.sensors.vectornav import FIELD_BYTES, VectorNavDecoder
from tests.not_none import not_none
from tests.sensors.encoders import vectornav as vn

REGISTERS = (
    b"$VNRRG,20,+1.0684,-0.2578,+3.0649,-00.005,+00.341,-09.780,-0.000963,+0.000840,-0.000466*64\r\n"
    b"$VNRRG,18,+00.013,+00.354,-09.801*65\r\n"
    b"$VNRRG,19,+0.002112,-0.000362,-0.000876*6C\r\n"
)
BINARY = bytes.fromhex("FA 01 08 00 93 50 2E 42 83 3E F1 3F 48 B5 04 BB 92 88")
PACKETS = vn.packets(60)
DOWN_FROM_UP = np.diag((1.0, -1.0, -1.0))  # forward-right-down from forward-left-up, and north-east-down from -west-up
ENU_FROM_NED = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])

triples = st.tuples(*3 * [st.floats(-30.0, 30.0, width=32)])
attitudes = st.tuples(st.floats(-180.0, 180.0), st.floats(-89.0, 89.0), st.floats(-180.0, 180.0))


def one(data: bytes) -> Sample:
    decoder = VectorNavDecoder()
    samples = decoder.feed(data)
    assert len(samples) == 1
    assert decoder.tally == Tally(packets=1)
    return samples[0]


def test_registers_of_the_manual() -> None:
    decoder = VectorNavDecoder()
    all_three, acc, gyr = decoder.feed(REGISTERS)
    assert decoder.tally == Tally(packets=3)
    assert all_three.mag == pytest.approx((106.84, 25.78, -306.49))
    assert all_three.acc == pytest.approx((-0.005, -0.341, 9.780))
    assert all_three.gyr == pytest.approx((-0.000963, -0.000840, 0.000466))
    assert acc == Sample(acc=(0.013, -0.354, 9.801))
    assert gyr == Sample(gyr=(0.002112, 0.000362, 0.000876))


XYZ = (0.1, 0.2, 9.8)


@pytest.mark.parametrize("stream", [vn.mar(XYZ, XYZ, XYZ), vn.binary({0: {8: vn.floats(*XYZ)}})])
def test_answers_within_a_stream_are_no_samples(stream: bytes) -> None:
    """They came at another time than the samples beside them: the keyframes were off by 5 sigma."""
    decoder = VectorNavDecoder()
    assert len(decoder.feed(BINARY + REGISTERS)) == 4  # an attitude alone is no stream
    assert decoder.feed(stream + REGISTERS + stream) == 2 * VectorNavDecoder().feed(stream)


def test_binary_packet_of_the_manual() -> None:
    rpy = one(BINARY).rpy
    yaw, pitch, roll = 43.578686, 1.8847202, -0.0020249654
    assert rpy == pytest.approx((radians(roll), -radians(pitch), pi / 2.0 - radians(yaw)))


def test_published_header_has_the_published_length() -> None:
    """fa 14 3e 00 3a 00 begins a packet of 123 bytes after the sync byte (jerabaul29/LoggerWavesInIce)."""
    fields = {
        2: {bit: bytes(FIELD_BYTES[2][bit]) for bit in range(1, 6)},
        4: {b: bytes(FIELD_BYTES[4][b]) for b in (1, 3, 4, 5)},
    }
    packet = vn.binary(fields)
    assert packet[:6] == bytes.fromhex("fa143e003a00")
    assert len(packet) - 1 == 123
    assert one(packet).rpy is not None


def expected_matrix(ypr: tuple[float, float, float]) -> np.ndarray:
    """The sensor's axes in east-north-up, from yaw, pitch and roll in north-east-down, by matrices alone."""
    yaw, pitch, roll = map(radians, ypr)
    ned_from_body: np.ndarray = quat_to_matrix(quat_from_rpy((roll, pitch, yaw)))  # the same sequence in any frame
    return np.asarray(ENU_FROM_NED @ ned_from_body @ DOWN_FROM_UP)


def assert_same_attitude(rpy: tuple[float, float, float] | None, ypr: tuple[float, float, float], tol: float) -> None:
    assert quat_to_matrix(quat_from_rpy(not_none(rpy))) == pytest.approx(expected_matrix(ypr), abs=tol)


@given(attitudes, triples, triples, triples)
def test_ascii(
    ypr: tuple[float, float, float],
    mag: tuple[float, float, float],
    acc: tuple[float, float, float],
    gyr: tuple[float, float, float],
) -> None:
    for data in (vn.ymr(ypr, mag, acc, gyr), vn.mar(mag, acc, gyr), vn.imu(mag, acc, gyr, 25.0, 101.3)):
        sample = one(data)
        assert sample.mag == pytest.approx(100.0 * DOWN_FROM_UP @ mag, abs=0.0051)
        assert sample.acc == pytest.approx(DOWN_FROM_UP @ acc, abs=0.00051)
        assert sample.gyr == pytest.approx(DOWN_FROM_UP @ gyr, abs=0.00000051)
        assert sample.t_device is None
        if data.startswith(b"$VNYMR"):
            assert_same_attitude(sample.rpy, ypr, 1e-4)
        else:
            assert sample.rpy is None


# Where time, attitude (angles or quaternion), field, acceleration and rate can stand: group and bit.
PLACES = st.fixed_dictionaries(
    {
        "time": st.sampled_from([(0, 0), (1, 0)]),
        "ypr": st.sampled_from([(0, 3), (4, 1)]),
        "mag": st.sampled_from([(0, 10), (2, 8), (2, 1)]),
        "acc": st.sampled_from([(0, 8), (2, 9), (2, 2)]),
        "gyr": st.sampled_from([(0, 5), (2, 10), (2, 3)]),
    }
)
TAKEN = {(0, 0), (1, 0), (0, 3), (4, 1), (0, 4), (4, 2), (0, 10), (2, 8), (2, 1), (0, 8), (2, 9), (2, 2)}
TAKEN |= {(0, 9), (0, 5), (2, 10), (2, 3)}
OTHERS = [(g, b) for g in range(7) for b in range(len(FIELD_BYTES[g])) if (g, b) not in TAKEN]


@given(PLACES, st.sets(st.sampled_from(OTHERS)), attitudes, triples, triples, triples, st.integers(0, 2**50))
def test_binary(
    places: dict[str, tuple[int, int]],
    others: set[tuple[int, int]],
    ypr: tuple[float, float, float],
    mag: tuple[float, float, float],
    acc: tuple[float, float, float],
    gyr: tuple[float, float, float],
    ns: int,
) -> None:
    """What is wanted in any of its places, and any other fields of known size around it."""
    fields: dict[int, dict[int, bytes]] = {}
    values = {"time": struct.pack("<Q", ns), "ypr": vn.floats(*ypr), "acc": vn.floats(*acc), "gyr": vn.floats(*gyr)}
    values["mag"] = vn.floats(*mag) + (vn.floats(25.0, 101.3) if places["mag"] == (0, 10) else b"")
    for what, (group, bit) in places.items():
        fields.setdefault(group, {})[bit] = values[what]
    for group, bit in others:
        fields.setdefault(group, {})[bit] = b"\xfa" * FIELD_BYTES[group][bit]  # full of false beginnings
    sample = one(vn.binary(fields))
    assert sample.mag == pytest.approx(100.0 * DOWN_FROM_UP @ mag)
    assert sample.acc == pytest.approx(DOWN_FROM_UP @ acc)
    assert sample.gyr == pytest.approx(DOWN_FROM_UP @ gyr)
    assert sample.t_device == pytest.approx(ns * 1e-9, abs=1e-9)
    assert_same_attitude(sample.rpy, ypr, 1e-5)


@given(attitudes)
def test_quaternion_and_angles_are_one_attitude(ypr: tuple[float, float, float]) -> None:
    w, x, y, z = quat_from_rpy([radians(angle) for angle in reversed(ypr)]).tolist()
    for place in (0, 4), (4, 2):
        sample = one(vn.binary({place[0]: {place[1]: vn.floats(x, y, z, w)}}))
        assert_same_attitude(sample.rpy, ypr, 1e-5)


def test_compensated_ones_come_first() -> None:
    raw, good = vn.floats(*6 * [1.0]), vn.floats(2.0, 2.0, 2.0)
    sample = one(vn.binary({0: {5: good, 8: good, 9: raw}, 2: {1: raw[:12], 8: good}}))
    assert sample == Sample(acc=(2.0, -2.0, -2.0), gyr=(2.0, -2.0, -2.0), mag=(200.0, -200.0, -200.0))
    only_raw = one(vn.binary({0: {9: vn.floats(1.0, 2.0, 3.0, 4.0, 5.0, 6.0)}}))
    assert only_raw == Sample(acc=(1.0, -2.0, -3.0), gyr=(4.0, -5.0, -6.0))


@pytest.mark.parametrize("size", [0, 40])  # of what stands in the unknown field
@pytest.mark.parametrize("header", ["fa8000", "fa010080", "fa080040", "fa020004", "fa00"])
def test_unknown_fields_are_refused_and_counted(header: str, size: int) -> None:
    decoder = VectorNavDecoder()
    inner = bytes.fromhex(header)[1:] + bytes(size)
    decoder.feed(b"\xfa" + inner + struct.pack(">H", vn.crc16(inner)))
    assert decoder.tally.packets == 0
    assert decoder.tally.bad_packets == 1
    assert len(decoder.feed(BINARY)) == 1


def test_sentences_of_others_are_stepped_over() -> None:
    decoder = VectorNavDecoder()
    assert decoder.feed(vn.sentence("VNWRG,07,40") + vn.sentence("VNYPR,+006.271,+000.031,-002.000")) == []
    assert decoder.tally == Tally(packets=2)


def test_status_behind_the_numbers_is_passed_over() -> None:
    assert one(vn.sentence("VNRRG,18,+00.013,+00.354,-09.801,S004711")) == Sample(acc=(0.013, -0.354, 9.801))


@pytest.mark.parametrize(
    "body",
    [
        "VNRRG,18,+00.013,+00.354,-09.801,+00.354",  # one came twice
        "VNRRG,18,+00.013,+00.354",
        "VNYMR,+043.0,+091.0,+000.0" + 9 * ",+0.1",  # no attitude
        "VNYMR,-614.8,+001.0,+000.0" + 9 * ",+0.1",
    ],
)
def test_what_passes_the_checksum_but_can_not_be_is_counted(body: str) -> None:
    decoder = VectorNavDecoder()
    assert decoder.feed(vn.sentence(body)) == []
    assert decoder.tally == Tally(packets=1, bad_packets=1)


def test_checksum_of_sixteen_bits() -> None:
    body = "VNRRG,18,+00.013,+00.354,-09.801"
    assert one(vn.sentence(body, wide=True)) == Sample(acc=(0.013, -0.354, 9.801))
    assert VectorNavDecoder().feed(b"$" + body.encode() + b"*0000\r\n") == []


@pytest.mark.parametrize("field", ["nan", "1_0", "", "inf", "1e999", " 1"])
def test_what_is_no_number_is_counted(field: str) -> None:
    decoder = VectorNavDecoder()
    assert decoder.feed(vn.sentence(f"VNRRG,18,{field},+00.354,-09.801")) == []
    assert decoder.tally == Tally(packets=1, bad_packets=1)


def test_not_a_number_in_a_binary_packet_is_counted() -> None:
    decoder = VectorNavDecoder()
    assert decoder.feed(vn.binary({0: {8: vn.floats(1.0, float("nan"), 1.0)}})) == []
    assert decoder.tally == Tally(packets=1, bad_packets=1)


def test_a_false_start_swallows_nothing() -> None:
    """A header that announces hundreds of bytes, or a sentence without an end, and whole packets after it."""
    for false in (b"\xfa\x7f" + b"\xff\x03" * 7, b"$VNYMR,+1", b"\xfa\x01\x08\x00"):
        decoder = VectorNavDecoder()
        samples = decoder.feed(false + b"".join(PACKETS))
        assert samples == VectorNavDecoder().feed(b"".join(PACKETS))
        assert decoder.tally.bad_packets > 0


def test_what_ends_with_no_line_is_no_packet() -> None:
    decoder = VectorNavDecoder()
    decoder.feed(b"$GPGGA," + bytes(1000))
    assert decoder.tally == Tally(bad_packets=1)


def test_a_packet_without_any_of_what_is_wanted_is_no_sample() -> None:
    decoder = VectorNavDecoder()
    group, bit = OTHERS[0]
    assert decoder.feed(vn.binary({group: {bit: bytes(FIELD_BYTES[group][bit])}})) == []
    assert (decoder.tally.packets, decoder.tally.bad_packets) == (1, 0)
