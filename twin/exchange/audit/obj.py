"""Read the Wavefront OBJ meshes of MJCF and URDF: only points and triangles."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

import numpy as np

from twin.core.foreign.budget import check_size
from twin.exchange.audit.poses import Array
from twin.exchange.audit.report import ReadError


def read_obj(path: Path) -> tuple[Array, Array]:
    """Return (points (n, 3), triangles (m, 3) with indices from 0); larger faces are split into triangles.

    Raises:
        ReadError: a line cannot be parsed, or a face refers to a point that does not exist.
    """
    check_size(path, "OBJ")
    stat = path.stat()
    return _read(path, stat.st_mtime_ns, stat.st_size)


@lru_cache(maxsize=1000)
def _read(path: Path, time: int, size: int) -> tuple[Array, Array]:
    """Read a file; the result is cached until the file changes, because MJCF and URDF share meshes."""
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
