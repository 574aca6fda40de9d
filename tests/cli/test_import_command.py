"""`pbd import` refuses what can't be tracked before it takes a name."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from pbd.cli import main
from pbd.data import GRAVITY
from pbd.files.demo import read_demo, write_demo
from pbd.sensors.simulate import simulate


@pytest.fixture
def in_g(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A table whose acceleration is in g, though nothing in it says so."""
    monkeypatch.chdir(tmp_path)
    demo = simulate("pour", "modern", 0)
    write_demo(replace(demo, recording=replace(demo.recording, acc=demo.recording.acc / GRAVITY)), tmp_path / "g")
    return tmp_path / "g" / "imu.csv"


def test_acceleration_in_g_is_told_at_once(in_g: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["import", str(in_g), "tea"]) == 1
    assert "the values are likely in g: import the file with --unit acc=g" in capsys.readouterr().err
    assert not Path("demos").exists()


def test_what_it_says_to_do_helps(in_g: Path) -> None:
    assert main(["import", str(in_g), "tea", "--unit", "acc=g"]) == 0
    assert read_demo(Path("demos/tea")).recording.acc[:, 2].max() > GRAVITY
