"""Compact triangle meshes for the page: equal vertices are merged and rounded to a grid of 16 bits.

Vertices are split where the surface has a sharp edge. The page then computes smooth normals itself, so normals are not
sent. A panda takes 1.3 MB this way.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pbd.io.meshes import TriangleSoup
from pbd.pose import Array


@dataclass(frozen=True, eq=False)
class Mesh:
    """A coloured triangle mesh on a grid.

    Attributes:
        grid: (n, 3) int16; a vertex is at centre + step * grid.
        centre: (3,) m.
        step: m.
        faces: (m, 3) uint32, counter-clockwise seen from outside.
        rgb: (n, 3) uint8, as displayed (sRGB).
        closed: the inside can't be seen, so faces are drawn from one side only.
    """

    grid: NDArray[np.int16]
    centre: Array
    step: float
    faces: NDArray[np.uint32]
    rgb: NDArray[np.uint8]
    closed: bool = True

    def painted(self, rgb: ArrayLike) -> Mesh:
        """The same mesh in one colour (3,), 0..1."""
        colour = np.rint(255.0 * np.asarray(rgb, dtype=np.float64)).astype(np.uint8)
        return replace(self, rgb=np.tile(colour, (len(self.rgb), 1)))

    @property
    def vertices(self) -> Array:
        """(n, 3) m."""
        return self.centre + self.step * self.grid


def compact(soup: TriangleSoup, default_rgb: ArrayLike) -> Mesh:
    """Merge equal vertices, split them along sharp edges and colour borders, and drop faces without an area.

    Args:
        soup: triangles; their colour is NaN where the file has none.
        default_rgb: (3,) in 0..1, colour of these.

    Raises:
        ValueError: no face is left.
    """
    rgb = np.where(np.isnan(soup.rgb), np.asarray(default_rgb), soup.rgb)
    grid, centre, step = on_grid(soup.corners.reshape(-1, 3))
    # Three numbers of 16 bits make one of 48 bits, so that merging is a sort of integers.
    key = (grid.astype(np.int64) + 2**15) @ np.array([2**32, 2**16, 1])
    faces = np.unique(key, return_inverse=True)[1].reshape(-1, 3)
    p, q, r = np.moveaxis(soup.corners, 1, 0)
    normals = np.cross(q - p, r - p)
    size = np.linalg.norm(normals, axis=1)
    a, b, c = faces.T
    sound = (size > 0.0) & (a != b) & (b != c) & (c != a)
    if not sound.any():
        raise ValueError("no triangle has an area")
    faces, rgb, normals = faces[sound], rgb[sound], normals[sound] / size[sound, None]
    corner = _split(faces, normals, rgb)
    labels, first, new_faces = np.unique(corner, return_index=True, return_inverse=True)
    # Vertices in the order of their first use: neighbours in the file are then alike and compress well.
    rank = np.empty(len(labels), dtype=np.int64)
    order = np.argsort(first)
    rank[order] = np.arange(len(labels))
    kept = grid.reshape(-1, 3, 3)[sound].reshape(-1, 3)[first[order]]
    colours = np.rint(255.0 * np.clip(rgb, 0.0, 1.0)).astype(np.uint8)[first[order] // 3]
    closed = _is_closed(faces, soup.corners[sound])
    return Mesh(kept, centre, step, rank[new_faces].reshape(-1, 3).astype(np.uint32), colours, closed)


def _is_closed(faces: NDArray[np.int64], corners: Array) -> bool:
    """Whether nearly all edges have a face on both sides, and the volume is positive, so that faces look outwards."""
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    forward, backward = edges @ np.array([2**32, 1]), edges @ np.array([1, 2**32])
    volume = np.einsum("ij,ij->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2]))
    # CAD exports have gaps: 0.97 in panda's link6.
    return bool(volume > 0.0 and np.isin(forward, backward).mean() > 0.95)


def on_grid(points: Array) -> tuple[NDArray[np.int16], Array, float]:
    """Round points (n, 3) m to the grid of 16 bits that spans them; return grid, centre and step of a `Mesh`."""
    low, high = points.min(axis=0), points.max(axis=0)
    centre = 0.5 * (low + high)
    step = float(max(np.max(high - low) / 65534.0, 1e-12))
    return np.rint((points - centre) / step).astype(np.int16), centre, step


def _split(faces: NDArray[np.int64], normals: Array, rgb: Array) -> NDArray[np.int64]:
    """Label the corners (3 m,) of faces. Corners at one vertex share a label if only smooth edges lie between them.

    At a smooth edge, the faces' normals differ by less than 35 degrees.
    """
    from scipy.sparse import coo_array  # loads slowly, and meshes are cached on disk
    from scipy.sparse.csgraph import connected_components

    m = len(faces)
    corners = np.arange(3 * m).reshape(m, 3)
    sides = ((0, 1), (1, 2), (2, 0))
    edge = np.concatenate([faces[:, side] for side in sides])
    corner = np.concatenate([corners[:, side] for side in sides])
    face = np.tile(np.arange(m), 3)
    backwards = edge[:, 0] > edge[:, 1]
    edge[backwards], corner[backwards] = edge[backwards, ::-1], corner[backwards, ::-1]
    order = np.lexsort((edge[:, 1], edge[:, 0]))
    edge, corner, face = edge[order], corner[order], face[order]
    face_a, face_b = face[:-1], face[1:]
    smooth = (
        (edge[:-1] == edge[1:]).all(axis=1)
        & (np.einsum("ij,ij->i", normals[face_a], normals[face_b]) > np.cos(np.radians(35.0)))
        & (rgb[face_a] == rgb[face_b]).all(axis=1)
    )
    i, j = corner[:-1][smooth].ravel(), corner[1:][smooth].ravel()
    graph = coo_array((np.ones(len(i), dtype=bool), (i, j)), shape=(3 * m, 3 * m))
    return connected_components(graph, directed=False)[1].astype(np.int64)
