"""`pbd touch`, and the options `--frame`, `--at` and `--tolerance`."""

import json
import shlex
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pbd.cli.common import track_demonstration
from pbd.files.calibration import read_calibration
from pbd.files.demo import load_demo, write_demo
from pbd.files.robot import load_robot
from pbd.pipeline import track
from pbd.planning import plan_path
from pbd.replay import replay_scene
from pbd.simulation.simulate import simulate
from tests.cli.run_command import Capture, run, run_json

BENCH = Path("calibration/bench.toml")


@pytest.fixture
def tea(elsewhere: Path) -> Path:
    write_demo(simulate("pick-and-place-stops", "wt901", 2), Path("demos/tea"))
    return Path("demos/tea/keyframes.toml")


@pytest.fixture
def brief(elsewhere: Path) -> Path:
    """One move: planning takes most of the time."""
    write_demo(simulate("pick-and-place-direct", "wt901", 2), Path("demos/tea"))
    return Path("demos/tea/keyframes.toml")


def places(capsys: Capture, *more: str) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    rows = run_json(capsys, "keyframes", "tea", "--robot", "panda", *more)["keyframes"]
    return np.array([row["base_position_m"] for row in rows])


def test_its_advice_can_be_pasted_for_a_name_with_a_space(tea: Path, capsys: Capture) -> None:
    tea.parent.rename("demos/my tea")
    touch = ("touch", "my tea", "2", "--robot", "panda", "--by", "0", "-0.004", "0")
    assert "`pbd touch 'my tea' --robot panda --accept-gap --undo`" in run(capsys, *touch, "--accept-gap")[2]
    assert run(capsys, "touch", "my tea", "--robot", "panda", "--undo")[0] == 0
    _, _, said = run(capsys, *touch)
    head = Path("demos/my tea/keyframes.toml").read_text(encoding="utf-8")
    assert run(capsys, *shlex.split(said.partition("`pbd ")[2].partition("`")[0]))[0] == 0
    assert shlex.split(head.partition("`pbd ")[2].partition("`")[0]) == ["keyframes", "my tea"]


def test_a_place_in_base_has_no_tool_axes(tea: Path, capsys: Capture) -> None:
    code, _, said = run(capsys, "touch", "tea", "2", "--robot", "panda", "--at", "0.5", "0", "0.3", "--tool")
    assert code == 2
    assert "leave --tool out" in said
    assert not tea.exists()


def test_an_editor_may_begin_the_file_with_a_byte_order_mark(tea: Path, capsys: Capture) -> None:
    run(capsys, "keyframes", "tea", "--save")
    tea.write_text(tea.read_text(encoding="utf-8"), encoding="utf-8-sig")
    touch = ("touch", "tea", "2", "--robot", "panda", "--by", "0", "0", "0.01")
    assert run(capsys, *touch)[0] == 0


def test_keyframes_and_the_page_are_as_certain_as_the_touch_up_says(tea: Path, capsys: Capture) -> None:
    run(capsys, "calibrate", "dock", "bench", "--position", "0.45", "-0.1", "0.25")
    bench = ("--calibration", "bench")
    before = run_json(capsys, "keyframes", "tea", *bench)["keyframes"]
    run_json(capsys, "touch", "tea", "1", "--robot", "panda", "--by", "0", "0", "0.001", "--only", *bench)
    told = run_json(capsys, "touch", "tea", "2", "--robot", "panda", "--by", "0", "-0.004", "0", *bench)["keyframes"]
    after = run_json(capsys, "keyframes", "tea", *bench)["keyframes"]
    sigmas = [max(row["base_sigma_m"]) for row in after]
    assert sigmas == pytest.approx([row["sigma_m"] for row in told], rel=1e-3)  # the file's digits
    assert sigmas[1:3] == pytest.approx([0.0005] * 2, rel=0.02)
    assert sigmas[3] < 0.8 * max(before[3]["base_sigma_m"])
    for row in after:
        parts = [each for each in row["base_sigma_parts_m"].values() if each is not None]
        np.testing.assert_allclose(np.sqrt(np.sum(np.square(parts), axis=0)), row["base_sigma_m"])
    assert "touch-ups (mm)" in run(capsys, "keyframes", "tea", *bench)[1]
    shown = replay_scene(plan_path(track(load_demo("demos/tea")), read_calibration(BENCH), load_robot("panda")))
    assert np.sqrt(np.diagonal(shown.cov[2])[:3]) == pytest.approx([0.0005] * 3, rel=0.02)


def test_a_touch_up_made_with_another_dock_is_told(tea: Path, capsys: Capture) -> None:
    """The touch-up corrected the dock's error, which its new place corrects as well: the tool is 4 cm off again."""
    dock = ("calibrate", "dock", "bench", "--position", "0.45")
    bench = ("--robot", "panda", "--calibration", "bench")
    run(capsys, *dock, "-0.1", "0.25")
    run(capsys, "touch", "tea", "2", "--by", "0", "-0.04", "0", *bench)
    assert "was touched up" not in run(capsys, "keyframes", "tea", *bench)[2]
    run(capsys, *dock, "-0.14", "0.25")
    said = run(capsys, "keyframes", "tea", *bench)[2]
    assert said.count("warning: keyframe 2 was touched up where the tool was 4.0 cm from where it is now") == 1
    x, y, z = run_json(capsys, "keyframes", "tea", *bench)["keyframes"][2]["base_position_m"]
    run(capsys, "touch", "tea", "2", "--at", str(x), str(y + 0.04), str(z), *bench)
    assert "was touched up" not in run(capsys, "keyframes", "tea", *bench)[2]


def test_a_place_is_of_the_motion_that_was_tried(tea: Path, capsys: Capture) -> None:
    """The tool of half the motion, with its z straight down, is told to be 1 cm higher: it moves by no more."""
    tried, at = ("--scale", "0.5", "--orientation", "fixed"), ("touch", "tea", "4", "--robot", "panda")
    shown = places(capsys, *tried)[4]
    assert np.linalg.norm(shown - places(capsys)[4]) > 0.05
    run(capsys, *at, "--at", *map(str, np.add(shown, (0.0, 0.0, 0.01))), *tried)
    np.testing.assert_allclose(places(capsys, *tried)[4] - shown, [0.0, 0.0, 0.01], atol=1e-4)
    assert "was touched up" not in run(capsys, "keyframes", "tea", "--robot", "panda", *tried)[2]
    said = run(capsys, "keyframes", "tea", "--robot", "panda", *tried[2:])[2]
    assert said.count("(another calibration, --scale or --orientation, or known places since)") == 1


def test_touching_again_with_another_calibration_is_told(tea: Path, capsys: Capture) -> None:
    """--by is along base's axes, which another dock turns: without --calibration it may be meant for yours."""
    run(capsys, "calibrate", "dock", "bench", "--position", "0.45", "-0.1", "0.25", "--rpy", "0", "0", "90")
    by = ("touch", "tea", "2", "--robot", "panda", "--by", "0", "-0.004", "0")
    said = run(capsys, *by, "--calibration", "bench")[2]
    assert "own dock" not in said
    assert "`pbd touch tea --robot panda --calibration bench --undo` takes it back" in said
    assert "was touched up" not in run(capsys, *by, "--calibration", "bench")[2]
    code, _, said = run(capsys, *by)
    assert code == 0
    assert said.count("warning: keyframe 2 was touched up where the tool was") == 1
    assert "the hand starts at panda's own dock, (0.450, -0.150, 0.250) m in base; for yours give --calibration" in said


def test_a_touch_up_is_kept_followed_and_undone(tea: Path, capsys: Capture) -> None:
    before = places(capsys)
    _, out, said = run(capsys, "touch", "tea", "2", "--robot", "panda", "--by", "0", "-0.004", "0", "--json")
    told = json.loads(out)["keyframes"]
    tea.write_text(f"# mine\n{tea.read_text()}")
    moved = places(capsys) - before
    np.testing.assert_allclose(moved[2], [0.0, -0.004, 0.0], atol=1e-4)  # the file's digits
    np.testing.assert_allclose(moved, [np.subtract(row["to_m"], row["from_m"]) for row in told], atol=2e-4)
    assert 0.001 < np.linalg.norm(moved[3]) < 0.006
    assert all(row["sigma_m"] < row["sigma_before_m"] for row in told)
    assert run(capsys, *said.partition("`pbd ")[2].partition("`")[0].split())[0] == 0
    np.testing.assert_allclose(places(capsys), before, atol=2e-4)
    assert "undone = true" in tea.read_text()
    assert tea.read_text().startswith("# mine\n")
    assert "no touch-up to undo" in refused_line(capsys, "touch", "tea", "--robot", "panda", "--undo")


def test_undo_removes_the_file_that_only_touch_ups_made(tea: Path, capsys: Capture) -> None:
    touch, undo = ("touch", "tea", "2", "--robot", "panda"), ("touch", "tea", "--robot", "panda", "--undo")
    for by in ("0.01", "-0.02"):
        assert run(capsys, *touch, "--by", "0", "0", by)[0] == 0
    assert run(capsys, *undo)[0] == 0
    assert tea.exists()
    assert "which nobody had edited, is removed" in run(capsys, *undo)[2]
    assert not tea.exists()
    run(capsys, "keyframes", "tea", "--save")
    saved = tea.read_text()
    run(capsys, *touch, "--by", "0", "0", "0.01")
    run(capsys, *undo)
    assert tea.read_text().startswith(saved)


def test_undo_keeps_a_keyframe_that_a_person_added(tea: Path, capsys: Capture) -> None:
    run(capsys, "touch", "tea", "2", "--robot", "panda", "--by", "0", "0", "0.01")
    added = "[[keyframe]]\nt_s = 60.0\ndwell_s = 0.5\nposition_m = [0.1, 0.0, 0.0]\nrpy_deg = [0.0, 0.0, 0.0]\n"
    tea.write_text(tea.read_text() + added)
    assert run(capsys, "touch", "tea", "--robot", "panda", "--undo")[0] == 0
    assert added in tea.read_text()


def test_millimetres_for_metres_are_refused_and_nothing_is_written(tea: Path, capsys: Capture) -> None:
    said = refused_line(capsys, "touch", "tea", "2", "--robot", "panda", "--by", "0", "-4", "0")
    assert "that is 4.00 m away" in said
    assert not tea.exists()


def test_a_motion_of_a_hundred_metres_is_refused_and_nothing_is_written(tea: Path, capsys: Capture) -> None:
    touch = ("touch", "tea", "2", "--robot", "panda", "--by", "0", "0", "0.01")
    assert "beyond any arm's reach; correct --scale, or the dock" in refused_line(capsys, *touch, "--scale", "1000")
    assert not tea.exists()


def test_what_another_command_saved_meanwhile_stays(
    tea: Path, capsys: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    def tracked(*args: Any) -> Any:
        found = track_demonstration(*args)
        tea.write_text("another's")
        return found

    monkeypatch.setattr("pbd.cli.touch.track_demonstration", tracked)
    said = refused_line(capsys, "touch", "tea", "2", "--robot", "panda", "--by", "0", "0", "0.01")
    assert said.endswith(
        "another command wrote demos/tea/keyframes.toml meanwhile, so nothing is saved; run this one again"
    )
    assert tea.read_text() == "another's"


def test_where_it_belongs_may_be_given_in_base_or_in_the_tools_axes(tea: Path, capsys: Capture) -> None:
    run(capsys, "touch", "tea", "1", "--robot", "panda", "--at", "0.45", "-0.1", "0.36")
    at = places(capsys)[1]
    np.testing.assert_allclose(at, [0.45, -0.1, 0.36], atol=1e-4)
    run(capsys, "touch", "tea", "1", "--robot", "panda", "--by", "0", "0", "0.01", "--tool", "--only")
    assert places(capsys)[1][2] == pytest.approx(at[2] - 0.01, abs=3e-4)  # the tool points down


def test_a_touch_up_that_no_error_of_tracking_explains_is_told(tea: Path, capsys: Capture) -> None:
    far = ("touch", "tea", "2", "--robot", "panda", "--by", "0.1", "0", "0")
    assert "hardly" not in run(capsys, "touch", "tea", "2", "--robot", "panda", "--by", "0", "0", "0")[2]
    told = "pbd: warning: keyframe 2 was off by 10.0 cm, "
    assert told in run(capsys, *far)[2]
    assert run(capsys, "touch", "tea", "--robot", "panda", "--undo")[0] == 0
    assert told in run(capsys, *far, "--json")[2]
    assert told not in run(capsys, *far, "--only")[2]


def test_nudges_are_in_base_or_tool_axes(tea: Path, capsys: Capture) -> None:
    before = places(capsys)
    run(capsys, "keyframes", "tea", "--save")
    lines = tea.read_text().replace("[[keyframe]] # 1", "[[keyframe]] # 1\nnudge_base_m = [0.01, 0, 0]")
    tea.write_text(lines.replace("[[keyframe]] # 2", "[[keyframe]] # 2\nnudge_tool_m = [0, 0, 0.02]"))
    moved = places(capsys) - before
    np.testing.assert_allclose(moved[1], [0.01, 0.0, 0.0], atol=2e-4)
    np.testing.assert_allclose(moved[2], [0.0, 0.0, -0.02], atol=6e-4)
    np.testing.assert_allclose(moved[3:], 0.0, atol=2e-4)


def test_a_thing_that_stands_elsewhere_takes_its_keyframes_along(tea: Path, capsys: Capture) -> None:
    run(capsys, "keyframes", "tea", "--frame", "tray=2..4", "--frame", "cup=3@tray")
    shown = places(capsys)
    moved = places(capsys, "--at", "tray=0.5,0.1,0.3,90")
    np.testing.assert_allclose(moved[2], [0.5, 0.1, 0.3], atol=1e-9)
    x, y, z = shown[4] - shown[2]
    np.testing.assert_allclose(moved[4] - moved[2], [-y, x, z], atol=1e-9)
    np.testing.assert_array_equal(moved[:2], shown[:2])
    both = places(capsys, "--at", "tray=0.5,0.1,0.3,90", "--at", "cup=0.4,0.2,0.4")
    np.testing.assert_allclose(both[3], [0.4, 0.2, 0.4], atol=1e-9)
    np.testing.assert_allclose(both[[2, 4]], moved[[2, 4]], atol=1e-9)
    found = run_json(capsys, "keyframes", "tea", "--robot", "panda")["frames"]
    assert [(each["name"], each["keyframes"]) for each in found] == [("tray", [2, 3, 4]), ("cup", [3])]
    np.testing.assert_allclose(found[1]["base_position_m"], shown[3])


def test_what_stands_on_a_thing_goes_with_what_carries_that(tea: Path, capsys: Capture) -> None:
    frames = ("tray=2", "cup=2..3@tray", "lid=4@cup", "cup=1")
    run(capsys, "keyframes", "tea", *(word for frame in frames for word in ("--frame", frame)))
    shift = places(capsys, "--at", "tray=0.5,0.1,0.3") - places(capsys)
    np.testing.assert_allclose(shift[3:], shift[[2, 2]], atol=1e-9)
    np.testing.assert_array_equal(shift[:2], 0.0)


def test_a_keyframe_that_is_given_to_another_thing_is_told(tea: Path, capsys: Capture) -> None:
    run(capsys, "keyframes", "tea", "--frame", "cup=1..2")
    tea.write_text(tea.read_text() + "# mine\n")
    err = run(capsys, "keyframes", "tea", "--frame", "lid=2..3")[2]
    assert err.count("no longer does") == 1
    assert "pbd: keyframe 2 belonged to cup and no longer does\n" in err
    assert tea.read_text().endswith("# mine\n")  # only the keyframes' things were edited


def test_a_touch_up_that_no_other_keyframe_follows_is_told(brief: Path, capsys: Capture) -> None:
    said = "the others hardly move: their errors have little in common with those of keyframe "
    words = ("touch", "tea", "1", "--robot", "panda", "--by", "0", "0")
    assert said not in run(capsys, *words, "0.0001")[2]  # nothing moves by much
    assert f"{said}1\n" in run(capsys, *words, "0.001")[2]


def test_out_of_reach_names_a_place_that_works(brief: Path, capsys: Capture) -> None:
    run(capsys, "keyframes", "tea", "--frame", "my cup=1")
    command = ("export", "tea", "--robot", "panda", "-o", "x.npz")
    _, _, err = run(capsys, *command, "--at", "my cup=0.5,1.2,0.3")
    line = err.splitlines()[-1]
    assert line.startswith("pbd: keyframe 1 is out of reach")
    assert "--scale" not in line  # the cup stands where it stands
    works = line.rpartition("shown (")[2].removesuffix(" works)")
    assert run(capsys, *command, *shlex.split(works))[0] == 0


def test_a_touch_up_is_undone_with_the_calibration_that_it_was_refused_with(brief: Path, capsys: Capture) -> None:
    """With another one, a place in base that demo.toml knows contradicts the path."""
    run(capsys, "calibrate", "dock", "bench", "--position", "0.45", "-0.15", "0.25", "--rpy", "0", "0", "0")
    by = ("--robot", "panda", "--calibration", "bench")
    run(capsys, "touch", "tea", "0", *by, "--by", "0.45", "0", "0")
    _, _, err = run(capsys, "replay", "tea", "--json", *by)
    assert "(`pbd touch tea --robot panda --calibration bench --undo`)" in err


@pytest.mark.parametrize("command", [("replay", "tea", "--json"), ("keyframes", "tea")])
def test_out_of_reach_after_a_touch_up_tells_how_to_undo_it(
    brief: Path, capsys: Capture, command: tuple[str, ...]
) -> None:
    run(capsys, "touch", "tea", "0", "--robot", "panda", "--by", "0.45", "0", "0")
    _, _, err = run(capsys, *command, "--robot", "panda")
    advice = "undo the touch-up that moved keyframe 0 by 45.0 cm (`pbd touch tea --robot panda --undo`)"
    assert err.splitlines()[-1].endswith(f", or {advice}")
    assert "undo" not in run(capsys, *command, "--robot", "panda", "--scale", "5")[2]  # it would not help
    assert run(capsys, "touch", "tea", "--robot", "panda", "--undo")[0] == 0
    assert run(capsys, *command, "--robot", "panda")[0] == 0


@pytest.mark.parametrize("command", [("replay", "tea", "--json"), ("keyframes", "tea")])
def test_out_of_reach_after_a_nudge_tells_to_remove_it(brief: Path, capsys: Capture, command: tuple[str, ...]) -> None:
    run(capsys, "keyframes", "tea", "--save")
    brief.write_text(brief.read_text().replace("[[keyframe]] # 1", "[[keyframe]] # 1\nnudge_base_m = [0.45, 0, 0.45]"))
    _, _, err = run(capsys, *command, "--robot", "panda")
    advice = "remove the nudge that moved keyframe 1 by 63.6 cm (in demos/tea/keyframes.toml)"
    assert err.splitlines()[-1].endswith(f", or {advice}")
    assert "nudge" not in run(capsys, *command, "--robot", "panda", "--scale", "5")[2]  # it would not help


def test_success_is_told_with_the_joint_distribution(tea: Path, capsys: Capture) -> None:
    loose, tight = (
        run_json(capsys, "keyframes", "tea", "--robot", "panda", "--tolerance", within) for within in ("0.05", "0.005")
    )
    assert loose["success"]["band"] == "over 90 %"
    assert tight["success"]["band"] == "under 50 %"
    shown = run(capsys, "keyframes", "tea", "--robot", "panda", "--tolerance", "0.05")[1]
    assert "\nprobability that all keyframes are within the tolerance: over 90 %\n" in shown
    each = [row["probability"] for row in tight["keyframes"]]
    assert np.prod(each) < tight["success"]["probability"] <= min(each)


def refused_line(capsys: Capture, *command: str) -> str:
    """Run a command that fails; return its last line on stderr."""
    code, _, err = run(capsys, *command)
    assert code == 1
    return err.splitlines()[-1]
