"""`pbd check` and `check_all`: unusable and differing demonstrations, and other backends of joblib."""

import os
import shutil
import signal
from dataclasses import replace
from pathlib import Path

import joblib
import numpy as np
import pytest

from pbd import check_all
from pbd.check_demos import DemoCheck, check_one, compare_siblings
from pbd.cli import main
from pbd.data import Demonstration
from pbd.errors import WrongValueError
from pbd.files.demo import load_demo, write_demo
from pbd.pose import quat_about_z, quat_rotate
from pbd.simulation.hand_motion import Waypoint
from pbd.simulation.simulate import random_task, simulate
from pbd.simulation.tasks import Task
from tests.cli.run_command import Capture, refused, run, run_json


@pytest.fixture
def takes(elsewhere: Path) -> list[str]:
    """Two valid takes, and one without samples."""
    write_demo(simulate("pick-and-place-stops", "modern", 0), Path("demos/tea1"))
    shutil.copytree("demos/tea1", "demos/tea2")
    shutil.copytree("demos/tea1", "demos/broken")
    Path("demos/broken/imu.csv").write_text("t,ax,ay,az\n")
    return ["tea1", "broken", "tea2"]


def test_each_is_told_in_its_own_row_and_the_worst_comes_first(takes: list[str], capsys: Capture) -> None:
    code, out, err = run(capsys, "check", *takes)
    assert code == 1
    assert err == "pbd: 1 of 3 can't be used: broken; leave them out, or put right what is said of each\n"
    assert [line.split()[0] for line in out.splitlines()[2:5]] == ["broken", "tea1", "tea2"]
    found = run_json(capsys, "check", "tea2", "tea1", "--robot", "ur5")["demos"]
    assert [row["keyframes"] for row in found] == [5, 5]
    assert found[0]["motion_s"] == found[1]["motion_s"] > 1.0


def test_one_that_was_set_aside_is_left_out_beside_others(takes: list[str], capsys: Capture) -> None:
    shutil.copytree("demos/tea1", "demos/tea1.before")
    code, out, err = run(capsys, "check", "demos/tea1", "demos/tea1.before")
    left_out = "left out, because they were set aside: demos/tea1.before; a name alone, without its folder, is used"
    assert (code, err) == (0, f"pbd: {left_out}\n")
    assert "tea1.before" not in out
    assert [row["name"] for row in run_json(capsys, "check", "tea1.before")["demos"]] == ["tea1.before"]


@pytest.mark.parametrize(
    ("command", "said"),
    [
        (("fuse", "-o", "x"), "no demonstration named 'demos/a'"),
        (("plot", "--csv"), "are for the spread of several demonstrations"),
        (("export", "--robot", "ur5", "-o", "x.csv"), "no demonstration named 'demos/a'"),
    ],
)
def test_other_commands_leave_it_out_too(capsys: Capture, command: tuple[str, ...], said: str) -> None:
    code, _, err = run(capsys, *command, "demos/a", "demos/a.before")
    *before, line = err.splitlines()
    assert code != 0
    assert said in line
    assert before[0].startswith("pbd: left out, because they were set aside: demos/a.before; ")
    both = run(capsys, *command, "a", "a.before")[2]
    assert "left out" not in both


def test_no_process_is_started_without_a_demonstration(takes: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    started = []

    def parallel(n_jobs: int, return_as: str) -> object:
        started.append(n_jobs)
        return Parallel(n_jobs=1, return_as=return_as)

    Parallel = joblib.Parallel
    monkeypatch.setattr(joblib, "Parallel", parallel)
    check_all(takes[:2], jobs=200)
    assert started == [2]


def test_no_demonstrations_are_no_results_with_any_jobs() -> None:
    assert check_all([], jobs=2) == ()


def test_no_jobs_at_all_are_refused() -> None:
    with pytest.raises(WrongValueError, match="jobs must be 1 or more, or -1 for one process per core, got 0"):
        check_all(["pouring"], jobs=0)


def test_a_killed_process_is_told_in_one_line(monkeypatch: pytest.MonkeyPatch, capsys: Capture) -> None:
    monkeypatch.setattr("pbd.check_demos.check_one", lambda name, arm, accept_gap: os.kill(os.getpid(), signal.SIGKILL))
    line = refused(capsys, 1, "check", "pouring", "paper-test1", "--jobs", "2")
    assert line == "pbd: a process was killed, most often for want of memory; give fewer --jobs"


def test_a_sensor_that_lies_upside_down_is_told(takes: list[str]) -> None:
    demo = load_demo("pouring")
    signs = np.array([1.0, -1.0, -1.0])  # turned about its x axis
    assert demo.recording.gyr is not None
    acc, gyr = demo.recording.acc * signs, demo.recording.gyr * signs
    turned = replace(demo.recording, acc=acc, gyr=gyr, mag=None, device_rpy=None)
    write_demo(Demonstration(turned), Path("demos/turned"))
    first, *others = check_one("turned").findings
    assert "at the first rest the sensor lies upside down" in first
    assert first not in others


def test_a_name_that_is_misspelled_is_corrected() -> None:
    assert check_one("pourin").why.endswith("nor a file or folder of that path; did you mean pouring?")


def test_one_that_is_not_there_is_named_once(takes: list[str], capsys: Capture) -> None:
    _, _, err = run(capsys, "check", "demos/none")
    assert err.count("demos/none") == 1


def test_one_that_stops_once_cannot_be_used(takes: list[str], capsys: Capture) -> None:
    write_demo(simulate(Task("once", (Waypoint(rest_s=3.0),)), "modern"), Path("demos/once"))
    assert check_one("once").why.startswith("the demonstration has 1 stop, but a motion needs two; ")
    code, _, err = run(capsys, "check", "once")
    assert (code, err) == (1, "pbd: 1 of 1 can't be used: once; leave them out, or put right what is said of each\n")


def test_a_gap_in_a_rest_can_be_accepted(takes: list[str], capsys: Capture) -> None:
    """By the commands that track many demonstrations or plan for many arms, too."""
    demo = load_demo("pouring")
    kept = np.delete(np.arange(len(demo.recording)), slice(60, 120))
    held = {name: getattr(demo.recording, name)[kept] for name in ("t", "acc", "gyr", "mag")}
    write_demo(replace(demo, recording=replace(demo.recording, device_rpy=None, **held)), Path("demos/gap"))
    assert "give --accept-gap to each command" in check_one("gap").why
    assert main(["check", "gap", "--accept-gap"]) == 0
    assert main(["robots", "panda", "--for", "gap", "--accept-gap", "--json"]) == 0
    capsys.readouterr()
    assert refused(capsys, 1, "robots", "--for", "gap", "--calibration", "nix").startswith("pbd: no calibration named")


def test_what_stops_the_robot_is_told(takes: list[str]) -> None:
    toml = Path("demos/tea1/keyframes.toml")
    assert main(["keyframes", "tea1", "--save"]) == 0
    lines = toml.read_text().splitlines()
    last = max(i for i, line in enumerate(lines) if line.startswith("position_m"))
    toml.write_text("\n".join([*lines[:last], "position_m = [3.0, 0.0, 0.0]", *lines[last + 1 :]]))
    (check,) = check_all(takes[:1], robot="so101")
    assert check.refused.startswith("so101: keyframe 4 ")
    assert not check.usable
    assert check.findings == check_all(takes[:1])[0].findings


def test_places_known_in_base_are_used_on_the_robots_dock(takes: list[str]) -> None:
    with Path("demos/tea1/demo.toml").open("a") as file:
        file.write("[[place]]\nt_s = [0.5]\nposition_m = [0.45, -0.15, 0.25]\n")  # panda's own dock
    alone, planned = check_one("tea1"), check_all(["tea1"], robot="panda")[0]
    assert "it counts only with a robot or a --calibration" in str(alone.findings)
    assert planned.findings == ()


def test_what_the_plan_warns_of_is_told(takes: list[str]) -> None:
    """Five joints can't turn the gripper as the hand did: the motion is audited all the same, so a person must look."""
    write_demo(simulate(random_task(seed=2, moves=6), "os5000", seed=2), Path("demos/turns"))
    alone, planned = check_one("turns"), check_all(["turns"], robot="so101")[0]
    assert planned.usable
    assert not any("can't match the hand's orientation" in words for words in alone.findings)
    assert any("can't match the hand's orientation" in words for words in planned.findings)
    assert planned.findings[: len(alone.findings)] == alone.findings


def sibling(name: str, off_m: float) -> DemoCheck:
    p = np.array([[0.0, 0.0, 0.0], [0.3 + off_m, 0.0, 0.0]])
    return DemoCheck(name, p_dock_sensor=p, sigma_m=0.001)


def test_one_that_differs_from_its_siblings_is_named() -> None:
    """Their scatter and its own sigma give the bound. With three demonstrations none is named."""
    offs = (0.0, 0.002, -0.002, 0.003, 0.05)
    checks = compare_siblings([sibling(str(off), off) for off in offs])
    assert [bool(check.differs) for check in checks] == [False, False, False, False, True]
    assert checks[-1].differs == ("keyframe 1 is 5 cm from where the 4 like it have theirs",)
    assert not any(check.differs for check in compare_siblings([sibling(str(off), off) for off in offs[2:]]))
    p = [np.array(check.p_dock_sensor)[[0, 1, 1, 0, 1]] for check in checks]
    more = compare_siblings([replace(check, p_dock_sensor=there) for check, there in zip(checks, p, strict=True)])
    told = "keyframes 1, 2, 4 are up to 5 cm from where the 4 like it have theirs"
    assert more[-1].differs == (told,)
    warned = replace(more[-1], warnings=("the gyro is wrong",), findings=("the gyro is wrong", "too short"))
    assert warned.remarks == ("the gyro is wrong", told, "too short")
    other = replace(sibling("grips", 0.05), grips=((1, True),))
    assert not compare_siblings([*(sibling(str(off), off) for off in offs[:4]), other])[-1].differs


def test_one_whose_sensor_was_turned_in_the_hand_is_told_in_one_line() -> None:
    way = 0.1 * np.random.default_rng(0).normal(size=(5, 3)) * (np.arange(5) > 0)[:, None]
    ways = [quat_rotate(quat_about_z(np.radians(turn)), way) for turn in (0.0, 0.2, 90.0, 0.1, 180.0, -0.2)]
    found = compare_siblings([DemoCheck(f"tea{k}", p_dock_sensor=p, sigma_m=0.002) for k, p in enumerate(ways)])
    told = [check.differs for check in found]
    turned = "the sensor is turned by {}° about the vertical against the 5 like it"
    assert told == [(), (), (turned.format(90),), (), (turned.format(180),), ()]
    up = [replace(check, p_dock_sensor=0.1 * np.array(check.p_dock_sensor), differs=()) for check in found]
    assert not any("turned" in words for check in compare_siblings(up) for words in check.differs)


@pytest.mark.filterwarnings("default")  # of Dask's own
def test_a_local_dask_cluster_does_the_same(takes: list[str]) -> None:
    from distributed import Client, LocalCluster

    folders = [str(Path("demos", name).resolve()) for name in takes]
    options = {"n_workers": 1, "threads_per_worker": 1, "dashboard_address": None}
    with LocalCluster(host="127.0.0.1", **options) as cluster, Client(cluster), joblib.parallel_config("dask"):
        there = check_all(folders)
    here = check_all(folders)
    assert [check.why for check in there] == [check.why for check in here]
    assert there[0].sigma_m == here[0].sigma_m
