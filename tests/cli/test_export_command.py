"""`pbd export`: formats, files and standard output."""

import io
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from pbd.cli import main
from pbd.files.demo import load_demo, write_demo
from pbd.files.exporters import DATASETS, FORMATS, SUFFIXES
from pbd.io.atomic import refuse_output
from tests.cli.run_command import Capture, refused

pytestmark = pytest.mark.usefixtures("elsewhere")

EXPORT = ("export", "paper-test2", "--robot", "ur5")


def command_of(format_name: str) -> list[str]:
    sampled = [] if FORMATS[format_name].default_hz is None else ["--rate", "20"]
    return ["export", "paper-test2", "--robot", "ur5", *sampled]


FILES = tuple(name for name in FORMATS if name not in DATASETS)


def test_every_format_has_a_suffix_and_is_on_the_page() -> None:
    also = {name for name, each in FORMATS.items() if each.other_suffixes or name in DATASETS}
    assert {*SUFFIXES.values(), *also} == set(FORMATS), "give it a suffix, or other_suffixes if it must be named"
    page = (Path(__file__).parents[2] / "docs" / "exports.md").read_text(encoding="utf-8")
    missing = [name for name in FORMATS if f" | `{name}` | " not in page]
    assert not missing, "add a row to the table of docs/exports.md"


def test_the_hands_path_needs_no_robot(elsewhere: Path, capsys: Capture) -> None:
    assert main(["export", "paper-test1", "--robot", "ur5", "--format", "tum-hand", "-o", "planned.tum"]) == 0
    assert main(["export", "paper-test1", "--format", "tum-hand", "-o", "hand.tum"]) == 0
    assert Path("hand.tum").read_text() == Path("planned.tum").read_text()
    capsys.readouterr()
    assert main(["export", "paper-test1", "-o", "motion.csv"]) == 2
    assert "name the robot: --robot (one of kinova, " in capsys.readouterr().err


def test_the_hands_path_is_told_in_the_hands_own_time(capsys: pytest.CaptureFixture[str]) -> None:
    """The arm's motion has another duration."""
    assert main(["export", "paper-test1", "--robot", "ur5", "--format", "tum-hand", "-o", "hand.tum"]) == 0
    t = np.loadtxt("hand.tum")[:, 0]
    assert capsys.readouterr().err.endswith(f"pbd: wrote hand.tum: {len(t)} poses, {np.ptp(t):.1f} s\n")


def same(ours: bytes, theirs: bytes, format_name: str) -> bool:
    """Whether two files are equal; of an npz its arrays, since a zip has times of its own."""
    if format_name != "npz":
        return ours == theirs
    with np.load(io.BytesIO(ours)) as one, np.load(io.BytesIO(theirs)) as other:
        return one.files == other.files and all((one[name] == other[name]).all() for name in one.files)


@pytest.mark.parametrize("format_name", FILES)
def test_standard_output_and_a_name_with_the_suffix_get_what_the_file_would(
    format_name: str, capfdbinary: pytest.CaptureFixture[bytes]
) -> None:
    command, file = [*command_of(format_name), "-o"], Path("file")
    assert main([*command, "-", "--format", format_name]) == 0
    out, err = capfdbinary.readouterr()
    assert main([*command, "file", "--format", format_name]) == 0
    refuse_output(file)  # not refused: by its beginning, pbd/io/made_by_pbd.py knows that pbd made it
    assert b"pbd: wrote to standard output: " in err
    assert not Path("-").exists()
    assert same(out, file.read_bytes(), format_name)
    for suffix in (suffix for suffix, says in SUFFIXES.items() if says == format_name):
        assert main([*command, f"by-name{suffix.upper()}"]) == 0
        assert same(Path(f"by-name{suffix.upper()}").read_bytes(), out, format_name)


@pytest.mark.parametrize(
    ("ours", "theirs"),
    [
        ("# replace this by your gripper's call, which", "rq_close() #"),
        ("must wait until it has closed\n    sleep(0.8)", "must wait until it has closed\n    rq_close()"),
        ("gripper_open():\n    sleep(0.8)", "gripper_open():\n    rq_open()"),
        ("movej([", "movel(["),
        ("pbd_paper_test2()\n", "pbd_paper_test2()\nrq_open()\n"),
    ],
)
def test_a_program_that_somebody_has_edited_is_not_replaced(
    capsys: pytest.CaptureFixture[str], ours: str, theirs: str
) -> None:
    command = ["export", "paper-test2", "--robot", "ur5", "-o", "tea.script"]
    assert main(command) == 0
    assert main(command) == 0  # nobody has
    program = Path("tea.script").read_text()
    mine = program.replace(ours, theirs)
    assert mine != program
    Path("tea.script").write_text(mine)
    assert main(command) == 1
    assert "tea.script was edited, so it is not overwritten; give another place\n" in capsys.readouterr().err
    assert Path("tea.script").read_text() == mine


def test_several_demonstrations_become_one_dataset(elsewhere: Path, capsys: pytest.CaptureFixture[str]) -> None:
    several = ["export", "paper-test2", "paper-test1", "--robot", "so101", "--json", "-o", "tea"]
    assert main([*several, "--format", "lerobot", "--task", "pour the tea"]) == 0
    out, err = capsys.readouterr()
    assert [(each["demo"], each["episode"]) for each in json.loads(out)["episodes"]] == [
        ("paper-test2", 0),
        ("paper-test1", 1),
    ]
    assert "pbd: lerobot-replay jumps to the first frame, so bring the arm there before: shoulder_pan -0.1, " in err
    info = json.loads((elsewhere / "tea/meta/info.json").read_text())
    assert (info["total_episodes"], info["total_tasks"]) == (2, 1)
    assert main(["export", "paper-test1", "--robot", "so101", "--format", "lerobot", "-o", "tea"]) == 0
    assert "pbd: episode 2 (lerobot-replay --dataset.episode=2)\n" in capsys.readouterr().err


def test_what_is_said_of_all_demonstrations_is_said_once(elsewhere: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_demo(load_demo("paper-test1"), Path("demos/again"))
    several = ["export", "paper-test1", "again", "paper-test2", "--robot", "so101", "--format", "lerobot", "-o", "tea"]
    assert main(several) == 0
    lines = capsys.readouterr().err.splitlines()
    assert len(set(lines)) == len(lines)
    assert [line for line in lines if line.startswith("pbd: torques: at most 28 %")]
    assert [line for line in lines if line.startswith("pbd: paper-test1, again: the move to keyframe 4 goes as the")]
    assert main([*several, "--scale", "9"]) == 3
    assert capsys.readouterr().err.splitlines()[-1].startswith("pbd: paper-test1: keyframe 3 is out of reach: ")


def test_a_reader_that_goes_away_is_no_error() -> None:
    command = f"{sys.executable} -m pbd export paper-test2 --robot ur5 --rate 1000 --format csv -o - | head -1"
    run = subprocess.run(["bash", "-c", command], capture_output=True, text=True, check=False)
    assert run.stdout.startswith("t,q_")
    assert "Traceback" not in run.stderr


def test_what_is_binary_is_not_printed_to_a_terminal(capsys: Capture, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys.stdout, "isatty", lambda: True)
    line = refused(capsys, 2, *EXPORT, "--format", "npz", "-o", "-")
    assert line == "pbd: npz is binary, so it is not printed to a terminal; name a file, or pipe it"
