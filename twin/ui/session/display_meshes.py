"""Prepare meshes for display: merge them by colour, keep sharp edges sharp, cut them by a section plane."""

from __future__ import annotations

import numpy as np

from twin.core import units
from twin.core.spatial import Array
from twin.model.body import Body

CREASE_ANGLE = np.radians(35)
"""Angle in rad between two adjacent faces above which their common edge is drawn sharp."""

DisplayMesh = tuple[Array, np.ndarray, tuple[int, int, int], float]
"""A mesh: vertices (n, 3) in m in the body's frame, triangles (m, 3), colour (sRGB, 0 to 255), opacity (0 to 1)."""


def display_meshes(body: Body) -> list[DisplayMesh]:
    """Return the meshes of a body, merged by colour so that the browser has few scene nodes."""
    by_color: dict[tuple[float, ...], list[tuple[Array, np.ndarray]]] = {}
    for mesh in body.meshes:
        by_color.setdefault(mesh.color_rgba, []).append(creased(mesh.vertices, mesh.triangles))
    merged = []
    for color, parts in by_color.items():
        vertices = []
        triangles = []
        start = 0
        for part_vertices, part_triangles in parts:
            vertices.append(part_vertices)
            triangles.append(part_triangles + start)
            start += len(part_vertices)
        # a mesh has linear colours, a browser shows sRGB
        r, g, b = (round(255 * units.srgb(linear)) for linear in color[:3])
        opacity = float(color[3])
        merged.append((np.concatenate(vertices), np.concatenate(triangles), (r, g, b), opacity))
    return merged


def creased(vertices: Array, triangles: np.ndarray) -> tuple[Array, np.ndarray]:
    """Return (vertices, triangles) with duplicated vertices along sharp edges, so that the edges are drawn sharp."""
    f = np.asarray(triangles, np.int64)
    face, neighbour = _smooth_pairs(vertices, f)
    label = _connected(face, neighbour, len(f))
    # a vertex is shared by the faces with one label only
    corners = (label[:, None] * len(vertices) + f).ravel()
    _, first, inverse = np.unique(corners, return_index=True, return_inverse=True)
    return vertices[f.ravel()[first]], inverse.reshape(-1, 3).astype(np.int32)


def _smooth_pairs(vertices: Array, f: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the numbers (m,), (m,) of two faces for each common edge that is not sharp; `f` (n, 3) are the faces."""
    a = vertices[f[:, 0]]
    b = vertices[f[:, 1]]
    c = vertices[f[:, 2]]
    normals = np.cross(b - a, c - a)
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
    # edges 3 i to 3 i + 2 belong to face i; one edge of two faces has the same key in both
    edges = np.sort(f[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    key = edges[:, 0] * len(vertices) + edges[:, 1]
    order = np.argsort(key, kind="stable")
    same = key[order][1:] == key[order][:-1]
    face = order[:-1][same] // 3
    neighbour = order[1:][same] // 3
    smooth = np.einsum("ij,ij->i", normals[face], normals[neighbour]) > np.cos(CREASE_ANGLE)
    return face[smooth], neighbour[smooth]


def _connected(face: np.ndarray, neighbour: np.ndarray, count: int) -> np.ndarray:
    """Return a label (count,) for each face: the smallest number of the faces that pairs (m,), (m,) connect it with."""
    label = np.arange(count)
    while True:
        least = np.minimum(label[face], label[neighbour])
        new = label.copy()
        np.minimum.at(new, label[face], least)
        np.minimum.at(new, label[neighbour], least)
        # pointer jumping: the label of the label, so that long chains take few rounds
        new = new[new]
        if np.array_equal(new, label):
            return label
        label = new


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
    for inner_corners in (1, 2):
        cut = f[count == inner_corners]
        if not len(cut):
            continue
        # Rotate the corners so that the only corner on its side of the plane is first.
        is_odd_inside = inner_corners == 1
        odd = np.argmax(inside[count == inner_corners] == is_odd_inside, axis=1)
        rotated = (odd[:, None] + np.arange(3)) % 3
        p0, p1, p2 = np.take_along_axis(cut, rotated, axis=1).T
        # The plane cuts the two edges at the first corner, each in a new point.
        points.append(_cut_points(vertices, distance, p0, p1))
        points.append(_cut_points(vertices, distance, p0, p2))
        n1 = base + np.arange(len(cut))
        n2 = n1 + len(cut)
        base += 2 * len(cut)
        if inner_corners == 1:
            faces.append(np.column_stack([p0, n1, n2]))
        else:
            faces.append(np.column_stack([n1, p1, p2]))
            faces.append(np.column_stack([n1, p2, n2]))
    return np.concatenate(points), np.concatenate(faces).astype(np.int32)


def _cut_points(vertices: Array, distance: Array, start: np.ndarray, end: np.ndarray) -> Array:
    """Return the points (m, 3) of the plane on the edges from vertices `start` (m,) to vertices `end` (m,)."""
    share = distance[start] / (distance[start] - distance[end])
    return vertices[start] + share[:, None] * (vertices[end] - vertices[start])
