"""What is known of the stops, on the command line."""

import json
import re
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pbd.cli import main

pytestmark = pytest.mark.usefixtures("cached_results")

HERE = """format = 1
name = "tea"
sensor = "simulated modern"
closed = true
"""
STOPS = """
[[place]]
t_s = [5.7, 18.1]
[[contact]]
t_s = 5.7
[[contact]]
t_s = 18.1
"""


@pytest.fixture
def tea(elsewhere: Path) -> Path:
    """The everyday task in ./demos/tea; its demo.toml."""
    assert main(["simulate", "pour", "tea"]) == 0
    return Path("demos/tea/demo.toml")


def keyframes_json(capsys: pytest.CaptureFixture[str], *args: str) -> tuple[list[dict[str, Any]], list[str]]:
    """The keyframes of tea as JSON, and the lines on stderr."""
    capsys.readouterr()
    assert main(["keyframes", "tea", "--json", *args]) == 0
    out, err = capsys.readouterr()
    rows: list[dict[str, Any]] = json.loads(out)["keyframes"]
    return rows, err.splitlines()


def test_keyframes_tells_what_was_known_and_how_it_fitted(tea: Path, capsys: pytest.CaptureFixture[str]) -> None:
    tea.write_text(HERE.replace("true", "false"))
    unknown, told = keyframes_json(capsys)
    assert told == []
    tea.write_text(HERE + STOPS)
    known, told = keyframes_json(capsys)
    number = r"\(off by \d\.\d cm, \d\.\d sigma\)"
    assert len(told) == 1
    assert re.fullmatch(
        rf"pbd: using: the hand returned to its start {number}; "
        rf"the tool at 18\.10 s \(stop 8\) is where it was at 5\.70 s \(stop 2\) {number}; "
        rf"the tool at 18\.10 s \(stop 8\) is on the table as at 5\.70 s \(stop 2\) {number}",
        told[0],
    )
    for before, after in zip(unknown[1:], known[1:], strict=True):
        assert np.all(np.array(after["sigma_m"]) <= np.array(before["sigma_m"]))
        assert np.all(np.array(after["sigma_deg"]) <= np.array(before["sigma_deg"]))
    assert np.linalg.norm(known[-1]["position_m"]) < 1e-3
    told = keyframes_json(capsys, "--method", "paper")[1]
    assert not any("known" in line for line in told)


def test_keyframes_refuses_a_contradiction_in_one_line(tea: Path, capsys: pytest.CaptureFixture[str]) -> None:
    tea.write_text(HERE + "[[contact]]\nt_s = 9.7\nas_at_s = 5.7\n")
    capsys.readouterr()
    for command in (["keyframes"], ["segments"], ["replay", "--robot", "panda", "--html", "page.html"]):
        assert main([command[0], "tea", *command[1:]]) == 1
        out, err = capsys.readouterr()
        assert out == ""
        assert err.startswith(
            f"pbd: {tea} says that the tool at 9.70 s (stop 4) is as high as at 5.70 s (stop 2), "
            "but it is 20 cm off (sigma "
        )
        assert err.endswith(" sigma); remove that [[contact]], or record again\n")
        assert err.count("\n") == 1


def test_the_calibration_of_the_robot_or_of_the_option_says_where_the_table_is(
    tea: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    tea.write_text(HERE + STOPS)
    dock = "[dock]\nposition = [0.45, -0.15, 0.25]\nrpy_deg = [0, 0, 0]\n"
    Path("bench.toml").write_text(f'format = 1\nname = "bench"\ntable_height = 0.151\n{dock}')
    rows, told = keyframes_json(capsys, "--calibration", "bench.toml")
    assert "(stop 2) is on the table (" in told[0]
    rows, told = keyframes_json(capsys, "--calibration", "bench.toml", "--robot", "panda")
    assert [rows[k]["base_position_m"][2] for k in (2, 8)] == pytest.approx([0.151] * 2, abs=0.002)
    Path("bench.toml").write_text(f'format = 1\nname = "bench"\ntable_height = 0.5\n{dock}')
    assert main(["keyframes", "tea", "--calibration", "bench.toml"]) == 1
    assert "is on the table, but it is 35 cm off (" in capsys.readouterr().err


def test_import_says_that_the_hand_ended_where_it_began(tea: Path, capsys: pytest.CaptureFixture[str]) -> None:
    shutil.copy(tea.parent / "imu.csv", "loose.csv")  # without its demo.toml, which says so too
    for option, told in ((), False), (("--closed",), True):
        assert main(["import", "loose.csv", "again", "--force", *option]) == 0
        capsys.readouterr()
        assert main(["keyframes", "again"]) == 0
        assert ("the hand returned to its start" in capsys.readouterr().err) == told
