"""Compacting: the same surface, with vertices split where it has edges."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from pbd.errors import RobotError
from pbd.pose import Array
from pbd.view import mesh_files, shapes
from pbd.view.mesh_files import load_mesh, read_soup
from pbd.view.meshes import Mesh, Soup, compact
from tests.unprivileged import full_disk
from tests.view.scenes import share

GREY = (0.5, 0.5, 0.5)
STL = share() / "example-robot-data" / "robots" / "so_arm_description" / "meshes" / "so100" / "Moving_Jaw.stl"


def face_normals(mesh: Mesh) -> Array:
    corners: Array = mesh.vertices[mesh.faces]
    normals: Array = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return normals


def page_normals(mesh: Mesh) -> Array:
    """As three.js computes them: the sum of the faces' areas at each vertex."""
    normals = np.zeros_like(mesh.vertices)
    for corner in mesh.faces.T:
        np.add.at(normals, corner, face_normals(mesh))
    lengths: Array = np.linalg.norm(normals, axis=1, keepdims=True)
    return normals / lengths


@given(arrays(np.float64, (12, 3, 3), elements=st.floats(-1.0, 1.0, width=32)))
def test_faces_stay_where_they_are(corners: Array) -> None:
    rgb = np.linspace(0.0, 1.0, 36).reshape(12, 3)
    try:
        mesh = compact(Soup(corners, rgb), GREY)
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
    assert not compact(Soup(corners[2:], unknown[2:]), GREY).closed
    assert not compact(Soup(corners[:, ::-1], unknown), GREY).closed  # inside out


def test_a_binary_stl_reads_as_assimp_reads_it() -> None:
    ours, theirs = read_soup(STL), mesh_files._read_by_assimp(STL)
    assert len(ours.corners) == len(theirs.corners)
    np.testing.assert_allclose(
        np.sort(ours.corners.mean(axis=1), axis=0), np.sort(theirs.corners.mean(axis=1), axis=0), atol=1e-6
    )


def test_a_text_stl_is_read(tmp_path: Path) -> None:
    path = tmp_path / "one.stl"
    path.write_text(
        "solid one\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\n"
        "endsolid one\n"
    )
    np.testing.assert_allclose(read_soup(path).corners, [[[0, 0, 0], [1, 0, 0], [0, 1, 0]]])


@pytest.mark.parametrize("name", ["missing.stl", "broken.obj"])
def test_an_unreadable_file_is_named(tmp_path: Path, name: str) -> None:
    (tmp_path / "broken.obj").write_text("nothing")
    with pytest.raises(RobotError, match=name):
        load_mesh(tmp_path / name, (1.0, 1.0, 1.0), GREY)


class TestCache:
    @pytest.fixture(autouse=True)
    def own_cache(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        self.folder = tmp_path / "cache"
        monkeypatch.setenv("XDG_CACHE_HOME", str(self.folder))
        self.reads = 0
        read = mesh_files.read_soup

        def counted(path: Path) -> Soup:
            self.reads += 1
            return read(path)

        monkeypatch.setattr(mesh_files, "read_soup", counted)

    def load(self, scale: float = 1.0) -> Mesh:
        return load_mesh(STL, (scale, scale, scale), GREY)

    def test_the_second_time_is_the_same_without_reading(self) -> None:
        first, second = self.load(), self.load()
        assert self.reads == 1
        for name, value in vars(first).items():
            np.testing.assert_array_equal(getattr(second, name), value)

    def test_another_scale_is_another_mesh(self) -> None:
        one, two = self.load(), self.load(2.0)
        assert self.reads == 2
        np.testing.assert_allclose(two.bounds(), 2.0 * one.bounds(), rtol=1e-6)

    def test_a_mirrored_mesh_keeps_its_outside(self) -> None:
        assert load_mesh(STL, (1.0, -1.0, 1.0), GREY).closed

    def test_a_broken_cache_is_made_anew(self) -> None:
        wanted = self.load()
        (file,) = self.folder.rglob("*.npz")
        file.write_bytes(file.read_bytes()[:100])
        np.testing.assert_array_equal(self.load().grid, wanted.grid)
        assert self.reads == 2

    def test_a_full_disk_leaves_nothing(self) -> None:
        with full_disk(0):
            self.load()
        assert not [path for path in self.folder.rglob("*") if path.is_file()]

    def test_without_a_place_for_it_all_works(self) -> None:
        self.folder.write_text("a file where the folder should be")
        self.load()
        self.load()
        assert self.reads == 2
