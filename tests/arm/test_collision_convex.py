"""Convex parts hold the whole mesh, and no more than they must."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from pbd.arm.convex import CORNER_TOLERANCE_M, CORNERS, ConvexPart, convex_parts, hull_corners, simplified
from scipy.optimize import nnls
from scipy.spatial import ConvexHull

from pbd.pose import Array, Pose, quat_exp

lengths = st.floats(0.02, 0.3)
triples = st.tuples(lengths, lengths, lengths)
places = st.tuples(*(st.floats(-0.2, 0.2),) * 3)
turns = st.tuples(*(st.floats(-3.0, 3.0),) * 3)


def box(size: tuple[float, ...], pose: Pose) -> Array:
    """Its 12 triangles."""
    corners = pose.act(0.5 * np.array(size) * np.array([np.where(m, 1.0, -1.0) for m in np.ndindex(2, 2, 2)]))
    triangles: Array = corners[ConvexHull(corners).simplices]
    return triangles


def bent(arm: float = 0.3, thick: float = 0.05) -> Array:
    """An L of two boxes in the xy plane: along x from the origin, and along y from the origin."""
    along_x = box((arm, thick, thick), Pose.from_rpy((arm / 2, 0, 0), (0, 0, 0)))
    along_y = box((thick, arm, thick), Pose.from_rpy((0, arm / 2, 0), (0, 0, 0)))
    return np.concatenate((along_x, along_y))


def on_surface(triangles: Array, count: int, seed: int = 0) -> Array:
    rng = np.random.default_rng(seed)
    weights = rng.dirichlet((1.0, 1.0, 1.0), count)
    points: Array = np.einsum("ij,ijk->ik", weights, triangles[rng.integers(len(triangles), size=count)])
    return points


def distance(points: Array, part: ConvexPart) -> Array:
    """How far points lie outside a part, at most: least squares over its corners' weights, which add up to one."""
    heavy = 1e3
    A = np.vstack((part.points.T, np.full(len(part.points), heavy)))
    return np.array([nnls(A, np.append(p, heavy))[1] for p in points]) - part.pad


@settings(max_examples=25, deadline=None)
@given(st.lists(st.tuples(triples, places, turns), min_size=1, max_size=4))
def test_no_part_of_a_mesh_is_left_out(
    boxes: list[tuple[tuple[float, ...], tuple[float, ...], tuple[float, ...]]],
) -> None:
    triangles = np.concatenate([box(size, Pose(np.array(p), quat_exp(turn))) for size, p, turn in boxes])
    parts = convex_parts(triangles)
    points = on_surface(triangles, 40)
    assert np.min([distance(points, part) for part in parts], axis=0).max() < 1e-6


def test_a_bend_stays_open() -> None:
    """One hull would hold this point; the parts keep at least 5 cm away from it."""
    inside_the_bend = np.array([[0.1, 0.1, 0.0]])
    hull = ConvexHull(bent().reshape(-1, 3))
    assert (hull.equations @ np.append(inside_the_bend[0], 1.0)).max() < 0.0
    parts = convex_parts(bent())
    assert min(distance(inside_the_bend, part)[0] for part in parts) > 0.05


def test_what_is_convex_is_not_cut() -> None:
    parts = convex_parts(box((0.1, 0.2, 0.3), Pose.identity()))
    assert len(parts) == 1
    assert (len(parts[0].points), parts[0].pad) == (8, 0.0)


def directions(count: int) -> Array:
    d = np.random.default_rng(3).normal(size=(count, 3))
    return np.asarray(d / np.linalg.norm(d, axis=1, keepdims=True))


@pytest.mark.parametrize("stretch", [(0.1, 0.1, 0.1), (0.02, 0.1, 0.3)])
def test_a_round_hull_loses_corners_but_holds_them_all(stretch: tuple[float, ...]) -> None:
    points = directions(1500) * np.array(stretch)
    part = simplified(points)
    assert len(part.points) < 0.7 * len(ConvexHull(points).vertices)
    assert 0.0 < part.pad <= 1.5 * CORNER_TOLERANCE_M
    d = directions(500)
    reach, kept = (points @ d.T).max(axis=0), (part.points @ d.T).max(axis=0)
    assert (kept + part.pad >= reach).all()
    assert (kept <= reach).all()
    lost = points[~(points[:, None] == part.points[None]).all(axis=2).any(axis=1)]
    assert distance(lost[:20], part).max() <= 1e-6


def test_a_pad_is_not_fooled_by_faces_in_one_plane() -> None:
    """A disc's lid is many triangles; what sticks out beyond its rim is near one of them and far from the others."""
    angle = np.linspace(0.0, 2.0 * np.pi, 400, endpoint=False)
    rim = 0.1 * np.stack((np.cos(angle), np.sin(angle)), axis=1)
    points = np.concatenate([np.column_stack((rim, np.full(400, z))) for z in (-0.005, 0.005)])
    assert simplified(points).pad <= 1.5 * CORNER_TOLERANCE_M


def test_few_corners_are_all_kept() -> None:
    points = directions(CORNERS)
    part = simplified(points)
    assert part.pad == 0.0
    assert_allclose(sorted(map(tuple, part.points)), sorted(map(tuple, points)))


@pytest.mark.parametrize(
    "points",
    [
        np.zeros((1, 3)),
        np.eye(3),
        np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]),
        np.arange(6.0).reshape(2, 3),
    ],
    ids=["a point", "a triangle", "a square", "a line"],
)
def test_what_has_no_volume_is_held_by_a_thin_box(points: Array) -> None:
    corners = hull_corners(points)
    assert ConvexHull(corners).volume > 0.0
    assert distance(points, ConvexPart(corners, 0.0)).max() < 1e-6


def test_a_mesh_without_volume_is_one_part() -> None:
    sheet = np.array([[[0.0, 0, 0], [1, 0, 0], [1, 1, 0]], [[0.0, 0, 0], [1, 1, 0], [0, 1, 0]]])
    parts = convex_parts(sheet)
    assert len(parts) == 1
    assert distance(on_surface(sheet, 20), parts[0]).max() < 1e-6
