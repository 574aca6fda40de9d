"""Programs for arms of Universal Robots, run by a simulated controller."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from pbd.errors import PbdError, PlanError, UsageError
from pbd.files.exporters import check_format, export
from pbd.files.exporters.urscript import SETTLE_S, check
from pbd.planning import Plan
from tests.arm.bundled import arm_of
from tests.files.planned_motions import planned
from tests.files.urscript import Controller, HaltedError


def program(
    place: Path, name: str, path: str = "keyframes", rate_hz: float | None = None, demo: str = "paper-test1"
) -> tuple[Plan, str]:
    """Plan and export; dense if a rate is given."""
    plan, robot, source = planned(name, demo, path)
    export(plan.trajectory, robot, "urscript", place, rate_hz, dense=rate_hz is not None, source=source)
    return plan, place.read_text()


def test_each_move_is_the_planned_one_within_the_limits(tmp_path: Path) -> None:
    plan, text = program(tmp_path / "p.script", "ur5")
    trajectory, limits = plan.trajectory, planned("ur5")[1].limits
    controller = Controller(trajectory.q[0])
    controller.run(text)
    assert controller.t == pytest.approx(trajectory.duration, abs=1e-4)
    ends = trajectory.at(np.array([move[:2] for move in controller.moves]).ravel())
    assert_allclose(np.array([move[2:4] for move in controller.moves]).reshape(-1, 6), ends.q, atol=2e-6)
    for i, (t, q) in enumerate(zip(trajectory.keyframe_t, trajectory.keyframe_q, strict=True)):
        assert controller.moves[i][1] == pytest.approx(t, abs=1e-4)
        assert_allclose(controller.moves[i][3], q, atol=1e-6)
    for since, until, q_before, q, a, v in controller.moves:
        share = np.abs(q - q_before) / np.abs(q - q_before).max()
        assert (a * share <= 1.000001 * limits.acceleration).all()
        assert (v * share <= 1.000001 * limits.velocity).all()
        between = trajectory.at(np.linspace(since, until, 50)).q - q_before
        along = between @ (q - q_before) / ((q - q_before) @ (q - q_before))
        assert_allclose(between, np.outer(along, q - q_before), atol=1e-5)  # the planned motion is straight


@pytest.mark.parametrize("rate_hz", [None, 125.0])
def test_the_gripper_is_called_when_planned(tmp_path: Path, rate_hz: float | None) -> None:
    plan, text = program(tmp_path / "p.script", "ur5", rate_hz=rate_hz, demo="pouring")
    controller = Controller(plan.trajectory.q[0])
    controller.run(text)
    assert [name for _, name in controller.calls] == ["pbd_pouring", "gripper_close", "gripper_open"]
    # Each move ends on the controller's beat; before a gripper's call the arm has to arrive.
    late = 0.0 if rate_hz is None else len(plan.keyframes) / rate_hz + 2.0 * SETTLE_S
    assert_allclose([t for t, _ in controller.calls[1:]], plan.trajectory.gripper_t[[1, 3]], atol=1e-4 + late)


@pytest.mark.parametrize(("rate_hz", "path"), [(125.0, "keyframes"), (500.0, "line")])
def test_dense_samples_are_the_motion(tmp_path: Path, rate_hz: float, path: str) -> None:
    plan, text = program(tmp_path / "p.script", "ur5", path, rate_hz, "paper-test2")
    trajectory = plan.trajectory
    controller = Controller(trajectory.q[0])
    controller.run(text)
    grips = sum(name.startswith("gripper") for _, name in controller.calls)
    late = (len(plan.keyframes) + 1) / rate_hz + SETTLE_S * (grips + 1)  # at most one period a move; and the end
    assert trajectory.duration <= controller.t + 1e-4 <= trajectory.duration + late + 2e-4
    for t, q in controller.servoed[::61]:  # each is on the planned motion, shortly before
        planned_q = trajectory.at(np.arange(max(t - late, 0.0), t + 1e-4, 1e-4)).q
        assert np.abs(planned_q - q).max(axis=1).min() < 1e-4 * 3.2
    q = np.array([q for _, q in controller.servoed])
    assert np.abs(np.diff(q, axis=0)).max() <= 3.1416 / rate_hz * 1.001


def test_names_stay_in_their_comments(tmp_path: Path) -> None:
    plan, robot, source = planned("ur5")
    code = "x\n  movej([0, 0, 0, 0, 0, 0])\x1b[8m"
    labelled = replace(source, name=code, keyframes=[replace(each, label=code) for each in source.keyframes])
    export(plan.trajectory, replace(robot, name=code), "urscript", tmp_path / "p.script", source=labelled)
    lines = (tmp_path / "p.script").read_text().splitlines()
    assert not any(line.startswith("  movej([0, 0") or "\x1b" in line for line in lines)


def test_the_program_halts_if_the_arm_is_not_at_the_start(tmp_path: Path) -> None:
    plan, text = program(tmp_path / "p.script", "ur5")
    controller = Controller(plan.trajectory.q[0] + np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.03]))
    start = ", ".join(f"{angle:.1f}" for angle in np.degrees(plan.trajectory.q[0]))  # as the teach pendant shows them
    with pytest.raises(HaltedError, match=rf"where the motion begins \({start} degrees\)"):
        controller.run(text)
    assert controller.moves == []


def test_what_it_refuses(tmp_path: Path) -> None:
    plan, robot, source = planned("ur5")
    place, trajectory = tmp_path / "p.script", plan.trajectory
    with pytest.raises(PlanError, match="the arm follows a curve, which movej can't; take --dense"):
        program(place, "ur5", "line")
    with pytest.raises(PlanError, match="which panda is not"):
        program(place, "panda")
    on_rail = replace(arm_of("panda").robot, joints=("rail", *robot.joints), mimic_joints=())
    with pytest.raises(PlanError, match=r"six joints of the arm, but not rail: leave that out of \[arm\] joints"):
        check(on_rail)
    with pytest.raises(UsageError, match=r"must be 125 \(CB3\) or 500"):  # before anything is planned
        check_format("urscript", 100.0, dense=True)
    with pytest.raises(PbdError, match="leave --rate out"):
        export(trajectory, robot, "urscript", place, 125.0, source=source)
    with pytest.raises(PbdError, match="--dense is for urscript"):
        export(trajectory, robot, "csv", place, dense=True)
    slow = replace(robot, limits=replace(robot.limits, acceleration=0.5 * robot.limits.acceleration))
    with pytest.raises(
        PlanError,
        match=r"the controller would reach 1\.50 times .* acceleration limit, at .* s; give 0\.66 times the --speed",
    ):
        export(trajectory, slow, "urscript", place, source=source)
    assert list(tmp_path.iterdir()) == []


def test_a_program_may_begin_anywhere_and_with_the_gripper(tmp_path: Path) -> None:
    plan, robot, source = planned("ur5")
    tiny = np.full((1, 4, 6), 0.0)
    c = plan.trajectory.coefficients.copy()
    c[:, 0] += 4.4e-7  # no joint is a number of six decimals
    tiny[0, 0], tiny[0, 2:] = c[0, 0], [[3e-8] * 6, [-2e-8] * 6]  # there is no digit for this move of 1e-8 rad
    c[:, 0] += 1e-8
    hold = np.concatenate((c[:1, :1], np.zeros((1, 3, 6))), axis=1)
    motion = replace(
        plan.trajectory,
        knots=np.concatenate(([0.0, 1.0], 2.0 + plan.trajectory.knots)),
        coefficients=np.concatenate((tiny, hold, c)),
        gripper_t=np.array([0.0, 1.0, 1.8]),
        gripper_opening=np.array([1.0, 1.0, 0.0]),
        keyframe_t=2.0 + plan.trajectory.keyframe_t,
        keyframe_q=plan.trajectory.keyframe_q + 4.5e-7,
    )
    for rate_hz in (None, 125.0, 500.0):
        export(motion, robot, "urscript", tmp_path / "p.script", rate_hz, dense=rate_hz is not None, source=source)
        controller = Controller(motion.at(0.0).q[0])
        controller.run((tmp_path / "p.script").read_text())
        (_, (t, name), *_) = controller.calls
        assert name == "gripper_close"
        assert t == pytest.approx(1.0, abs=0.21)  # dense: the arm settles first
        assert_allclose(controller.q, motion.at(motion.duration).q[0], atol=1e-6)
