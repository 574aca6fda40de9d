"""The help of every command: its examples parse, and those that need no device and no browser run."""

import argparse
import shlex
import shutil
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pbd.cli import main, parser
from pbd.cli.commands import EPILOG
from pbd.data import GRAVITY, Recording
from pbd.files.demo import write_demo
from pbd.sensors.witmotion import UNITS
from pbd.simulation.simulate import simulate
from tests.arm.own_robot import own_toml, own_urdf
from tests.files.witmotion_logs import DIALECTS, written
from tests.sensors.encoders import witmotion

# Plotting takes its time; tests/test_cli_plot.py does it.
RUN = ("simulate", "import", "segments", "keyframes", "replay", "export", "robots", "sensors", "calibrate")
NOT_HERE = ("calibrate points", "calibrate mount", "calibrate sensor", "robots --", "export tea1 tea2")
"""Examples that run elsewhere: test_calibrate*.py makes recordings for them, test_robots_command.py ranks the arms and
suggests a dock, and test_export_command.py makes a dataset."""


def parsers(of: argparse.ArgumentParser) -> Iterator[argparse.ArgumentParser]:
    """A parser and all its subcommands' parsers."""
    yield of
    for action in of._actions:
        if isinstance(action, argparse._SubParsersAction):
            for below in action.choices.values():
                yield from parsers(below)


def examples(of: argparse.ArgumentParser) -> list[str]:
    return [line.strip() for line in str(of.epilog).splitlines() if line.startswith("  pbd ")]


def words_of(line: str) -> list[str]:
    """The words of an example, without the remark after three spaces and without pipes and redirections."""
    typed = shlex.split(line.partition("   ")[0])
    return typed[1 : next((k for k, word in enumerate(typed) if word in ("|", ">")), None)]


COMMANDS = [of for of in parsers(parser()) if of.prog != "pbd"]
LINES = sorted({line for of in parsers(parser()) for line in examples(of)})


@pytest.mark.parametrize("of", COMMANDS, ids=lambda of: of.prog)
def test_every_command_has_an_example_of_its_own(of: argparse.ArgumentParser) -> None:
    assert any(line.startswith(of.prog) for line in examples(of))
    assert of.description


@pytest.mark.parametrize("of", [parser(), *COMMANDS], ids=lambda of: of.prog)
def test_every_option_says_what_it_does(of: argparse.ArgumentParser) -> None:
    for action in of._actions:
        assert action.help or isinstance(action, argparse._SubParsersAction), action
    assert all(len(line) <= 120 for line in (*str(of.description).splitlines(), *str(of.epilog).splitlines()))


@pytest.mark.parametrize("line", LINES)
def test_every_example_is_understood(line: str) -> None:
    parser().parse_args(words_of(line))


def in_other_units(recording: Recording) -> str:
    """A table in ms and g, whose header does not say so."""
    assert recording.gyr is not None
    rows = np.column_stack((1e3 * recording.t, recording.acc / GRAVITY, recording.gyr))
    return "t,AccX,AccY,AccZ,gx,gy,gz\n" + "\n".join(",".join(f"{x:.6f}" for x in row) for row in rows)


@pytest.fixture(scope="module")
def desk(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the files that the examples name."""
    folder = tmp_path_factory.mktemp("desk")
    demo = simulate("pour", "wt901", 0)
    recording = demo.recording
    for name in ("tea", "tea1", "tea2", "tea3"):
        write_demo(replace(demo, truth=None), folder / "demos" / name)
    (folder / "run7.csv").write_text(in_other_units(recording), encoding="utf-8")
    (folder / "log.txt").write_bytes(written(DIALECTS["WitMotion 2025"], recording))
    (folder / "robots").mkdir()
    (folder / "robots" / "mine.urdf").write_text(own_urdf(), encoding="utf-8")
    (folder / "robots" / "mine.toml").write_text(own_toml(), encoding="utf-8")
    assert recording.gyr is not None
    counts = np.rint(np.hstack((recording.acc / UNITS[0x51], recording.gyr / UNITS[0x52]))).astype(int).tolist()
    groups = (witmotion.group({witmotion.ACC: row[:3], witmotion.GYR: row[3:]}) for row in counts)
    (folder / "demos" / "tea" / "raw.bin").write_bytes(b"".join(groups))
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        assert main(["calibrate", "dock", "bench", "--position", "0.45", "0", "0.25"]) == 0
    return folder


RUNNABLE = [
    line
    for line in LINES
    if words_of(line)[0] in RUN
    and not " ".join(words_of(line)).startswith(NOT_HERE)
    and ("--html" in line or not line.startswith("pbd replay"))
]


@pytest.mark.parametrize("line", RUNNABLE)
def test_every_example_runs(line: str, desk: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    shutil.copytree(desk, tmp_path / "desk")
    monkeypatch.chdir(tmp_path / "desk")
    monkeypatch.setattr("pbd.sensors.port.list_ports", lambda: ())
    words = ["paper-test2" if word == "pouring" else word for word in words_of(line)]  # the shortest that is bundled
    force = ["--force"] if words[0] in ("import", "simulate") else []
    assert main([*words, *force]) == 0


def test_the_first_look_is_among_them() -> None:
    assert EPILOG.count("  pbd ") == 3


def test_no_command_prints_the_help_as_a_wrong_usage(capsys: pytest.CaptureFixture[str]) -> None:
    assert main([]) == 2
    out, err = capsys.readouterr()
    assert (out, err) == ("", parser().format_help())
