"""Meshes of URDF's primitives, and of the scene's paths and axes."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from pbd.io.meshes import TriangleSoup
from pbd.pose import Array
from pbd.view.compact_mesh import Mesh, compact, on_grid

SIDES = 32
"""Number of sides of round bodies."""
AXES_RGB = ((0.88, 0.27, 0.24), (0.22, 0.66, 0.36), (0.22, 0.46, 0.92))
"""Colours of axes: x red, y green, z blue."""
SPEED_RGB = np.array([[0.29, 0.42, 0.93], [0.60, 0.36, 0.85], [0.93, 0.40, 0.48], [0.98, 0.66, 0.27]])
"""Colours of the hand's path, from slow to fast. They are also in the page's legend (page.css)."""
PATH_RADIUS_M = 0.0025
"""Radius, m, of the tube that shows the hand's path."""
TRIAD_M, TRIAD_RADIUS_M = 0.05, 0.0012
"""Length and radius, m, of the axes at keyframes."""
UNSURE_RGB, UNSURE_OPACITY = (0.10, 0.72, 0.85), 0.6
"""Colour of the ellipsoids of two sigma. Nothing else has this colour, as they are often smaller than a fingertip."""


def speed_rgb(share: ArrayLike) -> Array:
    """Colours (n, 3) in 0..1 of speeds (n,), given as shares of the fastest one; above 1 the colour stays the same."""
    knots = np.linspace(0.0, 1.0, len(SPEED_RGB))
    return np.stack([np.interp(np.asarray(share), knots, channel) for channel in SPEED_RGB.T], axis=-1)


def primitive(shape: str, size: Sequence[float], rgb: ArrayLike) -> Mesh:
    """A box (x, y, z), a cylinder (diameter, height) or a sphere (diameter), `size` in m, centred at the origin."""
    if shape == "box":
        return box(size, rgb)
    if shape == "cylinder":
        return cylinder(0.5 * size[0], size[1], rgb)
    return sphere(0.5 * size[0], rgb)


def box(size: ArrayLike, rgb: ArrayLike) -> Mesh:
    """A box of size (3,) m, centred at the origin."""
    corners = (np.array(list(np.ndindex(2, 2, 2))) - 0.5) * np.asarray(size, dtype=np.float64)
    quads = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
    faces = np.array([face for a, b, c, d in quads for face in ((a, b, c), (a, c, d))])
    return _uniform(corners[faces], rgb)


def cylinder(radius: float, height: float, rgb: ArrayLike) -> Mesh:
    """A cylinder along z, centred at the origin; radius and height in m, rgb (3,) in 0..1."""
    z = 0.5 * height
    return _uniform(_revolved(((0.0, -z), (radius, -z), (radius, z), (0.0, z))), rgb)


def sphere(radius: float, rgb: ArrayLike) -> Mesh:
    """A sphere centred at the origin; radius in m, rgb (3,) in 0..1."""
    return capsule(radius, 0.0, rgb)


def capsule(radius: float, length: float, rgb: ArrayLike) -> Mesh:
    """A cylinder along z with a hemisphere at each end, centred at the origin; `length` m without them."""
    latitude = np.linspace(0.0, np.pi / 2, SIDES // 4 + 1)
    r, z = radius * np.cos(latitude), 0.5 * length + radius * np.sin(latitude)
    return _uniform(_revolved(np.column_stack((np.append(r[::-1], r), np.append(-z[::-1], z)))), rgb)


def triad(length: float, radius: float) -> Mesh:
    """Three arrows of `length` m along x (red), y (green) and z (blue)."""
    head = 2.7 * radius
    profile = ((0.0, 0.0), (radius, 0.0), (radius, length - 2.4 * head), (head, length - 2.4 * head), (0.0, length))
    arrow = _revolved(profile)
    # A cyclic permutation of axes is a rotation: it takes z to x, to y, and to z again.
    arrows = np.concatenate([np.roll(arrow, axis + 1, axis=2) for axis in range(3)])
    return compact(TriangleSoup(arrows, np.repeat(AXES_RGB, len(arrow), axis=0)), AXES_RGB[0])


def tube(points: Array, rgb: Array, radius: float, sides: int = 8) -> Mesh:
    """A tube of `radius` m along points (n, 3) m, coloured rgb (n, 3) in 0..1, its ends closed.

    The cross section does not twist along the path (double reflection: Wang et al. 2008).
    """
    far = np.append(True, np.linalg.norm(np.diff(points, axis=0), axis=1) > 1e-6)
    points, rgb = points[far], np.broadcast_to(rgb, (len(far), 3))[far]
    n = len(points)
    if n < 2:
        dot = sphere(radius, rgb[0])
        return replace(dot, centre=dot.centre + points[0])
    tangents = np.gradient(points, axis=0)
    tangents /= np.maximum(np.linalg.norm(tangents, axis=1, keepdims=True), 1e-12)
    across = _twist_free(points, tangents)
    angle = np.linspace(0.0, 2.0 * np.pi, sides, endpoint=False)[None, :, None]
    ring = np.cos(angle) * across[:, None] + np.sin(angle) * np.cross(tangents, across)[:, None]
    vertices = np.concatenate(((points[:, None] + radius * ring).reshape(-1, 3), points[[0, -1]]))
    i, k = np.meshgrid(np.arange(n - 1) * sides, np.arange(sides), indexing="ij")
    a, b = (i + k).ravel(), (i + (k + 1) % sides).ravel()
    first, last = np.arange(sides), np.arange(sides) + (n - 1) * sides
    faces = np.concatenate(
        (
            np.stack((a, b, b + sides), axis=1),
            np.stack((a, b + sides, a + sides), axis=1),
            np.stack((np.roll(first, -1), first, np.full(sides, n * sides)), axis=1),
            np.stack((last, np.roll(last, -1), np.full(sides, n * sides + 1)), axis=1),
        )
    )
    colours = np.rint(255.0 * np.concatenate((np.repeat(rgb, sides, axis=0), rgb[[0, -1]])))
    return Mesh(*on_grid(vertices), faces.astype(np.uint32), colours.astype(np.uint8))


def _twist_free(points: Array, tangents: Array) -> Array:
    """Unit vectors (n, 3), each normal to its tangent, which rotate as little as possible along the path."""
    across = np.empty_like(points)
    start = np.cross(tangents[0], np.eye(3)[np.argmin(np.abs(tangents[0]))])
    across[0] = start / np.linalg.norm(start)
    for i in range(len(points) - 1):
        step = points[i + 1] - points[i]
        mirror = 2.0 / (step @ step)
        vector, tangent = (v - mirror * (step @ v) * step for v in (across[i], tangents[i]))
        turn = tangents[i + 1] - tangent
        size = turn @ turn
        across[i + 1] = vector if size < 1e-18 else vector - 2.0 / size * (turn @ vector) * turn
    return across


def _revolved(profile: ArrayLike) -> Array:
    """Triangles (m, 3, 3) m of a solid of revolution about z, of radii and heights (n, 2) m from the bottom up.

    At radius 0 triangles have no area; `compact` drops them.
    """
    angle = np.linspace(0.0, 2.0 * np.pi, SIDES, endpoint=False)
    around = np.stack((np.cos(angle), np.sin(angle)), axis=1)
    rings = np.asarray(profile, dtype=np.float64)
    corners = np.concatenate([np.column_stack((r * around, np.full(SIDES, z))) for r, z in rings])
    low, k = np.meshgrid(np.arange(len(rings) - 1) * SIDES, np.arange(SIDES), indexing="ij")
    a, b = (low + k).ravel(), (low + (k + 1) % SIDES).ravel()
    faces = np.stack((a, b, b + SIDES, a, b + SIDES, a + SIDES), axis=1)
    return np.asarray(corners[faces.reshape(-1, 3)])


def _uniform(triangles: Array, rgb: ArrayLike) -> Mesh:
    """Compact triangles (m, 3, 3) m of one colour."""
    return compact(TriangleSoup(triangles, np.full((len(triangles), 3), np.nan)), rgb)
