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


@pytest.fixture
def pulled(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A table in the other convention: a level sensor reads -g on z; nothing in it says so."""
    monkeypatch.chdir(tmp_path)
    demo = simulate("pick-and-place-stops", "ideal", 0)
    write_demo(replace(demo, recording=replace(demo.recording, acc=-demo.recording.acc)), tmp_path / "pulled")
    return tmp_path / "pulled" / "imu.csv"


def test_a_sensor_on_its_head_is_told_and_what_it_says_to_do_helps(
    pulled: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for command in (("import", str(pulled), "tea"), ("keyframes", str(pulled)), ("keyframes", "tea")):
        assert main([*command]) == 0
        assert "at the first rest the sensor lies upside down (z reads -9.8 m/s2), or" in capsys.readouterr().err
    for remedy in (["--unit", "acc=-m/s2"], [word for a in "xyz" for word in ("--column", f"a{a}=-a{a}")]):
        assert main(["import", str(pulled), "tea", "--force", *remedy]) == 0
        assert main(["keyframes", "tea"]) == 0
        assert "upside down" not in capsys.readouterr().err
        assert read_demo(Path("demos/tea")).recording.acc[0, 2] > 0.0


def test_the_devices_own_attitude_refuses_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    demo = simulate("pour", "wt901", 0)
    write_demo(replace(demo, recording=replace(demo.recording, acc=-demo.recording.acc)), tmp_path / "pulled")
    assert main(["import", "pulled/imu.csv", "tea"]) == 1
    assert "with --unit acc=-g" in capsys.readouterr().err
    assert not Path("demos").exists()
    assert main(["import", "pulled/imu.csv", "tea", "--unit", "acc=-m/s2"]) == 0
