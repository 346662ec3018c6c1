"""3MF in, core specification: meshes, components, build items and their placements, and the unit it states."""

from __future__ import annotations

import zipfile
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from twin.spatial import Array

_MODEL = "3D/3dmodel.model"

UNITS = {"micron": 1e-6, "millimeter": 1e-3, "centimeter": 1e-2, "inch": 0.0254, "foot": 0.3048, "meter": 1.0}
"""Units a 3MF may state, in metres; millimeter if it states none."""


def read_3mf(path: Path) -> tuple[Array, np.ndarray, str]:
    """Return vertices (n, 3) in the file's unit, triangles (m, 3), and the unit that the file states.

    Raises:
        ValueError, KeyError, zipfile.BadZipFile, ElementTree.ParseError: it is no such file.
    """
    with zipfile.ZipFile(path) as archive:
        root = ElementTree.fromstring(archive.read(_MODEL))
    objects = {o.get("id"): o for o in root.iterfind("{*}resources/{*}object")}
    vertices: list[Array] = []
    triangles: list[np.ndarray] = []

    def add(number: str | None, T: Array, depth: int = 0) -> None:
        if number not in objects or depth > len(objects):
            raise ValueError(f"object {number} is missing or holds itself")
        mesh = objects[number].find("{*}mesh")
        if mesh is not None:
            points = _numbers(mesh.iterfind("{*}vertices/{*}vertex"), "xyz", float)
            corners = _numbers(mesh.iterfind("{*}triangles/{*}triangle"), ("v1", "v2", "v3"), int)
            if len(corners) and not 0 <= corners.min() <= corners.max() < len(points):
                raise ValueError(f"a triangle of object {number} has a vertex that does not exist")
            if np.linalg.det(T[:3]) < 0:
                corners = corners[:, ::-1]
            triangles.append(corners + sum(len(v) for v in vertices))
            vertices.append(points @ T[:3] + T[3])
        for part in objects[number].iterfind("{*}components/{*}component"):
            own = _placement(part.get("transform"))
            add(part.get("objectid"), np.vstack([own[:3] @ T[:3], own[3] @ T[:3] + T[3]]), depth + 1)

    for item in root.iterfind("{*}build/{*}item"):
        add(item.get("objectid"), _placement(item.get("transform")))
    unit = root.get("unit", "millimeter")
    if unit not in UNITS:
        raise ValueError(f"it states the unit '{unit}'")
    return np.concatenate([np.zeros((0, 3)), *vertices]), np.concatenate([np.zeros((0, 3), int), *triangles]), unit


def _numbers(items, keys, kind) -> np.ndarray:
    return np.array([[kind(item.attrib[k]) for k in keys] for item in items], kind).reshape(-1, 3)


def _placement(text: str | None) -> Array:
    """Return the (4, 3) matrix for row vectors: a turn over a shift."""
    return np.vstack([np.eye(3), np.zeros(3)]) if text is None else np.array(text.split(), float).reshape(4, 3)
