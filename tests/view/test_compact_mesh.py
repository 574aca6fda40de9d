"""Compacting keeps the surface, and splits vertices at sharp edges."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from pbd.errors import RobotError
from pbd.io.meshes import TriangleSoup
from pbd.pose import Array
from pbd.view import shapes
from pbd.view.compact_mesh import Mesh, compact
from pbd.view.visuals import load_mesh
from tests.view.scenes import share

GREY = (0.5, 0.5, 0.5)
STL = share() / "example-robot-data" / "robots" / "so_arm_description" / "meshes" / "so100" / "Moving_Jaw.stl"


def face_normals(mesh: Mesh) -> Array:
    corners: Array = mesh.vertices[mesh.faces]
    normals: Array = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return normals


def page_normals(mesh: Mesh) -> Array:
    """Vertex normals as three.js computes them: the mean of the faces', weighted by area."""
    normals = np.zeros_like(mesh.vertices)
    for corner in mesh.faces.T:
        np.add.at(normals, corner, face_normals(mesh))
    lengths: Array = np.linalg.norm(normals, axis=1, keepdims=True)
    return normals / lengths


@given(arrays(np.float64, (12, 3, 3), elements=st.floats(-1.0, 1.0, width=32)))
def test_faces_stay_where_they_are(corners: Array) -> None:
    rgb = np.linspace(0.0, 1.0, 36).reshape(12, 3)
    try:
        mesh = compact(TriangleSoup(corners, rgb), GREY)
    except ValueError:
        sizes = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
        extent = np.ptp(corners.reshape(-1, 3), axis=0).max()
        assert sizes.max() <= 1e-4 * max(extent, 1e-12) ** 2 or extent == 0.0
        return
    got = mesh.vertices[mesh.faces]
    distance = np.abs(got[:, None] - corners[None]).max(axis=(2, 3))
    assert (distance.min(axis=1) <= 0.51 * mesh.step + 1e-12).all()
    face_rgb = mesh.rgb[mesh.faces]
    assert (face_rgb == face_rgb[:, :1]).all()  # a face has one colour, even where faces touch


def test_a_box_has_sharp_edges() -> None:
    mesh = shapes.box((1.0, 2.0, 3.0), GREY)
    assert len(mesh.grid) == 24
    assert len(mesh.faces) == 12
    flat = face_normals(mesh) / np.linalg.norm(face_normals(mesh), axis=1, keepdims=True)
    np.testing.assert_allclose(page_normals(mesh)[mesh.faces], np.repeat(flat[:, None], 3, axis=1), atol=1e-4)


def test_a_sphere_is_smooth() -> None:
    mesh = shapes.sphere(1.0, GREY)
    away = mesh.vertices / np.linalg.norm(mesh.vertices, axis=1, keepdims=True)
    assert len(np.unique(mesh.grid, axis=0)) == len(mesh.grid)
    assert np.einsum("ij,ij->i", page_normals(mesh), away).min() > 0.99


def test_a_hole_makes_both_sides_visible() -> None:
    whole = shapes.box((1.0, 1.0, 1.0), GREY)
    corners = whole.vertices[whole.faces]
    unknown = np.full((12, 3), np.nan)
    assert whole.closed
    assert not compact(TriangleSoup(corners[2:], unknown[2:]), GREY).closed
    assert not compact(TriangleSoup(corners[:, ::-1], unknown), GREY).closed  # inside out


def test_a_mirrored_mesh_keeps_its_outside() -> None:
    plain, mirrored = (load_mesh(STL, (2.0, y, 1.0), GREY) for y in (1.0, -1.0))
    assert plain.closed
    assert mirrored.closed
    for end in (np.min, np.max):
        np.testing.assert_allclose(end(mirrored.vertices * (1, -1, 1), axis=0), end(plain.vertices, axis=0), atol=1e-9)


def test_what_has_no_area_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.obj").write_text("v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n")
    with pytest.raises(RobotError, match=r"a.obj can't be drawn \(no triangle has an area\)"):
        load_mesh(tmp_path / "a.obj", (1.0, 1.0, 1.0), GREY)
