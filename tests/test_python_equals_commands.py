"""`pbd.track` and `pbd.plan` give the same motion as `pbd export`, to the byte."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import pbd
from pbd.cli import main
from pbd.data import Calibration, Contact, Demonstration, GraspedObject, HandPath, Place, Robot
from pbd.errors import RecordingError
from pbd.files.demo import write_demo
from pbd.files.exporters import export
from pbd.pose import Pose
from pbd.simulation.hand_motion import Waypoint
from pbd.simulation.simulate import simulate
from pbd.simulation.tasks import HEADING, Task
from pbd.tracking.keyframes import keyframes_of

# Who asks the same is answered the same (tests/test_same_bytes.py).
pytestmark = pytest.mark.usefixtures("cached_results", "unadvised")

BOTTLE = (0.12, 0.05, -0.10)
FETCH = Task(
    "fetch",
    (
        Waypoint(rest_s=1.5),
        Waypoint(BOTTLE, move_s=1.0, rest_s=1.2, grip=True),
        Waypoint((0.12, 0.30, 0.10), move_s=1.3, rest_s=0.7),
        Waypoint(BOTTLE, move_s=1.1, rest_s=1.2, grip=False),
        Waypoint(move_s=1.0, rest_s=1.5),
    ),
    start_rpy=(0.0, 0.0, 0.0),
).rotated(HEADING)
AT_S = (3.1, 7.4)
"""Times at which the simulated hand is at the bottle's place, s."""

BENCH = """format = 1
name = "bench"
{table}
[dock]
position = [0.45, -0.15, 0.25]
rpy_deg = [0, 0, 0]
[sensor]
name = "simulated modern"
[sensor.acc]
bias = [0.01, -0.01, 0.02]
"""
"""A calibration with a bias of the sensor, with a table or without."""


@pytest.fixture(autouse=True)
def tea(elsewhere: Path) -> Demonstration:
    """A simulated demonstration that grips a bottle; ./calibration/bench.toml is there too."""
    Path("calibration").mkdir()
    Path("calibration/bench.toml").write_text(BENCH.format(table=""), encoding="utf-8")
    return replace(simulate(FETCH, "modern", 0), grasped=GraspedObject("cylinder", (0.06, 0.2)), closed=True)


@pytest.fixture(scope="module")
def panda() -> Robot:
    return pbd.load_robot("panda")


def exported(*options: str) -> bytes:
    """The file that `pbd export tea` writes."""
    assert main(["export", "tea", "--robot", "panda", "--format", "ros2-json", "-o", "command.json", *options]) == 0
    return Path("command.json").read_bytes()


def planned(path: HandPath, calibration: Calibration | None, robot: Robot) -> bytes:
    """The file that a program writes by `pbd.plan`."""
    assert calibration is not None
    export(pbd.plan(path, calibration, robot), robot, "ros2-json", Path("program.json"))
    return Path("program.json").read_bytes()


def edit() -> None:
    """Edit keyframes.toml: a longer dwell at one keyframe, another position of the next."""
    assert main(["keyframes", "tea", "--save"]) == 0
    file = Path("demos/tea/keyframes.toml")
    head, *tables = file.read_text(encoding="utf-8").split("\n[[keyframe]]")
    tables[2] = tables[2].replace("dwell_s = ", "dwell_s = 1")
    tables[3] = tables[3].replace("position_m = [0.", "position_m = [0.02")
    file.write_text("\n[[keyframe]]".join([head, *tables]), encoding="utf-8")


def test_an_edited_demonstration_with_an_object(tea: Demonstration, panda: Robot) -> None:
    write_demo(tea, Path("demos/tea"))
    unedited = exported()
    edit()
    edited = exported()
    assert edited != unedited
    assert planned(pbd.track(pbd.load_demo("tea")), panda.dock, panda) == edited
    assert planned(pbd.track(pbd.load_demo("tea").recording), panda.dock, panda) not in (edited, unedited)


@pytest.mark.filterwarnings("ignore::pbd.errors.PbdWarning")  # of what is left out while no calibration is named
@pytest.mark.parametrize("table", ["table_height = 0.0", ""])
def test_known_places_and_a_calibrated_sensor(tea: Demonstration, panda: Robot, table: str) -> None:
    """`plan` applies its calibration to tracking too, and the robot's table if the calibration has none."""
    Path("calibration/bench.toml").write_text(BENCH.format(table=table), encoding="utf-8")
    known = replace(tea, places=(Place(AT_S, (0.57, -0.1, 0.16)),), contacts=(Contact(AT_S[0], sigma_m=0.1),))
    write_demo(known, Path("demos/tea"))
    bench, demo = pbd.load_calibration("bench"), pbd.load_demo("tea")
    command = exported("--calibration", "bench")
    assert planned(pbd.track(demo), bench, panda) == command
    assert planned(pbd.track(demo, calibration=bench), bench, panda) == command
    assert planned(pbd.track(tea), bench, panda) != command


@pytest.mark.filterwarnings("ignore::pbd.errors.PbdWarning")
def test_known_places_of_a_fused_demonstrations_takes(tea: Demonstration, panda: Robot) -> None:
    """A program that tracked without a calibration used to plan without them."""
    write_demo(replace(tea, places=(Place(AT_S, (0.57, -0.1, 0.16)),)), Path("demos/tea1"))
    write_demo(simulate(FETCH, "modern", 1), Path("demos/tea2"))
    assert main(["fuse", "tea1", "tea2", "-o", "tea"]) == 0
    command = exported()
    assert planned(pbd.track(pbd.load_demo("tea")), panda.dock, panda) == command


def test_a_path_keeps_the_calibration_that_it_was_tracked_with(tea: Demonstration, panda: Robot) -> None:
    """Nor is a path tracked again that a program made or changed."""
    bench = pbd.load_calibration("bench")
    path = pbd.track(tea, calibration=bench)
    assert planned(path, replace(bench, sensor=None), panda) == planned(path, bench, panda)
    own = replace(pbd.track(tea), tracking=None)
    assert planned(own, bench, panda) == planned(own, replace(bench, sensor=None), panda)


def test_edited_keyframes_that_start_elsewhere_are_refused(tea: Demonstration) -> None:
    found = keyframes_of(pbd.track(tea))
    turned = replace(found[0], T_nav_sensor=Pose.from_rpy(np.zeros(3), np.radians((0.0, 0.0, 35.0))))
    with pytest.raises(RecordingError, match=r"turned by [45]\.\d degrees, but it is the dock"):
        pbd.track(replace(tea, keyframes=(turned, *found[1:])))


def test_keyframes_that_another_method_found_are_told_from_edited_ones() -> None:
    demo = simulate("pick-and-place-stops", "wt901", 2)
    demo = replace(demo, keyframes=keyframes_of(pbd.track(demo)))
    with pytest.raises(RecordingError, match=r"--calibration that found it \(the method here is paper\)$"):
        pbd.track(demo, "paper")
