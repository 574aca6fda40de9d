"""Paths through keyframes among obstacles: another way to hold the arm where the shortest one hits something."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from pbd.arm.collision import check_motion
from pbd.arm.ik import check
from pbd.arm.model import ArmModel
from pbd.arm.scene import CollisionScene
from pbd.arm.sequence import BarredError, solve_sequence
from pbd.arm.timing import time_keyframes
from pbd.data import Obstacle
from pbd.pose import Array, Pose

DOWN = (np.pi, 0.0, 0.0)
POSES = [Pose.from_rpy(p, DOWN) for p in ((0.5, -0.2, 0.35), (0.5, -0.2, 0.2), (0.5, 0.2, 0.2), (0.5, 0.2, 0.35))]
APART = [Pose.from_rpy(p, DOWN) for p in ((0.5, -0.3, 0.35), (0.5, -0.3, 0.2), (0.5, 0.3, 0.2), (0.5, 0.3, 0.35))]


def through(scene: CollisionScene, poses: list[Pose]) -> Array:
    """The path that the scene lets pass, there and back."""
    home = scene.arm.robot.home
    legs = scene.legs(poses, [None] * len(poses))
    return solve_sequence(
        scene.arm,
        poses,
        home,
        q_end=home,
        allowed=lambda i, q: scene.hit(q, legs[i]) is None,
        clear=lambda i, q, q_next: scene.check_move(q, q_next, legs[i]) is None,
    )


def sphere_at(p: Array, radius: float) -> Obstacle:
    return Obstacle("ball", "sphere", (radius,), Pose.from_rpy(p, (0.0, 0.0, 0.0)))


def test_where_nothing_is_in_the_way_nothing_changes(arm: ArmModel) -> None:
    home = arm.robot.home
    path = through(CollisionScene(arm, 0.0), POSES)
    np.testing.assert_array_equal(path, solve_sequence(arm, POSES, home, q_end=home))


def test_a_ball_at_the_elbow_is_avoided(arm: ArmModel) -> None:
    """Where the elbow is on the shortest path there is a ball now, on one side of it."""
    home = arm.robot.home
    shortest = solve_sequence(arm, POSES, home, q_end=home)
    arm.forward(shortest[2])
    elbow = (arm.T_base_universe * arm.data.oMi[4]).translation + np.array([0.0, 0.1, 0.0])
    scene = CollisionScene(arm, 0.0, [sphere_at(elbow, 0.05)])
    assert any(scene.hit(q) for q in shortest)
    path = through(scene, POSES)
    assert all(check(arm, pose, q).reached for pose, q in zip(POSES, path, strict=True))
    assert not any(scene.check_move(*move) for move in pairwise((home, *path, home)))
    assert check_motion(scene, time_keyframes(arm, path, [0.2] * len(path), [None] * len(path), home)) is None


def test_a_wall_that_no_straight_move_passes_is_named(arm: ArmModel) -> None:
    """Between the second keyframe and the third: the arm can stand on either side of it."""
    wall = Obstacle("wall", "box", (1.2, 0.02, 1.6), Pose.from_rpy((0.95, 0.0, 0.8), (0.0, 0.0, 0.0)))
    scene = CollisionScene(arm, None, [wall])
    home = arm.robot.home - np.array([0.6, 0, 0, 0, 0, 0, 0])
    with pytest.raises(BarredError) as caught:
        solve_sequence(
            arm,
            APART,
            home,
            allowed=lambda _, q: scene.hit(q) is None,
            clear=lambda _, q, q_next: scene.check_move(q, q_next) is None,
        )
    barred = caught.value
    assert (barred.keyframe, barred.stands) == (2, True)
    # Up to the keyframe before, the path that it gives is free; the next move isn't.
    moves = list(pairwise((home, *barred.path)))
    assert [scene.check_move(*move) is None for move in moves[:3]] == [True, True, False]
