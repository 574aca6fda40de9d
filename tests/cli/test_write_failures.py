"""Every command that writes, where writing fails: one line, exit code 1, no file left behind, no file lost."""

import os
import shutil
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

import pytest
from matplotlib.figure import Figure

from pbd.cli import main
from pbd.files.demo import write_demo
from pbd.simulation.simulate import simulate
from pbd.view.page import page_html
from tests.system_failures import as_a_user, full_disk

Capture = pytest.CaptureFixture[str]


@dataclass(frozen=True)
class Writer:
    """A command that writes to {}: a name in the folder `there`, with a `suffix`."""

    words: str
    suffix: str = ""

    def command(self, place: str) -> list[str]:
        return [word.replace("{}", place + self.suffix) for word in self.words.split()]


WRITERS = {
    "simulate": Writer("simulate pour {} --force"),
    "record": Writer("record {} --sensor sim --duration 0.4 --force"),
    "import": Writer("import walk.csv {} --force"),
    "export": Writer("export paper-test2 --robot ur5 -o {}", ".csv"),
    "replay": Writer("replay paper-test2 --robot ur5 --html {}", ".html"),
    "plot": Writer("plot paper-test2 --save {}/figures"),
    "keyframes": Writer("keyframes {} --save --force"),
    "dock": Writer("calibrate dock {} --position 0.4 0 0.2 --rpy 0 0 0", ".toml"),
    "show": Writer("calibrate show default paper-test2 --save {}", ".png"),
}
LINKED = {"simulate": "link", "import": "link", "record": "link.new"}
"""Where a new demonstration is that replaced a link, by command. A recording without a rest restores the link."""


@pytest.fixture(scope="module")
def older(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recording walk.csv, and in `there` an older output of every writer, named `old`."""
    folder = tmp_path_factory.mktemp("older")
    old = folder / "there" / "old"
    write_demo(simulate("pick-and-place-direct", "ideal", 0), old)
    assert main(["keyframes", str(old), "--save"]) == 0
    file = old / "keyframes.toml"
    file.write_text(f"# edited\n{file.read_text()}")
    shutil.copy(old / "imu.csv", folder / "walk.csv")
    (old / "figures").mkdir()
    old.with_suffix(".toml").write_text(
        "format = 1\nname = 'old'\n[dock]\nposition = [0.4, 0, 0.2]\nrpy_deg = [0, 0, 0]\n"
    )
    for suffix, text in {".csv": "t,q_1,gripper\n", ".png": "", ".html": page_html("old", b"")}.items():
        old.with_suffix(suffix).write_text(text)
    return folder


@pytest.fixture
def drawn(elsewhere: Path, monkeypatch: pytest.MonkeyPatch, older: Path) -> Path:
    """A folder with an older output of every writer, named `old`."""
    monkeypatch.setattr("pbd.plots.figures.names", lambda plot: ["position"])  # one of many figures
    shutil.copytree(older, elsewhere, dirs_exist_ok=True)
    return elsewhere / "there"


@pytest.fixture
def there(drawn: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The same, where figures are written that have nothing in them: drawing takes most of the time."""
    monkeypatch.setattr("pbd.plots.figures.draw", lambda name, plot: Figure())
    monkeypatch.setattr("pbd.plots.calibration.draw_calibration", lambda demo, placed: Figure())
    return drawn


def tree(folder: Path) -> dict[str, bytes]:
    """The content of a folder by path; of a link, its target."""
    found = {}
    for path in sorted(folder.rglob("*")):
        name = str(path.relative_to(folder))
        found[name] = os.fsencode(path.readlink()) if path.is_symlink() else b"" if path.is_dir() else path.read_bytes()
    return found


def refused(capsys: Capture, command: list[str]) -> str:
    """Run a command that fails; return its one line. Notes may come before it."""
    capsys.readouterr()
    assert main(command) == 1
    out, err = capsys.readouterr()
    assert out == ""
    *notes, line = err.splitlines()
    assert line.startswith("pbd: ")
    assert "; " in line or ": name a file" in line
    assert "Errno" not in line
    for note in notes:
        assert note.startswith(("pbd: ", "recording "))
        assert not any(word in note for word in ("wrote", "can't", "into", "saved"))
    return line


@contextmanager
def mode(folder: Path, bits: int) -> Iterator[None]:
    folder.chmod(bits)
    try:
        with as_a_user():
            yield
    finally:
        folder.chmod(0o700)


@pytest.mark.parametrize(("name", "bits"), [("old", 0o500), ("new", 0o600)])
@pytest.mark.parametrize("writer", WRITERS)
def test_a_folder_without_permission(capsys: Capture, there: Path, writer: str, name: str, bits: int) -> None:
    place = {"keyframes": "there/old", "plot": f"there/{name}/figures"}.get(writer, "there")
    if not Path(place).exists():
        place = "there"
    before = tree(there)
    with mode(Path(place), bits):
        refused(capsys, WRITERS[writer].command(f"there/{name}"))
    assert tree(there) == before


@pytest.mark.parametrize(("name", "room"), [("new", 0), ("old", 300)])
@pytest.mark.parametrize("writer", WRITERS)
def test_a_full_disk(capsys: Capture, there: Path, writer: str, name: str, room: int) -> None:
    if room and writer in ("dock", "record"):
        pytest.skip("there is room enough for a calibration; a recording keeps what came (tests/record)")
    before = tree(there)
    with full_disk(room):
        refused(capsys, WRITERS[writer].command(f"there/{name}"))
    assert tree(there) == before


@pytest.mark.parametrize("name", ["n" * 256, os.fsdecode(b"t\xff"), "a\x1bb"], ids=["long", "bytes", "control"])
@pytest.mark.parametrize("writer", WRITERS)
def test_an_odd_name(capsys: Capture, there: Path, writer: str, name: str) -> None:
    before = tree(there)
    refused(capsys, WRITERS[writer].command(f"there/{name}"))
    assert tree(there) == before


@pytest.mark.parametrize(
    "words",
    [
        "touch {} 1 --robot ur5 --by 0 0 0.002",
        "keyframes {} --save",
        "fuse {} there/old -o there/new",
        "simulate pour {} --force",
    ],
)
def test_a_demonstration_whose_folder_is_not_utf_8(capsys: Capture, there: Path, words: str) -> None:
    """It can be read, but nothing that names it can be written."""
    odd = os.fsdecode(b"there/t\xff")
    write_demo(simulate("pick-and-place-direct", "modern", 1), there / "t")
    (there / "t").rename(odd)
    before = tree(there)
    assert "can't be a name here" in refused(capsys, Writer(words).command(odd))
    assert tree(there) == before


@pytest.mark.parametrize("writer", WRITERS)
def test_the_longest_name(capsys: Capture, there: Path, writer: str) -> None:
    if writer == "keyframes":
        pytest.skip("it makes no name")
    name = "n" * (255 - len(WRITERS[writer].suffix))
    assert main(WRITERS[writer].command(f"there/{name}")) == 0
    assert (there / f"{name}{WRITERS[writer].suffix}").exists()


@pytest.mark.parametrize("writer", WRITERS)
def test_a_working_folder_that_was_deleted(
    capsys: Capture, there: Path, writer: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    walk = there.parent / "walk.csv"
    monkeypatch.chdir(there)
    shutil.rmtree(there)
    refused(capsys, [str(walk) if word == "walk.csv" else word for word in WRITERS[writer].command("new")])
    monkeypatch.undo()
    assert [path.name for path in walk.parent.iterdir()] == ["walk.csv"]


@pytest.mark.parametrize("writer", WRITERS)
def test_a_link(capsys: Capture, there: Path, writer: str) -> None:
    """The target of a link to a file is replaced. A link to a demonstration is replaced itself; its target stays."""
    suffix = WRITERS[writer].suffix
    link = there / f"link{suffix}"
    link.symlink_to(f"old{suffix}")
    before = tree(there)
    assert main(WRITERS[writer].command("there/link")) == 0
    after = tree(there)
    assert {name for name in set(after) - set(before) if name.partition("/")[0] != LINKED.get(writer, "old")} == set()
    if writer in LINKED:
        kept = {name: content for name, content in before.items() if name != "link"}
        assert {name: after[name] for name in kept} == kept
        assert f"{LINKED[writer]}/imu.csv" in after
    else:
        assert link.is_symlink()
        assert after != before


@pytest.mark.parametrize("stream", ["stdout", "stderr"])
@pytest.mark.parametrize("writer", WRITERS)
def test_a_closed_stream(
    capsys: Capture, there: Path, writer: str, stream: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    name = "old" if writer == "keyframes" else "new"
    before = tree(there)
    with monkeypatch.context() as patch:
        patch.setattr(sys, stream, None)
        assert main(WRITERS[writer].command(f"there/{name}")) == 0
    after = tree(there)
    assert after != before
    assert not [path for path in after if path.endswith(".tmp")]
    with suppress(KeyError):
        assert after["old/imu.csv"] == before["old/imu.csv"]


@pytest.mark.parametrize("writer", ["replay", "import", "plot"])
def test_a_recording_whose_name_is_odd(drawn: Path, writer: str) -> None:
    """A file to read may have any name, which a figure and a page show."""
    odd = os.fsdecode(b"w\xff.csv")
    Path("walk.csv").rename(odd)
    words = WRITERS[writer].command("there/new")
    assert main([odd if word in ("paper-test2", "walk.csv") else word for word in words]) == 0
