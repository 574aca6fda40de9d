"""Messages about bad input, word for word: any change of them shows in messages.txt.

messages.txt holds commands ("$ pbd ...") and under each its exit code and what it says on stderr, with # for a number
that has a decimal point. To try another command, write its line there. To write the file anew, once a change of words
is meant: python -m tests.test_messages
"""

import contextlib
import io
import os
import re
import shlex
import tempfile
from pathlib import Path

import pytest

from pbd.cli import main
from tests.faulty_inputs import write_faulty_inputs

pytestmark = pytest.mark.usefixtures("cached_results")

FILE = Path(__file__).with_name("messages.txt")
PROMPT = "$ pbd "


def files() -> dict[Path, int]:
    """All files below the working folder, with their modification times, ns."""
    return {path: path.stat().st_mtime_ns for path in Path().rglob("*") if path.is_file()}


def said(command: str) -> str:
    """Run a command; return its exit code, then the lines on stderr. One that fails prints and changes nothing."""
    before = files()
    with contextlib.redirect_stdout(io.StringIO()) as out, contextlib.redirect_stderr(io.StringIO()) as err:
        try:
            code = main(shlex.split(command))
        except SystemExit as left:
            code = int(left.code or 0)
    assert code == 0 or (out.getvalue() == "" and files() == before)
    lines = err.getvalue().replace(f"{Path.cwd()}/", "").replace(f"{FILE.parents[1]}/", "")
    lines = re.sub(r"plugged in are: .*?\)", "plugged in are: ...)", lines)  # as the machine has them
    return f"{code}\n" + re.sub(r"-?\d+\.\d+", "#", lines)


def written() -> dict[str, str]:
    """The expected exit code and lines on stderr, by command."""
    blocks = FILE.read_text(encoding="utf-8").split(PROMPT)[1:]
    return {command: told.rstrip("\n") for command, _, told in (block.partition("\n") for block in blocks)}


WRITTEN = written()


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("bench")
    write_faulty_inputs(folder)
    return folder


@pytest.mark.parametrize("command", WRITTEN)
def test_it_says_what_is_written(bench: Path, monkeypatch: pytest.MonkeyPatch, command: str) -> None:
    monkeypatch.chdir(bench)
    meant = "if this change of words is meant, write them anew: python -m tests.test_messages"
    assert said(command).rstrip("\n") == WRITTEN[command], meant


def write_anew() -> None:
    """Run every command of the file, and write the file with the present messages."""
    with tempfile.TemporaryDirectory() as folder:
        write_faulty_inputs(Path(folder))
        os.chdir(folder)
        blocks = [f"{PROMPT}{command}\n{said(command).rstrip()}\n" for command in WRITTEN]
    FILE.write_text("\n".join(blocks), encoding="utf-8")


if __name__ == "__main__":
    write_anew()
