"""Read the OBJ meshes of MJCF and URDF. Check triangle meshes (indices, winding, normals), and measure them."""

from __future__ import annotations

from collections.abc import Iterable
from functools import lru_cache
from pathlib import Path

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from twin.core.foreign.budget import check_size
from twin.exchange.audit.colors import surface_area
from twin.exchange.audit.motion import Shape
from twin.exchange.audit.poses import Array
from twin.exchange.audit.report import Ledger, Measured, ReadError

NEAR = 3e-6
"""Distance in m below which points may be one point in another format: two are rounded, to 0.001 mm in an OBJ."""

AGAINST = 0.01
"""Maximum fraction of a mesh's area with normals opposite to the winding; thin triangles have inexact normals."""


def check_mesh(
    ledger: Ledger, where: str, vertices: Array, triangles: Array, normals: Array | None, code: str
) -> Shape | None:
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
        bad = int(triangles.max()) if triangles.max() >= len(vertices) else int(triangles.min())
        text = f"mesh '{where}': a face uses point {bad}, but the mesh has {len(vertices)} points."
        ledger.wrong(f"{code}.index", text, where, size=Measured(bad, float(len(vertices) - 1)))
        return None
    shape, mixed = _measured(np.asarray(vertices, float).tobytes(), np.asarray(triangles, np.int64).tobytes())
    closed, volume = shape.closed, shape.volume
    if mixed:
        text = f"mesh '{where}' is closed, but its faces are not consistently oriented."
        ledger.wrong(f"{code}.winding_mixed", text, where)
    elif closed and volume < -shape.rounding:
        text = f"mesh '{where}' is inside out (volume {volume:.3g} m3): viewers show its inner side."
        ledger.wrong(f"{code}.winding", text, where, size=Measured(volume, 0.0, "m3"))
    if normals is not None:
        _check_normals(ledger, where, vertices, triangles, normals, code)
    return shape


@lru_cache(maxsize=512)
def _measured(points: bytes, faces: bytes) -> tuple[Shape, bool]:
    """Return (shape, mixed); `mixed` is True if the mesh is closed, but its triangles are inconsistently oriented.

    Several files can have the same mesh; therefore results are cached.
    """
    vertices = np.frombuffer(points).reshape(-1, 3)
    triangles = np.frombuffer(faces, np.int64).reshape(-1, 3)
    closed, mixed = edges(weld(vertices, triangles))
    unique, place = np.unique(triangles, return_inverse=True)
    used = vertices[unique]
    return Shape(
        used.min(axis=0),
        used.max(axis=0),
        signed_volume(vertices, triangles),
        closed,
        closed or edges(weld_near(vertices, triangles))[0],
        used,
        place.reshape(-1, 3),
        surface_area(vertices, triangles),
    ), mixed


def _check_normals(ledger: Ledger, where: str, vertices: Array, triangles: Array, normals: Array, code: str) -> None:
    size = np.linalg.norm(normals, axis=1)
    if not np.all(np.isfinite(size)) or np.max(np.abs(size - 1)) > 0.01:
        k = int(np.argmax(np.where(np.isfinite(size), np.abs(size - 1), np.inf)))
        text = f"mesh '{where}': a normal has length {size[k]:.4g}, not 1."
        ledger.wrong(f"{code}.normal", text, where, size=Measured(size[k], 1.0), suggestion="normalise the normals")
        return
    a, b, c = (vertices[triangles[:, i]] for i in range(3))
    area = np.cross(b - a, c - a)
    total = float(np.linalg.norm(area, axis=1).sum())
    along = np.einsum("ij,ikj->ik", area, normals.reshape(-1, 3, 3))
    against = float(-along[along < 0].sum() / 3)
    if total > 0 and against > AGAINST * total:
        text = (
            f"mesh '{where}': normals of {100 * against / total:.3g} % of the area point against the winding of the "
            "faces: the mesh looks lit from inside."
        )
        ledger.wrong(f"{code}.normals_against", text, where, size=Measured(against / total, AGAINST))


def weld(vertices: Array, triangles: Array) -> Array:
    """Return the triangles (m, 3) with merged indices of equal points; exporters duplicate points at sharp edges."""
    rows = np.ascontiguousarray(vertices + 0.0)  # adding 0.0 removes negative zeros
    keys = rows.view(np.dtype((np.void, rows.dtype.itemsize * 3))).ravel()
    _, first = np.unique(keys, return_inverse=True)
    return first[triangles]


def weld_near(vertices: Array, triangles: Array) -> Array:
    """Return the triangles (m, 3) with merged indices of points that are nearer than `NEAR`.

    Formats round points differently, so that two points are one point in one format only. Merging more points never
    opens a closed mesh.
    """
    points, place = np.unique(vertices, axis=0, return_inverse=True)
    pairs = KDTree(points, balanced_tree=False, compact_nodes=False).query_pairs(NEAR, output_type="ndarray")
    links = coo_matrix((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(points), len(points)))
    return connected_components(links, directed=False)[1][place.ravel()][triangles]


def edges(triangles: Array) -> tuple[bool, bool]:
    """Return two flags of a mesh: (closed and consistently oriented, closed and inconsistently oriented).

    The orientation is consistent if each directed edge occurs as often as its opposite. Both values are False for an
    open mesh. Triangles that are degenerate after welding are ignored.
    """
    t = triangles[(triangles[:, 0] != triangles[:, 1]) & (triangles[:, 1] != triangles[:, 2])]
    t = t[t[:, 0] != t[:, 2]].astype(np.int64)
    if not len(t):
        return False, False
    pairs = np.vstack([t[:, [0, 1]], t[:, [1, 2]], t[:, [2, 0]]])
    n = int(pairs.max()) + 1
    there, back = pairs[:, 0] * n + pairs[:, 1], pairs[:, 1] * n + pairs[:, 0]
    if np.array_equal(np.sort(there), np.sort(back)):
        return True, False
    _, count = np.unique(np.minimum(there, back), return_counts=True)
    return False, bool(np.all(count % 2 == 0))


def signed_volume(vertices: Array, triangles: Array) -> float:
    """Return the volume in m3 of a closed mesh; it is negative if the faces point inwards.

    The origin is moved to the centre of the bounding box, which reduces rounding errors.
    """
    p = vertices - (vertices.min(axis=0) + vertices.max(axis=0)) / 2
    a, b, c = (p[triangles[:, i]] for i in range(3))
    return float(np.sum(a * np.cross(b, c)) / 6)


def joined(shapes: Iterable[Shape]) -> Shape | None:
    """Return the shape of a link, combined from the shapes of its meshes; None if the link has no mesh."""
    parts = list(shapes)
    if not parts:
        return None
    points = np.vstack([s.points for s in parts])
    offsets = np.cumsum([0, *(len(s.points) for s in parts[:-1])])
    triangles = np.vstack([s.triangles + offset for s, offset in zip(parts, offsets, strict=True)])
    volume = sum(s.volume for s in parts)
    closed = all(s.closed for s in parts)
    nearly_closed = all(s.nearly_closed for s in parts)
    if len(parts) > 1 and not closed:
        closed = edges(weld(points, triangles))[0]
        nearly_closed = closed or nearly_closed or edges(weld_near(points, triangles))[0]
        volume = signed_volume(points, triangles)
    return Shape(
        np.min([s.low for s in parts], axis=0),
        np.max([s.high for s in parts], axis=0),
        volume,
        closed,
        nearly_closed,
        points,
        triangles,
        sum(s.area for s in parts),
    )


def read_obj(path: Path) -> tuple[Array, Array]:
    """Read an OBJ file; return (points (n, 3), triangles (m, 3) with indices from 0). Polygons become triangles.

    Raises:
        ReadError: a line cannot be parsed, or a face refers to a point that does not exist.
    """
    check_size(path, "OBJ")
    stat = path.stat()
    return _read_obj(path, stat.st_mtime_ns, stat.st_size)


@lru_cache(maxsize=1000)
def _read_obj(path: Path, time: int, size: int) -> tuple[Array, Array]:
    """Read an OBJ file. MJCF and URDF share meshes; therefore the result is cached until the file changes."""
    points: list[list[float]] = []
    faces: list[tuple[int, int, int]] = []
    try:
        for line in path.read_text(encoding="utf-8").splitlines():
            words = line.split()
            if not words:
                continue
            if words[0] == "v":
                points.append([float(w) for w in words[1:4]])
            elif words[0] == "f":
                corners = [int(w.split("/", 1)[0]) for w in words[1:]]
                corners = [c - 1 if c > 0 else len(points) + c for c in corners]
                faces += [(corners[0], corners[i], corners[i + 1]) for i in range(1, len(corners) - 1)]
    except (OSError, ValueError, IndexError) as error:
        raise ReadError(f"{path.name} cannot be read: {error}") from error
    vertices = np.array(points, float).reshape(-1, 3)
    triangles = np.array(faces, int).reshape(-1, 3)
    if len(triangles) and (triangles.min() < 0 or triangles.max() >= len(vertices)):
        raise ReadError(
            f"{path.name}: a face uses point {int(triangles.max()) + 1}, but the file has {len(vertices)} points"
        )
    return vertices, triangles
