"""All parts of a scene are seen on the page at the right place: pictures against points that Python computes."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pbd.pose import Array
from pbd.view import shapes
from pbd.view.meshcat_encoding import two_sigma_transform
from pbd.view.page import write_page
from pbd.view.replay_scene import ReplayScene
from pbd.view.visuals import read_visuals
from tests.view import scenes
from tests.view.browser import Replay
from tests.view.chromium import Chromium

DIFFERS = 12
"""Least difference of two pixels, of 255 in any channel."""
BLACK = (0.0, 0.0, 0.0)


def links(scene: ReplayScene) -> dict[str, Array]:
    """Some vertices (n, 3) m in base of each link at the start."""
    found: dict[str, list[Array]] = {}
    for visual in read_visuals(scene.robot):
        joint, T_joint_link = scene.motion.link(visual.link)
        T_base_visual = scene.motion.joint(joint)[0] @ T_joint_link @ visual.T_link_visual
        corners = visual.mesh.vertices
        found.setdefault(visual.link, []).append(T_base_visual.act(corners[:: max(len(corners) // 100, 1)]))
    return {link: np.concatenate(corners) for link, corners in found.items()}


def marks(scene: ReplayScene) -> list[tuple[str, Array]]:
    """Points (n, 3) m in base on or in each body except the robot and the grasped object, with the name of its part."""
    found = [("hand_path", scene.hand_path_base), ("tool_path", scene.motion.tool(scene.robot).p)]
    axes = np.linspace(0.1, 0.9, 9)[:, None, None] * shapes.TRIAD_M * np.eye(3)
    ball = shapes.sphere(0.9, BLACK).vertices
    for T_base_tool, cov in zip(scene.T_base_tool, scene.cov, strict=True):
        found.append(("keyframes", T_base_tool.act(axes.reshape(-1, 3))))
        T = two_sigma_transform(T_base_tool.p, cov[:3, :3])
        found.append(("keyframes", ball @ T[:3, :3].T + T[:3, 3]))
    for each in scene.calibration.obstacles:
        corners = shapes.primitive(each.shape, each.size, BLACK).vertices
        weights = np.random.default_rng(0).dirichlet(np.full(len(corners), 0.3), 200)  # points inside it
        found.append(("obstacles", each.T_base_obstacle.act(weights @ corners)))
    return found


def share(differs: NDArray[np.bool_], pixels: NDArray[np.int64]) -> float:
    """Share of the pixels (n, 2) inside the window that differ, or have a neighbour that does."""
    height, width = differs.shape
    wide = np.pad(differs, 1)
    near = np.any([wide[i : i + height, k : k + width] for i in range(3) for k in range(3)], axis=0)
    inside = ((pixels >= 0) & (pixels < (width, height))).all(axis=1)
    assert inside.mean() > 0.1, "it lies outside the picture"
    return float(near[pixels[inside, 1], pixels[inside, 0]].mean())


def differs(one: NDArray[np.int64], other: NDArray[np.int64]) -> NDArray[np.bool_]:
    found: NDArray[np.bool_] = np.abs(one - other).max(axis=2) > DIFFERS
    return found


def test_each_part_is_seen_where_it_is(chrome: Chromium, tmp_path: Path) -> None:
    scene = scenes.in_the_way()
    parts = ["robot", "hand_path", "tool_path", "keyframes", "object", "obstacles"]
    write_page(scene, tmp_path / "page.html")
    chrome.set_size(400, 300)
    chrome.set_media("dark")  # a white robot on white ground differs little
    try:
        replay = Replay(chrome, (tmp_path / "page.html").as_uri())
        nothing, whole = replay.drawn(), replay.drawn(*parts)
        alone = {part: differs(replay.drawn(part), nothing) for part in parts}
        without = {part: differs(replay.drawn(*(each for each in parts if each != part)), whole) for part in parts}
        for part, points in marks(scene):
            assert share(alone[part], replay.projected(points)) > 0.99, part
        for link, corners in links(scene).items():
            seen = differs(replay.drawn("robot", link=link), nothing)
            assert share(seen, replay.projected(corners)) > 0.99, link
    finally:
        chrome.set_size()
        chrome.set_media()
    for part in parts:  # of what it covers alone, at least half is seen among the others, or seen through them
        assert (without[part] & alone[part]).sum() > 0.5 * alone[part].sum() > 0, part
