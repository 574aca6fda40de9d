"""`pbd import` refuses what can't be tracked before it takes a name."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from pbd.cli import main
from pbd.data import GRAVITY
from pbd.files.demo import read_demo, write_demo
from pbd.simulation.simulate import simulate


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


def test_a_table_without_times_is_told_of_the_rate_and_takes_it(in_g: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rows = [line.partition(",")[2] for line in in_g.read_text().splitlines()]
    Path("notime.csv").write_text("\n".join(rows))
    assert main(["import", "notime.csv", "tea", "--unit", "acc=g"]) == 1
    assert "or import it with its --rate HZ" in capsys.readouterr().err
    assert main(["import", "notime.csv", "tea", "--unit", "acc=g", "--rate", "100"]) == 0
    ours, theirs = read_demo(Path("demos/tea")).recording, read_demo(in_g.parent).recording
    assert ours.t == pytest.approx(theirs.t, abs=1e-6)
    assert ours.info.rate_hz == 100.0


def test_a_recording_does_not_replace_the_folder_that_it_is_in(in_g: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Its raw.bin or its edited keyframes.toml would be gone."""
    before = in_g.read_bytes()
    assert main(["import", str(in_g), str(in_g.parent), "--unit", "acc=g", "--force"]) == 1
    assert f"imu.csv is in {in_g.parent}, which it would replace; give another name\n" in capsys.readouterr().err
    assert in_g.read_bytes() == before
