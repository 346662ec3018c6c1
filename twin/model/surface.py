"""Closed triangle surfaces: checks, subdivision of long edges, volume, and tests for points inside."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from twin.core.errors import TwinError
from twin.core.spatial import Array, Index
from twin.core.units import MM

VERTICES = 6000
"""Maximum number of vertices of a simulated surface; each picture frame sent to a page contains all of them."""

_SAME = 1e-9
"""Distance in m below which two vertices are merged: neighbouring faces of a STEP file do not share vertices."""


class Surface:
    """A closed surface whose triangles are counter-clockwise seen from outside.

    Vertices are (n, 3) in m; triangles are (m, 3) indices of vertices.
    """

    def __init__(self, name: str, vertices: Array, triangles: Index, edge: float = np.inf) -> None:
        """Merge equal vertices, then halve edges until no edge is longer than `edge` in m.

        Raises:
            TwinError: the surface is empty, not finite, open, inverted, or has more than `VERTICES` vertices.
        """
        v, f = np.asarray(vertices, float).reshape(-1, 3), np.asarray(triangles, int).reshape(-1, 3)
        if not len(f) or not np.isfinite(v).all():
            raise TwinError(f"surface '{name}' is {'not finite' if len(f) else 'empty'}; draw it again")
        _, first, index = np.unique(np.rint(v / _SAME), axis=0, return_index=True, return_inverse=True)
        v, f = v[first], index.reshape(-1)[f]
        f = f[(f[:, 0] != f[:, 1]) & (f[:, 1] != f[:, 2]) & (f[:, 2] != f[:, 0])]
        _require_closed(name, v, f)
        if (content := volume(v, f)) <= 0:
            raise TwinError(
                f"surface '{name}' is inverted: its volume is {content * 1e6:.3g} cm3, because its triangles are "
                "clockwise seen from outside; swap two corners of each triangle"
            )
        while len(v) <= VERTICES and (halved := _halved(v, f, edge)) is not None:
            v, f = halved
        if len(v) > VERTICES:
            raise TwinError(
                f"surface '{name}' is too fine: more than {VERTICES} vertices; "
                + ("allow longer edges" if np.isfinite(edge) else "draw it coarser")
            )
        self.name, self.vertices, self.triangles = name, v, f

    @property
    def volume(self) -> float:
        """Volume in m3."""
        return volume(self.vertices, self.triangles)


def volume(vertices: Array, triangles: Index) -> float:
    """Return the volume in m3 that the triangles (m, 3) of a closed surface enclose."""
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6)


def inside(points: Array, vertices: Array, triangles: Index) -> np.ndarray:
    """Return (k,) bool: whether each of the points (k, 3) is inside a closed surface, by the winding number.

    Formula for the solid angle of a triangle: A. van Oosterom and J. Strackee, doi:10.1109/TBME.1983.325207.
    """
    points = np.asarray(points, float).reshape(-1, 3)
    out = np.zeros(len(points), bool)
    near = np.flatnonzero(((points > vertices.min(axis=0)) & (points < vertices.max(axis=0))).all(axis=1))
    one, two, three = triangles.T
    for k in near.tolist():
        x, y, z = (vertices - points[k]).T
        r = np.sqrt(x * x + y * y + z * z)
        (ax, ay, az, la), (bx, by, bz, lb), (cx, cy, cz, lc) = ((x[i], y[i], z[i], r[i]) for i in (one, two, three))
        up = ax * (by * cz - bz * cy) + ay * (bz * cx - bx * cz) + az * (bx * cy - by * cx)
        ab, bc, ca = ax * bx + ay * by + az * bz, bx * cx + by * cy + bz * cz, cx * ax + cy * ay + cz * az
        out[k] = np.arctan2(up, la * lb * lc + ab * lc + bc * la + ca * lb).sum() > np.pi
    return out


def rings(triangles: Index, start: int) -> Index:
    """Return the level (m,) of each triangle around the triangle `start`; -1 for triangles not connected with `start`.

    Level 0 is the triangle `start`. Level 1 are the triangles that share a corner with level 0, level 2 are further
    triangles that share a corner with level 1, and so on, as in figure 19 of the paper on the PA-10 virtual surgery
    robot.
    """
    level = np.full(len(triangles), -1)
    level[start] = 0
    for k, ring in enumerate(_outwards(triangles, start), 1):
        level[ring] = k
    return level


def _outwards(triangles: Index, start: int) -> Iterator[Index]:
    reached = np.zeros(int(triangles.max()) + 1, bool)
    left = np.ones(len(triangles), bool)
    left[start] = False
    reached[triangles[start]] = True
    while True:
        ring = np.flatnonzero(left & reached[triangles].any(axis=1))
        if not len(ring):
            return
        yield ring
        left[ring] = False
        reached[triangles[ring]] = True


def _sides(triangles: Index) -> Index:
    """Return the three edges of each triangle (m, 3, 2), from corner 0 to 1, 1 to 2, and 2 to 0."""
    return triangles[:, [[0, 1], [1, 2], [2, 0]]]


def _require_closed(name: str, vertices: Array, triangles: Index) -> None:
    """Raise an error unless each edge belongs to exactly two triangles and has opposite directions in them."""
    sides = _sides(triangles).reshape(-1, 2)
    _, index = np.unique(np.sort(sides, axis=1), axis=0, return_inverse=True)
    index = index.reshape(-1)
    count = np.bincount(index)
    balance = np.bincount(index, np.where(sides[:, 0] < sides[:, 1], 1.0, -1.0))
    wrong = (count != 2)[index]
    if not wrong.any() and not balance.any():
        return
    bad = sides[wrong if wrong.any() else (balance != 0)[index]]
    x, y, z = (vertices[bad[0]].mean(axis=0) / MM).tolist()
    count = len(np.unique(np.sort(bad, axis=1), axis=0))
    what, why = f"is open: {count} edges do not join two triangles", "a deformable needs a closed surface"
    if not wrong.any():
        what = f"has triangles of both orientations: {count} edges join two triangles of different orientation"
        why = "list the corners of all triangles counter-clockwise, seen from outside"
    raise TwinError(f"surface '{name}' {what}, one of them at ({x:.1f}, {y:.1f}, {z:.1f}) mm; {why}")


def _halved(v: Array, f: Index, edge: float) -> tuple[Array, Index] | None:
    """Return the surface with a new vertex in the middle of each side longer than `edge` in m; None: no such side."""
    if not np.isfinite(edge):
        return None
    sides = np.sort(_sides(f).reshape(-1, 2), axis=1)
    unique, index = np.unique(sides, axis=0, return_inverse=True)
    long = np.linalg.norm(v[unique[:, 0]] - v[unique[:, 1]], axis=1) > edge
    if not long.any():
        return None
    middle = np.full(len(unique), -1)
    middle[long] = len(v) + np.arange(int(long.sum()))
    m = middle[index.reshape(-1, 3)]
    # rotate the corners of each triangle so that its halved sides come first
    count = (m >= 0).sum(axis=1)
    turn = np.where(count == 1, np.argmax(m >= 0, axis=1), np.where(count == 2, (np.argmin(m, axis=1) + 1) % 3, 0))
    order = (turn[:, None] + np.arange(3)) % 3
    (a, b, c), (p, q, r) = np.take_along_axis(f, order, 1).T, np.take_along_axis(m, order, 1).T
    none, one, two, three = (count == k for k in range(4))
    parts = [
        (none, (a, b, c)),
        (one, (a, p, c)), (one, (p, b, c)),
        (two, (p, b, q)), (two, (a, p, q)), (two, (a, q, c)),
        (three, (a, p, r)), (three, (p, b, q)), (three, (r, q, c)), (three, (p, q, r)),
    ]  # fmt: skip
    triangles = np.concatenate([np.stack([x[which] for x in corners], axis=1) for which, corners in parts])
    return np.concatenate([v, (v[unique[long, 0]] + v[unique[long, 1]]) / 2]), triangles


def nearest(p: Array, vertices: Array, triangles: Index) -> tuple[Array, int, Array]:
    """Return the surface point nearest to p (3,): (position (3,), index of the triangle, barycentric coordinates (3,)).

    The case distinction is that of C. Ericson, "Real-Time Collision Detection" (2005), 5.1.5.
    """
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    ab, ac, ap = b - a, c - a, p - a

    def dot(x: Array, y: Array) -> Array:
        return np.einsum("ij,ij->i", x, y)

    d1, d2 = dot(ab, ap), dot(ac, ap)
    d3, d4 = dot(ab, p - b), dot(ac, p - b)
    d5, d6 = dot(ab, p - c), dot(ac, p - c)
    va, vb, vc = d3 * d6 - d5 * d4, d5 * d2 - d1 * d6, d1 * d4 - d3 * d2
    with np.errstate(divide="ignore", invalid="ignore"):
        v, w = vb / (va + vb + vc), vc / (va + vb + vc)
        on_ab, on_ac, on_bc = d1 / (d1 - d3), d2 / (d2 - d6), (d4 - d3) / ((d4 - d3) + (d5 - d6))
    shares = np.column_stack([1 - v - w, v, w])
    for where, own in (
        ((va <= 0) & (d4 - d3 >= 0) & (d5 - d6 >= 0), np.column_stack([0 * v, 1 - on_bc, on_bc])),
        ((vb <= 0) & (d2 >= 0) & (d6 <= 0), np.column_stack([1 - on_ac, 0 * v, on_ac])),
        ((vc <= 0) & (d1 >= 0) & (d3 <= 0), np.column_stack([1 - on_ab, on_ab, 0 * v])),
        ((d6 >= 0) & (d5 <= d6), np.array([0.0, 0, 1])),
        ((d3 >= 0) & (d4 <= d3), np.array([0.0, 1, 0])),
        ((d1 <= 0) & (d2 <= 0), np.array([1.0, 0, 0])),
    ):
        shares = np.where(where[:, None], own, shares)
    points = shares[:, :1] * a + shares[:, 1:2] * b + shares[:, 2:] * c
    k = int(np.argmin(np.linalg.norm(points - p, axis=1)))
    return points[k], k, shares[k]
