import math
import random

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pbd.data import GRAVITY
from pbd.pose import quat_from_rpy, quat_rotate
from pbd.sensors.decoding import Sample
from pbd.sensors.line_layout import layout_from_options
from pbd.sensors.lines import LONGEST_LINE, LineDecoder
from tests.not_none import not_none
from tests.sensors.decoded import held_bytes
from tests.sensors.decoder_checks import mutated

NINE = ("ax", "ay", "az", "gx", "gy", "gz", "mx", "my", "mz")
VALUES = dict(zip(NINE, (1.5, -2.0, 3e-3, -4.0, 5.25, 60.0, 7.0, -0.8, 0.09), strict=True))


def reader(columns: str, *units: str, separator: str = ",", prefix: str = "", wrap: float | None = None) -> LineDecoder:
    """A decoder that has seen the end of a line, so that the next one counts."""
    decoder = LineDecoder(
        layout_from_options(columns, dict(unit.split("=") for unit in units), separator, prefix, wrap)
    )
    assert decoder.feed(b"\n") == []
    return decoder


def one(decoder: LineDecoder, line: str) -> Sample:
    (sample,) = decoder.feed(line.encode() + b"\r\n")
    return sample


@given(st.permutations(NINE), st.sampled_from([",", ";", "space", "tab"]))
def test_columns_in_any_order(columns: list[str], separator: str) -> None:
    decoder = reader(",".join(columns), separator=separator)
    sign = {"space": "  ", "tab": "\t"}.get(separator, separator)
    sample = one(decoder, sign.join(str(VALUES[name]) for name in columns))
    assert [*not_none(sample.acc), *not_none(sample.gyr), *not_none(sample.mag)] == list(VALUES.values())


def test_units() -> None:
    sample = one(reader(",".join(NINE), "acc=g", "gyr=deg/s", "mag=gauss"), ",".join(map(str, VALUES.values())))
    np.testing.assert_allclose(not_none(sample.acc), np.multiply((1.5, -2.0, 3e-3), GRAVITY))
    np.testing.assert_allclose(not_none(sample.gyr), np.radians((-4.0, 5.25, 60.0)))
    np.testing.assert_allclose(not_none(sample.mag), (700.0, -80.0, 9.0))


def test_signs_and_columns_to_pass_over() -> None:
    sample = one(reader("_,-ax,az,-ay,_"), "board_1,1,2,3,ok")
    assert sample.acc == (-1.0, -3.0, 2.0)


def test_a_compass_and_a_turn_say_the_same() -> None:
    compass = one(reader("ax,ay,az,heading,pitch,roll", "angle=deg"), "0,0,1,210,20,-30").rpy
    turn = one(reader("ax,ay,az,roll,pitch,yaw", "angle=deg"), "0,0,1,-30,-20,-120").rpy
    np.testing.assert_allclose(not_none(compass), not_none(turn))
    forward = quat_rotate(quat_from_rpy(not_none(compass)), (1.0, 0.0, 0.0))
    level = math.cos(math.radians(20.0))
    heading = math.radians(210.0)
    np.testing.assert_allclose(
        forward, (level * math.sin(heading), level * math.cos(heading), math.sin(math.radians(20.0)))
    )


@pytest.mark.parametrize(
    "line", ["1,2,3,", "1,2,3, ", " 1 , 2,3", "+1,2.0,3e0", "1,2,3\n\n", "junk\n1,2,3", "1,2,3\n1,2"]
)
def test_ways_to_print_a_line(line: str) -> None:
    assert one(reader("ax,ay,az"), line).acc == (1.0, 2.0, 3.0)


@pytest.mark.parametrize(
    "line",
    [
        "1,2",
        "1,2,3,4",
        "1,,3",
        "1,2,x",
        "nan,2,3",
        "1,inf,3",
        "1e400,2,3",
        "1,2,9999",
        "1_0,2,3",
        "1 2 3",
        "",
        "1,2,3,4,",
    ],
)
def test_a_line_that_is_not_as_described_is_thrown_away(line: str) -> None:
    decoder = reader("ax,ay,az")
    assert decoder.feed(line.encode() + b"\n") == []
    assert decoder.tally.bad_packets == bool(line)
    assert one(decoder, "1,2,3").acc == (1.0, 2.0, 3.0)


def test_without_a_prefix_the_first_line_may_be_cut_and_is_left_out() -> None:
    decoder = LineDecoder(layout_from_options("ax,ay,az"))
    assert decoder.feed(b"34.5,2,3\n") == []  # the end of 1234.5, for all we know
    assert one(decoder, "1,2,3").acc == (1.0, 2.0, 3.0)


def test_with_a_prefix_the_first_whole_line_counts_wherever_it_begins() -> None:
    for before in ("", "3,4\n", "IMU 3,4", "IM", "IMU ", "\x00\xff"):
        decoder = LineDecoder(layout_from_options("ax,ay,az", prefix="IMU "))
        (sample,) = decoder.feed(before.encode("latin-1") + b"IMU 1,2,3\n")
        assert sample.acc == (1.0, 2.0, 3.0)


def test_time() -> None:
    decoder = reader("ax,ay,az,t", "t=ms", wrap=1000)
    times = [not_none(one(decoder, f"0,0,1,{tick % 1000}").t_device) for tick in range(900, 4000, 30)]
    np.testing.assert_allclose(times, np.arange(900, 4000, 30) / 1000.0)


def test_one_false_time_does_not_shift_the_rest() -> None:
    decoder = reader("t,ax,ay,az", "t=us")
    times = [not_none(one(decoder, f"{tick},0,0,1").t_device) for tick in (10_000, 20_000, 4_000_000_000, 40_000)]
    assert (times[0], times[1], times[3]) == (0.01, 0.02, 0.04)


@pytest.mark.parametrize("tick", ["-1", "4294967296", "nan", "1e99"])
def test_a_time_that_the_clock_cant_show_is_thrown_away(tick: str) -> None:
    decoder = reader("t,ax,ay,az", "t=us")
    assert decoder.feed(f"{tick},0,0,1\n".encode()) == []
    assert decoder.tally.bad_packets == 1


@pytest.mark.parametrize("prefix", ["", "IMU "])
def test_noise_is_not_kept(prefix: str) -> None:
    decoder = reader("ax,ay,az", prefix=prefix)
    for noise in (b"IMU 1,2," * 200_000, bytes(1_000_000)):
        decoder.feed(noise)
        assert held_bytes(decoder) <= LONGEST_LINE + len(prefix)
    decoder.feed(b"\n")
    assert one(decoder, prefix + "1,2,3").acc == (1.0, 2.0, 3.0)


def test_the_end_of_what_is_too_long_is_no_line() -> None:
    decoder = reader("ax,ay,az")
    assert decoder.feed(b"9" + b" " * LONGEST_LINE + b"1,2,3\n") == []
    assert one(decoder, "1,2,3").acc == (1.0, 2.0, 3.0)


def readings(stream: bytes) -> list[tuple[float, ...]]:
    """All lines of four numbers but for the first line, read the slow way."""
    found = []
    for line in stream.replace(b"\r", b"\n").split(b"\n")[1:-1]:
        cells = line.removesuffix(b",").split(b",")
        try:
            values = tuple(float(cell) for cell in cells)
        except ValueError:
            continue
        t_is_right = len(values) == 4 and 0.0 <= values[0] < 2.0**32
        if t_is_right and b"_" not in line and max(map(abs, values[1:])) <= 2000.0 and math.isfinite(sum(values)):
            found.append(values[1:])
    return found


def some_stream(rng: random.Random) -> bytes:
    lines = [f"{1000 * k},{rng.gauss(0, 5):.3f},{rng.gauss(0, 5):.3f},9.8" for k in range(12)]
    return ("\r\n".join(lines) + "\r\n").encode()


def make() -> LineDecoder:
    return LineDecoder(layout_from_options("t,ax,ay,az", {"t": "us"}))


def test_damaged_streams() -> None:
    rng = random.Random(20131007)
    for _ in range(300):
        stream = mutated(some_stream(rng), rng) + b"\n"
        decoder = make()
        assert [sample.acc for sample in decoder.feed(stream)] == readings(stream)
        assert one(decoder, "13000,1,2,3").acc == (1.0, 2.0, 3.0)
