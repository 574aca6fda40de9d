import itertools

import numpy as np
import pytest
from hypothesis import strategies as st

from pbd.data import GRAVITY
from pbd.sensors.decoding import Sample
from pbd.sensors.lines import LineDecoder
from pbd.sensors.razor import razor_layout
from tests.not_none import not_none
from tests.sensors.decoded import decode
from tests.sensors.encoders.razor import frame

three = st.tuples(*[st.floats(-8.0, 8.0)] * 3)


def make() -> LineDecoder:
    return LineDecoder(razor_layout())


def test_a_frame_quoted_from_a_level_board() -> None:
    """As a program on the web prints it; on its table the z axis feels 1 g upwards."""
    stream = b"#A-C=-12.29,13.31,245.76\r\n#M-C=-86.33,-64.50,63.50\r\n#G-C=-42.00,60.00,-3.00\r\n"
    (sample,) = decode(make, stream)
    np.testing.assert_allclose(not_none(sample.acc), np.multiply((12.29, 13.31, 245.76), GRAVITY / 256.0))
    np.testing.assert_allclose(not_none(sample.mag), (-86.33, 64.5, -63.5))
    np.testing.assert_allclose(not_none(sample.gyr), np.radians(np.multiply((-42.0, -60.0, 3.0), 0.06957)))


def test_boards_that_give_rad_per_s() -> None:
    decoder = LineDecoder(razor_layout({"gyr": "rad/s"}))
    (sample,) = decoder.feed(b"#A-C=0,0,256\r\n#M-C=1,2,3\r\n#G-C=0.5,-0.25,1\r\n")
    assert sample.gyr == (0.5, 0.25, -1.0)
    np.testing.assert_allclose(not_none(sample.acc), (0.0, 0.0, GRAVITY), atol=1e-15)


def parts(sample: Sample) -> tuple[bool, bool, bool]:
    return sample.acc is not None, sample.mag is not None, sample.gyr is not None


@pytest.mark.parametrize("lost", range(3))
def test_a_lost_line_costs_its_part_of_one_sample(lost: int) -> None:
    frames = [frame((0.0, 0.0, 1.0), (k, 0.0, 0.0), (k, 0.0, 0.0)) for k in range(5)]
    whole = decode(make, b"".join(frames))
    lines = frames[2].splitlines(keepends=True)
    del lines[lost]
    samples = decode(make, b"".join([*frames[:2], *lines, *frames[3:]]))
    assert samples[:2] + samples[3:] == whole[:2] + whole[3:]
    assert parts(samples[2]) == tuple(k != lost for k in range(3))


@pytest.mark.parametrize("order", list(itertools.permutations(range(3)))[:2])
def test_either_order_after_the_acceleration(order: tuple[int, ...]) -> None:
    frames = [frame((0.0, 0.0, 1.0), (k, 0.0, 0.0), (k, 0.0, 0.0)) for k in range(5)]
    lines = [frame.splitlines(keepends=True) for frame in frames]
    samples = decode(make, b"".join(b"".join(three[i] for i in order) for three in lines))
    assert samples == decode(make, b"".join(frames))


def test_other_lines_are_passed_over() -> None:
    decoder = make()
    stream = b"#YPR=1.0,2.0,3.0\r\n!ERR: reading gyroscope\r\n#A-R=1,2,3\r\n" + frame((0, 0, 1), (1, 2, 3), (4, 5, 6))
    assert len(decoder.feed(stream)) == 1
    assert (decoder.tally.packets, decoder.tally.bad_packets) == (3, 0)
