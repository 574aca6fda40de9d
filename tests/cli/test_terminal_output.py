"""Output to terminals and pipes: control characters in names do nothing, and a failing stream loses no result."""

import json
import os
import subprocess
import sys
import tomllib
from pathlib import Path
from unittest.mock import Mock

import pytest

from pbd.cli import main
from pbd.view.terminal import SafeStream, escaped
from tests.cli.pbd_process import PBD, Terminal

Capture = pytest.CaptureFixture[str]
EVIL = "\x1b[2J\x9b2J\u202e[/b]:tea:"
"""Clears the screen twice, reverses the line, and breaks rich's markup."""

SHOWN = r"\x1b[2J\x9b2J\u202e[/b]:tea:"


@pytest.fixture
def tea(elsewhere: Path, capsys: Capture) -> Path:
    """A demonstration with the label EVIL."""
    assert main(["simulate", "pick-and-place-direct", "tea"]) == 0
    assert main(["keyframes", "tea", "--save"]) == 0
    file = elsewhere / "demos" / "tea" / "keyframes.toml"
    text = file.read_text().replace("[[keyframe]] # 1\n", f"[[keyframe]] # 1\nlabel = {json.dumps(EVIL)}\n")
    file.write_text(text)
    capsys.readouterr()
    return file


@pytest.mark.parametrize("form", [(), ("--csv",)])
def test_a_label_is_shown_as_it_is(tea: Path, capsys: Capture, form: tuple[str, ...]) -> None:
    assert main(["keyframes", "tea", *form]) == 0
    out = capsys.readouterr().out
    assert SHOWN in out
    assert not set(out) & set("\x1b\x9b\u202e")


def test_a_program_gets_the_label_itself(tea: Path, capsys: Capture) -> None:
    assert main(["keyframes", "tea", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["keyframes"][1]["label"] == EVIL


def test_in_a_terminal_too(tea: Path) -> None:
    terminal = Terminal("keyframes", "tea", cwd=tea.parents[2])
    for step in ("reading tea ...", "tracking ...", SHOWN):
        terminal.until(step)
    assert "\x1b[2J" not in terminal.text
    assert terminal.exit_code() == 0


def test_a_message_is_one_line(capsys: Capture) -> None:
    assert main(["segments", "no\n\x1b]0;title\x07such"]) == 1
    err = capsys.readouterr().err
    assert r"'no \x1b]0;title" in err
    assert err.count("\n") == 1


def test_a_name_that_is_not_utf_8_shows_its_bytes() -> None:
    assert escaped(os.fsdecode(b"t\xff")) == r"t\xff"


def pbd(words: str, redirected: str, cwd: Path) -> subprocess.CompletedProcess[str]:
    """Run `pbd` in a shell with streams redirected or closed."""
    line = f"{PBD[0]} -m pbd {words} {redirected}"
    return subprocess.run(["bash", "-c", line], cwd=cwd, capture_output=True, text=True, check=False)


def test_without_stderr_the_result_is_the_same(tmp_path: Path, capsys: Capture) -> None:
    """A closed stderr leaves its number free for the next file, into which libraries would then print."""
    planning, tracking = "keyframes paper-test2 --robot ur5 --json", "keyframes paper-test2 --json"
    for words, redirected in ((tracking, "2>/dev/full"), (planning, "<&- 2>&-")):
        assert main(words.split()) == 0
        wanted = capsys.readouterr().out
        run = pbd(words, redirected, tmp_path)
        assert (run.returncode, run.stdout) == (0, wanted), redirected


def test_a_result_without_stdout_is_not_said_to_be_written(tmp_path: Path) -> None:
    run = pbd("export paper-test2 --robot panda --format csv -o -", ">&-", tmp_path)
    assert run.returncode == 1
    assert run.stderr.splitlines()[-1] == "pbd: standard output is closed: name a file"


def test_ctrl_c_is_one_line(monkeypatch: pytest.MonkeyPatch, capsys: Capture) -> None:
    monkeypatch.setattr("pbd.cli.parse", Mock(side_effect=KeyboardInterrupt))
    assert main(["robots"]) == 130
    assert capsys.readouterr() == ("", "pbd: stopped by Ctrl-C\n")


STOP = "raise KeyboardInterrupt"
STOP_IN_A_CLASS = f"""
class Name:
    def __set_name__(self, *_):
        {STOP}
class Named:
    name = Name()
"""


@pytest.mark.parametrize(("module", "text"), [("argparse", STOP), ("argparse", STOP_IN_A_CLASS), ("uuid", STOP)])
def test_ctrl_c_while_the_command_line_is_loaded_is_no_traceback(tmp_path: Path, module: str, text: str) -> None:
    """orjson crashes if Ctrl-C comes while it imports uuid, so that is imported before."""
    (tmp_path / f"{module}.py").write_text(text)
    environment = os.environ | {"PYTHONPATH": os.pathsep.join((str(tmp_path), str(Path(__file__).parents[2])))}
    command = [sys.executable, "-m", "pbd", "simulate", "pour", "tea"]
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "")
    assert not (tmp_path / "demos").exists()
    script = tomllib.loads((Path(__file__).parents[2] / "pyproject.toml").read_text())["project"]["scripts"]["pbd"]
    assert script == "pbd.__main__:main"


STOPPED_WHILE_WRITING = """
import os, signal, sys
import pbd.__main__, pbd.files.demo
number = int(sys.argv.pop(1))
pbd.files.demo.write_table = lambda path, *_: path.touch() or os.kill(os.getpid(), number)
sys.exit(pbd.__main__.main())
"""


@pytest.mark.parametrize(("number", "name"), [(2, "Ctrl-C"), (15, "SIGTERM"), (1, "SIGHUP")])
def test_a_command_that_is_stopped_leaves_nothing(tmp_path: Path, number: int, name: str) -> None:
    """A closed window and a scheduler end a command as Ctrl-C does: no temporary folder stays."""
    enabled = (  # the tests' own parent may ignore them
        "import signal; signal.signal(signal.SIGINT, signal.default_int_handler); "
        "signal.signal(signal.SIGHUP, signal.SIG_DFL)"
    )
    command = [sys.executable, "-c", enabled + STOPPED_WHILE_WRITING, str(number), "simulate", "pour", "tea"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (128 + number, "", f"pbd: stopped by {name}\n")
    assert not list(tmp_path.iterdir())


def test_nohup_is_kept(tmp_path: Path) -> None:
    ignored = "import signal; signal.signal(signal.SIGHUP, signal.SIG_IGN)"
    command = [sys.executable, "-c", ignored + STOPPED_WHILE_WRITING, "1", "simulate", "pour", "tea"]
    assert subprocess.run(command, cwd=tmp_path, capture_output=True, check=False).returncode == 0


def test_only_what_is_needed_fails() -> None:
    class Broken:
        def write(self, text: str) -> int:
            raise OSError(28, "No space left on device")

        def fileno(self) -> int:
            raise OSError

    assert SafeStream(Broken(), needed=False).write("a note") == 6  # type: ignore[arg-type]
    with pytest.raises(OSError, match="No space"):
        SafeStream(Broken(), needed=True).write("a result")  # type: ignore[arg-type]


def test_the_streams_of_a_program_that_calls_are_put_back() -> None:
    before = sys.stdin, sys.stdout, sys.stderr
    assert main(["segments", "pouring"]) == 0
    assert (sys.stdin, sys.stdout, sys.stderr) == before
