"""Wrong usage is one line that says where the help is; output that can't be written is one line too."""

import argparse
import errno
import subprocess
import sys
import warnings
from pathlib import Path

import pytest

import pbd
from pbd.cli import main, sensors
from pbd.cli.commands import parse
from pbd.cli.options import not_negative, pair, positive, thing_place
from pbd.errors import collected_warnings, nearest, warn
from tests.cli.test_help import COMMANDS

Capture = pytest.CaptureFixture[str]


def told(capsys: Capture, *args: str) -> tuple[object, str]:
    """Run a command that fails; return its exit code and its one line on stderr."""
    try:
        code: object = main([*args])
    except SystemExit as left:
        code = left.code
    out, err = capsys.readouterr()
    assert out == ""
    assert err.count("\n") == 1
    return code, err


def test_nothing_alike_is_no_question() -> None:
    assert nearest("xyz", ("pour", "stir")) == ""
    assert nearest("", ("pour",)) == ""
    assert nearest("pour", ()) == ""
    assert nearest("--position", ("--orientation", "--scale")) == ""
    assert nearest("ur4", ("ur3", "ur5", "ur10")) == "; did you mean ur3 or ur5?"
    assert nearest("--potision", ("--orientation", "--position")) == "; did you mean --position?"


@pytest.mark.parametrize("text", ["0", "-1", "nan", "inf", "", "1,5"])
def test_a_number_above_zero(text: str) -> None:
    with pytest.raises(argparse.ArgumentTypeError, match="must be a number above zero, got '"):
        positive(text)


@pytest.mark.parametrize("text", ["acc", "acc=", "=g"])
def test_a_unit_names_its_quantity(text: str) -> None:
    with pytest.raises(argparse.ArgumentTypeError, match="must be two words with = between them"):
        pair(text)


@pytest.mark.parametrize("text", ["cup", "cup=1,2", "cup=1,2,3,4,5", "cup=1,2,x"])
def test_a_thing_has_a_place_and_perhaps_a_turn(text: str) -> None:
    assert thing_place("cup=1,2,3,90") == ("cup", (1.0, 2.0, 3.0, 90.0))
    with pytest.raises(argparse.ArgumentTypeError, match=f"must be like cup=0.5,0.2,0.1 .*, got '{text}'"):
        thing_place(text)


@pytest.mark.parametrize("text", ["-1", "nan", "inf", "", "1,5"])
def test_a_dwell_is_zero_or_more(text: str) -> None:
    assert not_negative("0") == 0.0
    with pytest.raises(argparse.ArgumentTypeError, match="must be zero or a number above, got '"):
        not_negative(text)


@pytest.mark.parametrize("command", [of.prog for of in COMMANDS])
def test_every_command_speaks_so(capsys: Capture, command: str) -> None:
    code, err = told(capsys, *command.split()[1:], "--surely-not-there")
    assert code == 2
    assert err.endswith(f"see {command} --help\n")


@pytest.mark.parametrize(
    ("command", "name"),
    [("keyframes", "DEMO"), ("keyframes pouring --calibration", "--calibration"), ("plot --save", "--save")],
)
def test_an_empty_word_is_not_taken_as_left_out(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Capture, command: str, name: str
) -> None:
    """A script whose variable is unset must not get the newest demonstration, or another dock."""
    monkeypatch.chdir(tmp_path)
    code, err = told(capsys, *command.split(), "")
    assert (code, err.partition(": ")[2].partition(";")[0]) == (
        2,
        f"argument {name}: is empty: give a value, or leave it out",
    )


FULL = "pbd: standard output can't be written (No space left on device); send it elsewhere"


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no device that is always full")
@pytest.mark.parametrize(
    "words",
    [
        "segments pouring",
        "demos --json",
        "sensors --csv",
        "--print-completion bash",
        "--version",
        "export --help",
    ],
)
def test_output_that_can_not_be_written_is_told_in_one_line(
    capsys: Capture, monkeypatch: pytest.MonkeyPatch, words: str
) -> None:
    with Path("/dev/full").open("w") as full, monkeypatch.context() as patch:
        patch.setattr(sys, "stdout", full)
        assert main(words.split()) == 1
    *before, line = capsys.readouterr().err.splitlines()
    assert line == FULL
    assert all(said.startswith("pbd: ") for said in before)


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no device that is always full")
def test_nor_does_the_interpreter_complain_at_its_end() -> None:
    run = subprocess.run(
        ["bash", "-c", f"{sys.executable} -m pbd --version >/dev/full"], capture_output=True, text=True, check=False
    )
    assert (run.returncode, run.stderr) == (1, f"{FULL}\n")


def test_an_error_that_is_not_of_the_output_stays_a_bug(monkeypatch: pytest.MonkeyPatch) -> None:
    def run(*_: object) -> int:
        raise OSError(errno.ENOENT, "No such file", "x")

    monkeypatch.setattr(sensors, "run", run)
    with pytest.raises(OSError, match="No such file"):
        main(["sensors"])


def test_an_output_that_is_closed_is_not_missed() -> None:
    words = f"{sys.executable} -m pbd segments pouring >&-"
    run = subprocess.run(["bash", "-c", words], stderr=subprocess.PIPE, text=True, check=False)
    assert run.returncode == 0
    assert "Traceback" not in run.stderr


def test_warnings_of_other_packages_are_not_ours() -> None:
    with warnings.catch_warnings(record=True) as others:
        warnings.simplefilter("always")
        with collected_warnings() as ours:
            warnings.warn("overflow", RuntimeWarning, stacklevel=1)
            warn("mind")
    assert (ours, [each.category for each in others]) == (["mind"], [RuntimeWarning])


def test_the_packages_names_are_listed_before_they_are_loaded() -> None:
    assert set(pbd.__all__) <= set(dir(pbd))


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("import -run.csv tea", "pbd import: -run.csv begins like an option; if it is a file, write ./-run.csv; see"),
        ("keyframes -run.csv", "pbd keyframes: -run.csv begins like an option; if it is a file, write ./-run.csv; see"),
        ("calibrate points b tea --points -p.csv", "pbd calibrate points: -p.csv begins like an option; if it is a"),
        ("-run.csv", "pbd: -run.csv begins like an option; if it is a file, write ./-run.csv; see pbd --help"),
        ("import run.csv -tea", "pbd import: unknown option -tea; see pbd import --help"),
        ("import --unt run.csv", "pbd import: unknown option --unt; did you mean --unit? see pbd import --help"),
        (
            "calibrate mount bench turns --turns -x,y",
            "pbd calibrate mount: -x,y begins like an option; if it is the value of --turns, write --turns=-x,y; "
            "see pbd calibrate mount --help",
        ),
        ("fuse a b -oc -z", "pbd fuse: unknown option -z; see pbd fuse --help"),
        ("replay -- -run.csv", "pbd replay: the following arguments are required: --robot (one of"),
        ("touch pouring 3 --by -0.1 a 0", "pbd touch: argument --by: must be a number, got 'a'; see"),
    ],
)
def test_an_unknown_option_is_named_before_what_it_seems_to_lack(capsys: Capture, words: str, said: str) -> None:
    code, err = told(capsys, *words.split())
    assert code == 2
    assert err.startswith(said)


def test_an_option_may_be_between_two_names() -> None:
    touch = parse(["touch", "tea", "--robot", "panda", "3", "--by", "0", "0", "-0.01"])
    assert (touch.demo, touch.keyframe, touch.by) == ("tea", 3, [0.0, 0.0, -0.01])
    assert parse(["plot", "tea1", "--json", "tea2"]).demos == ["tea1", "tea2"]
