"""Seeds are near the poses that they are asked for, well placed, and kept in the user's cache."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pbd.arm import seeds
from pbd.arm.model import ArmModel
from pbd.arm.seeds import LEAF, ROTATION_WEIGHT_M, SAMPLES, manipulability, seed_map
from pbd.arm.tool import Target, target
from pbd.pose import Array
from tests.arm.bundled import arm_of
from tests.arm.conftest import random_joints


def features(arm: ArmModel, q: Array) -> Array:
    p, R = arm.forward_many(q)
    return np.hstack((p, ROTATION_WEIGHT_M * R.reshape(-1, 9))).astype(np.float64)


def wanted(goal: Target) -> Array:
    return np.concatenate((goal.p, ROTATION_WEIGHT_M * goal.R.ravel()))


def test_each_leaf_keeps_its_best_and_its_worst(arm: ArmModel) -> None:
    q = seed_map(arm).q
    assert q.shape == (2, SAMPLES // LEAF, 7)
    assert ((q >= arm.limits.lower) & (q <= arm.limits.upper)).all()
    J = np.array([[arm.jacobian(each) for each in side[:2000]] for side in q])
    best, worst = (np.median(manipulability(side)) for side in J)
    assert best > 1.3 * worst
    margin = np.minimum(q - arm.limits.lower, arm.limits.upper - q).min(axis=2)
    assert np.median(margin[0]) > 1.3 * np.median(margin[1])


@pytest.mark.parametrize("worst", [False, True])
def test_the_nearest_are_near(arm: ArmModel, worst: bool) -> None:
    """Nearest first; and hardly farther off than the truly nearest, which are sought among all."""
    places = seed_map(arm)
    everywhere = features(arm, places.q[int(worst)])
    farther = []
    for truth in random_joints(arm.robot, 50, seed=5):
        goal = target(arm.forward(truth))
        found = np.linalg.norm(features(arm, places.nearest(goal, 8, worst=worst)) - wanted(goal), axis=1)
        assert (np.diff(found) > -1e-6).all()
        least = np.sort(np.linalg.norm(everywhere - wanted(goal), axis=1))[:8]
        assert (found > least - 1e-5).all()
        farther.append(found.mean() / least.mean())
    assert np.mean(farther) < 1.15


def test_around_holds_the_nearest(arm: ArmModel) -> None:
    goal = target(arm.forward(random_joints(arm.robot, 1, seed=6)[0]))
    around = {tuple(q) for q in seed_map(arm).around(goal)}
    assert around >= {tuple(q) for q in seed_map(arm).nearest(goal, 8)}


def test_anywhere_is_the_same_each_time(arm: ArmModel) -> None:
    np.testing.assert_array_equal(seed_map(arm).anywhere(30), seed_map(arm).anywhere(30))
    assert len(np.unique(seed_map(arm).anywhere(30), axis=0)) > 20


@pytest.mark.parametrize("name", ["panda", "ur5", "so101"])
def test_manipulability_is_the_product_of_the_singular_values(name: str) -> None:
    arm = arm_of(name)
    J = np.array([arm.jacobian(q) for q in random_joints(arm.robot, 20, seed=7)])
    np.testing.assert_allclose(manipulability(J), np.linalg.svd(J, compute_uv=False).prod(axis=1), atol=1e-12)


def test_a_straight_arm_is_singular() -> None:
    arm = arm_of("ur5")
    assert manipulability(arm.jacobian(np.zeros(6))[None])[0] < 1e-9


def test_seeds_are_kept_and_an_arm_of_other_limits_has_its_own(
    odd_arm: ArmModel, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr(seeds, "SAMPLES", 2**10)
    made = seed_map.__wrapped__(odd_arm)
    assert len(list(tmp_path.rglob("*.npz"))) == 1
    monkeypatch.setattr(seeds, "_build", lambda arm: pytest.fail("built again"))
    again = seed_map.__wrapped__(odd_arm)
    np.testing.assert_array_equal(again.q, made.q)
    assert again.clumsy == made.clumsy
    with pytest.raises(pytest.fail.Exception, match="built again"):
        seed_map.__wrapped__(arm_of("so101"))
