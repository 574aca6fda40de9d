"""`pbd sensors phyphox`: the experiment and its QR codes, read back with ZXing, as the app does."""

import io
import os
import sys
import zipfile
import zlib
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
import segno
import zxingcpp
from PIL import Image

from pbd.sensors.phyphox.answers import BUFFERS
from pbd.sensors.phyphox.experiment import BUFFER_ROWS, experiment, qr_payloads
from tests.cli.pbd_process import Terminal
from tests.cli.run_command import Capture, run, run_json


def in_the_app(codes: list[bytes]) -> str:
    """Join the codes as the app does, in any order of scanning; return the experiment's text."""
    heads = {(code[:11], code[12]) for code in codes}
    assert heads == {(b"phyphox" + zlib.crc32(b"".join(code[13:] for code in codes)).to_bytes(4, "big"), len(codes))}
    assert [code[11] for code in codes] == list(range(len(codes)))
    with zipfile.ZipFile(io.BytesIO(b"".join(code[13:] for code in codes))) as archive:
        (name,) = archive.namelist()
        assert name.endswith(".phyphox")
        return archive.read(name).decode()


def test_the_code_in_a_picture_is_the_experiment(elsewhere: Path, capsys: Capture) -> None:
    code, out, err = run(capsys, "sensors", "phyphox", "-o", "code.png")
    assert code == 0
    assert "scan the code" in out
    assert "open it with phyphox" not in err  # the app opens no pictures
    assert "--port http://ADDRESS" in out
    (read,) = zxingcpp.read_barcodes(Image.open("code.png"))
    assert read.symbology_identifier == "]Q1"  # no ECI: the app takes the first byte segment as it is
    assert in_the_app([read.bytes]) == experiment()


def test_what_is_about_a_cable_is_refused_for_a_phone(elsewhere: Path, capsys: Capture) -> None:
    code, _, err = run(capsys, "sensors", "phyphox", "--probe")
    assert (code, list(Path().iterdir())) == (2, [])
    assert "--probe, --port and --csv are for sensors on a cable" in err


@pytest.mark.parametrize("count", [1, 3, 6])
def test_several_codes_make_one_experiment(count: int) -> None:
    read = []
    for part in qr_payloads(count):
        picture = np.array(
            [list(row) for row in segno.make_qr(part, mode="byte", error="l").matrix_iter(scale=4, border=4)]
        )
        (code,) = zxingcpp.read_barcodes(np.where(picture, 0, 255).astype(np.uint8))
        read.append(code.bytes)
    assert in_the_app(read) == experiment()


def test_the_experiment_has_the_three_sensors_with_gravity(elsewhere: Path, capsys: Capture) -> None:
    code, out, _ = run(capsys, "sensors", "phyphox")
    assert code == 0
    assert "scan" not in out  # without a terminal there is no code
    root = ElementTree.parse("pbd.phyphox").getroot()
    buffers = {each.text: each.get("size") for each in root.iter("container")}
    assert buffers == {name: str(BUFFER_ROWS) for names in BUFFERS.values() for name in names}
    inputs = {each.get("type"): [out.text for out in each] for each in root.iter("sensor")}
    assert inputs == dict(
        zip(
            ("accelerometer", "gyroscope", "magnetic_field"),
            map(list, (BUFFERS["acc"], BUFFERS["gyr"], BUFFERS["mag"])),
            strict=True,
        )
    )
    assert [each.get("component") for each in next(root.iter("sensor"))] == ["t", "x", "y", "z"]
    exported = {each.text for each in root.iter("data")}
    assert exported == buffers.keys()


def test_a_small_terminal_shows_code_after_code(tmp_path: Path) -> None:
    terminal = Terminal("sensors", "phyphox", cwd=tmp_path)
    terminal.until("\x1b[97;40m")  # the colours reach it as such
    terminal.until("code 1 of ")
    terminal.type("\n" * 12)
    terminal.until("add experiment from QR code")
    assert terminal.exit_code() == 0


def test_a_terminal_too_small_for_a_code_and_one_that_shows_it_whole(
    elsewhere: Path, monkeypatch: pytest.MonkeyPatch, capsys: Capture
) -> None:
    assert run_json(capsys, "sensors", "phyphox", "-o", "code.svg") == {"file": "code.svg"}
    for size, code, told in (
        ((20, 8), 1, "a terminal of 20 x 8 is too small for a code"),
        ((300, 200), 0, "is written"),
    ):
        monkeypatch.setattr("shutil.get_terminal_size", lambda size=size: os.terminal_size(size))
        monkeypatch.setattr(sys.stdout, "isatty", lambda: True)
        found, out, err = run(capsys, "sensors", "phyphox")
        assert found == code
        assert told in err
        assert "code 1 of" not in out
