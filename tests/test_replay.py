"""The scene of a replay agrees with its plan."""

from dataclasses import replace

import numpy as np
import pytest

import pbd
from pbd.arm.gripper import arm_bodies
from pbd.data import Known, Obstacle, Place
from pbd.data.world import THE_TOOL
from pbd.planning import PlanOptions, arm_of, plan_keyframes, plan_path
from pbd.pose import Pose
from pbd.replay import replay_scene
from tests.arm.bundled import keyframes_of, path_of
from tests.arm.collision_oracles import placements
from tests.not_none import not_none


@pytest.mark.parametrize("scale", [1.0, 0.5])
def test_a_plan_becomes_a_scene(scale: float) -> None:
    demo, robot = pbd.load_demo("paper-test1"), pbd.load_robot("panda")
    shelf = Obstacle("the shelf", "box", (0.2, 0.2, 0.02), Pose(np.array([-0.4, 0.6, 0.3]), np.eye(4)[0]))
    calibration = replace(not_none(robot.dock), obstacles=(shelf,))
    path, options = path_of("paper-test1"), PlanOptions(scale=scale)
    plan = plan_keyframes(keyframes_of("paper-test1"), calibration, robot, options, path, demo.grasped)
    scene = replay_scene(plan, ("a warning",))
    assert scene.calibration.obstacles == (shelf,)
    assert scene.contacts == ()
    assert scene.warnings == ("a warning",)
    for cov, keyframe, pose in zip(scene.cov, plan.keyframes, plan.T_base_tool, strict=True):
        # The tool's frame lies in the sensor's origin here: its ellipsoid is the hand's, scaled and turned.
        np.testing.assert_allclose(
            np.linalg.eigvalsh(cov[:3, :3]), scale**2 * np.linalg.eigvalsh(keyframe.cov[:3, :3]), atol=1e-12
        )
        nearest = np.linalg.norm(scene.hand_path_base - pose.p, axis=1).min()
        assert nearest < 0.002 + 2.0 * scale * float(np.sqrt(np.linalg.eigvalsh(keyframe.cov[:3, :3]).max()))


def test_the_drawn_path_meets_the_tool_where_known_places_correct_mount_and_scale() -> None:
    demo, robot = pbd.load_demo("pouring"), pbd.load_robot("panda")
    bench = replace(
        not_none(robot.dock), cov_sensor_tool=0.01**2 * np.eye(6), residuals={"dock.scale_sigma": 0.03}, name="bench"
    )
    options = PlanOptions(approach=False)
    shown = plan_keyframes(keyframes_of("pouring"), bench, robot, options, path_of("pouring"))
    p, t = np.array([pose.p for pose in shown.T_base_tool]), [each.t for each in shown.keyframes]
    larger = p + 0.02 * (p - p[0]) + (0.005, 0.0, 0.0)
    places = tuple(Place((t[k],), tuple(larger[k].tolist()), 0.001) for k in (2, 3, 4))
    path = pbd.track(demo, known=Known(places=places), calibration=bench)
    plan = plan_path(path, bench, robot, options)
    corrected = plan.placed.calibration
    assert np.linalg.norm(corrected.T_sensor_tool.p - bench.T_sensor_tool.p) > 0.002
    assert abs(plan.scale - bench.scale) > 0.001
    drawn, at = replay_scene(plan).hand_path_base, path.t[path.demonstrated]
    for keyframe, pose in zip(plan.keyframes, plan.T_base_tool, strict=True):
        np.testing.assert_allclose(drawn[np.searchsorted(at, keyframe.t)], pose.p, atol=1e-4)


@pytest.mark.filterwarnings("ignore:not checked against the table")
def test_all_that_touches_is_shown_by_when_it_begins() -> None:
    demo, robot = pbd.load_demo("pouring"), pbd.load_robot("panda")
    post = Obstacle("the post", "cylinder", (0.06, 0.5), Pose(np.array([0.45, -0.05, 0.25]), np.eye(4)[0]))
    calibration = replace(not_none(robot.dock), obstacles=(post,), table_height=0.16)
    path, options = path_of("pouring"), PlanOptions(allow_collision=True)
    plan = plan_keyframes(keyframes_of("pouring")[:5], calibration, robot, options, path, demo.grasped)
    assert plan.touching is not None
    told = plan.touching.error.message
    scene = replay_scene(plan, (f"collision: {told}",))
    assert [each.bodies for each in scene.contacts] == [(h.hit.first, h.hit.second) for h in plan.touching.hits]
    assert {each.bodies[1] for each in scene.contacts} >= {"the post", "the table"}
    assert [each.start for each in scene.contacts] == sorted(each.start for each in scene.contacts)
    assert [each.message for each in scene.contacts].count(told) == 1  # the first, with what to do about it
    assert all(0.0 <= each.start <= each.end <= plan.trajectory.duration for each in scene.contacts)


@pytest.mark.parametrize(("name", "ahead_m"), [("ur5", 0.16), ("ur5", 0.045), ("ur5", 0.03), ("panda", 0.1)])
def test_the_tool_that_is_checked_is_shown(name: str, ahead_m: float) -> None:
    """Its pose and size in the scene are those of the body that collisions are checked with."""
    known = pbd.load_robot(name)
    robot = replace(known, T_body_tool=Pose(np.array([0.0, 0.0, ahead_m]), known.T_body_tool.wxyz))
    demo = pbd.load_demo("paper-test2")
    path, options = path_of("paper-test2"), PlanOptions(allow_collision=True)
    plan = plan_keyframes(keyframes_of("paper-test2"), not_none(robot.dock), robot, options, path, demo.grasped)
    rod = replay_scene(plan).rod
    arm = arm_of(robot)
    checked = arm_bodies(arm)[-1]
    assert checked.name == THE_TOOL
    assert rod is not None
    assert (rod.diameter, rod.length) == checked.size
    x = np.append(robot.home, 1.0)
    T_base_rod = placements(arm, x)[checked.joint] @ checked.T_joint_body
    assert max((arm.forward(robot.home) @ rod.T_tool_rod).distance(T_base_rod)) < 1e-9
