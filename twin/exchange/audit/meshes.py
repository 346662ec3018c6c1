"""Check triangle meshes (indices, winding, normals), measure their shapes, and join those of a link."""

from __future__ import annotations

from collections.abc import Iterable
from functools import lru_cache

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from twin.exchange.audit.colors import surface_area
from twin.exchange.audit.file_content import LinkShape
from twin.exchange.audit.ledger import Ledger, Measured
from twin.exchange.audit.poses import Array

MERGE_DISTANCE = 3e-6
"""Distance in m below which points may be one point in another format: two are rounded, to 0.001 mm in an OBJ."""

NORMAL_TOL = 3**0.5 / 2 / 127
"""Maximum difference between a normal's length and 1: the rounding of three components to signed bytes."""

_MIN_AREA_SHARE = 1e-6
"""Area of a triangle, as a fraction of the mesh's, up to which its normal is only rounding."""

_REVERSED_COSINE = -0.5
"""Cosine of the angle, 120 degrees, from which a normal is reversed: at sharp edges, correct ones are up to 90 off."""

MAX_SHARE_AGAINST = 0.01
"""Maximum fraction of a mesh's area with normals opposite to the winding; thin triangles have inexact normals."""


def check_mesh(
    ledger: Ledger, where: str, vertices: Array, triangles: Array, normals: Array | None, code: str
) -> LinkShape | None:
    """Report the faults of a mesh, and return the shape of the mesh; None if the triangles are invalid.

    Vertices are (n, 3) in m, triangles (m, 3). `normals` (3 m, 3) contains a unit normal for each triangle corner, or
    is None. `code` is the first part of the codes of the findings.
    """
    if not len(vertices) or not len(triangles):
        return None
    if not np.all(np.isfinite(vertices)):
        ledger.wrong(f"{code}.finite", f"mesh '{where}' has points that are not finite.", where)
        return None
    if triangles.min() < 0 or triangles.max() >= len(vertices):
        index = int(triangles.max())
        if index < len(vertices):
            index = int(triangles.min())
        text = f"mesh '{where}': a face uses point {index}, but the mesh has {len(vertices)} points."
        ledger.wrong(f"{code}.index", text, where, size=Measured(index, float(len(vertices) - 1)))
        return None
    # As bytes, which the cache can compare.
    points = np.asarray(vertices, float).tobytes()
    faces = np.asarray(triangles, np.int64).tobytes()
    shape, mixed = _shape_and_orientation(points, faces)
    if mixed:
        text = f"mesh '{where}' is closed, but its faces are not consistently oriented."
        ledger.wrong(f"{code}.winding_mixed", text, where)
    elif shape.closed and shape.volume < -shape.rounding:
        text = f"mesh '{where}' is inside out (volume {shape.volume:.3g} m3): viewers show its inner side."
        ledger.wrong(f"{code}.winding", text, where, size=Measured(shape.volume, 0.0, "m3"))
    if normals is not None:
        _check_normals(ledger, where, vertices, triangles, normals, code)
    return shape


@lru_cache(maxsize=512)
def _shape_and_orientation(points: bytes, faces: bytes) -> tuple[LinkShape, bool]:
    """Return (shape, mixed); `mixed` is True if the mesh is closed, but its triangles are inconsistently oriented.

    Several files can have the same mesh; therefore results are cached.
    """
    vertices = np.frombuffer(points).reshape(-1, 3)
    triangles = np.frombuffer(faces, np.int64).reshape(-1, 3)
    closed, mixed = is_closed_and_oriented(weld(vertices, triangles))
    nearly_closed = closed
    if not closed:
        nearly_closed, _ = is_closed_and_oriented(weld_near(vertices, triangles))
    unique, new_indices = np.unique(triangles, return_inverse=True)
    used_vertices = vertices[unique]
    shape = LinkShape(
        used_vertices.min(axis=0),
        used_vertices.max(axis=0),
        signed_volume(vertices, triangles),
        closed,
        nearly_closed,
        used_vertices,
        new_indices.reshape(-1, 3),
        surface_area(vertices, triangles),
    )
    return shape, mixed


def _check_normals(ledger: Ledger, where: str, vertices: Array, triangles: Array, normals: Array, code: str) -> None:
    """Report normals that are not unit vectors, or that point against the winding."""
    lengths = np.linalg.norm(normals, axis=1)
    errors = np.abs(lengths - 1)
    finite = np.isfinite(lengths)
    if not np.all(finite) or np.max(errors) > NORMAL_TOL:
        worst = int(np.argmax(np.where(finite, errors, np.inf)))
        text = f"mesh '{where}': a normal has length {lengths[worst]:.4g}, not 1."
        ledger.wrong(
            f"{code}.normal", text, where, size=Measured(lengths[worst], 1.0), suggestion="normalise the normals"
        )
        return
    areas = _doubled_areas(vertices, triangles)
    total = float(np.linalg.norm(areas, axis=1).sum())
    corner_normals = normals.reshape(-1, 3, 3)
    projections = np.einsum("ij,ikj->ik", areas, corner_normals)
    against = float(-projections[projections < 0].sum() / 3)  # each triangle has three corners
    if total > 0 and against > MAX_SHARE_AGAINST * total:
        share = against / total
        text = (
            f"mesh '{where}': normals of {100 * share:.3g} % of the area point against the winding of the "
            "faces: the mesh looks lit from inside."
        )
        ledger.wrong(f"{code}.normals_against", text, where, size=Measured(share, MAX_SHARE_AGAINST))
        return
    reversed_points = _count_reversed_points(triangles, areas, projections)
    if reversed_points:
        text = f"mesh '{where}': the normals of {reversed_points} points are against all faces around them: dark spots."
        ledger.add(f"{code}.normal_reversed", "warning", text, where, size=float(reversed_points))


def _count_reversed_points(triangles: Array, areas: Array, projections: Array) -> int:
    """Return the number of points whose normals are more than 120 degrees from the normals of all their faces.

    `areas` (m, 3) are vectors along the normals of the triangles, `projections` (m, 3) their products with the normals
    of the corners. Faces that are too thin to have an exact normal do not count.
    """
    size = np.linalg.norm(areas, axis=1)
    counted = size > _MIN_AREA_SHARE * size.sum()
    cosines = projections[counted] / size[counted, None]
    corners = triangles[counted]
    nearest = np.full(int(triangles.max()) + 1, -np.inf)
    np.maximum.at(nearest, corners.ravel(), cosines.ravel())
    return int(np.count_nonzero(np.isfinite(nearest) & (nearest < _REVERSED_COSINE)))


def _doubled_areas(vertices: Array, triangles: Array) -> Array:
    """Return vectors (m, 3) along the normals of triangles, with twice the areas of the triangles as lengths."""
    a = vertices[triangles[:, 0]]
    b = vertices[triangles[:, 1]]
    c = vertices[triangles[:, 2]]
    return np.cross(b - a, c - a)


def weld(vertices: Array, triangles: Array) -> Array:
    """Return the triangles (m, 3) with merged indices of equal points; exporters duplicate points at sharp edges."""
    rows = np.ascontiguousarray(vertices + 0.0)  # adding 0.0 removes negative zeros
    # Each row becomes one value of 24 bytes: np.unique(axis=0) would sort the same rows much more slowly.
    keys = rows.view(np.dtype((np.void, rows.dtype.itemsize * 3))).ravel()
    _, first = np.unique(keys, return_inverse=True)
    return first[triangles]


def weld_near(vertices: Array, triangles: Array) -> Array:
    """Return the triangles (m, 3) with merged indices of points that are nearer than `MERGE_DISTANCE`.

    Formats round points differently, so that two points are one point in one format only. Merging more points never
    opens a closed mesh.
    """
    points, point_of_vertex = np.unique(vertices, axis=0, return_inverse=True)
    tree = KDTree(points, balanced_tree=False, compact_nodes=False)
    pairs = tree.query_pairs(MERGE_DISTANCE, output_type="ndarray")
    ones = np.ones(len(pairs))
    graph = coo_matrix((ones, (pairs[:, 0], pairs[:, 1])), shape=(len(points), len(points)))
    _, merged = connected_components(graph, directed=False)
    return merged[point_of_vertex.ravel()][triangles]


def is_closed_and_oriented(triangles: Array) -> tuple[bool, bool]:
    """Return two flags of a mesh: (closed and consistently oriented, closed and inconsistently oriented).

    The orientation is consistent if each directed edge occurs as often as its opposite. Both values are False for an
    open mesh. Triangles that are degenerate after welding are ignored.
    """
    a = triangles[:, 0]
    b = triangles[:, 1]
    c = triangles[:, 2]
    proper = (a != b) & (b != c) & (a != c)
    proper_triangles = triangles[proper].astype(np.int64)
    if not len(proper_triangles):
        return False, False
    pairs = np.vstack([proper_triangles[:, [0, 1]], proper_triangles[:, [1, 2]], proper_triangles[:, [2, 0]]])
    # One number for each directed edge, and one for its opposite.
    n = int(pairs.max()) + 1
    forward = pairs[:, 0] * n + pairs[:, 1]
    backward = pairs[:, 1] * n + pairs[:, 0]
    if np.array_equal(np.sort(forward), np.sort(backward)):
        return True, False
    # Without regard to direction, each edge of a closed mesh belongs to two triangles, or to two pairs of them.
    _, count = np.unique(np.minimum(forward, backward), return_counts=True)
    return False, bool(np.all(count % 2 == 0))


def signed_volume(vertices: Array, triangles: Array) -> float:
    """Return the volume in m3 of a closed mesh; it is negative if the faces point inwards.

    The origin is moved to the centre of the bounding box, which reduces rounding errors.
    """
    center = (vertices.min(axis=0) + vertices.max(axis=0)) / 2
    points = vertices - center
    a = points[triangles[:, 0]]
    b = points[triangles[:, 1]]
    c = points[triangles[:, 2]]
    return float(np.sum(a * np.cross(b, c)) / 6)


def joined(shapes: Iterable[LinkShape]) -> LinkShape | None:
    """Return the shape of a link, combined from the shapes of its meshes; None if the link has no mesh."""
    parts = list(shapes)
    if not parts:
        return None
    all_points = []
    all_triangles = []
    lows = []
    highs = []
    count = 0
    volume = 0.0
    area = 0.0
    closed = True
    nearly_closed = True
    for shape in parts:
        all_points.append(shape.points)
        all_triangles.append(shape.triangles + count)
        lows.append(shape.low)
        highs.append(shape.high)
        count += len(shape.points)
        volume += shape.volume
        area += shape.area
        closed = closed and shape.closed
        nearly_closed = nearly_closed and shape.nearly_closed
    points = np.vstack(all_points)
    triangles = np.vstack(all_triangles)
    # Meshes that are open by themselves can close each other: a body whose faces are separate meshes.
    if len(parts) > 1 and not closed:
        closed, _ = is_closed_and_oriented(weld(points, triangles))
        if closed:
            nearly_closed = True
        elif not nearly_closed:
            nearly_closed, _ = is_closed_and_oriented(weld_near(points, triangles))
        volume = signed_volume(points, triangles)
    low = np.min(lows, axis=0)
    high = np.max(highs, axis=0)
    return LinkShape(low, high, volume, closed, nearly_closed, points, triangles, area)
