"""Read Collada (.dae): triangles of all instances, in m, and the up axis that the file states.

Only geometry and scene reach pycollada: materials, images, lights and animations are removed before, and no other file
is opened.
"""

from __future__ import annotations

from io import BytesIO
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np

from twin.core.foreign.budget import BUDGETS, over
from twin.core.foreign.text import parse_xml
from twin.core.spatial import Array

TO_Z_UP = {
    "X_UP": np.array([[0.0, -1, 0], [0, 0, -1], [1, 0, 0]]),
    "Y_UP": np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]),
    "Z_UP": np.eye(3),
}
"""{up_axis of a file: rotation (3, 3) to z up}, from the axes right, up and in of the Collada specification."""

_WITHOUT_SHAPE = {
    *("library_animations", "library_animation_clips", "library_cameras", "library_effects", "library_images"),
    *("library_lights", "library_materials", "library_physics_materials", "library_physics_models"),
    *("library_physics_scenes", "bind_material", "instance_camera", "instance_light", "extra"),
}
"""Elements without effect on the shape."""

_MAX_NODES = 10_000
"""Maximum number of nodes; pycollada searches them again for each level of nodes that refer to later ones."""

_UNSUPPORTED_SHAPES = ("convex_mesh", "spline", "instance_controller")
"""Elements with a shape that pycollada does not read."""


def read_collada(path: Path) -> tuple[Array, np.ndarray, str]:
    """Return vertices (n, 3) in m along the axes of the file, triangles (m, 3), and the up axis, such as "Y_UP".

    A file without an up axis has "Y_UP", the default of the Collada specification. `TO_Z_UP` turns vertices upright.

    Raises:
        BudgetError: the file, or the file with all its instances, exceeds the limits of its format.
        DoctypeError: the file declares a document type.
        ValueError, KeyError, ElementTree.ParseError, collada.DaeError: the file is not a Collada file.
    """
    import collada

    root = parse_xml(path, kind="DAE")
    if _tag(root) != "COLLADA":
        raise ValueError(f"the root element is <{_tag(root)}>, expected <COLLADA>")
    _remove_elements(root)
    for element in root.iter():
        if _tag(element) in _UNSUPPORTED_SHAPES:
            raise ValueError(f"<{_tag(element)}> is not supported; save the mesh with triangles")
    _check_count(path, root)
    unit = _unit(root)
    up = (root.findtext("{*}asset/{*}up_axis") or "Y_UP").strip()
    if up not in TO_Z_UP:
        raise ValueError(f"up_axis '{up[:40]}' is not one of {', '.join(TO_Z_UP)}")
    document = collada.Collada(BytesIO(ElementTree.tostring(root)))
    if document.scene is None:
        raise ValueError("the file has no scene")
    vertices = [np.zeros((0, 3))]
    triangles = [np.zeros((0, 3), int)]
    count = 0
    for placed in document.scene.objects("geometry"):
        T = np.asarray(placed.matrix, float)
        for part in placed.original.primitives:
            corners = _triangles(part)
            if corners is None:
                continue
            points = np.asarray(part.vertex, float)
            if len(corners) and not 0 <= corners.min() <= corners.max() < len(points):
                raise ValueError(f"a triangle of geometry '{placed.original.id}' has a vertex that does not exist")
            if np.linalg.det(T[:3, :3]) < 0:  # a mirror turns the faces inside out
                corners = corners[:, ::-1]
            vertices.append(points @ T[:3, :3].T + T[:3, 3])
            triangles.append(corners + count)
            count += len(points)
    return unit * np.concatenate(vertices), np.concatenate(triangles), up


def _triangles(part) -> np.ndarray | None:
    """Return the vertex indices (m, 3) of a part's triangles; None if the part has lines, or nothing."""
    from collada.polylist import Polylist
    from collada.triangleset import TriangleSet

    if isinstance(part, Polylist):
        part = part.triangleset()
    if not isinstance(part, TriangleSet) or part.vertex is None or part.vertex_index is None:
        return None
    return np.asarray(part.vertex_index, int).reshape(-1, 3)


def _tag(element: Element) -> str:
    return str(element.tag).rpartition("}")[2]


def _remove_elements(element: Element) -> None:
    for child in list(element):
        if _tag(child) in _WITHOUT_SHAPE:
            element.remove(child)
        else:
            _remove_elements(child)


def _unit(root: Element) -> float:
    """Return the size in m of the file's unit; the default is the metre."""
    element = root.find("{*}asset/{*}unit")
    text = "1"
    if element is not None:
        text = element.get("meter", "1")
    unit = float(text)
    if not 0 < unit < np.inf:
        raise ValueError(f"the unit has meter = '{text[:40]}', expected a positive number")
    return unit


def _check_count(path: Path, root: Element) -> None:
    """Check the number of values in all instances before the scene, whose nodes may be repeated, is expanded.

    Raises:
        ValueError: a node contains itself, or refers to another file.
        BudgetError: the expanded file exceeds the limits of its format.
    """
    limits = BUDGETS["DAE"]
    weights: dict[str | None, int] = {}
    for geometry in root.iterfind("{*}library_geometries/{*}geometry"):
        # Each value takes at least two characters, with the space behind it.
        letters = 0
        for element in geometry.iter():
            letters += len(element.text or "")
        name = geometry.get("id")
        # Of geometries with one id, the largest counts: which of them pycollada takes is not known before it has read
        # them.
        weights[name] = max(letters // 2 + 1, weights.get(name, 0))
    scenes = [element for element in root.iter() if _tag(element) in ("node", "visual_scene")]
    if len(scenes) > _MAX_NODES:
        over(path, "DAE", "nodes", len(scenes), _MAX_NODES)
    nodes: dict[str | None, list[Element]] = {}  # of nodes with one id, the largest counts
    for element in scenes:
        nodes.setdefault(element.get("id"), []).append(element)
    totals: dict[Element, tuple[int, int]] = {}
    above: set[Element] = set()

    def total(node: Element, depth: int) -> tuple[int, int]:
        """Return the number of values in a node, and the number of levels below it."""
        if depth > limits.depth:
            over(path, "DAE", "depth of the nodes so far", depth, limits.depth)
        if node in above:
            raise ValueError(f"node '{node.get('id')}' contains itself")
        if node in totals:
            return totals[node]
        above.add(node)
        count = 1
        height = 0
        for child in node:
            kind = _tag(child)
            url = child.get("url", "")
            below: list[Element] = []
            if kind == "node":
                below = [child]
            elif kind in ("instance_node", "instance_geometry"):
                if not url.startswith("#"):
                    raise ValueError(f"<{kind}> refers to '{url[:80]}'; other files are not read")
                if kind == "instance_geometry":
                    count += weights.get(url[1:], 0)
                else:
                    below = nodes.get(url[1:], [])
            most = 0
            for inner in below:
                inner_count, levels = total(inner, depth + 1)
                most = max(most, inner_count)
                height = max(height, levels + 1)
            count += most
        if height > limits.depth:
            over(path, "DAE", "depth of the nodes so far", height, limits.depth)
        above.remove(node)
        totals[node] = count, height
        return totals[node]

    for element in scenes:
        count, _ = total(element, 0)
        if count > limits.numbers:
            over(path, "DAE", "numbers in all instances of a node", count, limits.numbers)
