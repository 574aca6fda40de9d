"""`pbd sensors`: which ports there are, and which sensor is on each."""

import csv
import json

import pytest

from pbd.cli import main
from pbd.sensors import probe
from pbd.sensors.port import PortInfo
from pbd.sensors.protocols import PROTOCOLS
from tests.record.emulated_sensors import SPEAKERS, Device, random_hand

Capture = pytest.CaptureFixture[str]


def test_what_is_plugged_in(monkeypatch: pytest.MonkeyPatch, capsys: Capture) -> None:
    ports = (PortInfo("/dev/ttyUSB7", "FTDI FT232R", "0403:6001"),)
    monkeypatch.setattr("pbd.sensors.port.list_ports", lambda: ports)
    assert main(["sensors"]) == 0
    out = capsys.readouterr().out
    assert all(word in out for word in ("/dev/ttyUSB7", "FTDI FT232R", "0403:6001", *PROTOCOLS))
    monkeypatch.setattr("pbd.sensors.port.list_ports", lambda: ())
    assert main(["sensors"]) == 0
    assert "no serial port has anything plugged in; try one without hardware" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("name", "sensor", "note"), [("vectornav-binary", "vectornav", ""), ("lines", None, "record --sensor lines")]
)
def test_what_it_speaks(capsys: Capture, name: str, sensor: str | None, note: str) -> None:
    hand = random_hand(300, seed=1)
    with Device([SPEAKERS[name].encode(hand, row) for row in range(300)], 300.0, again=True) as device:
        device.go()
        assert main(["sensors", "--probe", "--port", device.device, "--json"]) == 0
    out, err = capsys.readouterr()
    (row,) = json.loads(out)["ports"]
    assert row["port"] == device.device
    assert row["sensor"] == sensor
    assert note in row["note"]
    assert err == f"listening to {device.device} ...\n"


def test_a_port_that_cannot_be_opened_does_not_hide_the_others(
    monkeypatch: pytest.MonkeyPatch, capsys: Capture
) -> None:
    monkeypatch.setattr(probe, "LISTEN_S", 0.03)
    monkeypatch.setattr(probe, "BOOT_S", 0.05)
    with Device([b"\xf0\x0f garbage "], 200.0, again=True) as garbage, Device([b""], 100.0) as silent:
        names = "/dev/nothing", garbage.device, silent.device
        monkeypatch.setattr("pbd.sensors.port.list_ports", lambda: tuple(PortInfo(name, "", "") for name in names))
        garbage.go()
        assert main(["sensors", "--probe", "--csv"]) == 0
    rows = csv.DictReader(capsys.readouterr().out.partition("\n\n")[0].splitlines())
    remarks = {row["port"]: (row["speaks"], row["remarks"].partition(" (")[0]) for row in rows}
    told = "there is no port /dev/nothing", "bytes in no known protocol", "silent"
    assert remarks == {name: ("", remark) for name, remark in zip(names, told, strict=True)}


def test_csv_has_both_tables(monkeypatch: pytest.MonkeyPatch, capsys: Capture) -> None:
    monkeypatch.setattr("pbd.sensors.port.list_ports", lambda: (PortInfo("/dev/ttyUSB7", "FTDI, Ltd", "0403:6001"),))
    assert main(["sensors", "--csv"]) == 0
    ports, sensors = (list(csv.DictReader(part.splitlines())) for part in capsys.readouterr().out.split("\n\n"))
    assert ports == [{"port": "/dev/ttyUSB7", "device": "FTDI, Ltd", "USB id": "0403:6001"}]
    assert [row["--sensor"] for row in sensors] == list(PROTOCOLS)


def test_a_port_that_is_not_there(capsys: Capture) -> None:
    assert main(["sensors", "--port", "/dev/nothing"]) == 2
    assert "--port is the port to listen to: add --probe" in capsys.readouterr().err
    assert main(["sensors", "--probe", "--port", "/dev/nothing"]) == 1
    assert "pbd: there is no port /dev/nothing" in capsys.readouterr().err
