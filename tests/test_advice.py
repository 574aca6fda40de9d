"""The advice in a refusal has been tried and works, and messages about a motion are true."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pbd.arm.collision.scene import CollisionScene
from pbd.arm.motion_request import Motion
from pbd.cli.plan_report import remarks, unfollowed
from pbd.data import Obstacle
from pbd.errors import PlanError, RobotError
from pbd.files.demo import load_demo
from pbd.pipeline import track
from pbd.planning import PlanOptions, arm_of, choose_joints, plan_keyframes, plan_path
from pbd.planning.object_frames import ThingPlace, nearest_working_place
from pbd.planning.task import PlanningTask
from pbd.pose import Pose
from pbd.simulation.hand_motion import Waypoint
from pbd.simulation.simulate import simulate
from pbd.simulation.tasks import Task
from tests.cli.run_command import Capture, run
from tests.not_none import not_none
from tests.planned_keyframes import PANDA, TURN, UR5, dock, keyframe, low, planned
from tests.reading_meshes import read_mesh


def test_other_options_are_named_where_they_work() -> None:
    with pytest.raises(PlanError, match=r"; raise the keyframe or the dock, or view .* --allow-collision$"):
        plan_keyframes(*low(), PANDA)
    high = replace(dock(), obstacles=(Obstacle("the lamp", "sphere", (0.2,), arm_of(PANDA).forward(PANDA.home)),))
    options = PlanOptions(approach=False)
    with pytest.raises(PlanError, match=r"^home of panda: .*, or do not go back home \(--no-retreat\)$"):
        plan_keyframes([keyframe(0.0, y=0.3), keyframe(1.0, y=0.3, z=0.05)], high, PANDA, options)


def test_what_no_motion_avoids_is_not_searched_for_again(monkeypatch: pytest.MonkeyPatch) -> None:
    searched = []

    def choose(task: PlanningTask, scene: CollisionScene | None) -> Motion | choose_joints.PlanRefusal:
        searched.append(scene is not None)
        return choose_once(task, scene)

    choose_once = choose_joints._choose
    monkeypatch.setattr(choose_joints, "_choose", choose)
    with pytest.raises(PlanError, match="--allow-collision"):
        plan_keyframes(*low(), PANDA)
    assert searched == [True, False]


def test_options_that_do_not_work_either_are_not_named() -> None:
    """The line past the arm's base can't be followed. The other line is blocked, and so is the straight move."""
    own = UR5.dock or dock()
    past_base = [keyframe(0.0, x=-0.3, y=-0.2, z=0.2), keyframe(1.0, x=-0.3, y=0.6, z=0.2)]
    with pytest.raises(PlanError, match=r"can't follow the straight line .*; move the dock, or use --path keyframes$"):
        plan_keyframes(past_base, own, UR5, PlanOptions(path="line", approach=False, retreat=False))
    with pytest.raises(PlanError, match=r"the straight line .*; move the dock, or leave out --path-tolerance$"):
        plan_keyframes(past_base, own, UR5, PlanOptions(tolerance_m=0.01, approach=False, retreat=False))
    with pytest.raises(PlanError, match=r"; raise the keyframe or the dock, or view .* --allow-collision$"):
        plan_keyframes(*low(), PANDA, PlanOptions(path="line"))


def test_a_path_that_touches_something_may_be_left_where_that_helps() -> None:
    """A ball in the middle of the line, too thick to pass between the fingers; the arm can go around it."""
    pytest.importorskip("ompl")
    ends, middle = [keyframe(0.0), keyframe(1.0, y=0.3)], Pose(np.array([0.45, 0.0, 0.25]), TURN)
    blocked = replace(dock(), obstacles=(Obstacle("the ball", "sphere", (0.1,), middle),))
    for options, advice in (
        (PlanOptions(path="line"), "use --path keyframes"),
        (PlanOptions(tolerance_m=0.001), "leave out --path-tolerance"),
    ):
        with pytest.raises(
            PlanError, match=f"would touch the ball, .*; move the dock or the obstacle, or {advice}, or "
        ):
            plan_keyframes(ends, blocked, PANDA, options)


def test_a_move_that_cannot_be_followed_is_blamed_not_the_next_one() -> None:
    """The first line passes the arm's base; each of the others can be followed alone."""
    own = UR5.dock or dock()
    places = ((-0.3, -0.2), (-0.3, 0.6), (-0.6, -0.2), (-0.3, -0.2), (-0.1, -0.2))
    keyframes = [keyframe(float(i), x=x, y=y, z=0.2) for i, (x, y) in enumerate(places)]
    options = PlanOptions(path="line", approach=False, retreat=False)
    with pytest.raises(PlanError, match="straight line from keyframe 0 to keyframe 1:"):
        plan_keyframes(keyframes, own, UR5, options)


def test_home_is_skipped_where_that_helps() -> None:
    """The lamp touches the hand at home only."""
    behind = arm_of(PANDA).forward(PANDA.home) @ Pose(np.array([-0.12, 0.0, -0.12]), TURN)
    lamp = Obstacle("the lamp", "sphere", (0.1,), behind)
    with pytest.raises(PlanError, match=r"^home of panda: .*; move the lamp, .*, or skip home \(--no-approach --no-"):
        planned(calibration=replace(dock(), obstacles=(lamp,)))
    planned(calibration=replace(dock(), obstacles=(lamp,)), approach=False, retreat=False)


def test_a_start_at_a_keyframe_in_the_table_is_not_blamed_on_home() -> None:
    sunk = replace(dock(), T_base_dock=Pose(np.array([0.45, -0.15, -0.01]), TURN))
    options = PlanOptions(approach=False, allow_collision=True)
    plan = plan_keyframes([keyframe(0.0), keyframe(1.0, z=0.2)], sunk, PANDA, options)
    told = not_none(plan.touching).error.message
    assert told.startswith("at keyframe 0 (t = 0.0 s): panda_")
    assert "the table" in told
    assert told.endswith("; raise the keyframe, or raise the dock and with it the whole motion")


def test_a_motion_that_goes_home_through_something_is_not_said_to_end_before() -> None:
    """The line and the way back are both blocked. The motion shown ignores collisions, and does go home."""
    wall = Obstacle("the wall", "box", (0.3, 0.02, 0.6), Pose(np.array([0.5, 0.05, 0.3]), TURN))
    keyframes = [keyframe(0.0), keyframe(1.0, y=0.4)]
    options = PlanOptions(path="line", allow_collision=True)
    plan = plan_keyframes(keyframes, replace(dock(), obstacles=(wall,)), PANDA, options)  # any warning is an error here
    assert plan.touching is not None
    np.testing.assert_allclose(plan.trajectory.q[-1], PANDA.home, atol=1e-9)


@pytest.mark.parametrize("can", [True, False])
def test_a_straight_line_is_tried_before_it_is_recommended(
    capsys: Capture, tmp_path: Path, can: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    if not can:
        monkeypatch.setattr("pbd.arm.ladder_checks.follow", lambda *args: None)
    code, _, err = run(capsys, "export", "paper-test1", "--robot", "panda", "-o", f"{tmp_path}/x.csv")
    assert code == 0
    said = "--path-tolerance 0.01 keeps it straight" if can else "panda can't keep it straight from this dock"
    assert f" from a straight line; {said}\n" in err


def test_beside_a_way_around_the_dock_is_not_blamed_for_a_curve() -> None:
    """A line allows no way around, so it can't be had, from whatever dock."""
    plan = plan_path(track(load_demo("pouring")), not_none(PANDA.dock), PANDA)
    around = replace(plan, segments=(*plan.segments[:-1], replace(plan.segments[-1], kind="detour")))
    assert remarks(around, None)[-1].endswith("from a straight line; --path-tolerance would forbid the way around")


def test_where_a_mesh_is_missing_no_key_is_named_that_a_robot_does_not_take(tmp_path: Path) -> None:
    with pytest.raises(
        RobotError, match=r"hand.stl: can't be read .*; put it there, or correct its address in the URDF$"
    ):
        read_mesh(tmp_path / "hand.stl")


def test_the_size_that_is_advised_works() -> None:
    """A larger one, by a percent of what was asked for, does not."""
    with pytest.raises(
        PlanError, match=r"is out of reach: .*; move the dock.*, or make .* \(--scale [\d.]+ works\)$"
    ) as caught:
        planned(scale=5.0)
    works = float(caught.value.message.split("--scale ")[1].split()[0])
    planned(scale=works)
    with pytest.raises(PlanError):
        planned(scale=works + 0.05)


def test_no_size_is_advised_where_the_dock_is_out_of_reach() -> None:
    far = replace(dock(), T_base_dock=Pose(np.array([2.0, 0.0, 0.3]), TURN))
    with pytest.raises(PlanError, match=r"^keyframe 0 is out of reach: .*; move the dock$"):
        planned(calibration=far)


def test_the_place_that_is_advised_is_the_nearest_that_works() -> None:
    wanted, shown = ThingPlace("cup", (1.1, 0.2, -0.1), 0.4), np.array([0.1, 0.2, -0.1])
    assert nearest_working_place(wanted, shown, lambda _: False) is None  # the fault lies elsewhere
    found = nearest_working_place(wanted, shown, lambda place: place.p_base[0] <= 0.4)
    assert found is not None
    assert 0.38 < found.p_base[0] <= 0.4
    assert (*found.p_base[1:], found.turn_rad) == pytest.approx((0.2, -0.1, 0.4 * (found.p_base[0] - 0.1)))


@pytest.mark.parametrize(
    ("degrees", "arm_m", "did"),
    [(90.0, 0.2, "left the straight line by 5.9 cm"), (270.0, 0.0, "turned by 270 degrees instead of 90")],
    ids=["a crank", "a knob"],
)
def test_a_move_on_which_the_hand_went_round_or_turned_is_named(degrees: float, arm_m: float, did: str) -> None:
    """Straight from stop to stop, that is lost."""
    turn = Waypoint(turn=(0.0, 0.0, np.radians(degrees)), move_s=1.5, rest_s=1.0)
    task = Task("turn", (Waypoint(rest_s=2.0), turn), p_sensor_point=(0.0, arm_m, 0.0))
    path = track(simulate(task).recording)
    straight, demo = (
        unfollowed(plan_path(path, not_none(UR5.dock), UR5, options))
        for options in (PlanOptions(), PlanOptions(path="demo"))
    )
    assert straight == [f"between keyframes 0 and 1 the hand {did}; only --path demo follows the hand"]
    assert demo == []


def test_a_long_stay_that_the_arm_cuts_is_named() -> None:
    """A pour is held for seconds; two seconds and less are what anybody stops for."""
    there = [Waypoint((0.1 * i, 0.0, 0.0), move_s=1.0, rest_s=s) for i, s in enumerate((1.7, 4.0, 9.0), start=1)]
    path = track(simulate(Task("pour", (Waypoint(rest_s=9.0), *there))).recording)
    cut, kept = (
        unfollowed(plan_path(path, not_none(UR5.dock), UR5, options))
        for options in (PlanOptions(), PlanOptions(dwell_s=5.0))
    )
    assert len(cut) == 1
    assert re.match(r"the hand stayed 4\.\d s at keyframe 2, the arm 0\.5 s; --dwell [45] keeps all stays, ", cut[0])
    assert kept == []
