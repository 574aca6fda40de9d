"""Meshes of simple bodies: closed, and of the right volume and size."""

import numpy as np
import pytest

from pbd.view import shapes
from pbd.view.compact_mesh import Mesh

GREY = (0.5, 0.5, 0.5)


def volume(mesh: Mesh) -> float:
    a, b, c = (mesh.vertices[mesh.faces[:, i]] for i in range(3))
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0)


@pytest.mark.parametrize(
    ("shape", "size", "reach", "wanted"),
    [
        ("box", (0.1, 0.2, 0.3), (0.1, 0.2, 0.3), 0.006),
        ("cylinder", (0.2, 0.5), (0.2, 0.2, 0.5), np.pi * 0.005),
        ("sphere", (0.4,), (0.4, 0.4, 0.4), 4 / 3 * np.pi * 0.008),
    ],
)
def test_a_solid_is_closed_and_has_its_size(
    shape: str, size: tuple[float, ...], reach: tuple[float, ...], wanted: float
) -> None:
    mesh = shapes.primitive(shape, size, GREY)
    assert mesh.closed
    assert volume(mesh) == pytest.approx(wanted, rel=0.02)
    np.testing.assert_allclose(mesh.vertices.min(axis=0), -mesh.vertices.max(axis=0), atol=1e-9)
    np.testing.assert_allclose(np.ptp(mesh.vertices, axis=0), reach, rtol=0.01)


def test_a_triad_points_along_its_axes_in_their_colours() -> None:
    mesh = shapes.triad(0.05, 0.002)
    assert mesh.closed
    for axis in range(3):
        tip = np.argmax(mesh.vertices[:, axis])
        np.testing.assert_allclose(mesh.vertices[tip], 0.05 * np.eye(3)[axis], atol=1e-5)
        assert np.argmax(mesh.rgb[tip]) == axis


def test_a_tube_follows_its_path_without_twist() -> None:
    turn = np.linspace(0.0, 4.0 * np.pi, 400)
    helix = np.stack((0.1 * np.cos(turn), 0.1 * np.sin(turn), 0.02 * turn), axis=1)
    mesh = shapes.tube(helix, np.array(GREY), 0.003)
    rings = mesh.vertices[: 8 * 400].reshape(400, 8, 3)
    np.testing.assert_allclose(np.linalg.norm(rings - helix[:, None], axis=2), 0.003, atol=3e-5)
    length = np.linalg.norm(np.diff(helix, axis=0), axis=1).sum()
    octagon = 2.0 * np.sqrt(2.0) * 0.003**2
    assert volume(mesh) == pytest.approx(octagon * length, rel=0.01)
    # neighbours lie along the path, not around it
    sideways = np.linalg.norm(np.diff(rings, axis=0), axis=2).max()
    assert sideways < 1.2 * np.linalg.norm(np.diff(helix, axis=0), axis=1).max()


@pytest.mark.parametrize("n", [1, 2, 5])
def test_a_tube_of_one_point_is_a_dot(n: int) -> None:
    mesh = shapes.tube(np.tile([0.3, 0.2, 0.1], (n, 1)), np.tile(GREY, (n, 1)), 0.003)
    np.testing.assert_allclose(mesh.vertices.mean(axis=0), [0.3, 0.2, 0.1], atol=1e-6)
    assert np.ptp(mesh.vertices, axis=0).max() == pytest.approx(0.006, rel=0.01)
