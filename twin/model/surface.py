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
        v = np.asarray(vertices, float).reshape(-1, 3)
        f = np.asarray(triangles, int).reshape(-1, 3)
        if not len(f):
            raise TwinError(f"surface '{name}' is empty; draw it again")
        if not np.isfinite(v).all():
            raise TwinError(f"surface '{name}' is not finite; draw it again")
        v, f = _merged(v, f)
        _require_closed(name, v, f)
        content = volume(v, f)
        if content <= 0:
            raise TwinError(
                f"surface '{name}' is inverted: its volume is {content * 1e6:.3g} cm3, because its triangles are "
                "clockwise seen from outside; swap two corners of each triangle"
            )
        while len(v) <= VERTICES:
            halved = _halved(v, f, edge)
            if halved is None:
                break
            v, f = halved
        if len(v) > VERTICES:
            way_out = "allow longer edges" if np.isfinite(edge) else "draw it coarser"
            raise TwinError(f"surface '{name}' is too fine: more than {VERTICES} vertices; {way_out}")
        self.name = name
        self.vertices = v
        self.triangles = f

    @property
    def volume(self) -> float:
        """Volume in m3."""
        return volume(self.vertices, self.triangles)


def _merged(vertices: Array, triangles: Index) -> tuple[Array, Index]:
    """Return the surface with equal vertices merged, without triangles that this makes degenerate."""
    cells = np.rint(vertices / _SAME)
    _, first, index = np.unique(cells, axis=0, return_index=True, return_inverse=True)
    triangles = index.reshape(-1)[triangles]
    a, b, c = triangles.T
    different = (a != b) & (b != c) & (c != a)
    return vertices[first], triangles[different]


def volume(vertices: Array, triangles: Index) -> float:
    """Return the volume in m3 that the triangles (m, 3) of a closed surface enclose."""
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    # the sum of the signed volumes of the tetrahedra of the triangles and the origin
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6)


def inside(points: Array, vertices: Array, triangles: Index) -> np.ndarray:
    """Return (k,) bool: whether each of the points (k, 3) is inside a closed surface, by the winding number.

    Formula for the solid angle of a triangle: A. van Oosterom and J. Strackee, doi:10.1109/TBME.1983.325207.
    """
    points = np.asarray(points, float).reshape(-1, 3)
    out = np.zeros(len(points), bool)
    in_box = (points > vertices.min(axis=0)) & (points < vertices.max(axis=0))
    candidates = np.flatnonzero(in_box.all(axis=1))
    first, second, third = triangles.T
    for k in candidates.tolist():
        # vectors a, b, c from the point to the corners, by components, which is faster than (m, 3) arrays
        x, y, z = (vertices - points[k]).T
        r = np.sqrt(x * x + y * y + z * z)
        ax, ay, az, la = x[first], y[first], z[first], r[first]
        bx, by, bz, lb = x[second], y[second], z[second], r[second]
        cx, cy, cz, lc = x[third], y[third], z[third], r[third]
        triple = ax * (by * cz - bz * cy) + ay * (bz * cx - bx * cz) + az * (bx * cy - by * cx)
        ab = ax * bx + ay * by + az * bz
        bc = bx * cx + by * cy + bz * cz
        ca = cx * ax + cy * ay + cz * az
        half_angles = np.arctan2(triple, la * lb * lc + ab * lc + bc * la + ca * lb)
        # the solid angles add up to 4 pi inside, to 0 outside
        out[k] = half_angles.sum() > np.pi
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
    """Yield the indices of the triangles of level 1, 2, ...; see `rings`."""
    reached_vertices = np.zeros(int(triangles.max()) + 1, bool)
    unreached = np.ones(len(triangles), bool)
    unreached[start] = False
    reached_vertices[triangles[start]] = True
    while True:
        adjacent = reached_vertices[triangles].any(axis=1)
        ring = np.flatnonzero(unreached & adjacent)
        if not len(ring):
            return
        yield ring
        unreached[ring] = False
        reached_vertices[triangles[ring]] = True


def _sides(triangles: Index) -> Index:
    """Return the three edges of each triangle (m, 3, 2), from corner 0 to 1, 1 to 2, and 2 to 0."""
    return triangles[:, [[0, 1], [1, 2], [2, 0]]]


def _require_closed(name: str, vertices: Array, triangles: Index) -> None:
    """Raise an error unless each edge belongs to exactly two triangles and has opposite directions in them."""
    sides = _sides(triangles).reshape(-1, 2)
    _, edge = np.unique(np.sort(sides, axis=1), axis=0, return_inverse=True)
    edge = edge.reshape(-1)  # number of the edge of each side
    count = np.bincount(edge)
    direction = np.where(sides[:, 0] < sides[:, 1], 1.0, -1.0)
    balance = np.bincount(edge, direction)
    is_open = count != 2
    is_inconsistent = balance != 0
    if is_open.any():
        bad = sides[is_open[edge]]
        number = int(is_open.sum())
        what = f"is open: {number} edges do not join two triangles"
        why = "a deformable needs a closed surface"
    elif is_inconsistent.any():
        bad = sides[is_inconsistent[edge]]
        number = int(is_inconsistent.sum())
        what = f"has triangles of both orientations: {number} edges join two triangles of different orientation"
        why = "list the corners of all triangles counter-clockwise, seen from outside"
    else:
        return
    x, y, z = (vertices[bad[0]].mean(axis=0) / MM).tolist()
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
    is_halved = m >= 0
    count = is_halved.sum(axis=1)
    # rotate the corners of each triangle so that its halved sides come first
    turn = np.zeros(len(f), int)
    none, one, two, three = (count == k for k in range(4))
    turn[one] = np.argmax(is_halved[one], axis=1)
    turn[two] = (np.argmin(m[two], axis=1) + 1) % 3  # the side after the whole one
    order = (turn[:, None] + np.arange(3)) % 3
    a, b, c = np.take_along_axis(f, order, 1).T
    p, q, r = np.take_along_axis(m, order, 1).T
    parts = [
        (none, (a, b, c)),
        (one, (a, p, c)), (one, (p, b, c)),
        (two, (p, b, q)), (two, (a, p, q)), (two, (a, q, c)),
        (three, (a, p, r)), (three, (p, b, q)), (three, (r, q, c)), (three, (p, q, r)),
    ]  # fmt: skip
    triangles = []
    for which, corners in parts:
        triangles.append(np.stack([corner[which] for corner in corners], axis=1))
    middles = (v[unique[long, 0]] + v[unique[long, 1]]) / 2
    return np.concatenate([v, middles]), np.concatenate(triangles)


def nearest(p: Array, vertices: Array, triangles: Index) -> tuple[Array, int, Array]:
    """Return the surface point nearest to p (3,): (position (3,), index of the triangle, barycentric coordinates (3,)).

    The case distinction is that of C. Ericson, "Real-Time Collision Detection" (2005), 5.1.5.
    """
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    ab = b - a
    ac = c - a
    ap = p - a
    bp = p - b
    cp = p - c

    def dot(x: Array, y: Array) -> Array:
        return np.einsum("ij,ij->i", x, y)

    d1 = dot(ab, ap)
    d2 = dot(ac, ap)
    d3 = dot(ab, bp)
    d4 = dot(ac, bp)
    d5 = dot(ab, cp)
    d6 = dot(ac, cp)
    # proportional to the barycentric coordinates of the projection into the triangle's plane
    va = d3 * d6 - d5 * d4
    vb = d5 * d2 - d1 * d6
    vc = d1 * d4 - d3 * d2
    # quotients of cases that do not apply may be infinite or NaN
    with np.errstate(divide="ignore", invalid="ignore"):
        v = vb / (va + vb + vc)
        w = vc / (va + vb + vc)
        on_ab = d1 / (d1 - d3)
        on_ac = d2 / (d2 - d6)
        on_bc = (d4 - d3) / ((d4 - d3) + (d5 - d6))
    shares = np.column_stack([1 - v - w, v, w])
    # the last case that applies counts: edges before corners
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
