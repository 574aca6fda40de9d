"""Simulated calibration tasks: each leads to its step of `pbd calibrate`; the guide's commands print what it says."""

import json
import re
import shlex
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from pbd.cli import main
from pbd.data import Calibration
from pbd.files.calibration import read_calibration
from pbd.files.points import read_points
from pbd.pose import Pose, quat_about_z
from pbd.simulation.calibration_tasks import CALIBRATION_TASKS, DOCK, PIVOT_TIP, TOUCHED, YAW_WORLD_BASE
from pbd.simulation.sensor_model import SENSOR_MODELS
from pbd.simulation.simulate import simulate
from tests.calibration.device_errors import device
from tests.docs_pages import ROOT, blocks
from tests.not_none import not_none

pytestmark = pytest.mark.usefixtures("elsewhere")

Capture = pytest.CaptureFixture[str]
GUIDE = ROOT / "docs" / "calibration.md"
NUMBER = re.compile(r"[-+]?\d+(?:\.\d+)?")


def check_nav(calibration: Calibration) -> None:
    """Compare with the dock of the task, within four of the reported sigmas."""
    assert calibration.T_base_nav is not None
    assert calibration.cov_base is not None
    off = Pose(np.array(DOCK), quat_about_z(-YAW_WORLD_BASE)).inverse() @ calibration.T_base_nav
    assert (np.abs(calibration.T_base_nav.p - DOCK) < 4.0 * np.sqrt(np.diagonal(calibration.cov_base))[:3]).all()
    assert 2.0 * abs(off.wxyz[3]) < 4.0 * np.sqrt(calibration.cov_base[5, 5])


def check_tip(calibration: Calibration) -> None:
    sigma = np.sqrt(np.trace(not_none(calibration.cov_sensor_tool)[:3, :3]))
    assert np.linalg.norm(calibration.T_sensor_tool.p - PIVOT_TIP) < 4.0 * sigma


def check_sensor(calibration: Calibration) -> None:
    assert calibration.sensor is not None
    _, bias = device(SENSOR_MODELS["wt901"], 7)["gyr"]
    assert not_none(calibration.sensor.gyr).bias == pytest.approx(bias, abs=np.radians(0.03))


@pytest.mark.parametrize(("task", "check"), [("touch", check_nav), ("pivot", check_tip), ("sides", check_sensor)])
def test_what_is_told_to_try_finds_the_truth(task: str, check: Callable[[Calibration], None], capsys: Capture) -> None:
    assert main(["simulate", task, "my demos/a", "--sensor-model", "wt901", "--seed", "7"]) == 0
    line = capsys.readouterr().err.splitlines()[-1]
    assert line.startswith("pbd: try it: pbd calibrate ")
    words = shlex.split(line.removeprefix("pbd: try it: pbd "))
    assert main(words) == 0
    check(read_calibration(Path(f"calibration/{words[2]}.toml")))


@pytest.mark.parametrize("task", CALIBRATION_TASKS)
def test_a_task_is_closed_where_its_sensor_returns(task: str) -> None:
    """In "pivot" only the tip returns, not the sensor."""
    demo = simulate(task, "ideal")
    assert demo.closed == bool(np.linalg.norm(not_none(demo.truth).p_nav_sensor[-1]) < 1e-6)


def test_every_calibration_task_is_tried_above() -> None:
    from pbd.cli.simulate import NEXT_COMMAND

    assert set(NEXT_COMMAND) == set(CALIBRATION_TASKS) == {"touch", "pivot", "sides"}


def test_the_points_lie_beside_the_demonstration(capsys: Capture) -> None:
    assert main(["simulate", "touch", "a", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["points"] == "demos/a/points.csv"
    points = read_points(Path(told["points"]))
    assert points == {name: pytest.approx(point) for name, point in TOUCHED.items()}
    listed = [line.strip() for line in GUIDE.read_text(encoding="utf-8").splitlines()]
    begin = listed.index("name,x_mm,y_mm,z_mm")
    assert listed[begin : begin + 7] == Path(told["points"]).read_text(encoding="utf-8").splitlines()[1:]


def test_the_guides_commands_print_what_it_says(capsys: Capture) -> None:
    """The same words. Figures depend on the tracker, so they are nearly the same; results are near the truth."""
    commands = 0
    printed = ""
    for line in "".join(blocks(GUIDE, "sh")).splitlines():
        if line.startswith("pbd "):
            capsys.readouterr()
            assert main(shlex.split(line)[1:]) == 0, line
            commands += 1
            printed = re.sub(r"\s+", " ", "".join(capsys.readouterr()))
        else:
            said = line.removeprefix("# ")
            pattern = "([-+]?[0-9.]+)".join(map(re.escape, NUMBER.split(said)))
            found = re.search(pattern, printed)
            assert found is not None, f"{said!r} is not in {printed!r}"
            for shown, true in zip(NUMBER.findall(said), found.groups(), strict=True):
                last_digit = 10.0 ** -len(shown.partition(".")[2])
                assert float(true) == pytest.approx(float(shown), rel=0.3, abs=5.0 * last_digit)
    assert commands == 9
    check_nav(read_calibration(Path("calibration/trial.toml")))
    check_tip(read_calibration(Path("calibration/trial-tip.toml")))


def test_the_tip_stays_and_the_dock_is_returned_to() -> None:
    assert CALIBRATION_TASKS["touch"].closed
    assert CALIBRATION_TASKS["touch"].start_rpy[2] == pytest.approx(np.radians(30.0) + YAW_WORLD_BASE)
    assert {waypoint.p for waypoint in CALIBRATION_TASKS["pivot"].waypoints} == {(0.0, 0.0, 0.0)}
    assert len([w for w in CALIBRATION_TASKS["sides"].waypoints if w.rest_s >= 2.0]) == 12


def test_the_heading_of_a_start_with_another_heading_is_less_certain_until_the_sensor_is_calibrated(
    capsys: Capture,
) -> None:
    for task in ("touch", "sides"):
        assert main(["simulate", task, task, "--sensor-model", "wt901", "--seed", "7"]) == 0
    points = ["calibrate", "points", "bench", "touch", "--points", "demos/touch/points.csv"]
    for known in (
        r"at that point \(to 3 mm: --sigma-mm\); with another heading there, nav's is known to [12]\.\d degrees only",
        r"at that point \(to 3 mm: --sigma-mm\)$",
    ):
        assert main(points) == 0
        assert re.search(known, capsys.readouterr().err.rstrip())
        assert main(["calibrate", "sensor", "bench", "sides", "--latitude", "46"]) == 0
        capsys.readouterr()
