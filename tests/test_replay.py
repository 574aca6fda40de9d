"""From a plan to what the replay shows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import pbd
from pbd.data import Obstacle
from pbd.planning import PlanOptions, plan_keyframes
from pbd.pose import Pose
from pbd.replay import replay_scene
from pbd.tracking.keyframes import find_keyframes


@pytest.mark.parametrize("scale", [1.0, 0.5])
def test_a_plan_becomes_a_scene(scale: float) -> None:
    demo, robot = pbd.load_demo("pouring"), pbd.load_robot("panda")
    assert robot.dock is not None
    shelf = Obstacle("the shelf", "box", (0.2, 0.2, 0.02), Pose(np.array([-0.4, 0.6, 0.3]), np.eye(4)[0]))
    calibration = replace(robot.dock, obstacles=(shelf,))
    path, options = pbd.track(demo.recording), PlanOptions(scale=scale)
    plan = plan_keyframes(find_keyframes(path), calibration, robot, options, path, demo.grasped)
    scene = replay_scene(demo, path, plan, robot, options, ("a warning",))
    assert scene.obstacles == (shelf,)
    assert scene.touching is None
    assert "a warning" in scene.notes
    for shown, keyframe, pose in zip(scene.keyframes, plan.keyframes, plan.T_base_tool, strict=True):
        assert shown.cov is not None
        # The tool's frame lies in the sensor's origin here: its ellipsoid is the hand's, scaled and turned.
        np.testing.assert_allclose(
            np.linalg.eigvalsh(shown.cov[:3, :3]), scale**2 * np.linalg.eigvalsh(keyframe.cov[:3, :3]), atol=1e-12
        )
        nearest = np.linalg.norm(scene.hand_path_base - pose.p, axis=1).min()
        assert nearest < 0.002 + 2.0 * scale * float(np.sqrt(np.linalg.eigvalsh(keyframe.cov[:3, :3]).max()))
