"""The commands that are sent to the page."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pbd.data import GraspedObject, Gripper
from pbd.io.meshes import mesh_file
from pbd.pose import Pose
from pbd.view import visuals
from pbd.view.meshcat_encoding import LEAST_SIGMA_M, ScenePath, Visualizer, two_sigma_transform
from pbd.view.replay_scene import ReplayScene, Rod, TouchingPair
from pbd.view.robot_motion import FRAME_RATE_HZ
from pbd.view.scene import build, carried_object
from pbd.view.visuals import read_visuals
from tests.view import scenes


class Recorder:
    """A substitute for meshcat's window that keeps the commands."""

    def __init__(self) -> None:
        self.commands: list[dict[str, Any]] = []

    def send(self, command: Any) -> None:
        self.commands.append(command.lower())


def commands(scene: ReplayScene) -> list[dict[str, Any]]:
    recorder = Recorder()
    build(scene, Visualizer.view_into(recorder, ScenePath(("pbd",))))
    return recorder.commands


RED = (181, 3, 3)
"""The red of bodies that touch, (0.86, 0.12, 0.10) in sRGB, as linear light in 8 bits."""


def colours(command: dict[str, Any]) -> set[tuple[int, ...]]:
    """Colours of an object's vertices."""
    packed = command["object"]["geometries"][0]["data"]["attributes"]["color"]["array"].data
    return {tuple(rgb) for rgb in np.frombuffer(packed, np.uint8).reshape(-1, 3).tolist()}


@pytest.fixture(scope="module")
def pouring() -> list[dict[str, Any]]:
    return commands(scenes.pouring())


def test_every_animated_node_exists_and_moves_all_the_time(pouring: list[dict[str, Any]]) -> None:
    placed = {command["path"] for command in pouring if command["type"] in ("set_transform", "set_object")}
    (animation,) = (command for command in pouring if command["type"] == "set_animation")
    moving = {}
    for part in animation["animations"]:
        assert part["path"] in placed
        for track in part["clip"]["tracks"]:
            t = np.frombuffer(track["times"].data, dtype=np.float32)
            values = np.frombuffer(track["values"].data, dtype=np.float32)
            assert len(values) == len(t) * {"vector3": 3, "quaternion": 4}[track["type"]]
            if len(t) > 1:
                assert np.diff(t) == pytest.approx(1.0 / FRAME_RATE_HZ, rel=1e-3)
                assert t[-1] >= scenes.pouring().trajectory.duration - 1e-6
            moving[part["path"].split("/")[-1], track["name"]] = len(t) > 1
    for i in range(1, 8):  # a joint that turns in its place has one position, and only its turn is sent
        assert moving[f"panda_joint{i}", ".quaternion"]
        assert not moving[f"panda_joint{i}", ".position"]
    assert moving["panda_finger_joint1", ".position"]
    assert moving["object", ".position"]


def test_the_description_comes_last(pouring: list[dict[str, Any]]) -> None:
    scene = scenes.pouring()
    assert pouring[0]["type"] == "delete"  # of an earlier scene
    last = pouring[-1]
    assert last["property"] == "replay"
    assert [keyframe["t"] for keyframe in last["value"]["keyframes"]] == scene.trajectory.keyframe_t.tolist()
    assert last["value"]["duration"] == scene.trajectory.duration


def test_the_camera_sees_the_whole_path(pouring: list[dict[str, Any]]) -> None:
    seen = np.array(pouring[-1]["value"]["bounds"])
    path = scenes.pouring().hand_path_base
    slack = 0.01
    assert (seen.min(axis=0) <= path.min(axis=0) + slack).all()
    assert (seen.max(axis=0) >= path.max(axis=0) - slack).all()
    assert seen[:, 2].max() > 0.5  # and the arm above it


def test_a_detour_has_a_path_a_time_span_and_a_marked_keyframe() -> None:
    scene = scenes.ur5_moves()
    assert not any("/detour" in command["path"] for command in commands(scene))
    first, second = scene.trajectory.keyframe_t[1:3].tolist()
    sent = commands(replace(scene, detours=((first, second),)))
    (drawn,) = (command for command in sent if "/detour" in command["path"])
    assert drawn["path"].endswith("/detour/0")
    described = sent[-1]["value"]
    ((start, end),) = described["detours"]
    assert first <= start < end <= second
    assert [keyframe["detour"] for keyframe in described["keyframes"]] == [False, False, True, False, False]


def test_an_object_stands_is_held_and_stands_again() -> None:
    scene = scenes.pouring()
    tool = scene.motion.tool(scene.robot)
    carried = carried_object(scene, tool)
    assert carried is not None
    close, let_go = (int(np.searchsorted(scene.motion.t, phase.end)) for phase in scene.phases[:2])
    held = [(tool[i].inverse() @ carried[i]).log() for i in range(close, let_go + 1)]
    np.testing.assert_allclose(held, np.tile(held[0], (len(held), 1)), atol=1e-9)
    for still in (carried.p[: close + 1], carried.p[let_go + 1 :]):
        np.testing.assert_allclose(still, np.tile(still[0], (len(still), 1)), atol=1e-9)


@given(st.lists(st.floats(0.0, 0.1), min_size=3, max_size=3), st.integers(0, 2**32 - 1))
def test_an_ellipsoid_is_two_sigma_and_the_page_can_decompose_it(sigma: list[float], seed: int) -> None:
    rng = np.random.default_rng(seed)
    axes = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    cov = axes @ np.diag(np.square(np.maximum(sigma, 2.0 * LEAST_SIGMA_M))) @ axes.T
    T = two_sigma_transform(np.ones(3), cov)
    np.testing.assert_allclose(T[:3, :3] @ T[:3, :3].T, 4.0 * cov, atol=1e-9)
    np.testing.assert_array_equal(T[:3, 3], np.ones(3))
    flat = two_sigma_transform(np.ones(3), axes @ np.diag(np.square(sigma)) @ axes.T)[:3, :3]
    turn = flat / np.linalg.norm(flat, axis=0)  # as three.js does it
    np.testing.assert_allclose(turn.T @ turn, np.eye(3), atol=1e-9)
    assert np.linalg.det(turn) > 0.0


def test_a_keyframe_that_is_certain_has_no_ellipsoid() -> None:
    scene = scenes.ur5_moves()
    certain = replace(scene, cov=np.zeros_like(scene.cov))
    assert not [command for command in commands(certain) if "two_sigma" in command.get("path", "")]
    assert commands(certain)[-1]["value"]["keyframes"][0]["sigma"] == [0.0, 0.0]


def test_moves_and_grips_have_their_times(pouring: list[dict[str, Any]]) -> None:
    trajectory = scenes.pouring().trajectory
    starts = np.append(0.0, trajectory.keyframe_t[1:-1] + 0.4)  # a move begins where the dwell of 0.4 s ends
    moves = pouring[-1]["value"]["moves"]
    np.testing.assert_allclose(moves, np.column_stack((starts, trajectory.keyframe_t[1:])), atol=0.011)
    ((start, end),) = pouring[-1]["value"]["closed"]
    assert start == pytest.approx(trajectory.keyframe_t[1], abs=0.05)  # the gripper moves in the dwells
    assert end == pytest.approx(trajectory.keyframe_t[6] + 0.4, abs=0.05)


def test_bodies_that_touch_are_red() -> None:
    sent = commands(scenes.in_the_way())
    objects = [command for command in sent if command["type"] == "set_object"]
    painted = {command["path"].split("/")[-1] for command in objects if colours(command) == {RED}}
    assert {name.partition(":")[2] or name for name in painted} == {
        "panda_hand",
        "panda_link6",
        "0",
    }  # obstacle 0 is the post
    described = sent[-1]["value"]
    assert described["warnings"] == []  # the warning would repeat the first contact
    assert [each["bodies"] for each in described["touching"]] == [
        ("panda_hand", "the post"),
        ("panda_link6", "the table"),
    ]
    assert np.ptp(np.array(described["bounds"]), axis=0).max() < 2.0  # a long wall does not shrink everything else


def placeholders(scene: ReplayScene) -> dict[str, dict[str, Any]]:
    """Commands that draw a gripper which the model lacks, by name."""
    objects = [each for each in commands(scene) if each["type"] == "set_object" and "/placeholder/" in each["path"]]
    return {each["path"].rpartition("/")[2]: each for each in objects}


def with_rod(scene: ReplayScene, ahead_m: float, length: float) -> ReplayScene:
    """The same with the tool frame `ahead_m` in front of its body, and a rod in between."""
    T_tool_rod = Pose(np.array([0.0, 0.0, -0.5 * length]), np.array([1.0, 0.0, 0.0, 0.0]))
    T_body_tool = Pose(np.array([0.0, 0.0, ahead_m]), scene.robot.T_body_tool.wxyz)
    return replace(scene, robot=replace(scene.robot, T_body_tool=T_body_tool), rod=Rod(T_tool_rod, 0.02, length))


@pytest.mark.parametrize(
    ("scene", "ahead_m", "drawn"),
    [
        (scenes.ur5_moves, 0.16, {"rod", "0", "1", "2"}),  # with a palm and two fingers
        (scenes.ur5_moves, 0.03, {"rod"}),  # no room for them
        (scenes.pouring, 0.1, {"rod"}),  # the model has fingers, which end before the tool
    ],
)
def test_the_rod_that_is_checked_is_drawn(scene: Callable[[], ReplayScene], ahead_m: float, drawn: set[str]) -> None:
    full = scene()
    assert placeholders(full) == {}
    assert set(placeholders(with_rod(full, ahead_m, ahead_m - 0.015))) == drawn


@pytest.mark.parametrize("touches", [False, True])
def test_the_placeholder_is_red_where_it_touches(touches: bool) -> None:
    """It is drawn, too, for a gripper whose fingers the model lacks."""
    full = with_rod(scenes.ur5_moves(), 0.16, 0.145)
    full = replace(full, robot=replace(full.robot, gripper=Gripper((), np.zeros(0), np.zeros(0), 0.5)))
    contact = TouchingPair(("the tool", "the table"), 1.0, 2.0, "it does")
    objects = placeholders(replace(full, contacts=(contact,) if touches else ())).values()
    assert len(objects) == 4
    assert [colours(each) == {RED} for each in objects] == [touches] * 4


@pytest.mark.parametrize(("width", "gap"), [(0.03, 0.03), (0.3, 0.16), (None, 0.08)])
def test_the_placeholders_fingers_are_as_far_apart_as_what_they_hold(width: float | None, gap: float) -> None:
    """All of it moves with the tool's frame; its fingers begin in the palm, and the rod is where it is checked."""
    full = with_rod(scenes.ur5_moves(), 0.16, 0.145)
    sent = commands(replace(full, grasped=None if width is None else GraspedObject("cylinder", (width, 0.1))))
    placed = {each["path"]: np.reshape(each["matrix"], (4, 4)).T for each in sent if each["type"] == "set_transform"}
    bounds = {}
    for each in (each for each in sent if each["type"] == "set_object" and "/placeholder/" in each["path"]):
        points = np.frombuffer(
            each["object"]["geometries"][0]["data"]["attributes"]["position"]["array"].data, np.int16
        )
        T_tool_mesh = placed[each["path"]] @ np.reshape(each["object"]["object"]["matrix"], (4, 4)).T
        p_tool = points.reshape(-1, 3) @ T_tool_mesh[:3, :3].T + T_tool_mesh[:3, 3]
        node, _, name = each["path"].rpartition("/")
        bounds[name] = np.array((p_tool.min(axis=0), p_tool.max(axis=0)))
    _, T_joint_body = full.motion.link(full.robot.body)
    np.testing.assert_allclose(placed[node], (T_joint_body @ full.robot.T_body_tool).matrix(), atol=1e-9)
    np.testing.assert_allclose(bounds["rod"], ((-0.01, -0.01, -0.155), (0.01, 0.01, 0.01)), atol=1e-5)
    palm, left, right = (bounds[name] for name in "012")
    np.testing.assert_allclose((left[1, 0], right[0, 0]), (-0.5 * gap, 0.5 * gap), atol=1e-5)
    for low, high in (left, right):
        assert (palm[0, :2] < low[:2]).all()
        assert (high[:2] < palm[1, :2]).all()
        np.testing.assert_allclose((low[2], high[2]), (palm[:, 2].mean(), 0.01), atol=1e-5)


class TestVisuals:
    def urdf(self, folder: Path, visual: str) -> tuple[visuals.Visual, ...]:
        path = folder / "thing.urdf"
        path.write_text(
            f'<robot name="thing"><material name="tea"><color rgba="0 0.5 0 1"/></material>'
            f'<link name="cup"><visual>{visual}</visual></link></robot>'
        )
        return read_visuals(replace(scenes.ur5(), urdf=path))

    @pytest.mark.parametrize(
        ("geometry", "size"),
        [
            ('<box size="0.1 0.2 0.3"/>', (0.1, 0.2, 0.3)),
            ('<cylinder radius="0.1" length="0.5"/>', (0.2, 0.2, 0.5)),
            ('<sphere radius="0.1"/>', (0.2, 0.2, 0.2)),
        ],
    )
    def test_primitives(self, tmp_path: Path, geometry: str, size: tuple[float, float, float]) -> None:
        (visual,) = self.urdf(
            tmp_path,
            f'<origin xyz="1 2 3" rpy="0 0 1.5"/><geometry>{geometry}</geometry><material name="tea"/>',
        )
        assert visual.link == "cup"
        np.testing.assert_allclose(np.ptp(visual.mesh.vertices, axis=0), size, atol=1e-4)
        np.testing.assert_allclose(visual.T_link_visual.log(), [1, 2, 3, 0, 0, 1.5], atol=1e-12)
        assert (visual.mesh.rgb == [0, 128, 0]).all()

    @pytest.mark.parametrize("colour", ["", "0 1", "red green blue 1"])
    def test_a_material_whose_own_colour_is_none_has_its_names(self, tmp_path: Path, colour: str) -> None:
        material = f'<material name="tea"><color rgba="{colour}"/></material>'
        (visual,) = self.urdf(tmp_path, f'<geometry><sphere radius="1"/></geometry>{material}')
        assert (visual.mesh.rgb == [0, 128, 0]).all()

    def test_files_are_found_as_urdf_names_them(self, tmp_path: Path) -> None:
        mesh = tmp_path / "packages" / "thing" / "meshes" / "a.stl"
        mesh.parent.mkdir(parents=True)
        mesh.touch()
        urdf = tmp_path / "packages" / "thing" / "thing.urdf"
        packages = tmp_path / "packages"
        assert mesh_file("package://thing/meshes/a.stl", urdf, [tmp_path, packages]) == mesh
        assert mesh_file("package://thing/meshes/a.stl", urdf, [packages / "thing"]) == mesh
        assert mesh_file("meshes/a.stl", urdf, []) == mesh
        assert mesh_file(f"file://{mesh}", urdf, []) == mesh
