"""Read the OBJ meshes of MJCF and URDF."""

from __future__ import annotations

from functools import lru_cache
from itertools import pairwise
from pathlib import Path

import numpy as np

from twin.core.foreign.budget import check_size
from twin.exchange.audit.ledger import ReadError
from twin.exchange.audit.poses import Array


def read_obj(path: Path) -> tuple[Array, Array]:
    """Read an OBJ file; return (points (n, 3), triangles (m, 3) with indices from 0). Polygons become triangles.

    Raises:
        ReadError: a line cannot be parsed, a point has less than three coordinates, or a face refers to a point that
            does not exist.
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
                point = list(map(float, words[1:4]))
                if len(point) < 3:
                    raise ReadError(f"{path.name}: point {len(points) + 1} has {len(point)} coordinates, not 3")
                points.append(point)
            elif words[0] == "f":
                corners = []
                for word in words[1:]:
                    corners.append(_corner(word, len(points), path.name))
                for second, third in pairwise(corners[1:]):  # a polygon becomes a fan of triangles
                    faces.append((corners[0], second, third))
    except (OSError, ValueError) as error:
        raise ReadError(f"{path.name} cannot be read: {error}") from error
    vertices = np.array(points, float).reshape(-1, 3)
    triangles = np.array(faces, int).reshape(-1, 3)
    # Points may follow the faces that use them.
    if len(triangles) and triangles.max() >= len(vertices):
        last = int(triangles.max()) + 1
        raise ReadError(f"{path.name}: a face uses point {last}, but the file has {len(vertices)} points")
    return vertices, triangles


def _corner(word: str, count: int, file: str) -> int:
    """Return the index from 0 of a corner "point/texture/normal" after `count` points of a file.

    Points are numbered from 1; negative numbers count back from the last point before the face.
    """
    number = int(word.split("/", 1)[0])
    if number > 0:
        return number - 1
    if number == 0:
        raise ReadError(f"{file}: a face uses point 0, but the points of an OBJ are numbered from 1")
    if count + number < 0:
        raise ReadError(f"{file}: a face uses point {number}, but only {count} points stand before it")
    return count + number
