"""Plans: paths, times, starts, ends, refusals and warnings."""

import sys
import warnings
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

import pbd
from pbd.arm.motion_request import DEMO, LINE, STRAIGHT
from pbd.arm.tool_deviation import off_line
from pbd.audit import audit
from pbd.audit.arm import AuditArm
from pbd.audit.contact import Pair, Touch, find_touch
from pbd.data import Calibration, GraspedObject, HandPath, JointTrajectory, Keyframe, Obstacle, Robot, Stop
from pbd.data.covariance import PoseCovariance
from pbd.errors import PbdError, PbdWarning, PlanError, TrackingError, UsageError
from pbd.files.demo import load_demo
from pbd.planning import Plan, PlanOptions, arm_of, plan_keyframes, source_of
from pbd.planning.object_frames import ThingPlace
from pbd.planning.options import SHORTEST_DWELL_S, dwells
from pbd.planning.plan import _tracked_with
from pbd.planning.preconditions import check_certainty
from pbd.pose import Array, Pose, quat_exp
from pbd.tracking.keyframes import find_keyframes
from tests.arm.bundled import keyframes_of, path_of
from tests.not_none import not_none
from tests.planned_keyframes import PANDA, TURN, UR5, dock, keyframe, low, plan_once, planned, tracked


def begun(keyframes: Sequence[Keyframe] | None = None, **options: object) -> Plan:
    """Plan the first five keyframes of `pouring`, in the hand's time."""
    demo, path, found = tracked("pouring")
    asked = PlanOptions(time="demo", **options)  # type: ignore[arg-type]
    plan: Plan = plan_once(keyframes or found[:5], dock(), PANDA, asked, path, demo.grasped)
    return plan


def moving(plan: Plan) -> Array:
    """Return joints (n, k) at 1 kHz between the first keyframe and the last."""
    samples, t = plan.trajectory, plan.trajectory.keyframe_t
    inside: Array = samples.q[(samples.t >= t[0]) & (samples.t <= t[-1])]
    return inside


# --- paths ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("robot", [PANDA, pbd.load_robot("ur5")], ids=["panda", "ur5"])
def test_lines_are_straight_to_a_tenth_of_a_millimetre(robot: Robot) -> None:
    plan = planned(robot=robot, path="line")
    assert [way.kind for way in plan.segments] == [STRAIGHT, *4 * [LINE]]
    arm, samples, reached = arm_of(robot), plan.trajectory, plan.trajectory.keyframe_t
    for start, end in pairwise(reached):
        inside = (samples.t >= start) & (samples.t <= end)
        assert off_line(arm.forward_many(samples.q[inside][:: max(1, inside.sum() // 300)])[0]) < 1e-4


def test_the_demonstrated_path_is_where_the_hand_was() -> None:
    """Each position of the tool is within the smoothing, 5 mm at most, of the tracked hand's path."""
    plan = planned("paper-test1", path="demo")
    _, path, _ = tracked("paper-test1")
    inside = slice(path.stops[0].start, path.stops[-1].stop)
    often = np.linspace(path.t[inside][0], path.t[inside][-1], 5000)
    hand = plan.placed.T_base_nav.act(dock().scale * CubicSpline(path.t[inside], path.p_nav_sensor[inside])(often))
    p, _ = arm_of(PANDA).forward_many(moving(plan)[::25])
    away = np.linalg.norm(p[:, None] - hand[None], axis=2).min(axis=1)
    assert away.max() < 0.006


def on_a_circle(move_s: float, turn: float, radius: float, axes: tuple[int, int]) -> HandPath:
    """Return a hand that moves on a circle by an angle `turn`, from rest to rest, with 1 s of rest at both ends."""
    t = np.arange(0.0, move_s + 2.0, 0.01)
    share = np.clip((t - 1.0) / move_s, 0.0, 1.0)
    angle = turn * (10 * share**3 - 15 * share**4 + 6 * share**5)
    p, last = np.zeros((len(t), 3)), len(t) - 100
    p[:, axes] = radius * np.column_stack((1.0 - np.cos(angle), np.sin(angle)))
    v: Array = np.gradient(p, t, axis=0)  # type: ignore[assignment]
    return HandPath(
        t, p, v, np.tile(TURN, (len(t), 1)), (Stop(0, 101, 1.0), Stop(last, last + 100, 0.99)),
        np.zeros((1, 3)), PoseCovariance.chained(np.tile(1e-6 * np.eye(6), (2, 1, 1))),
    )  # fmt: skip


def test_a_demonstration_without_stops_on_the_way_is_followed() -> None:
    """Half a circle of 20 cm in one move; with keyframes alone it would be a straight move."""
    path = on_a_circle(2.0, np.pi, 0.1, (1, 2))
    plan = plan_keyframes(find_keyframes(path), dock(), PANDA, PlanOptions(path="demo"), path)
    tool, _ = arm_of(PANDA).forward_many(moving(plan)[::20])
    centre = plan.placed.T_base_nav.act(np.array([0.0, 0.1, 0.0]))
    np.testing.assert_allclose(np.linalg.norm(tool - centre, axis=1), 0.1, atol=0.002)
    assert tool[:, 2].max() > centre[2] + 0.097


def test_a_hand_that_comes_back_to_where_it_began_is_followed() -> None:
    """A circle: its two keyframes coincide, and only the hand's path gives the motion."""
    path = on_a_circle(3.0, 2.0 * np.pi, 0.06, (0, 1))
    plan = plan_keyframes(find_keyframes(path), dock(), PANDA, PlanOptions(path="demo"), path)
    tool, _ = arm_of(PANDA).forward_many(moving(plan)[::20])
    centre = plan.placed.T_base_nav.act(np.array([0.06, 0.0, 0.0]))
    np.testing.assert_allclose(np.linalg.norm(tool - centre, axis=1), 0.06, atol=0.002)
    assert np.ptp(tool[:, 1]) > 0.115
    with pytest.raises(TrackingError, match="or follow the hand with --path demo"):
        plan_keyframes(find_keyframes(path), dock(), PANDA, None, path)


def test_a_tolerance_makes_lines_of_moves_beyond_it() -> None:
    free, kept = planned(), planned(tolerance_m=0.01)
    off = [way.off_line_m for way in free.segments]
    assert min(off[1:]) < 0.01 < 0.02 < max(off)
    assert [way.kind == LINE for way in kept.segments] == [each > 0.01 for each in off]
    assert max(way.off_line_m for way in kept.segments) <= 0.01


def test_the_hands_path_needs_a_hand() -> None:
    with pytest.raises(PlanError, match="only the keyframes are known, not the hand's path; choose another --path"):
        plan_keyframes(tracked("paper-test1")[2], dock(), PANDA, PlanOptions(path="demo"))


# --- times ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("path", ["keyframes", "line", "demo"])
def test_the_hands_own_time_is_kept_where_the_limits_allow_it(path: str) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        plan = begun(path=path)
    keyframes = tracked("pouring")[2][:5]
    shown = plan.trajectory.keyframe_t
    took = [after.t - 0.5 * after.dwell_s - before.t - 0.5 * before.dwell_s for before, after in pairwise(keyframes)]
    stroke = PANDA.gripper.stroke_s if PANDA.gripper else 0.0
    stays = [0.0, *(max(k.dwell_s, stroke) if k.grip is not None else k.dwell_s for k in keyframes[1:-1])]
    np.testing.assert_allclose(np.diff(shown), np.add(took, stays), rtol=0.02, atol=0.02)
    assert plan.stretched == ()


@pytest.mark.parametrize("stay_s", [0.2, 5.0])
def test_a_longer_or_shorter_stay_changes_no_move(stay_s: float) -> None:
    """keyframes.toml changes how long the arm stays, not when and where the hand moved: durations and path stay."""
    keyframes = tracked("pouring")[2][:5]
    edited = [replace(each, dwell_s=stay_s) for each in keyframes]
    shown, stayed = begun(path="demo"), begun(edited, path="demo", dwell_s=np.inf)
    assert stayed.stretched == ()
    for before, after in zip(shown.segments, stayed.segments, strict=True):
        np.testing.assert_array_equal(after.q, before.q)
    moved, shown_s = np.diff(stayed.trajectory.keyframe_t) - stay_s, np.diff(shown.trajectory.keyframe_t)
    stood = [each.dwell_s for each in keyframes[1:-1]]
    plain = [k for k in range(1, len(keyframes) - 1) if keyframes[k].grip is None]
    np.testing.assert_allclose(moved[plain], (shown_s[1:] - stood)[np.array(plain) - 1], atol=1e-6)


@pytest.mark.parametrize("path", ["keyframes", "line", "demo"])
def test_moves_beyond_the_limits_are_stretched_with_a_warning(path: str) -> None:
    with pytest.warns(PbdWarning, match="moves are slower than the hand's, to keep the joint limits: ") as caught:
        plan = planned(path=path, time="demo")
    assert len(caught) == 1
    assert plan.stretched
    for each in plan.stretched:
        assert each.planned_s > 1.02 * each.demonstrated_s
        assert f"{each.planned_s:.2f} s instead of {each.demonstrated_s:.2f} s to keyframe {each.keyframe}" in str(
            caught[0].message
        )
    assert plan.report.velocity <= 1.0 + 1e-6


def test_a_move_that_a_low_speed_stretches_needs_a_higher_one() -> None:
    with pytest.warns(PbdWarning, match="for the hand's own time give a higher --speed, "):
        planned(time="demo", speed=0.1)


@pytest.mark.parametrize("path", ["keyframes", "line"])
def test_a_metre_in_a_tenth_of_a_second_is_stretched(path: str) -> None:
    keyframes = [keyframe(0.25), keyframe(0.85, y=0.45), keyframe(1.45, y=0.45 - 1.0)]
    centre = replace(dock(), T_base_dock=Pose(np.array([0.35, 0.05, 0.35]), TURN))
    with pytest.warns(PbdWarning, match=r"2 of 2 moves are slower than the hand's"):
        plan = plan_keyframes(keyframes, centre, PANDA, PlanOptions(time="demo", path=path))
    assert [each.demonstrated_s for each in plan.stretched] == pytest.approx([0.1, 0.1])
    assert plan.stretched[1].planned_s > 0.4
    assert max(plan.report.velocity, plan.report.acceleration, plan.report.jerk) <= 1.0 + 1e-6


@pytest.mark.parametrize(
    ("path", "speed", "margin", "share"),
    [("keyframes", 1.0, 0.05, 0.95), ("keyframes", 0.3, 0.2, 0.24), ("line", 0.3, 0.2, 0.24), ("demo", 0.3, 0.2, 0.24)],
)
def test_speed_and_margin_are_shares_of_all_limits(path: str, speed: float, margin: float, share: float) -> None:
    report = planned(path=path, speed=speed, margin=margin).report
    used = (report.velocity, report.acceleration, report.jerk)
    assert max(used) <= share + 1e-9
    assert max(used) > 0.97 * share


def test_dwells() -> None:
    _, _, keyframes = tracked("paper-test1")
    plan = planned(dwell_s=0.2)
    stays = plan.trajectory.at(plan.trajectory.keyframe_t[1:-1] + 0.19).qd
    np.testing.assert_array_equal(stays, 0.0)
    left = plan.trajectory.at(plan.trajectory.keyframe_t[1:-1] + 0.21).qd
    assert all(np.abs(qd).max() > 0.0 for qd, k in zip(left, keyframes[1:-1], strict=True) if k.grip is None)
    assert sum(k.grip is None for k in keyframes[1:-1]) > 1


def test_at_a_stop_without_a_length_the_arm_stays_too() -> None:
    _, _, keyframes = tracked("paper-test1")
    at_once = [replace(keyframe, dwell_s=0.0) for keyframe in keyframes[:3]]
    assert dwells(at_once, PlanOptions()) == [0.0, SHORTEST_DWELL_S, 0.0]


# --- starts and ends --------------------------------------------------------------------------------------------------


def test_it_starts_at_home_and_goes_back_there_slowly() -> None:
    plan, alone = planned(), planned(approach=False, retreat=False)
    trajectory = plan.trajectory
    np.testing.assert_array_equal(trajectory.q[0], PANDA.home)
    np.testing.assert_allclose(trajectory.q[-1], PANDA.home, atol=1e-12)
    last = trajectory.keyframe_t[-1]
    for soft in (trajectory.t < trajectory.keyframe_t[0], trajectory.t > last + 0.5):
        assert (np.abs(trajectory.qd[soft]) <= 0.5 * PANDA.limits.velocity + 1e-9).all()
        assert (np.abs(trajectory.qdd[soft]) <= 0.5 * PANDA.limits.acceleration + 1e-9).all()
    np.testing.assert_array_equal(alone.trajectory.q[0], alone.trajectory.keyframe_q[0])
    np.testing.assert_allclose(alone.trajectory.q[-1], alone.trajectory.keyframe_q[-1], atol=1e-12)


def test_it_starts_where_the_arm_is() -> None:
    here = tuple((PANDA.home + 0.2).tolist())
    trajectory = planned(start=here).trajectory
    np.testing.assert_array_equal(trajectory.q[0], here)
    np.testing.assert_allclose(trajectory.q[-1], PANDA.home, atol=1e-12)


@pytest.mark.parametrize(
    ("start", "message"),
    [
        ((0.0, 0.0), r"the start must give 7 numbers, in rad .*, for panda_joint1, .*"),
        ((0.0, 0.0, 0.0, 1.0, 0.0, 1.0, 0.0), r"the start has panda_joint4 at 1 rad, outside its limits of -3.072 to "),
        ((0.0, float("inf"), 0.0, -1.0, 0.0, 1.0, 0.0), r"the start must give 7 numbers"),
        ((0.0, 1.7, 0.0, -0.1, 0.0, 1.8, 0.0), r"at the arm's start: .* would touch .*, .* deep; .*move the arm"),
    ],
)  # fmt: skip
def test_a_start_that_can_not_be(start: tuple[float, ...], message: str) -> None:
    with pytest.raises(PlanError, match=message) as caught:
        planned(start=start)
    assert "\n" not in caught.value.message
    assert caught.value.exit_code == 3


@pytest.mark.parametrize("path", ["keyframes", "line"])
def test_an_arm_turns_over_on_its_way_from_home_and_not_with_the_object(path: str) -> None:
    """At home the wrist is in a configuration in which the arm would touch the object that it pours from."""
    turned_over = replace(pbd.load_robot("ur5"), home=np.array((-1.6125, -0.832, 0.6291, 1.7729, 1.5704, -0.0417)))
    dock = Pose(np.array((0.085, -0.58, 0.19)), np.array((1.0, 0.0, 0.0, 0.0)))
    side = Calibration("side", T_base_dock=dock, table_height=-0.06)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        made = plan_keyframes(
            *(keyframes_of("pouring"), side, turned_over, PlanOptions(path=path)), grasped=load_demo("pouring").grasped
        )
    assert not [str(each.message) for each in caught if "out of its way" in str(each.message)]
    wrist = made.trajectory.at(made.trajectory.keyframe_t).q[:, 4]
    assert (wrist < 0.0).all()


def test_a_home_in_collision() -> None:
    high = replace(dock(), obstacles=(Obstacle("the lamp", "sphere", (0.2,), arm_of(PANDA).forward(PANDA.home)),))
    with pytest.raises(
        PlanError,
        match=r"^home of panda: .* would touch the lamp, .*; move the lamp, or change home in the robot's TOML$",
    ):
        planned(calibration=high)


# --- what is in the way -----------------------------------------------------------------------------------------------


def test_a_plan_that_touches_something_is_refused_unless_that_is_allowed() -> None:
    with pytest.raises(
        PlanError, match=r"^no collision-free .* keyframe 1\b.* would touch the table, .* deep; raise the keyframe"
    ) as caught:
        plan_keyframes(*low(), PANDA)
    assert caught.value.exit_code == 3
    assert planned(allow_collision=True).touching is None


def test_a_contact_has_both_bodies_its_depth_and_its_time() -> None:
    plan = plan_keyframes(*low(), PANDA, PlanOptions(allow_collision=True))
    touching, t = plan.touching, plan.trajectory.keyframe_t
    assert touching is not None
    first = touching.hits[0]
    assert first.hit.second == "the table"
    assert t[0] < first.t < t[1] < first.parted_t < t[2]
    assert touching.error.fields["bodies"] == (first.hit.first, "the table")
    assert 0.015 < first.hit.depth < 0.05


def test_a_motion_that_is_said_to_touch_nothing_is_audited_though_contacts_are_allowed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("pbd.arm.collision.motion_check.all_hits", lambda *_: ())
    with pytest.raises(PlanError, match=r"^audit: .* the table"):
        plan_keyframes(*low(), PANDA, PlanOptions(allow_collision=True))


def test_plan_refuses_a_contact_even_if_it_is_allowed() -> None:
    wall = Obstacle("the wall", "box", (0.02, 1.0, 1.0), Pose(np.array([0.5, 0.0, 0.5]), TURN))
    with pytest.raises(PlanError, match="would touch the wall"):
        pbd.plan(
            tracked("paper-test2")[1],
            replace(dock(), obstacles=(wall,)),
            PANDA,
            PlanOptions(allow_collision=True, detour=False),
        )


def test_the_hands_path_avoids_an_obstacle() -> None:
    """The hand moves over a wall, and so does the arm, since straight moves would touch it."""
    t = np.arange(0.0, 4.0, 0.01)
    share = np.clip((t - 1.0) / 2.0, 0.0, 1.0)
    angle = np.pi * (10 * share**3 - 15 * share**4 + 6 * share**5)
    p = np.column_stack((np.zeros_like(t), 0.15 * (1.0 - np.cos(angle)), 0.38 * np.sin(angle)))
    path = HandPath(
        t, p, np.gradient(p, t, axis=0), np.tile(TURN, (len(t), 1)), (Stop(0, 101, 1.0), Stop(300, 400, 0.99)),
        np.zeros((1, 3)), PoseCovariance.chained(np.tile(1e-6 * np.eye(6), (2, 1, 1))),
    )  # fmt: skip
    wall = Obstacle("the wall", "box", (0.3, 0.01, 0.52), Pose(np.array([0.5, 0.0, 0.26]), TURN))
    bench, alone = replace(dock(), obstacles=(wall,)), PlanOptions(approach=False, retreat=False)
    keyframes = find_keyframes(path)
    plan = plan_keyframes(keyframes, bench, PANDA, alone, path)
    assert plan.segments[1].kind == DEMO
    assert not_none(plan.segments[1].avoided).second == "the wall"
    with pytest.warns(PbdWarning, match="out of its way: to keyframe 1 it will turn 98 degrees instead of 0"):
        unknown = plan_keyframes(keyframes, bench, PANDA, replace(alone, detour=False))  # the hand's path is unknown
    assert unknown.segments[1].kind == STRAIGHT


def test_a_curve_that_touches_is_followed_more_closely(monkeypatch: pytest.MonkeyPatch) -> None:
    """If the audit finds a contact, the motion is timed again with a tenth of the deviation from the curve."""
    looked = list[JointTrajectory]()

    def touch_first(arm: AuditArm, trajectory: JointTrajectory, pairs: Sequence[Pair]) -> Touch | None:
        looked.append(trajectory)
        return Touch(pairs[0], 1.0) if len(looked) == 1 else find_touch(arm, trajectory, pairs)

    monkeypatch.setattr(audit, "find_touch", touch_first)
    demo, path, keyframes = tracked("paper-test2")
    plan = plan_keyframes(keyframes, UR5.dock or dock(), UR5, PlanOptions(path="demo"), path, demo.grasped)
    monkeypatch.undo()
    assert looked[1] is plan.trajectory
    usual = planned("paper-test2", UR5, path="demo").trajectory
    np.testing.assert_array_equal(usual.keyframe_t, looked[0].keyframe_t)
    assert (looked[0].keyframe_t != plan.trajectory.keyframe_t).any()


# --- keyframes that make no motion ------------------------------------------------------------------------------------


def test_one_keyframe_only() -> None:
    with pytest.raises(TrackingError, match="the demonstration has 1 stop, but a motion needs two") as caught:
        plan_keyframes([keyframe(0.0)], dock(), PANDA)
    assert caught.value.exit_code == 1


def test_keyframes_within_a_millimetre_of_each_other() -> None:
    close = [keyframe(0.0), keyframe(1.0, x=5e-4), keyframe(2.0, z=9e-4)]
    with pytest.raises(TrackingError, match="all 3 keyframes lie within 1 mm of the first: nothing moves; ") as caught:
        plan_keyframes(close, dock(), PANDA)
    assert caught.value.exit_code == 1
    for path in ("keyframes", "line"):  # two of several are one stop after the other
        plan = plan_keyframes([*close, keyframe(3.0, x=0.1)], dock(), PANDA, PlanOptions(path=path))
        assert (np.diff(plan.trajectory.keyframe_t) > 0.0).all()
    plan_keyframes([keyframe(0.0), keyframe(1.0, roll=0.5)], dock(), PANDA)  # a turn is a motion


def test_options_have_names() -> None:
    with pytest.raises(PbdError, match="path must be one of keyframes, line, demo, got 'curve'"):
        PlanOptions(path="curve")
    with pytest.raises(PbdError, match="time must be one of limits, demo, got 'fast'"):
        PlanOptions(time="fast")


@pytest.mark.parametrize("path", ["line", "demo"])
def test_a_path_tolerance_that_would_have_no_effect_is_refused(path: str) -> None:
    with pytest.raises(UsageError, match="--path-tolerance is for --path keyframes"):
        PlanOptions(path=path, tolerance_m=0.01)


def test_options_in_millimetres_are_refused() -> None:
    far = "is at 450 m, beyond any arm's reach; give metres, not cm or mm"
    with pytest.raises(UsageError, match=f"^the place of 'cup' {far}$"):
        PlanOptions(at=(ThingPlace("cup", (450.0, -150.0, 250.0)),))
    with pytest.raises(UsageError, match=f"^the payload's centre of mass {far}$"):
        PlanOptions(payload=0.5, p_tool_payload=(0.0, 20.0, 450.0))


def test_options_that_are_no_finite_numbers_are_refused() -> None:
    for kg in (-1.0, np.inf, np.nan):
        with pytest.raises(UsageError, match=f"^the payload is {kg} kg; give a number, zero or above$"):
            PlanOptions(payload=kg)
    with pytest.raises(UsageError, match=r"^the payload's centre of mass must have finite numbers$"):
        PlanOptions(p_tool_payload=(0.0, 0.0, np.nan))
    for place in (ThingPlace("cup", (0.4, -np.inf, 0.1)), ThingPlace("cup", (0.4, 0.0, 0.1), np.nan)):
        with pytest.raises(UsageError, match=r"^the place of 'cup' must have finite numbers$"):
            PlanOptions(at=(place,))


def test_keyframes_alone_have_no_path_of_the_hand_to_export() -> None:
    plan = plan_keyframes([keyframe(0.0), keyframe(1.0, x=0.1)], dock(), PANDA)
    assert repr(plan) == f"<Plan: {plan.trajectory!r}>"
    with pytest.raises(PlanError, match=r"a plan of keyframes alone has no path of the hand; plan from what "):
        source_of(plan)
    with pytest.raises(PlanError, match=r"these keyframes come without their demonstration; track one with pbd\.track"):
        _ = plan.tracked


def knob(yaw_deg: float, turn_deg: float) -> list[Keyframe]:
    """Return five keyframes in one place near the dock, each rotated by `turn_deg` from the one before."""
    turns = np.radians(yaw_deg + turn_deg * np.arange(5))
    p = np.array([0.0, 0.0, -0.05])
    at = [Keyframe(i + 1.0, 0.5, Pose(p, quat_exp((0.0, 0.0, turn))), 1e-6 * np.eye(6)) for i, turn in enumerate(turns)]
    return [keyframe(0.0), *at]


@pytest.mark.parametrize("yaw_deg", [0.0, 90.0])
def test_a_knob_keeps_turning(yaw_deg: float) -> None:
    """With the first at 90 degrees, joint 7 must start a whole turn away."""
    xarm7 = pbd.load_robot("xarm7")
    plan = plan_keyframes(knob(yaw_deg, 90.0), not_none(xarm7.dock), xarm7)
    turned = np.degrees(np.diff(plan.trajectory.keyframe_q[1:, 6]))
    assert (turned < -60.0).all()
    assert all(segment.wide is None for segment in plan.segments)


def test_a_tool_that_turns_back_is_warned_of() -> None:
    """Joint 7 of a panda has less than a whole turn, so it must turn back once, at one of two keyframes."""
    back = r"\(panda_joint7 turns back: its range of 33\d degrees is no whole turn\)"
    told = rf"to keyframe [45] it will turn 27\d degrees instead of 90 {back}; panda found no line there"
    with pytest.warns(PbdWarning, match=told):
        plan = plan_keyframes(knob(0.0, -90.0), dock(), PANDA)
    assert sum(segment.wide is not None for segment in plan.segments) == 1


@pytest.mark.parametrize("name", ["speed", "margin", "scale", "tolerance_m", "dwell_s"])
def test_options_have_bounds(name: str) -> None:
    for value in (-1.0, float("nan"), *((1e-9, 0.0, 1e6) if name in ("speed", "scale", "tolerance_m") else ())):
        with pytest.raises(PbdError, match=f"{name} must be from [^;]*, got "):
            PlanOptions(**{name: value})


def test_an_object_that_nothing_grips_is_told_and_carried_by_nobody() -> None:
    """A logger of samples alone knows no grip; the summary said that the arm carries the object."""
    box, way = GraspedObject("box", (0.04, 0.04, 0.08), 0.4), [keyframe(0.0), keyframe(2.0, x=0.1), keyframe(4.0)]
    with pytest.warns(
        PbdWarning, match=r"the box is left out, because the grip never closes: .*\[\[grip\]\] in demo.toml"
    ):
        plan = plan_keyframes(way, dock(), PANDA, grasped=box)
    assert plan.grasped is None
    gripped = plan_keyframes([way[0], replace(way[1], grip=True), way[2]], dock(), PANDA, grasped=box)
    assert gripped.grasped is box


def test_a_motion_of_hours_is_refused() -> None:
    long = [keyframe(0.0), keyframe(4000.0, x=0.1, dwell_s=4000.0), keyframe(9000.0)]
    with pytest.raises(PlanError, match=r"^the motion would take \d{4} s, at most 3600 can be planned; give a higher"):
        plan_keyframes(long, dock(), PANDA, PlanOptions(dwell_s=np.inf))


def test_the_cause_of_an_uncertain_keyframe_is_named() -> None:
    """The cause is one long move, or many moves."""
    variances = {"long": (0.0, 1e-4, 1e-2, 1.1e-2), "many": tuple(1e-3 * k for k in range(12))}
    said = {}
    for name, each in variances.items():
        frames = [replace(keyframe(3.0 * k, x=0.1 * k), cov=variance * np.eye(6)) for k, variance in enumerate(each)]
        with pytest.warns(PbdWarning) as told:
            check_certainty(frames, 1.0)
        said[name] = str(told[0].message)
    assert said["long"] == (
        "keyframe 3 at 9.0 s is uncertain by 10 cm (one sigma), most of it from the 2.5 s move to keyframe 2: pause "
        "half a second during that move"
    )
    many = "keyframe 11 at 33.0 s is uncertain by 10 cm (one sigma), from the drift of many moves"
    assert many in said["many"]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_certainty(frames, 0.3)
    near = [replace(frame, T_nav_sensor=Pose(0.05 * frame.T_nav_sensor.p, TURN)) for frame in frames]
    with pytest.raises(
        TrackingError, match=r"by 10 cm \(one sigma\), more than the whole path \(6 cm\): not usable; from"
    ):
        plan_keyframes(near, replace(dock(), scale=2.0), PANDA, PlanOptions(scale=0.5))


def test_a_path_is_not_tracked_again_where_nothing_is_known_of_its_stops(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delattr(sys.modules[_tracked_with.__module__], "track")
    path = path_of("pouring")
    assert path.tracking is not None
    assert _tracked_with(path, Calibration("bench", Pose.identity()), PANDA) is path
