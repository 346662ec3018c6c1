"""Closed triangle surfaces: checks, subdivision of long edges, volume, and tests for points inside."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from twin.core.errors import TwinError
from twin.core.spatial import Array, Index
from twin.core.units import MM

MAX_VERTICES = 6000
"""Maximum number of vertices of a simulated surface; each picture frame sent to a page contains all of them."""

_COINCIDENT_DISTANCE = 1e-9
"""Distance in m below which two vertices are merged: neighbouring faces of a STEP file do not share vertices."""


class Surface:
    """A closed surface whose triangles are counter-clockwise seen from outside.

    Vertices are (n, 3) in m; triangles are (m, 3) indices of vertices.
    """

    def __init__(self, name: str, vertices: Array, triangles: Index, edge: float = np.inf) -> None:
        """Merge equal vertices, then halve edges until no edge is longer than `edge` in m.

        Raises:
            TwinError: the surface is empty, not finite, open, inverted, or has more than `MAX_VERTICES` vertices.
        """
        vertices = np.asarray(vertices, float).reshape(-1, 3)
        triangles = np.asarray(triangles, int).reshape(-1, 3)
        if not len(triangles):
            raise TwinError(f"surface '{name}' is empty; draw it again")
        if not np.isfinite(vertices).all():
            raise TwinError(f"surface '{name}' is not finite; draw it again")
        vertices, triangles = _merged(vertices, triangles)
        _require_closed(name, vertices, triangles)
        content = volume(vertices, triangles)
        # After the check that it is closed: an open surface has no volume that could tell its orientation.
        if content <= 0:
            raise TwinError(
                f"surface '{name}' is inverted: its volume is {content * 1e6:.3g} cm3, because its triangles are "
                "clockwise seen from outside; swap two corners of each triangle"
            )
        while len(vertices) <= MAX_VERTICES:
            halved = _halved(vertices, triangles, edge)
            if halved is None:
                break
            vertices, triangles = halved
        if len(vertices) > MAX_VERTICES:
            way_out = "draw it coarser"
            if np.isfinite(edge):
                way_out = "allow longer edges"
            raise TwinError(f"surface '{name}' is too fine: more than {MAX_VERTICES} vertices; {way_out}")
        self.name = name
        self.vertices = vertices
        self.triangles = triangles

    @property
    def volume(self) -> float:
        """Volume in m3."""
        return volume(self.vertices, self.triangles)


def _merged(vertices: Array, triangles: Index) -> tuple[Array, Index]:
    """Return the surface with equal vertices merged, without triangles that this makes degenerate."""
    cells = np.rint(vertices / _COINCIDENT_DISTANCE)
    _, first, index = np.unique(cells, axis=0, return_index=True, return_inverse=True)
    triangles = index.reshape(-1)[triangles]
    a, b, c = triangles.T
    different = (a != b) & (b != c) & (c != a)
    return vertices[first], triangles[different]


def volume(vertices: Array, triangles: Index) -> float:
    """Return the volume in m3 that the triangles (m, 3) of a closed surface enclose."""
    a, b, c = _corners(vertices, triangles)
    # the sum of the signed volumes of the tetrahedra of the triangles and the origin
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6)


def _corners(vertices: Array, triangles: Index) -> tuple[Array, Array, Array]:
    """Return the positions (m, 3) of the first, second and third corner of each triangle."""
    first, second, third = triangles.T
    return vertices[first], vertices[second], vertices[third]


def inside(points: Array, vertices: Array, triangles: Index) -> np.ndarray:
    """Return (k,) bool: whether each of the points (k, 3) is inside a closed surface, by the winding number.

    Formula for the solid angle of a triangle: A. van Oosterom and J. Strackee, doi:10.1109/TBME.1983.325207.
    """
    points = np.asarray(points, float).reshape(-1, 3)
    is_inside = np.zeros(len(points), bool)
    in_box = (points > vertices.min(axis=0)) & (points < vertices.max(axis=0))
    candidates = np.flatnonzero(in_box.all(axis=1))
    first, second, third = triangles.T
    for candidate in candidates.tolist():
        # vectors a, b, c from the point to the corners, by components, which is faster than (m, 3) arrays
        x, y, z = (vertices - points[candidate]).T
        length = np.sqrt(x * x + y * y + z * z)
        ax, ay, az = x[first], y[first], z[first]
        bx, by, bz = x[second], y[second], z[second]
        cx, cy, cz = x[third], y[third], z[third]
        length_a = length[first]
        length_b = length[second]
        length_c = length[third]
        b_cross_c_x = by * cz - bz * cy
        b_cross_c_y = bz * cx - bx * cz
        b_cross_c_z = bx * cy - by * cx
        triple_product = ax * b_cross_c_x + ay * b_cross_c_y + az * b_cross_c_z
        a_dot_b = ax * bx + ay * by + az * bz
        b_dot_c = bx * cx + by * cy + bz * cz
        c_dot_a = cx * ax + cy * ay + cz * az
        denominator = length_a * length_b * length_c + a_dot_b * length_c + b_dot_c * length_a + c_dot_a * length_b
        half_angles = np.arctan2(triple_product, denominator)
        # the solid angles add up to 4 pi inside, to 0 outside
        is_inside[candidate] = half_angles.sum() > np.pi
    return is_inside


def rings(triangles: Index, start: int) -> Index:
    """Return the level (m,) of each triangle around the triangle `start`; -1 for triangles not connected with `start`.

    Level 0 is the triangle `start`. Level 1 are the triangles that share a corner with level 0, level 2 are further
    triangles that share a corner with level 1, and so on, as in figure 19 of the paper on the PA-10 virtual surgery
    robot.
    """
    level = np.full(len(triangles), -1)
    level[start] = 0
    for k, ring in enumerate(_triangle_rings(triangles, start), 1):
        level[ring] = k
    return level


def _triangle_rings(triangles: Index, start: int) -> Iterator[Index]:
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
        faulty_sides = sides[is_open[edge]]
        number = int(is_open.sum())
        what = f"is open: {number} edges do not join two triangles"
        why = "a deformable needs a closed surface"
    elif is_inconsistent.any():
        faulty_sides = sides[is_inconsistent[edge]]
        number = int(is_inconsistent.sum())
        what = f"has triangles of both orientations: {number} edges join two triangles of different orientation"
        why = "list the corners of all triangles counter-clockwise, seen from outside"
    else:
        return
    x, y, z = (vertices[faulty_sides[0]].mean(axis=0) / MM).tolist()
    raise TwinError(f"surface '{name}' {what}, one of them at ({x:.1f}, {y:.1f}, {z:.1f}) mm; {why}")


def _halved(vertices: Array, triangles: Index, edge: float) -> tuple[Array, Index] | None:
    """Return the surface with a new vertex in the middle of each side longer than `edge` in m; None: no such side.

    The neighbour of a triangle across such a side halves it too, so the surface stays closed.
    """
    if not np.isfinite(edge):
        return None
    sides = np.sort(_sides(triangles).reshape(-1, 2), axis=1)
    edges, edge_of_side = np.unique(sides, axis=0, return_inverse=True)
    starts = vertices[edges[:, 0]]
    ends = vertices[edges[:, 1]]
    is_long = np.linalg.norm(starts - ends, axis=1) > edge
    if not is_long.any():
        return None
    middles = (starts[is_long] + ends[is_long]) / 2
    middle_of_edge = np.full(len(edges), -1)
    middle_of_edge[is_long] = len(vertices) + np.arange(len(middles))
    middle_of_side = middle_of_edge[edge_of_side.reshape(-1, 3)]  # (m, 3) new vertex; -1: the side stays whole
    return np.concatenate([vertices, middles]), _split(triangles, middle_of_side)


def _split(triangles: Index, middle_of_side: Index) -> Index:
    """Return the triangles that replace each triangle, given the new vertices (m, 3) on its sides; -1: a whole side."""
    is_halved = middle_of_side >= 0
    halved_sides = is_halved.sum(axis=1)
    # rotate the corners of each triangle so that its halved sides come first
    turn = np.zeros(len(triangles), int)
    is_whole = halved_sides == 0
    has_one = halved_sides == 1
    has_two = halved_sides == 2
    has_three = halved_sides == 3
    turn[has_one] = np.argmax(is_halved[has_one], axis=1)
    turn[has_two] = (np.argmin(middle_of_side[has_two], axis=1) + 1) % 3  # the side after the whole one
    order = (turn[:, None] + np.arange(3)) % 3
    a, b, c = np.take_along_axis(triangles, order, 1).T
    p, q, r = np.take_along_axis(middle_of_side, order, 1).T  # middles of the sides ab, bc and ca
    parts = [
        (is_whole, (a, b, c)),
        (has_one, (a, p, c)), (has_one, (p, b, c)),
        (has_two, (p, b, q)), (has_two, (a, p, q)), (has_two, (a, q, c)),
        (has_three, (a, p, r)), (has_three, (p, b, q)), (has_three, (r, q, c)), (has_three, (p, q, r)),
    ]  # fmt: skip
    pieces = []
    for which, corners in parts:
        pieces.append(np.stack(corners, axis=1)[which])
    return np.concatenate(pieces)


def nearest(p: Array, vertices: Array, triangles: Index) -> tuple[Array, int, Array]:
    """Return the surface point nearest to p (3,): (position (3,), index of the triangle, barycentric coordinates (3,)).

    The case distinction is that of C. Ericson, "Real-Time Collision Detection" (2005), 5.1.5.
    """
    a, b, c = _corners(vertices, triangles)
    barycentric = _nearest_in_triangles(p, a, b, c)
    points = barycentric[:, :1] * a + barycentric[:, 1:2] * b + barycentric[:, 2:] * c
    k = int(np.argmin(np.linalg.norm(points - p, axis=1)))
    return points[k], k, barycentric[k]


def _nearest_in_triangles(p: Array, a: Array, b: Array, c: Array) -> Array:
    """Return the barycentric coordinates (m, 3) of the point nearest to p (3,) in each triangle of corners a, b, c."""
    ab = b - a
    ac = c - a
    ap = p - a
    bp = p - b
    cp = p - c
    d1 = _dot(ab, ap)
    d2 = _dot(ac, ap)
    d3 = _dot(ab, bp)
    d4 = _dot(ac, bp)
    d5 = _dot(ab, cp)
    d6 = _dot(ac, cp)
    # proportional to the barycentric coordinates of the projection into the triangle's plane
    va = d3 * d6 - d5 * d4
    vb = d5 * d2 - d1 * d6
    vc = d1 * d4 - d3 * d2
    along_bc = d4 - d3
    from_c_along_bc = d5 - d6
    # quotients of cases that do not apply may be infinite or NaN
    with np.errstate(divide="ignore", invalid="ignore"):
        v = vb / (va + vb + vc)
        w = vc / (va + vb + vc)
        share_ab = d1 / (d1 - d3)
        share_ac = d2 / (d2 - d6)
        share_bc = along_bc / (along_bc + from_c_along_bc)
    zero = np.zeros(len(a))
    cases = [
        # the point is nearest to the inside of an edge
        ((va <= 0) & (along_bc >= 0) & (from_c_along_bc >= 0), np.column_stack([zero, 1 - share_bc, share_bc])),
        ((vb <= 0) & (d2 >= 0) & (d6 <= 0), np.column_stack([1 - share_ac, zero, share_ac])),
        ((vc <= 0) & (d1 >= 0) & (d3 <= 0), np.column_stack([1 - share_ab, share_ab, zero])),
        # to a corner
        ((d6 >= 0) & (d5 <= d6), np.array([0.0, 0, 1])),
        ((d3 >= 0) & (d4 <= d3), np.array([0.0, 1, 0])),
        ((d1 <= 0) & (d2 <= 0), np.array([1.0, 0, 0])),
    ]
    barycentric = np.column_stack([1 - v - w, v, w])
    # the last case that applies counts: at a corner, the conditions of its edges may hold too
    for applies, coordinates in cases:
        barycentric = np.where(applies[:, None], coordinates, barycentric)
    return barycentric


def _dot(x: Array, y: Array) -> Array:
    """Return the dot products (m,) of the rows of x and y (m, 3)."""
    return np.einsum("ij,ij->i", x, y)
