"""Xsens MTData2: the captured packet, what is encoded is decoded, and nothing comes of a wrong checksum."""

import struct
from math import pi

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pbd.pose import quat_exp, quat_from_rpy, quat_to_matrix
from pbd.sensors.decoding import Sample, Tally
from pbd.sensors.xsens import XsensDecoder
from tests.not_none import not_none
from tests.sensors.encoders import xsens

CAPTURED = bytes.fromhex(
    "faff3692102002918d10600401363fa62010103f35e0423f31cd15bd9f49dbbda938cf40200cbd635a90411d08d43e5faa5040100cb9116800"
    "3cc901003a0f7d0040300cbc3b29803c35fc003ca46e0080200c3caea241bb56d800bad5ac018030103f80000037df8801b6898000b608c000"
    "c0200cbefbfbf23f33c485bfa0a2c108100442168000301004000186e1e0200400400003dd"
)
PACKETS = xsens.packets(60)
RESOLUTION = {xsens.FLOAT: 2e-6, xsens.FIXED_12_20: 2.0**-20, xsens.FIXED_16_32: 2.0**-32, xsens.DOUBLE: 0.0}
ENU_FROM = {0: np.eye(3)}  # by the frame of the identifier
ENU_FROM[xsens.NED] = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
ENU_FROM[xsens.NWU] = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])

triples = st.tuples(*3 * [st.floats(-30.0, 30.0)])
angles = st.tuples(st.floats(-pi, pi), st.floats(-1.55, 1.55), st.floats(-pi, pi))


def one(data: bytes) -> Sample:
    decoder = XsensDecoder()
    samples = decoder.feed(data)
    assert len(samples) == 1
    assert decoder.tally == Tally(packets=1)
    return samples[0]


def test_captured_packet() -> None:
    sample = one(CAPTURED)
    assert sample.acc == pytest.approx((-0.055506, 9.814655, 0.218423), abs=1e-6)
    assert sample.gyr == pytest.approx((0.021318, -0.003278, -0.001630), abs=1e-6)
    assert sample.mag == pytest.approx((-0.492157, 0.702217, -1.254967), abs=1e-6)
    assert quat_from_rpy(not_none(sample.rpy)) == pytest.approx((0.710453, 0.694536, -0.077778, -0.082628), abs=1e-6)
    assert sample.t_device == 0x01363FA6 / 1e4


def test_captured_packet_agrees_with_itself() -> None:
    """Its attitude turns the specific force up, and its velocity and turn are acceleration and rate times 2.5 ms."""
    sample = one(CAPTURED)
    assert sample.acc is not None
    up = quat_to_matrix(quat_from_rpy(not_none(sample.rpy))) @ sample.acc
    assert up == pytest.approx((0.0, 0.0, 9.81), abs=0.05)
    without = CAPTURED[4:-1].replace(bytes.fromhex("4020"), b"\x41\x21").replace(bytes.fromhex("8020"), b"\x81\x21")
    decoder = XsensDecoder()
    decoder.feed(xsens.message(xsens.clock(0x918C, 0x01363FA6 - 25)))
    (delta,) = decoder.feed(xsens.message(without))
    assert delta.acc == pytest.approx(sample.acc, abs=1e-3)  # the device gives 13 bits or so of these
    assert delta.gyr == pytest.approx(sample.gyr, abs=1e-3)


@given(st.sampled_from(sorted(RESOLUTION)), triples, triples, triples, angles, st.sampled_from(sorted(ENU_FROM)))
def test_every_precision_and_frame(
    precision: int,
    acc: tuple[float, float, float],
    gyr: tuple[float, float, float],
    mag: tuple[float, float, float],
    rpy: tuple[float, float, float],
    frame: int,
) -> None:
    attitude = ENU_FROM[frame] @ quat_to_matrix(quat_from_rpy(rpy))
    for kind, numbers in ((xsens.QUATERNION, quat_from_rpy(rpy).tolist()), (xsens.EULER, np.degrees(rpy).tolist())):
        sample = one(
            xsens.message(
                xsens.clock(7, 123_456),
                xsens.item(kind | frame, numbers, precision),
                xsens.item(xsens.ACC, acc, precision),
                xsens.item(xsens.GYR, gyr, precision),
                xsens.item(xsens.MAG, mag, precision),
            )
        )
        for read, sent in ((sample.acc, acc), (sample.gyr, gyr), (sample.mag, mag)):
            assert read == pytest.approx(sent, abs=RESOLUTION[precision], rel=1e-7)
        assert sample.t_device == 12.3456
        turned = quat_to_matrix(quat_from_rpy(not_none(sample.rpy)))
        assert turned == pytest.approx(attitude, abs=3e-4 if precision == xsens.FIXED_12_20 else 3e-6)


def test_fixed_point_as_the_protocol_writes_it() -> None:
    """16.32 has its fraction first; -1.5 is -2 and a half."""
    data = bytes.fromhex("80000000fffe 000000000001 400000000000")
    assert one(xsens.message(xsens.raw_item(0x4022, data))).acc == (-1.5, 1.0, 0.25)
    data = struct.pack(">iii", -0x180000, 0x100000, 0x040000)
    assert one(xsens.message(xsens.raw_item(0x4021, data))).acc == (-1.5, 1.0, 0.25)


@given(st.integers(0, 2**32 - 1), st.lists(st.integers(1, 20_000), min_size=1, max_size=20))
def test_sample_time_wraps_around(start: int, steps: list[int]) -> None:
    decoder, ticks, times = XsensDecoder(), start, []
    for step in [0, *steps]:
        ticks += step
        (sample,) = decoder.feed(xsens.message(xsens.clock(0, ticks), xsens.item(xsens.ACC, (0.0, 0.0, 9.8))))
        times.append(sample.t_device)
    assert times == [t / 1e4 for t in np.cumsum([start, *steps])]


def test_a_device_that_begins_anew_steps_back() -> None:
    decoder = XsensDecoder()
    acc = xsens.item(xsens.ACC, (0.0, 0.0, 9.8))
    samples = decoder.feed(b"".join(xsens.message(xsens.clock(0, t), acc) for t in (900_000, 900_025, 25, 50)))
    assert [sample.t_device for sample in samples] == [90.0, 90.0025, 0.0025, 0.005]


@given(triples, st.tuples(*3 * [st.floats(-20.0, 20.0)]), st.sampled_from([25, 100]), st.lists(st.integers(1, 4)))
def test_velocity_and_turn_serve_for_acceleration_and_rate(
    acc: tuple[float, float, float], gyr: tuple[float, float, float], interval: int, lost: list[int]
) -> None:
    """The counter tells how many packets were lost, and so the interval that the rest were summed over."""
    dt, ticks, counter = interval / 1e4, 40, 65_534
    deltas = (
        xsens.item(xsens.DELTA_V, [a * dt for a in acc], xsens.DOUBLE),
        xsens.item(xsens.DELTA_Q, quat_exp([w * dt for w in gyr]).tolist(), xsens.DOUBLE),
        xsens.item(xsens.QUATERNION, (1.0, 0.0, 0.0, 0.0)),
    )
    decoder = XsensDecoder()
    assert decoder.feed(xsens.message(xsens.clock(counter, ticks), *deltas)) == []
    for packets in [1, *lost]:
        counter, ticks = counter + packets, ticks + packets * interval
        (sample,) = decoder.feed(xsens.message(xsens.clock(counter, ticks), *deltas))
        assert sample.acc == pytest.approx(acc, abs=1e-9)
        assert sample.gyr == pytest.approx(gyr, abs=1e-9)


def test_a_turn_of_either_sign_is_one_turn() -> None:
    turn = quat_exp((0.01, -0.02, 0.03))
    for quaternion in (turn, -turn):
        decoder = XsensDecoder()
        decoder.feed(xsens.message(xsens.clock(0, 0)))
        data = xsens.message(xsens.clock(1, 100), xsens.item(xsens.DELTA_Q, quaternion.tolist(), xsens.DOUBLE))
        assert decoder.feed(data)[0].gyr == pytest.approx((1.0, -2.0, 3.0))


def test_acceleration_comes_before_velocity() -> None:
    items = xsens.item(xsens.DELTA_V, (9.0, 9.0, 9.0)), xsens.item(xsens.ACC, (1.0, 2.0, 3.0))
    samples = XsensDecoder().feed(b"".join(xsens.message(xsens.clock(k, 25 * k), *items) for k in range(3)))
    assert [sample.acc for sample in samples] == 3 * [(1.0, 2.0, 3.0)]


def test_field_and_attitude_are_held_for_a_fifth_of_a_second() -> None:
    acc, mag = xsens.item(xsens.ACC, (0.0, 0.0, 9.8)), xsens.item(xsens.MAG, (1.0, 0.0, 0.0))
    decoder = XsensDecoder()
    decoder.feed(xsens.message(xsens.clock(0, 0), acc))
    assert decoder.feed(xsens.message(xsens.clock(1, 10), mag)) == []  # a message of its own
    times = (10, 500, 2010, 2011)
    samples = decoder.feed(b"".join(xsens.message(xsens.clock(2, t), acc) for t in times))
    assert [sample.mag for sample in samples] == [(1.0, 0.0, 0.0), (1.0, 0.0, 0.0), (1.0, 0.0, 0.0), None]


def test_no_field_from_before_a_restart_is_held() -> None:
    acc, mag = xsens.item(xsens.ACC, (0.0, 0.0, 9.8)), xsens.item(xsens.MAG, (1.0, 0.0, 0.0))
    messages = xsens.message(xsens.clock(7, 90_000), acc, mag) + xsens.message(xsens.clock(0, 10), acc)
    assert [sample.mag for sample in XsensDecoder().feed(messages)] == [(1.0, 0.0, 0.0), None]


def test_attitude_alone_is_a_sample() -> None:
    sample = one(xsens.message(xsens.item(xsens.EULER, (0.0, 0.0, 90.0))))
    assert sample == Sample(rpy=(0.0, 0.0, pi / 2.0))
    decoder = XsensDecoder()
    times = xsens.message(xsens.clock(0, 0), xsens.item(xsens.EULER, (0, 0, 0))) + xsens.message(xsens.clock(1, 1))
    assert len(decoder.feed(times)) == 1  # the second says nothing new


def test_a_message_of_extended_length() -> None:
    filler = [xsens.raw_item(0x0810, bytes(200)) for _ in range(4)]
    assert one(xsens.message(*filler, xsens.item(xsens.ACC, (1.0, 2.0, 3.0)))) == Sample(acc=(1.0, 2.0, 3.0))


@pytest.mark.parametrize(
    "payload",
    [
        xsens.raw_item(xsens.ACC, bytes(8)),  # too few numbers
        xsens.item(xsens.ACC, (1.0, 2.0, 3.0))[:-1],  # the last item is longer than the message
        xsens.item(xsens.ACC, (1.0, 2.0, 3.0)) + b"\x40",  # half an identifier
        xsens.item(xsens.ACC, (1.0, float("nan"), 3.0)),
        xsens.item(xsens.GYR, (1.0, float("-inf"), 3.0), xsens.DOUBLE),
    ],
)
def test_a_whole_message_of_nonsense_is_counted(payload: bytes) -> None:
    decoder = XsensDecoder()
    assert decoder.feed(xsens.message(payload)) == []
    assert decoder.tally == Tally(packets=1, bad_packets=1)


def test_messages_of_others_are_skipped() -> None:
    wake_up = bytes.fromhex("faff3e00c3")
    decoder = XsensDecoder()
    assert len(decoder.feed(wake_up + CAPTURED + wake_up)) == 1
    assert decoder.tally == Tally(packets=1)


def test_a_false_start_swallows_nothing() -> None:
    for false in (b"\xfa\xff\x36\xff\x07\xff", b"\xfa\xff\x36\xfe", b"\xfa\xff\x36\xff\xff\xff", b"\xfa\xff", b"\xfa"):
        assert XsensDecoder().feed(false + b"".join(PACKETS)) == XsensDecoder().feed(b"".join(PACKETS))


def test_quaternions_of_any_length_and_none() -> None:
    rpy = one(xsens.message(xsens.item(xsens.QUATERNION, (2.0, 0.0, 0.0, 2.0)))).rpy
    assert rpy == pytest.approx((0.0, 0.0, pi / 2.0))
    for w in (0.0, 1e-170):  # whose square is 0
        assert XsensDecoder().feed(xsens.message(xsens.item(xsens.QUATERNION, (w, 0.0, 0.0, 0.0), xsens.DOUBLE))) == []
