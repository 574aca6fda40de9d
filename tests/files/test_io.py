"""Files of others: only regular files of bounded size are read, and each failure is a PbdError."""

import os
import re
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from pbd.cli import main
from pbd.errors import LONGEST_MESSAGE, PbdError, RecordingError, RobotError
from pbd.files.demo import read_demo
from pbd.files.importers import import_file
from pbd.files.points import read_points
from pbd.files.table import open_sheet
from pbd.io import meshes
from pbd.io.atomic import refuse_file, write_text
from pbd.io.meshes import mesh_file
from pbd.io.numbers import number, seconds
from pbd.io.read_file import read_bytes
from pbd.io.toml import read_toml
from pbd.io.urdf import read_xml
from pbd.record.redecode import decode_raw
from pbd.sensors.protocols import protocol
from tests.fuzz import contents
from tests.reading_meshes import read_mesh

READ: dict[str, Callable[[Path], object]] = {
    "a.toml": lambda path: read_toml(path, RecordingError),
    "a.csv": import_file,
    "a.npz": import_file,
    "points.csv": read_points,
    "a.xml": lambda path: read_xml(path),
    "a.stl": read_mesh,
    "a.dae": read_mesh,
    "raw.bin": lambda path: decode_raw(path, protocol("xsens").decoder(), "xsens"),
}


@pytest.mark.parametrize("name", READ)
@pytest.mark.parametrize(
    "make", [os.mkfifo, os.mkdir, lambda path: path.symlink_to("/dev/zero")], ids=["pipe", "folder", "device"]
)
def test_what_is_not_a_regular_file_is_refused_without_waiting(
    tmp_path: Path, name: str, make: Callable[[Path], None]
) -> None:
    make(tmp_path / name)
    with pytest.raises(PbdError, match=r"can't be read \((Is a directory|it is not a regular file)\); "):
        READ[name](tmp_path / name)


def test_a_pipe_is_no_place_for_a_result(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.csv")
    with pytest.raises(PbdError, match=r"pipe\.csv can't be written \(not a regular file\); give another place"):
        refuse_file(tmp_path / "pipe.csv")


def test_a_pipe_as_a_robots_file_is_refused(elsewhere: Path, capsys: pytest.CaptureFixture[str]) -> None:
    Path("robots").mkdir()
    os.mkfifo("robots/mine.toml")
    assert main(["robots", "mine"]) == 1
    assert "robots/mine.toml: can't be read (it is not a regular file)" in capsys.readouterr().err


def test_a_pipe_to_import_is_not_said_to_be_missing(elsewhere: Path, capsys: pytest.CaptureFixture[str]) -> None:
    os.mkfifo("run.csv")
    assert main(["import", "run.csv", "tea"]) == 1
    assert "run.csv: can't be read (it is not a regular file)" in capsys.readouterr().err


def test_a_pipe_as_keyframes_file_is_refused(tmp_path: Path) -> None:
    (tmp_path / "demo.toml").write_text(contents.DEMO, encoding="utf-8")
    (tmp_path / "imu.csv").write_text("t,ax,ay,az\n0,0,0,9.81\n0.01,0,0,9.81\n", encoding="utf-8")
    os.mkfifo(tmp_path / "keyframes.toml")
    with pytest.raises(RecordingError, match=r"keyframes\.toml: can't be read"):
        read_demo(tmp_path)


def test_a_file_that_is_too_large_is_not_read(tmp_path: Path) -> None:
    path = tmp_path / "large"
    with path.open("wb") as file:
        file.truncate(10**12)  # a sparse file
    with pytest.raises(RobotError, match=r"it has 1e\+06 MB, more than the 1e\+03 MB that are read\); go"):
        read_bytes(path, RobotError, "go")


def test_a_message_is_one_short_printable_line() -> None:
    message = str(PbdError("no \x1b[2J name\n'" + "(" * 100_000 + "'; correct it"))
    assert message.startswith(r"no \x1b[2J name '(((")
    assert message.endswith("((('; correct it")
    assert len(message) < LONGEST_MESSAGE + 10


# --- numbers ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("text", ["1_000", "１２", "0x10", "", "1e", "--1", "1 2"])
def test_texts_that_are_not_numbers(text: str) -> None:
    with pytest.raises(ValueError, match=r"number|float|time"):
        number(text)


def test_a_time_of_any_number_of_decimals() -> None:
    assert seconds("8:18:9." + "5" * 400) == pytest.approx(8 * 3600 + 18 * 60 + 9 + 5 / 9, abs=1e-9)
    with pytest.raises(ValueError, match=r"number|float|time"):
        seconds("8:18:9:" + "5" * 400)


# --- tables -----------------------------------------------------------------------------------------------------------


def test_a_quote_that_is_never_closed(tmp_path: Path) -> None:
    (tmp_path / "imu.csv").write_text('t,a\n0,1\n1,"2\n' + "3,4\n" * 40_000, encoding="utf-8")
    with pytest.raises(RecordingError, match=r"imu\.csv:\d+: '23,43,[^']*' in column 'a' is not a number; "):
        open_sheet(tmp_path / "imu.csv").read()


# --- npz --------------------------------------------------------------------------------------------------------------


def test_only_the_known_arrays_of_an_npz_are_read(tmp_path: Path) -> None:
    path = tmp_path / "run.npz"
    np.savez(path, rate_hz=100.0, acc=np.ones((3, 3)))
    with zipfile.ZipFile(path, "a") as archive:
        archive.writestr("video.npy", b"no array at all")
    assert len(import_file(path).recording) == 3


def test_a_too_large_array_is_not_decompressed(tmp_path: Path) -> None:
    path = tmp_path / "run.npz"
    np.savez_compressed(path, rate_hz=100.0, acc=np.zeros((2_500_000, 3)))
    assert path.stat().st_size < 100_000
    with pytest.raises(RecordingError, match=r"its content of \d+ bytes decompresses to 60 MB, which is refused"):
        import_file(path)


def test_a_sensor_at_rest_may_compress_well(tmp_path: Path) -> None:
    path = tmp_path / "run.npz"
    np.savez_compressed(path, rate_hz=100.0, acc=np.tile([0.0, 0.0, 9.81], (100_000, 1)))
    assert len(import_file(path).recording) == 100_000


@pytest.mark.parametrize("shape", [(10**9, 3), (10**30, 3), (4, 3), (-1, 3)])
def test_an_array_with_a_wrong_shape_in_its_header_is_refused(tmp_path: Path, shape: tuple[int, int]) -> None:
    path = tmp_path / "run.npz"
    np.savez(path, rate_hz=100.0, acc=np.ones((3, 3)))
    with zipfile.ZipFile(path) as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    with zipfile.ZipFile(path, "w") as archive:
        for name, data in members.items():
            archive.writestr(name, data.replace(b"(3, 3), }" + b" " * 40, f"{shape}, }}".encode().ljust(49)))
    with pytest.raises(RecordingError, match="can't be read as an npz"):
        import_file(path)


# --- XML and meshes ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("encoding", ["utf-7", "shift_jis", "nonsense"])
def test_xml_in_an_unknown_encoding_is_refused(tmp_path: Path, encoding: str) -> None:
    path = tmp_path / "a.urdf"
    path.write_text(f'<?xml version="1.0" encoding="{encoding}"?><robot name="a"/>', encoding="ascii")
    with pytest.raises(RobotError, match=r"a\.urdf: not valid XML: .*; save it as UTF-8"):
        read_xml(path)


def test_a_mesh_address_without_a_file(tmp_path: Path) -> None:
    assert not mesh_file("package://", tmp_path / "a.urdf", [tmp_path]).is_file()


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("<p>0 2 1 0 1 3</p>", "<p>0 2 1 0 1 99</p>", "Indexes (maxindex=99)"),
        ("<vcount>3 3</vcount>", "<vcount>1000000000000 3</vcount>", "negative dimensions"),
        ("0 0 0 1 0 0", "nan 0 0 1 0 0", "a vertex that is not a number"),
        ('<node id="n">', '<node id="n"><instance_node url="#n"/>', "Node #n not found"),
        ("<scale>1 2 1</scale>", "<scale>1 two 1</scale>", "Failed to parse scale"),
    ],
)
def test_an_invalid_collada_mesh_is_refused(tmp_path: Path, old: str, new: str, message: str) -> None:
    path = tmp_path / "a.dae"
    path.write_text(contents.DAE.replace(old, new), encoding="utf-8")
    with pytest.raises(RobotError, match=re.escape(message)):
        read_mesh(path)


def test_a_small_collada_file_that_shows_one_geometry_a_billion_times(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(meshes, "MOST_NODES", 200)
    twice = [f'<node id="n{k}">' + 2 * f'<instance_node url="#n{k + 1}"/>' + "</node>" for k in range(30)]
    text = contents.DAE.replace("<library_nodes>", f"<library_nodes>{''.join(twice)}")
    (tmp_path / "a.dae").write_text(text.replace('"n"', '"n30"').replace('"#n"', '"#n0"'), encoding="utf-8")
    with pytest.raises(RobotError, match="more than 200 nodes"):
        read_mesh(tmp_path / "a.dae")


def test_no_link_that_waits_in_a_shared_folder_is_written_through(tmp_path: Path) -> None:
    """The temporary name was once made of the process's number and a counter, which others can guess."""
    (secret := tmp_path / "secret").write_text("kept", encoding="utf-8")
    for guess in range(1000):
        (tmp_path / f".pbd-{os.getpid()}-{guess}.tmp").symlink_to(secret)
    write_text(tmp_path / "file", "other")
    assert secret.read_text(encoding="utf-8") == "kept"
