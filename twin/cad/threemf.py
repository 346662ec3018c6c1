"""Read 3MF, core specification: meshes, components, build items and their placements, and the stated unit."""

from __future__ import annotations

import zipfile
from collections.abc import Iterable
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from twin.core.foreign.budget import BUDGETS, over
from twin.core.foreign.text import parse_xml
from twin.core.spatial import Array

_MODEL_FILE = "3D/3dmodel.model"
"""Path of the file with the meshes in the archive."""

UNITS = {"micron": 1e-6, "millimeter": 1e-3, "centimeter": 1e-2, "inch": 0.0254, "foot": 0.3048, "meter": 1.0}
"""{unit that a 3MF file may state: size of the unit in m}; the default unit is the millimeter."""


def read_3mf(path: Path) -> tuple[Array, np.ndarray, str]:
    """Return vertices (n, 3) in the file's unit, triangles (m, 3), and the name of the file's unit.

    Raises:
        ValueError, KeyError, zipfile.BadZipFile, ElementTree.ParseError: the file is not a 3MF file.
        BudgetError: the unpacked or expanded file exceeds the limits of its format.
    """
    with zipfile.ZipFile(path) as archive:
        root = parse_xml(path, archive.read(_MODEL_FILE), "3MF")
    objects = {}
    for item in root.iterfind("{*}resources/{*}object"):
        objects[item.get("id")] = item
    _check_count(path, root, objects)
    vertices: list[Array] = [np.zeros((0, 3))]
    triangles: list[np.ndarray] = [np.zeros((0, 3), int)]
    count = 0  # of the vertices so far

    def add(number: str | None, T: Array) -> None:
        """Add the mesh of an object and of the objects in it, placed by T (4, 3) for row vectors."""
        nonlocal count
        mesh = objects[number].find("{*}mesh")
        if mesh is not None:
            points = _numbers(mesh.iterfind("{*}vertices/{*}vertex"), "xyz", float)
            corners = _numbers(mesh.iterfind("{*}triangles/{*}triangle"), ("v1", "v2", "v3"), int)
            if len(corners) and not 0 <= corners.min() <= corners.max() < len(points):
                raise ValueError(f"a triangle of object {number} has a vertex that does not exist")
            if np.linalg.det(T[:3]) < 0:
                corners = corners[:, ::-1]  # a mirror turns the faces inside out
            triangles.append(corners + count)
            vertices.append(points @ T[:3] + T[3])
            count += len(points)
        for part in objects[number].iterfind("{*}components/{*}component"):
            # x @ placement[:3] + placement[3], then placed by T
            placement = _placement(part.get("transform"))
            linear = placement[:3] @ T[:3]
            offset = placement[3] @ T[:3] + T[3]
            add(part.get("objectid"), np.vstack([linear, offset]))

    for item in root.iterfind("{*}build/{*}item"):
        add(item.get("objectid"), _placement(item.get("transform")))
    unit = root.get("unit", "millimeter")
    if unit not in UNITS:
        raise ValueError(f"the unit '{unit}' of the file is not known; use one of {', '.join(UNITS)}")
    return np.concatenate(vertices), np.concatenate(triangles), unit


def _check_count(path: Path, root: ElementTree.Element, objects: dict[str | None, ElementTree.Element]) -> None:
    """Check the number of vertices and triangles before objects, which may be nested and repeated, are expanded.

    Raises:
        ValueError: an object is missing, or contains itself.
        BudgetError: the expanded file exceeds the limits of its format.
    """
    limits = BUDGETS["3MF"]
    totals: dict[str | None, int] = {}

    def total(number: str | None, depth: int = 0) -> int:
        # Before any mesh is read: a few lines of nested components can ask for billions of triangles.
        if depth > limits.depth:
            over(path, "3MF", "depth of its objects so far", depth, limits.depth)
        if number not in objects or number in expanding:
            raise ValueError(f"object {number} is missing or contains itself")
        if number not in totals:
            expanding.add(number)
            count = 1
            for array in objects[number].iterfind("{*}mesh/*"):
                count += len(array)
            for part in objects[number].iterfind("{*}components/{*}component"):
                count += total(part.get("objectid"), depth + 1)
            totals[number] = count
            expanding.remove(number)
        return totals[number]

    expanding: set[str | None] = set()  # the object and those that contain it
    count = 0
    for item in root.iterfind("{*}build/{*}item"):
        count += total(item.get("objectid"))
    if count > limits.numbers:
        over(path, "3MF", "vertices and triangles in its objects", count, limits.numbers)


def _numbers(items: Iterable[ElementTree.Element], keys: Iterable[str], kind: type[float] | type[int]) -> np.ndarray:
    rows = []
    for item in items:
        rows.append([kind(item.attrib[key]) for key in keys])  # a missing attribute is a KeyError of the reader
    return np.array(rows, kind).reshape(-1, 3)


def _placement(text: str | None) -> Array:
    """Return the matrix (4, 3) for row vectors: the rotation in rows 0 to 2, the translation in row 3."""
    if text is None:
        return np.eye(4, 3)
    return np.array(text.split(), float).reshape(4, 3)
