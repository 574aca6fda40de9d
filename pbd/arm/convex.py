"""Meshes as a few convex parts that hold all of them: what distances are measured between.

One hull over a bent link (a UR's forearm) fills the bend and touches what never comes near the link itself. So a mesh
is cut in two where that shrinks its hulls, up to MOST_CUTS deep. A hull of thousands of corners (CAD's round edges)
then loses most of them; `pad` says how far the lost ones stick out, and is counted in every distance. Either way the
parts hold the mesh: a contact can be seen too early, by the bends that are left, but not missed.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from pbd.pose import Array

CUT_GAIN = 0.85
"""A cut is made where the hulls of both halves have less than this share of the whole hull's volume."""
MOST_CUTS = 2
CORNERS = 160
"""A hull of no more corners than this is kept as it is."""
CORNER_TOLERANCE_M = 5e-4
"""How far a corner that is left out may stick out."""

_SHARES = (0.25, 0.5, 0.75)  # where along each side of its box a mesh may be cut
_SLIVER_M = 1e-4  # what is flat is given this much thickness
_SAME_M = 1e-8  # corners nearer than this are one: files repeat them for each triangle
_COARSE_M = 1e-3  # the same, where only a volume is asked for


class ConvexPart(NamedTuple):
    """A convex part of a mesh: the hull of `points` (n, 3), made larger by `pad` on all sides; metres."""

    points: Array
    pad: float


def convex_parts(triangles: Array) -> list[ConvexPart]:
    """Cover triangles (m, 3, 3) in metres with convex parts."""
    return [simplified(points) for points in _cut(triangles, MOST_CUTS)]


def simplified(points: Array) -> ConvexPart:
    """Leave out corners of the hull of points (n, 3), as far as CORNER_TOLERANCE_M lets it."""
    corners = hull_corners(points)
    if len(corners) <= CORNERS:
        return ConvexPart(corners, 0.0)
    kept = np.zeros(len(corners), dtype=bool)
    kept[np.argmax(corners @ _directions(64).T, axis=0)] = True
    while True:
        hull = ConvexHull(corners[kept])
        beyond = corners @ hull.equations[:, :3].T + hull.equations[:, 3]  # (corners, faces)
        short = beyond.max(axis=0) > CORNER_TOLERANCE_M
        if not short.any():
            break
        kept[np.argmax(beyond[:, short], axis=0)] = True
    faces = hull.points[hull.simplices]
    # What lies beyond the hull is no further from it than from any face. Mostly the face that it is furthest beyond is
    # near enough; among faces in one plane that may be a distant one.
    lost, nearest = corners[~kept], np.argmax(beyond[~kept], axis=1)
    away = _to_triangles(lost, faces[nearest])
    for i in np.flatnonzero(away > CORNER_TOLERANCE_M):
        away[i] = _to_triangles(np.broadcast_to(lost[i], (len(faces), 3)), faces).min()
    return ConvexPart(corners[kept], float(away.max(initial=0.0)))


def hull_corners(points: Array) -> Array:
    """Corners (k, 3) of the hull of points (n, 3); what has no volume becomes the box around it, a little thicker."""
    try:
        return np.asarray(points[ConvexHull(points).vertices], dtype=np.float64)
    except (QhullError, ValueError):
        low, high = points.min(axis=0) - _SLIVER_M, points.max(axis=0) + _SLIVER_M
        return np.array([np.where(mask, high, low) for mask in np.ndindex(2, 2, 2)])


def _cut(triangles: Array, cuts: int) -> list[Array]:
    """Cut a mesh where it pays, and its halves; return the points of each part."""
    best: tuple[Array, Array] | None = None
    wanted = CUT_GAIN * _volume(triangles) if cuts else 0.0
    low, high = triangles.min(axis=(0, 1)), triangles.max(axis=(0, 1))
    for axis, share in ((axis, share) for axis in range(3) for share in _SHARES) if cuts else ():
        halves = _halves(triangles, axis, low[axis] + share * (high[axis] - low[axis]))
        volume = sum(map(_volume, halves))
        if volume < wanted:
            best, wanted = halves, volume
    if best is None:
        return [_points(triangles, _SAME_M)]
    return [part for half in best for part in _cut(half, cuts - 1)]


def _volume(triangles: Array) -> float:
    """Return the volume of the hull, m3, roughly."""
    try:
        return float(ConvexHull(_points(triangles, _COARSE_M)).volume)
    except (QhullError, ValueError):
        return 0.0  # flat, or nothing at all


def _points(triangles: Array, apart: float) -> Array:
    """Return the corners, those nearer to each other than `apart` once."""
    corners = triangles.reshape(-1, 3)
    cells = np.rint(corners / apart).astype(np.int64)
    cells -= cells.min(axis=0, initial=0)
    most = cells.max(axis=0, initial=0) + 1
    key = (cells[:, 0] * most[1] + cells[:, 1]) * most[2] + cells[:, 2]  # sorting numbers is faster than rows
    return corners[np.unique(key, return_index=True)[1]]


def _halves(triangles: Array, axis: int, x: float) -> tuple[Array, Array]:
    above = triangles[:, :, axis] - x
    return _clip(triangles, above), _clip(triangles, -above)


def _clip(triangles: Array, above: Array) -> Array:
    """Return what lies below a plane, given the height (m, 3) of each corner above it."""
    below = above <= 0.0
    count = below.sum(axis=1)
    parts = [triangles[count == 3]]
    for inside in (1, 2):
        rows = np.flatnonzero(count == inside)
        # Turned so that the corner that is alone on its side comes first.
        alone = np.argmax(below[rows] == (inside == 1), axis=1)
        order = (alone[:, None] + np.arange(3)) % 3
        corners = np.take_along_axis(triangles[rows], order[:, :, None], axis=1)
        o, p, q = np.moveaxis(corners, 1, 0)
        height = np.take_along_axis(above[rows], order, axis=1)
        op, oq = (o + (height[:, :1] / (height[:, :1] - height[:, i, None])) * (r - o) for i, r in ((1, p), (2, q)))
        pieces = [(o, op, oq)] if inside == 1 else [(op, p, q), (op, q, oq)]
        parts += [np.stack(piece, axis=1) for piece in pieces]
    return np.concatenate(parts)


def _directions(count: int) -> Array:
    """Unit vectors (count, 3) spread evenly over the sphere, along a spiral."""
    i = np.arange(count) + 0.5
    z, turn = 1.0 - 2.0 * i / count, np.pi * (1.0 + np.sqrt(5.0)) * i
    radius = np.sqrt(1.0 - z * z)
    return np.stack((radius * np.cos(turn), radius * np.sin(turn), z), axis=1)


def _to_triangles(points: Array, triangles: Array) -> Array:
    """Distance (n,) of each of the points (n, 3) from its own triangle (n, 3, 3)."""
    least = np.full(len(points), np.inf)
    normal = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    size = np.linalg.norm(normal, axis=1)
    inside = size > 0.0  # a triangle without an area has no inside
    normal /= np.where(inside, size, 1.0)[:, None]
    for i in range(3):
        start, side = triangles[:, i], triangles[:, (i + 1) % 3] - triangles[:, i]
        away = points - start
        along = np.clip(np.einsum("ij,ij->i", away, side) / np.einsum("ij,ij->i", side, side), 0.0, 1.0)
        least = np.minimum(least, np.linalg.norm(away - along[:, None] * side, axis=1))
        inside &= np.einsum("ij,ij->i", np.cross(side, away), normal) >= 0.0
    height = np.abs(np.einsum("ij,ij->i", points - triangles[:, 0], normal))
    return np.where(inside, height, least)
