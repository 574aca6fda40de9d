"""What is said where a port can't be opened, and what is heard on one that can."""

import errno
import os
import termios
import time
import tty
from collections.abc import Iterator
from pathlib import Path

import pytest
from serial import Serial

from pbd.errors import SensorError
from pbd.sensors import probe
from pbd.sensors.port import Port, open_port
from pbd.sensors.probe import describe_bytes, find_baud, identify_protocol, printed_line
from pbd.sensors.protocols import PROTOCOLS
from pbd.sensors.reader import Reader
from tests.not_none import not_none
from tests.record.emulated_sensors import SPEAKERS, Device, random_hand

HAND = random_hand(200, seed=1)


def bytes_of(name: str) -> bytes:
    return b"".join(SPEAKERS[name].encode(HAND, row) for row in range(20))


@pytest.fixture
def pair(monkeypatch: pytest.MonkeyPatch) -> Iterator[tuple[int, str]]:
    """A pseudo-terminal whose other end is ours; little patience."""
    monkeypatch.setattr(probe, "LISTEN_S", 0.03)
    monkeypatch.setattr(probe, "BOOT_S", 0.05)
    master, slave = os.openpty()
    tty.setraw(slave)
    yield master, os.ttyname(slave)
    os.close(master)
    os.close(slave)


def test_a_port_in_use(pair: tuple[int, str]) -> None:
    with open_port(pair[1], 9600), pytest.raises(SensorError, match="is in use by another program; close that one"):
        open_port(pair[1], 9600)
    open_port(pair[1], 9600).close()


@pytest.mark.parametrize("baud", [-5, 0])
def test_no_such_baud(pair: tuple[int, str], baud: int) -> None:
    with pytest.raises(SensorError, match=f"can't be set to {baud} baud; give another --baud") as told:
        open_port(pair[1], baud).read()
    assert told.value.fields["baud"] == baud


@pytest.mark.parametrize(
    ("group", "mode", "advice"),
    [
        (
            "dialout",
            0o660,
            "it belongs to the group 'dialout'; add yourself with `sudo usermod -aG dialout ann`, then log",
        ),
        (
            "uucp",
            0o660,
            "it belongs to the group 'uucp'; add yourself with `sudo usermod -aG uucp ann`, then log in again",
        ),
        ("root", 0o660, "only its owner may use it; give it to yourself with `sudo chown ann "),
        ("dialout", 0o600, "only its owner may use it; give it to yourself with `sudo chown ann "),
        (None, 0o660, "only its owner may use it; give it to yourself with `sudo chown ann "),
    ],
)
def test_no_permission(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, group: str | None, mode: int, advice: str
) -> None:
    """Who runs the tests may be allowed everything, so the refusal is made up."""
    port = tmp_path / "ttyUSB0"
    port.touch()
    port.chmod(mode)

    def refuse(*given: object, **named: object) -> None:
        raise OSError(errno.EACCES, "Permission denied")

    def group_of(path: Path) -> str:
        if group is None:
            raise KeyError("gid not found: 986")
        return group

    monkeypatch.setattr("serial.Serial", refuse)
    monkeypatch.setattr(Path, "group", group_of)
    monkeypatch.setenv("USER", "ann")
    with pytest.raises(SensorError) as told:
        open_port(str(port), 9600)
    assert told.value.message.startswith(f"no permission for {port}: {advice}")


@pytest.mark.parametrize(
    ("reason", "message"),
    [
        (
            OSError(errno.EIO, "Input/output error"),
            r"can't be opened \(.*error\); unplug the sensor and plug it in again",
        ),
        (termios.error(errno.EPROTO, "Protocol error"), "can't be set to 9600 baud; give another --baud"),
    ],
)
def test_a_driver_that_refuses(
    pair: tuple[int, str], monkeypatch: pytest.MonkeyPatch, reason: Exception, message: str
) -> None:
    def refuse(*given: object, **named: object) -> None:
        raise reason

    monkeypatch.setattr("serial.Serial", refuse)
    with pytest.raises(SensorError, match=message):
        open_port(pair[1], 9600)


@pytest.mark.parametrize("reason", [ValueError("no such rate"), termios.error(errno.EINVAL, "Invalid argument")])
def test_a_rate_that_the_port_refuses_is_passed_over(
    pair: tuple[int, str], monkeypatch: pytest.MonkeyPatch, reason: Exception
) -> None:
    """Nobody named it, so nobody can name another."""
    rate = Serial.baudrate

    def choose(serial: Serial, baud: int) -> None:
        if baud in (probe.FIRST_BAUD, PROTOCOLS["witmotion"].bauds[0]):
            raise reason
        rate.fset(serial, baud)

    with listening(pair, bytes_of("witmotion"), monkeypatch) as port:
        monkeypatch.setattr(Serial, "baudrate", property(rate.fget, choose))
        assert probe.probe(port)[:2] == ("witmotion", probe.BAUDS[1])
        assert find_baud(port, PROTOCOLS["witmotion"].decoder, "witmotion") == PROTOCOLS["witmotion"].bauds[1]


def test_a_port_that_goes_while_it_is_probed() -> None:
    master, slave = os.openpty()
    tty.setraw(slave)
    with open_port(os.ttyname(slave), 9600) as port:
        os.close(slave)
        os.close(master)
        with pytest.raises(SensorError, match="is gone: the sensor was unplugged; plug it in again"):
            port.set_baud(115200)


@pytest.mark.parametrize("name", SPEAKERS)
def test_whose_bytes_these_are(name: str) -> None:
    sensor = SPEAKERS[name].sensor
    data = bytes_of(name)
    if sensor == "lines":
        assert identify_protocol(data) is None
        assert printed_line(data) is not None
    else:
        assert identify_protocol(data) == sensor
        assert describe_bytes(data, 9600, "another") == f"they are {sensor}'s: give --sensor {sensor}"


@pytest.mark.parametrize(
    ("line", "shown"),
    [
        ("6551,0.07,-0.16,1e-3,31.5,0,.5,1", "'6551,0.07,-0.16,1e-3,31.5,0,.5,1' (8 numbers)"),
        ("6551\t-8\t0\t8192", r"'6551\t-8\t0\t8192' (4 numbers)"),
        ("t2 Gyro: 0.1 0.2 Acc: -1", "'t2 Gyro: 0.1 0.2 Acc: -1' (3 numbers)"),
        ("05/17/2024,12:00:07.69,-0.2,1004.96", "'05/17/2024,12:00:07.69,-0.2,1004.96' (4 numbers)"),
        (",".join(["-0.12345"] * 12), f"'{'-0.12345,' * 7}-0.123...' (12 numbers)"),
    ],
    ids=["commas", "tabs", "words", "date", "long"],
)
def test_a_printed_line_is_shown_with_how_many_numbers_it_has(line: str, shown: str) -> None:
    """So a person sees that --columns names too few; a sketch that separates by tabs is text, too."""
    data = f"{line}\r\n".encode() * 9
    assert describe_bytes(data, None) == f'they are lines such as {shown}: give --sensor lines --columns "..."'
    assert describe_bytes(data, None, "lines") == f"a line is {shown}: correct --columns, --separator or --prefix"


def test_lines_of_the_sensor_itself_in_another_unit_are_not_taken_for_an_unknown_sketch() -> None:
    hand = random_hand(20, 1)
    data = b"".join(SPEAKERS["razor"].encode(hand, row) for row in range(20))
    told = describe_bytes(data, None, "razor", "its acc is too large")
    assert told.startswith("a line is '#")
    assert told.endswith(": its acc is too large")


@pytest.mark.parametrize("data", [b"", b"hello\r\n" * 9, bytes(range(256)) * 4, b"1,2,3\n", b"\xff\n" * 50])
def test_what_is_no_line_of_numbers(data: bytes) -> None:
    assert printed_line(data) is None
    assert describe_bytes(data, 9600, device="/dev/my port") == (
        "9600 baud is wrong, or it is another kind of sensor: look with `pbd sensors --probe --port '/dev/my port'`"
    )


@pytest.mark.parametrize("name", SPEAKERS)
def test_probing(pair: tuple[int, str], name: str) -> None:
    packets = [SPEAKERS[name].encode(HAND, row) for row in range(200)]
    with Device(packets, 400.0, again=True) as device, open_port(device.device, 19200) as port:
        device.go()
        found = probe.probe(port)
    if name == "lines":
        assert found.sensor is None
        assert len(not_none(found.line).split(",")) == 7
    else:
        assert found.sensor == SPEAKERS[name].sensor


def listening(pair: tuple[int, str], data: bytes, monkeypatch: pytest.MonkeyPatch) -> Port:
    """A port on which this comes again and again, as often as it is read."""
    port, read = open_port(pair[1], 115200), Port.read

    def told(self: Port) -> bytes:
        os.write(pair[0], data)
        return read(self)

    monkeypatch.setattr(Port, "read", told)
    return port


def test_the_baud_rate_is_found(pair: tuple[int, str], monkeypatch: pytest.MonkeyPatch) -> None:
    with listening(pair, bytes_of("witmotion"), monkeypatch) as port:
        assert find_baud(port, PROTOCOLS["witmotion"].decoder, "witmotion") == 9600


def test_another_sensor_than_was_said(pair: tuple[int, str], monkeypatch: pytest.MonkeyPatch) -> None:
    message = (
        r"\d+ bytes came from .*, but no whole packet of razor \(tried 57600, 115200 baud\): they are xsens's: give"
    )
    with (
        listening(pair, bytes_of("xsens"), monkeypatch) as port,
        pytest.raises(SensorError, match=message),
    ):
        find_baud(port, PROTOCOLS["razor"].decoder, "razor")


def test_silence_says_what_was_tried(pair: tuple[int, str]) -> None:
    message = r"is silent \(tried 57600, 115200 baud\); check that the sensor is on and sends by itself"
    with open_port(pair[1], 57600) as port:
        with pytest.raises(SensorError, match=message):
            find_baud(port, PROTOCOLS["razor"].decoder, "razor")
        assert probe.probe(port).bytes_seen == 0


def test_a_closed_reader_waits_for_no_further_byte(pair: tuple[int, str]) -> None:
    with open_port(pair[1], 115200) as port:
        reader = Reader(lambda: port)
        begun = time.monotonic()
        reader.close()
        assert time.monotonic() - begun < 2.0  # of the 5 s that a read may hang
