import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pbd.data import GRAVITY
from pbd.pose import quat_from_rpy, quat_inverse, quat_rotate
from pbd.sensors.decoding import Sample, Tally
from pbd.sensors.os5000 import OS5000Decoder
from tests.not_none import not_none
from tests.sensors.decoded import decode
from tests.sensors.encoders import os5000 as encode

FULL = b"$C212.4P2.5R-14.0T28.4Mx107977.90My-79422.00Mz173.27Ax0.045Ay-0.245Az0.977*3A\r\n"
SHORT = b"$C320.5P0.2R-18.3T19.0*3C\r\n"
FIELD_6 = b"$OHPR,78.8,-0.5,-1.4,-0.009,-0.025,0.976*34\r\n"  # as a user's program quotes it
FIELD_4 = b"$OHPR,237.7,-14.3,175.5,30.1*2B\r\n"  # as another's does

angles = st.tuples(st.floats(0.0, 359.9), st.floats(-90.0, 90.0), st.floats(-180.0, 180.0))
acc_g = st.tuples(*[st.floats(-8.0, 8.0)] * 3)
mag_mgauss = st.tuples(*[st.floats(-9e5, 9e5)] * 3)


def one(stream: bytes) -> Sample:
    (sample,) = decode(OS5000Decoder, stream)
    return sample


def heading_pitch_roll(sample: Sample) -> tuple[float, float, float]:
    return encode.compass_from_rpy(quat_from_rpy(not_none(sample.rpy)))


def test_published_sentences() -> None:
    full, short = one(FULL), one(SHORT)
    np.testing.assert_allclose(heading_pitch_roll(full), (212.4, 2.5, -14.0))
    np.testing.assert_allclose(not_none(full.acc), np.multiply((0.045, -0.245, 0.977), GRAVITY))
    np.testing.assert_allclose(not_none(full.mag), (10797.79, -7942.2, 17.327))
    np.testing.assert_allclose(heading_pitch_roll(short), (320.5, 0.2, -18.3))
    assert (full.gyr, full.t_device) == (None, None)
    assert (short.gyr, short.acc, short.mag) == (None, None, None)


def test_sentences_from_the_field() -> None:
    six, four = one(FIELD_6), one(FIELD_4)
    np.testing.assert_allclose(heading_pitch_roll(six), (78.8, -0.5, -1.4))
    np.testing.assert_allclose(not_none(six.acc), np.multiply((-0.009, -0.025, 0.976), GRAVITY))
    np.testing.assert_allclose(heading_pitch_roll(four), (237.7, -14.3, 175.5))
    assert four.acc is None


@pytest.mark.parametrize("stream", [FULL, FIELD_6])
def test_attitude_and_acceleration_of_one_sentence_agree(stream: bytes) -> None:
    sample = one(stream)
    acc = np.array(not_none(sample.acc))
    up = quat_rotate(quat_inverse(quat_from_rpy(not_none(sample.rpy))), (0.0, 0.0, 1.0))
    cosine = np.dot(up, acc) / np.linalg.norm(acc)
    assert math.degrees(math.acos(cosine)) < 0.15  # angles are in steps of 0.1 degree, the acceleration of 0.06


@given(angles, acc_g, mag_mgauss, st.sampled_from(["", "T28.4", "T-3.0D12.1M512.3", "A1.003"]))
def test_tags_and_commas_say_the_same(
    wanted: tuple[float, float, float],
    acc: tuple[float, float, float],
    mag: tuple[float, float, float],
    extra: str,
) -> None:
    tagged, commas = one(encode.tagged(wanted, acc, mag, extra)), one(encode.by_commas(wanted, acc, mag))
    assert tagged == commas
    np.testing.assert_allclose(np.array(not_none(tagged.acc)) / GRAVITY, acc, atol=0.0005 + 1e-9)
    np.testing.assert_allclose(not_none(tagged.mag), np.multiply(mag, 0.1), atol=0.0005 + 1e-6)


@pytest.mark.parametrize("given_parts", range(8))
def test_any_subset_of_fields(given_parts: int) -> None:
    wanted = (10.0, 2.0, 3.0) if given_parts & 1 else None
    acc = (0.1, 0.2, 0.3) if given_parts & 2 else None
    mag = (100.0, 200.0, 300.0) if given_parts & 4 else None
    decoder = OS5000Decoder()
    samples = decoder.feed(encode.tagged(wanted, acc, mag, "T20.0"))
    assert decoder.tally.packets == 1
    parts = [(sample.rpy is not None, sample.acc is not None, sample.mag is not None) for sample in samples]
    assert parts == ([] if not given_parts else [(wanted is not None, acc is not None, mag is not None)])


@pytest.mark.parametrize(
    "body",
    [
        *("C10.0P95.0R0.0", "C10.0P0.0R190.0", "C400.0P0.0R0.0", "C1.0P2.0R3.0Ax99.0Ay0.0Az0.0"),
        *("C1.0P2.0P2.0", "C1..0P2", "C1.0Pnan", "C1e3", "OHPR,1,2,x", "OHPR,1,2,99999"),
    ],
)
def test_absurd_sentences_are_thrown_away_and_counted(body: str) -> None:
    decoder = OS5000Decoder()
    assert decoder.feed(encode.sentence(body)) == []
    assert (decoder.tally.packets, decoder.tally.bad_packets) == (0, 1)


def test_a_vector_too_long_for_g_is_no_acceleration() -> None:
    sample = one(encode.sentence("OHPR,78.8,-0.5,-1.4,200.0,-25.0,-400.0"))  # X71: the field, in milligauss
    assert sample.acc is None
    assert sample.rpy is not None


def test_other_sentences_are_passed_over() -> None:
    decoder = OS5000Decoder()
    assert decoder.feed(encode.sentence("HCHDT,212.4,T") + encode.sentence("CTCS,view")) == []
    assert decoder.tally == Tally(packets=2)
