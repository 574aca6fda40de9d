"""What numba compiles, against pinocchio, and against the descent that it repeats."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin
import pytest

from pbd.arm.compiled import COMPILED
from pbd.arm.descent import PATIENCE, SOLVED, chain, descend_each, look_at
from pbd.arm.ik import solve
from pbd.arm.model import ArmModel
from pbd.arm.seeds import seed_map
from pbd.arm.tool import Target, target
from pbd.pose import Array, Pose
from tests.arm.bundled import FIVE_JOINTS, NAMES, arm_of
from tests.arm.conftest import random_joints


@pytest.fixture(params=[*NAMES, "odd"])
def any_arm(request: pytest.FixtureRequest, odd_arm: ArmModel) -> ArmModel:
    return odd_arm if request.param == "odd" else arm_of(request.param)


def look(kernel: Any, arm: ArmModel, goal: Target, q: Array) -> tuple[Array, Array, float]:
    """e, its Jacobian and |e|^2, from the source of what is compiled: compiling it alone takes a second."""
    k = len(q)
    e, J, work = np.empty(6), np.empty((6, k)), np.empty((7 + 2 * k, 3))
    links, slides, _, _ = chain(arm)
    return e, J, kernel.look.py_func(links, slides, *goal, q, e, J, work)


def test_tool_and_jacobian_are_pinocchios(kernel: Any, any_arm: ArmModel) -> None:
    R_base = any_arm.T_base_universe.rotation
    in_base = np.kron(np.eye(2), R_base)
    for q, other in zip(random_joints(any_arm.robot, 10, 1), random_joints(any_arm.robot, 10, 2), strict=True):
        goal = target(any_arm.forward(other))
        e, J, square = look(kernel, any_arm, goal, q)
        e_universe, J_universe = look_at(any_arm, goal, q)
        np.testing.assert_allclose(e, in_base @ e_universe, atol=1e-12)
        np.testing.assert_allclose(J, in_base @ J_universe, atol=1e-12)
        assert square == pytest.approx(e @ e, rel=1e-12)
        # And the tool itself: e is what is left of it.
        here = any_arm.forward(q)
        np.testing.assert_allclose(goal.p + e[:3], here.p, atol=1e-12)
        np.testing.assert_allclose(pin.exp3(e[3:]) @ goal.R, target(here).R, atol=1e-12)


def test_the_gradient_is_that_of_half_of_the_square(kernel: Any, any_arm: ArmModel) -> None:
    """J lacks log3's own derivative; J^T e doesn't need it."""
    step = 1e-6
    for q, other in zip(random_joints(any_arm.robot, 5, 3), random_joints(any_arm.robot, 5, 4), strict=True):
        goal = target(any_arm.forward(other))
        e, J, _ = look(kernel, any_arm, goal, q)
        for joint, shift in enumerate(step * np.eye(len(q))):
            after, before = (look(kernel, any_arm, goal, q + sign * shift)[2] for sign in (1, -1))
            assert (J.T @ e)[joint] == pytest.approx((after - before) / (4 * step), abs=1e-6)


@pytest.mark.parametrize("angle", [0.0, 1e-12, 1e-7, 1e-3, 1.0, 3.0, np.pi - 1e-3, np.pi - 1e-7])
def test_log3_is_exact_near_no_turn_and_half_a_turn(kernel: Any, angle: float) -> None:
    rng, found = np.random.default_rng(5), np.empty(3)
    for axis in (*np.eye(3), *-np.eye(3), *rng.normal(size=(20, 3))):
        vector = angle * axis / np.linalg.norm(axis)
        kernel.log3.py_func(np.ascontiguousarray(Pose.exp((0, 0, 0, *vector)).matrix()[:3, :3]), found)
        np.testing.assert_allclose(found, vector, atol=1e-15 + 1e-9 * angle)


def test_damped_steps_are_numpys(kernel: Any) -> None:
    rng = np.random.default_rng(6)
    for k in (4, 5, 6, 7):
        J, gradient, x, L = rng.normal(size=(6, k)), rng.normal(size=k), np.empty(k), np.empty((k, k))
        kernel.solve_damped.py_func(np.tril(J.T @ J), gradient, 0.3, L, x)
        np.testing.assert_allclose(x, np.linalg.solve(J.T @ J + 0.3 * np.eye(k), gradient), atol=1e-12)


def test_descents_are_the_same_step_for_step(kernel: Any, any_arm: ArmModel, monkeypatch: pytest.MonkeyPatch) -> None:
    """From where they can be told apart only by rounding: a chaotic descent may end elsewhere."""
    same = total = 0
    for truth in random_joints(any_arm.robot, 20, seed=7):
        goal = target(any_arm.forward(truth))
        seeds = seed_map(any_arm).nearest(goal, 5)
        monkeypatch.setattr(COMPILED, "kernel", None)
        plain = descend_each(any_arm, goal, seeds, all_of_them=True)
        monkeypatch.setattr(COMPILED, "kernel", kernel)
        compiled = descend_each(any_arm, goal, seeds, all_of_them=True)
        total += len(seeds)
        same += int((np.abs(plain[0] - compiled[0]).max(axis=1) < 1e-6).sum())
        stopped = descend_each(any_arm, goal, seeds, patience=PATIENCE)
        assert (stopped[1][:-1] >= SOLVED).all()
        np.testing.assert_array_equal(stopped[0], compiled[0][: len(stopped[0])])
    assert same >= 0.97 * total


def test_the_nearest_seeds_are_the_same(kernel: Any, any_arm: ArmModel, monkeypatch: pytest.MonkeyPatch) -> None:
    for truth in random_joints(any_arm.robot, 20, seed=8):
        goal = target(any_arm.forward(truth))
        for worst in (False, True):
            monkeypatch.setattr(COMPILED, "kernel", None)
            plain = seed_map(any_arm).nearest(goal, 8, worst=worst)
            monkeypatch.setattr(COMPILED, "kernel", kernel)
            # Seeds that are equally far, to single precision, may change places.
            assert {*map(tuple, plain)} == {*map(tuple, seed_map(any_arm).nearest(goal, 8, worst=worst))}


@pytest.mark.parametrize("name", [name for name in NAMES if name not in FIVE_JOINTS])
def test_every_reachable_pose_is_reached(name: str, kernel: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(COMPILED, "kernel", kernel)
    arm = arm_of(name)
    for truth in random_joints(arm.robot, 500, seed=9):
        pose = arm.forward(truth)
        result = solve(arm, pose)
        assert max(pose.distance(arm.forward(result.q))) <= 1e-5
        assert ((result.q >= arm.limits.lower) & (result.q <= arm.limits.upper)).all()
