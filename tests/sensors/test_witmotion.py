import math
from collections.abc import Mapping, Sequence

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from witmotion import protocol as other

from pbd.data import GRAVITY
from pbd.pose import quat_canonical, quat_from_rpy, quat_inverse, quat_log, quat_multiply
from pbd.sensors.decoding import Sample, Triple
from pbd.sensors.protocols import PROTOCOLS
from pbd.sensors.witmotion import WitMotionDecoder
from tests.not_none import not_none
from tests.sensors.decoded import decode
from tests.sensors.encoders.witmotion import ACC, ANGLE, GYR, MAG, QUATERNION, group, packet, whole_sample

PUBLISHED = bytes.fromhex(
    "55 51 00 fc 00 02 00 f8 e3 09 88  55 52 10 00 f0 ff 48 01 00 00 ef"
    "55 53 00 20 00 f0 00 80 00 00 38  55 54 88 ff fa 00 84 fe c4 09 79"
)
BLUETOOTH = bytes.fromhex("55 61 5a 00 be ff 37 f8 00 00 00 00 00 00 72 82 03 fd 19 b8")
"""A packet that a Bluetooth model sent while it lay upside down."""

G, DEG = GRAVITY, math.pi / 180.0

words = st.tuples(*[st.integers(-32768, 32767)] * 3)
groups = st.fixed_dictionaries({ACC: words, GYR: words, ANGLE: words, MAG: words})


def expected(parts: Mapping[int, Sequence[int]]) -> Sample:
    """What the maker's formulas make of a group."""

    def scaled(kind: int, full: float) -> Triple | None:
        if kind not in parts:
            return None
        x, y, z = (word / 32768 * full for word in parts[kind])
        return x, y, z

    return Sample(scaled(ACC, 16 * G), scaled(GYR, 2000 * DEG), scaled(MAG, 32768.0), scaled(ANGLE, 180 * DEG))


def close(got: list[Sample], wanted: list[Sample]) -> None:
    assert len(got) == len(wanted)
    for one, two in zip(got, wanted, strict=True):
        for a, b in ((one.acc, two.acc), (one.gyr, two.gyr), (one.mag, two.mag), (one.rpy, two.rpy)):
            assert (a is None) == (b is None)
            if a is not None and b is not None:
                np.testing.assert_allclose(a, b, rtol=1e-12)


def test_published_packets() -> None:
    first, second = decode(WitMotionDecoder, PUBLISHED * 2)
    assert first == second
    np.testing.assert_allclose(not_none(first.acc), np.multiply((-0.5, 0.25, -1.0), G))
    np.testing.assert_allclose(not_none(first.gyr), np.multiply((0.9765625, -0.9765625, 20.01953125), DEG))
    np.testing.assert_allclose(not_none(first.rpy), np.multiply((45.0, -22.5, -180.0), DEG))
    assert first.mag == (-120.0, 250.0, -380.0)
    assert first.t_device is None


@given(groups)
def test_the_package_witmotion_reads_the_same(sent: dict[int, Sequence[int]]) -> None:
    """Their g is 9.8, so acceleration is compared in g."""
    stream = group(sent)
    theirs = {}
    for start in range(0, len(stream), 11):
        one = other.receive_messages[stream[start + 1]]
        assert one.compute_checksum(stream[start + 2 : start + 10]) == stream[start + 10]
        theirs[stream[start + 1]] = one.parse(stream[start + 2 : start + 10])
    ours, *_ = decode(WitMotionDecoder, stream * 2)
    angle = theirs[ANGLE]
    np.testing.assert_allclose(np.array(not_none(ours.acc)) / G, np.array(theirs[ACC].a) / other.G, rtol=1e-12)
    np.testing.assert_allclose(not_none(ours.gyr), np.radians(theirs[GYR].w), rtol=1e-12)
    np.testing.assert_allclose(not_none(ours.rpy), np.radians((angle.roll, angle.pitch, angle.yaw)), rtol=1e-12)
    assert ours.mag == theirs[MAG].mag


@given(st.tuples(*[st.floats(-math.pi, math.pi)] * 3))
def test_a_quaternion_is_an_attitude(rpy: Triple) -> None:
    truth = quat_from_rpy(rpy)
    sent = packet(QUATERNION, [min(round(part * 32768), 32767) for part in truth])
    _, sample = decode(WitMotionDecoder, sent * 2)
    ours, theirs = quat_from_rpy(not_none(sample.rpy)), np.array(other.QuaternionMessage.parse(sent[2:10]).q)
    for one, within in ((truth, 4 / 32768), (theirs / np.linalg.norm(theirs), 1e-6)):  # counts; nothing
        missed = quat_log(quat_canonical(quat_multiply(quat_inverse(one), ours)))
        assert np.linalg.norm(missed) < within


def test_zeros_are_no_quaternion() -> None:
    decoder = WitMotionDecoder()
    assert decoder.feed(packet(QUATERNION, (0, 0, 0, 0)) * 3) == []
    assert decoder.tally.bad_packets == 3


def test_a_packet_of_a_bluetooth_model() -> None:
    (sample,) = WitMotionDecoder().feed(BLUETOOTH + BLUETOOTH)
    close([sample], [expected({ACC: (90, -66, -1993), GYR: (0, 0, 0), ANGLE: (-32142, -765, -18407)})])
    acc, rpy = not_none(sample.acc), not_none(sample.rpy)
    assert math.atan2(acc[1], acc[2]) == pytest.approx(rpy[0], abs=2.0 * DEG)  # its own attitude says the same


@given(st.lists(st.tuples(*[st.integers(-32768, 32767)] * 9), min_size=2, max_size=5))
def test_each_packet_of_a_bluetooth_model_is_a_sample(sent: list[tuple[int, ...]]) -> None:
    stream = b"".join(map(whole_sample, sent))
    wanted = [expected({ACC: words[:3], GYR: words[3:6], ANGLE: words[6:]}) for words in sent[:-1]]
    close(decode(WitMotionDecoder, stream), wanted)


@pytest.mark.parametrize("cut", range(2, len(BLUETOOTH)))
def test_half_a_packet_of_a_bluetooth_model_is_no_sample(cut: int) -> None:
    decoder = WitMotionDecoder()
    assert len(decoder.feed(BLUETOOTH * 2 + BLUETOOTH[:cut] + BLUETOOTH * 3)) == 4
    assert decoder.tally.bad_packets == 1


SENT = [{kind: (k, kind, -k) for kind in (ACC, GYR, ANGLE, MAG)} for k in range(1, 9)]


def test_a_complete_group_is_given_at_once() -> None:
    decoder = WitMotionDecoder()
    decoder.feed(group(SENT[0]))
    assert len(decoder.feed(group(SENT[1]))) == 2  # the first had to wait: nobody knew where it would end
    for parts in SENT[2:]:
        close(decoder.feed(group(parts)), [expected(parts)])


@pytest.mark.parametrize("lost", [ACC, GYR, ANGLE, MAG])
@pytest.mark.parametrize("where", range(2, 8))
def test_a_group_that_lacks_a_part_is_given_with_what_it_has(lost: int, where: int) -> None:
    sent = [dict(parts) for parts in SENT]
    del sent[where][lost]
    wanted = [expected(parts) for parts in sent]
    given_late = lost == MAG and where == len(sent) - 1
    close(decode(WitMotionDecoder, b"".join(map(group, sent))), wanted[:-1] if given_late else wanted)


@pytest.mark.parametrize("kinds", [(ACC,), (ACC, GYR), (ACC, GYR, ANGLE), (ACC, GYR, QUATERNION), (ANGLE,)])
def test_any_choice_of_outputs(kinds: tuple[int, ...]) -> None:
    one = b"".join(packet(kind, (32767, 0, 0, 0) if kind == QUATERNION else (1, 2, 3)) for kind in sorted(kinds))
    assert len(decode(WitMotionDecoder, one * 7)) == 7


def test_other_packets_do_not_break_a_group() -> None:
    time, port, pressure = (packet(kind, (1, 2, 3, 4)) for kind in (0x50, 0x55, 0x56))
    stream = b"".join(time + group(parts) + port + pressure for parts in SENT)
    decoder = WitMotionDecoder()
    close(decoder.feed(stream), [expected(parts) for parts in SENT])
    assert decoder.tally.packets == 7 * len(SENT)


def test_a_false_start_does_not_swallow_a_true_packet() -> None:
    """Each word of the lost packet's end looks like the start of another, whose checksum is wrong."""
    stream = packet(ACC, (0x5155, 0x5255, 0x5355, 0x5155))[1:] + group(SENT[0]) + group(SENT[1])
    decoder = WitMotionDecoder()
    close(decoder.feed(stream), [expected(parts) for parts in SENT[:2]])
    assert decoder.tally.bad_packets > 0


@pytest.mark.parametrize("hz", PROTOCOLS["witmotion"].rate_commands)
def test_the_package_witmotion_sets_the_same_rates(hz: int) -> None:
    wanted = (
        (other.Register.unknown_config_cmd, 0xB588),
        (other.Register.rate, other.ReturnRateSelect[f"rate_{hz}hz"].value),
        (other.Register.save, 0),
    )
    commands = [other.ConfigCommand(register=register, data=data).serialize() for register, data in wanted]
    assert list(PROTOCOLS["witmotion"].rate_commands[hz]) == commands
