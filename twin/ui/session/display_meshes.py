"""Prepare meshes for display: merge them by colour, keep sharp edges sharp, cut them by a section plane."""

from __future__ import annotations

import numpy as np

from twin.core import units
from twin.core.spatial import Array
from twin.model.body import Body

CREASE = np.radians(35)
"""Angle in rad between two adjacent faces above which their common edge is drawn sharp."""

Look = tuple[Array, np.ndarray, tuple[int, int, int], float]
"""A mesh: vertices (n, 3) in m in the body's frame, triangles (m, 3), colour (sRGB, 0 to 255), opacity (0 to 1)."""


def looks(body: Body) -> list[Look]:
    """Return the meshes of a body, merged by colour so that the browser has few scene nodes."""
    by_color: dict[tuple[float, ...], list[tuple[Array, np.ndarray]]] = {}
    for mesh in body.meshes:
        by_color.setdefault(mesh.color_rgba, []).append(creased(mesh.vertices, mesh.triangles))
    out = []
    for color, parts in by_color.items():
        vertices = []
        triangles = []
        start = 0
        for part_vertices, part_triangles in parts:
            vertices.append(part_vertices)
            triangles.append(part_triangles + start)
            start += len(part_vertices)
        r, g, b = (round(255 * units.srgb(c)) for c in color[:3])
        out.append((np.concatenate(vertices), np.concatenate(triangles), (r, g, b), float(color[3])))
    return out


def creased(vertices: Array, triangles: np.ndarray) -> tuple[Array, np.ndarray]:
    """Return (vertices, triangles) with duplicated vertices along sharp edges, so that the edges are drawn sharp."""
    f = np.asarray(triangles, np.int64)
    a = vertices[f[:, 0]]
    b = vertices[f[:, 1]]
    c = vertices[f[:, 2]]
    normals = np.cross(b - a, c - a)
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
    edges = np.sort(f[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    key = edges[:, 0] * len(vertices) + edges[:, 1]
    order = np.argsort(key, kind="stable")
    same = key[order][1:] == key[order][:-1]
    # edges 3 i to 3 i + 2 belong to face i; left and right have an edge in common
    left = order[:-1][same] // 3
    right = order[1:][same] // 3
    smooth = np.einsum("ij,ij->i", normals[left], normals[right]) > np.cos(CREASE)
    left = left[smooth]
    right = right[smooth]
    # Smoothly connected faces get a common label, their smallest face number, propagated by pointer jumping.
    label = np.arange(len(f))
    while True:
        least = np.minimum(label[left], label[right])
        new = label.copy()
        np.minimum.at(new, label[left], least)
        np.minimum.at(new, label[right], least)
        new = new[new]
        if np.array_equal(new, label):
            break
        label = new
    corners = (label[:, None] * len(vertices) + f).ravel()
    _, first, inverse = np.unique(corners, return_index=True, return_inverse=True)
    return vertices[f.ravel()[first]], inverse.reshape(-1, 3).astype(np.int32)


def behind(vertices: Array, triangles: np.ndarray, point: Array, normal: Array) -> tuple[Array, np.ndarray]:
    """Return (vertices, triangles) of the part of a surface that is behind a plane, on the side opposite to the normal.

    `point` (3,) is a point of the plane, `normal` (3,) its normal.
    """
    distance = (vertices - point) @ normal
    f = np.asarray(triangles)
    inside = distance[f] <= 0
    count = inside.sum(axis=1)
    points = [vertices]
    faces = [f[count == 3]]
    base = len(vertices)
    for kept in (1, 2):
        cut = f[count == kept]
        if not len(cut):
            continue
        # Rotate the corners so that the only corner on its side of the plane is first.
        odd = np.argmax(inside[count == kept] == (kept == 1), axis=1)
        rotated = (odd[:, None] + np.arange(3)) % 3
        p0, p1, p2 = np.take_along_axis(cut, rotated, axis=1).T
        # The plane cuts the two edges at the first corner, each in a new point.
        points.append(_cut_points(vertices, distance, p0, p1))
        points.append(_cut_points(vertices, distance, p0, p2))
        n1 = base + np.arange(len(cut))
        n2 = n1 + len(cut)
        base += 2 * len(cut)
        if kept == 1:
            faces.append(np.column_stack([p0, n1, n2]))
        else:
            faces.append(np.column_stack([n1, p1, p2]))
            faces.append(np.column_stack([n1, p2, n2]))
    return np.concatenate(points), np.concatenate(faces).astype(np.int32)


def _cut_points(vertices: Array, distance: Array, start: np.ndarray, end: np.ndarray) -> Array:
    """Return the points (m, 3) of the plane on the edges from vertices `start` (m,) to vertices `end` (m,)."""
    share = distance[start] / (distance[start] - distance[end])
    return vertices[start] + share[:, None] * (vertices[end] - vertices[start])
