"""Paths of output: refused before anything is planned; files that people edit are never overwritten."""

from pathlib import Path

import pytest

from pbd.cli import main
from pbd.errors import PbdError
from pbd.io.atomic import DEMONSTRATION_FILES, refuse_output
from pbd.view.page import page_html
from tests.system_failures import as_a_user

Capture = pytest.CaptureFixture[str]


@pytest.fixture(autouse=True)
def elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with a complete demonstration, a robot and a calibration."""
    monkeypatch.chdir(tmp_path)
    for name in (*(f"demos/tea/{name}" for name in DEMONSTRATION_FILES), "robots/mine.toml", "calibration/bench.toml"):
        file = Path(name)
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(name)
    return tmp_path


def command(place: str) -> list[str]:
    """A command that writes to a place. It fails soon: if not for the place, then for the unknown robot."""
    if place.endswith((".html", ".toml", "/")):
        return ["replay", "pouring", "--robot", "nobody", "--html", place]
    return ["export", "pouring", "--robot", "nobody", "--format", "csv", "-o", place]


def refused(capsys: Capture, place: str) -> str:
    assert main(command(place)) == 1
    out, err = capsys.readouterr()
    assert out == ""
    assert err.count("\n") == 1
    assert "Errno" not in err
    assert "nobody" not in err
    return err


@pytest.mark.parametrize("name", DEMONSTRATION_FILES)
def test_no_file_of_a_demonstration_is_written_over(name: str) -> None:
    for place in (Path("demos/tea") / name, Path("demos/../demos/tea") / name):
        with pytest.raises(PbdError, match=r"belongs to the demonstration .*tea, so it is not overwritten"):
            refuse_output(place)
    Path("link.csv").symlink_to(Path("demos/tea") / name)
    with pytest.raises(PbdError, match="belongs to the demonstration"):
        refuse_output(Path("link.csv"))


@pytest.mark.parametrize(
    ("place", "line"),
    [
        ("demos/tea/imu.csv", "belongs to the demonstration demos/tea, so it is not overwritten; give another name"),
        ("demos/tea/demo.toml", "belongs to the demonstration demos/tea, so it is not overwritten"),
        (
            "robots/mine.toml",
            "robots/mine.toml is not an earlier output of pbd, so it is not overwritten; give another",
        ),
        ("calibration/bench.toml", "calibration/bench.toml is not an earlier output of pbd"),
        ("demos/", "demos is a folder: give a file's name"),
        ("nowhere/x.csv", "x.csv can't be written: there is no folder nowhere; make it, or give another place"),
        ("nowhere/x.html", "x.html can't be written: there is no folder nowhere; make it, or give another place"),
        ("robots/mine.toml/x.csv", "can't be written: robots/mine.toml is not a folder; give another"),
    ],
)
def test_a_place_is_tested_first(capsys: Capture, elsewhere: Path, place: str, line: str) -> None:
    assert line in refused(capsys, place)
    for file in (file for folder in ("demos", "robots", "calibration") for file in Path(folder).rglob("*.*")):
        assert file.read_text() == str(file)


def test_what_is_read_is_not_written_over(capsys: Capture) -> None:
    Path("walk.csv").write_text("t,ax,ay,az\n")
    assert main(["export", "walk.csv", "--robot", "nobody", "-o", "./walk.csv"]) == 1
    assert "walk.csv is what this command reads, so it is not overwritten" in capsys.readouterr().err


def test_a_read_only_file(capsys: Capture) -> None:
    Path("x.csv").touch(0o400)
    with as_a_user():
        assert "x.csv is read-only; change its permissions, or give another place" in refused(capsys, "x.csv")


@pytest.mark.parametrize("place", ["new.csv", "demos/tea/tea.csv", "imu.csv"])
def test_elsewhere_it_may_be(place: str) -> None:
    """Also beside a demonstration's files, and over an empty file."""
    refuse_output(Path(place))
    Path(place).touch()
    refuse_output(Path(place))


@pytest.mark.parametrize("place", ["notes.txt", "mine.html", "map.png"])
def test_a_persons_file_is_not_written_over(capsys: Capture, place: str) -> None:
    mine = "mine: the frame is pbd_tool, drawn by pbd, with matplotlib"
    Path(place).write_text(mine)
    draw = ["calibrate", "show", "default", "pouring", "--save", place]
    assert main(draw if place.endswith(".png") else command(place)) == 1
    assert f"{place} is not an earlier output of pbd, so it is not overwritten; give another" in capsys.readouterr().err
    assert Path(place).read_text() == mine


def test_a_page_and_the_files_for_a_phone_are_replaced(capsys: Capture) -> None:
    """For exports and figures: tests of their commands."""
    Path("tea.html").write_text(page_html("tea", b""), encoding="utf-8")
    refuse_output(Path("tea.html"))
    for place in ("code.png", "code.svg", "pbd.phyphox"):
        assert main(["sensors", "phyphox", "-o", place]) == 0
        refuse_output(Path(place))
