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
        starts = np.cumsum([0, *(len(v) for v, _ in parts)])
        vertices = np.concatenate([v for v, _ in parts])
        triangles = np.concatenate([f + s for (_, f), s in zip(parts, starts[:-1], strict=True)])
        r, g, b = (round(255 * units.srgb(c)) for c in color[:3])
        out.append((vertices, triangles, (r, g, b), float(color[3])))
    return out


def creased(vertices: Array, triangles: np.ndarray) -> tuple[Array, np.ndarray]:
    """Return (vertices, triangles) with duplicated vertices along sharp edges, so that the edges are drawn sharp."""
    f = np.asarray(triangles, np.int64)
    a, b, c = (vertices[f[:, i]] for i in range(3))
    normals = np.cross(b - a, c - a)
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
    edges = np.sort(f[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    key = edges[:, 0] * len(vertices) + edges[:, 1]
    order = np.argsort(key, kind="stable")
    same = key[order][1:] == key[order][:-1]
    left, right = order[:-1][same] // 3, order[1:][same] // 3
    smooth = np.einsum("ij,ij->i", normals[left], normals[right]) > np.cos(CREASE)
    left, right = left[smooth], right[smooth]
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
    _, first, inverse = np.unique((label[:, None] * len(vertices) + f).ravel(), return_index=True, return_inverse=True)
    return vertices[f.ravel()[first]], inverse.reshape(-1, 3).astype(np.int32)


def behind(vertices: Array, triangles: np.ndarray, point: Array, normal: Array) -> tuple[Array, np.ndarray]:
    """Return (vertices, triangles) of the part of a surface that is behind a plane, on the side opposite to the normal.

    `point` (3,) is a point of the plane, `normal` (3,) its normal.
    """
    d = (vertices - point) @ normal
    f = np.asarray(triangles)
    inside = d[f] <= 0
    count = inside.sum(axis=1)
    whole = f[count == 3]
    points, faces = [vertices], [whole]
    base = len(vertices)
    for kept in (1, 2):
        cut = f[count == kept]
        if not len(cut):
            continue
        # Rotate the corners so that the only corner on its side of the plane is first.
        odd = np.argmax(inside[count == kept] == (kept == 1), axis=1)
        i = (odd[:, None] + np.arange(3)) % 3
        corner = np.take_along_axis(cut, i, axis=1)
        p0, p1, p2 = corner.T
        s1, s2 = (d[p0] / (d[p0] - d[p])[...] for p in (p1, p2))
        q1 = vertices[p0] + s1[:, None] * (vertices[p1] - vertices[p0])
        q2 = vertices[p0] + s2[:, None] * (vertices[p2] - vertices[p0])
        n1, n2 = base + np.arange(len(cut)), base + len(cut) + np.arange(len(cut))
        points += [q1, q2]
        base += 2 * len(cut)
        if kept == 1:
            faces.append(np.column_stack([p0, n1, n2]))
        else:
            faces += [np.column_stack([n1, p1, p2]), np.column_stack([n1, p2, n2])]
    return np.concatenate(points), np.concatenate(faces).astype(np.int32)
