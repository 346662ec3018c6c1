"""Read and check the meshes of a glTF file, and join them to the shapes and colours of its links."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from twin.core.json_types import JsonObject
from twin.exchange.audit import poses
from twin.exchange.audit.colors import Palette, Rgba, surface_area
from twin.exchange.audit.file_content import LinkShape
from twin.exchange.audit.ledger import Ledger
from twin.exchange.audit.meshes import check_mesh, joined
from twin.exchange.audit.poses import Array
from twin.exchange.formats.glb.audit.container import Gltf
from twin.exchange.formats.glb.audit.materials import base_color, factor_of
from twin.exchange.formats.glb.audit.nodes import Node, link_above

# Modes of primitives; points and lines have no triangles.
_TRIANGLES = 4
_STRIP = 5
_FAN = 6


def read_link_shapes(
    file: Gltf, nodes: list[Node], world: list[Array]
) -> tuple[dict[str, LinkShape], dict[str, dict[Rgba, float]], dict[str, dict[Rgba, float]]]:
    """Check each mesh of a node once; return the shapes of the links in their frames, and shares of colours, finishes.

    Args:
        file: the glTF file.
        nodes: its nodes, in the order of their numbers.
        world: T_world_node (1, 4, 4) of each node at rest; it may scale.
    """
    palette = Palette()
    finishes = Palette()
    checked_meshes: dict[int, tuple[Array, Array]] = {}
    parts: dict[str, list[LinkShape]] = {}
    for node in nodes:
        if "mesh" not in node.spec:
            continue
        index = node.spec["mesh"]
        mesh = file.item("meshes", index)
        name = str(mesh.get("name") or node.label)
        if index not in checked_meshes:
            _check_primitives(mesh, name, file.ledger)
            checked_meshes[index] = _checked_triangles(file, mesh, name)
        vertices, triangles = checked_meshes[index]
        owner = link_above(nodes, node)
        if owner is None or not owner.name or not len(triangles):
            continue
        T_world_link, _ = poses.split(world[owner.index][0])
        M_link_node = poses.inverse(T_world_link) @ world[node.index][0]  # may scale, so it is no pose
        points = vertices @ M_link_node[:3, :3].T + M_link_node[:3, 3]
        # `_checked_triangles` has reported the faults of the mesh: those found here go nowhere.
        shape = check_mesh(Ledger(""), name, points, triangles, None, "gltf")
        if shape is not None:
            parts.setdefault(owner.name, []).append(shape)
            _add_colors(file, mesh, owner.name, palette, finishes)
    shapes = {}
    for link, meshes in parts.items():
        shape = joined(meshes)
        if shape is not None:
            shapes[link] = shape
    return shapes, palette.shares(), finishes.shares()


def check_normals(file: Gltf) -> None:
    """Report meshes without normals in a file in which other meshes have them."""
    faceted = []
    smooth = 0
    for number, mesh in enumerate(file.items("meshes")):
        primitives = mesh.get("primitives") or []
        has_normals = False
        for primitive in primitives:
            if "NORMAL" in primitive.get("attributes", {}):
                has_normals = True
        if has_normals:
            smooth += 1
        elif primitives:
            faceted.append(str(mesh.get("name") or f"mesh {number}"))
    if smooth and faceted:
        text = f"mesh '{faceted[0]}' has no NORMAL: viewers show it faceted; {smooth} other meshes have normals."
        file.ledger.add("gltf.normal", "warning", text, faceted[0], suggestion="write the normals of the mesh")


def _check_primitives(mesh: JsonObject, name: str, ledger: Ledger) -> None:
    """Report a mesh that shows nothing, or not all of its primitives."""
    primitives = mesh.get("primitives")
    if not primitives:
        ledger.wrong("gltf.mesh", f"mesh '{name}' has no primitives: it shows nothing.", name)
        return
    previous = []
    for number, primitive in enumerate(primitives):
        if primitive in previous:
            text = f"mesh '{name}': primitive {number} is the same as another: its surface is there twice."
            ledger.wrong("gltf.mesh", text, name, suggestion="leave one of the two out")
        previous.append(primitive)
        if "POSITION" not in primitive.get("attributes", {}):
            text = f"mesh '{name}': primitive {number} has no POSITION: viewers do not show it."
            ledger.wrong("gltf.mesh", text, name, suggestion="give each primitive the points of its triangles")


def _primitives(file: Gltf, mesh: JsonObject) -> Iterator[tuple[JsonObject, Array, Array]]:
    """Yield (JSON object, points (n, 3), triangles (m, 3)) for each primitive that has positions."""
    for primitive in mesh.get("primitives", []):
        attributes = primitive.get("attributes", {})
        if "POSITION" not in attributes or "KHR_draco_mesh_compression" in primitive.get("extensions", {}):
            continue
        vertices = file.accessor(attributes["POSITION"])
        index = primitive.get("indices")
        if index is None:  # the points are the corners, in their order
            indices = np.arange(len(vertices))
        else:
            indices = file.accessor(index)[:, 0].astype(int)
        yield primitive, vertices, _triangles(indices, primitive.get("mode", _TRIANGLES))


def _add_colors(file: Gltf, mesh: JsonObject, link: str, palette: Palette, finishes: Palette) -> None:
    """Add the coloured areas of a mesh to the palette of its link, and the areas of each finish."""
    for primitive, vertices, triangles in _primitives(file, mesh):
        if not len(triangles) or triangles.max() >= len(vertices):
            continue
        if "material" in primitive:
            pbr = file.item("materials", primitive["material"]).get("pbrMetallicRoughness", {})
        elif file.items("materials"):
            pbr = {}  # viewers show the default material of glTF, white metal
        else:
            continue  # the file states no colours
        area = surface_area(vertices, triangles)
        palette.add(link, base_color(pbr, "baseColorFactor"), area)
        if isinstance(pbr, dict) and "metallicRoughnessTexture" not in pbr:
            finishes.add_finish(link, factor_of(pbr, "metallicFactor"), factor_of(pbr, "roughnessFactor"), area)


def _check_counts(file: Gltf, primitive: JsonObject, count: int, name: str) -> None:
    """Report attributes that do not have one value for each of the `count` points of a primitive."""
    for attribute, accessor in primitive["attributes"].items():
        values = file.item("accessors", accessor).get("count")
        if values != count:
            text = f"mesh '{name}': {attribute} has {values} values for {count} points."
            file.ledger.wrong("gltf.count", text, name, suggestion="give each point one value of each attribute")


def _checked_triangles(file: Gltf, mesh: JsonObject, name: str) -> tuple[Array, Array]:
    """Check a mesh, and return the points (n, 3) and triangles (m, 3) of all its primitives."""
    points = [np.zeros((0, 3))]
    faces = [np.zeros((0, 3), int)]
    normals: list[Array] = []
    has_all_normals = True
    count = 0
    for primitive, vertices, triangles in _primitives(file, mesh):
        attributes = primitive["attributes"]
        spec = file.item("accessors", attributes["POSITION"])
        if not ("min" in spec and "max" in spec):
            text = f"mesh '{name}': the accessor of the positions lacks min and max."
            file.ledger.wrong("gltf.minmax", text, name)
        _check_counts(file, primitive, len(vertices), name)
        if not len(triangles) or vertices.shape[1] != 3:
            continue
        normal = np.zeros(0)
        if "NORMAL" in attributes:
            normal = file.accessor(attributes["NORMAL"])
        last = triangles.max()
        if normal.shape == vertices.shape and last < len(normal):
            normals.append(normal[triangles.ravel()])
        else:
            has_all_normals = False
        if last >= len(vertices):
            # The corners of the mesh cannot be used; `check_mesh` reports the index.
            check_mesh(file.ledger, name, vertices, triangles, None, "gltf")
            return points[0], faces[0]
        points.append(vertices)
        faces.append(triangles + count)
        count += len(vertices)
    vertices = np.vstack(points)
    triangles = np.vstack(faces)
    corner_normals = None
    if normals and not has_all_normals:
        text = f"mesh '{name}': only some of its primitives have a NORMAL for each point: the others look faceted."
        file.ledger.add("gltf.normal", "warning", text, name)
    if normals and has_all_normals:
        corner_normals = np.vstack(normals)
    check_mesh(file.ledger, name, vertices, triangles, corner_normals, "gltf")
    return vertices, triangles


def _triangles(indices: Array, mode: object) -> Array:
    """Return the triangles (m, 3) of a primitive with corners (n,)."""
    if mode == _TRIANGLES:
        usable = len(indices) // 3 * 3
        return indices[:usable].reshape(-1, 3)
    if mode == _STRIP and len(indices) > 2:
        strip = np.stack([indices[:-2], indices[1:-1], indices[2:]], axis=1)
        # Every second triangle of a strip has the opposite order of corners.
        strip[1::2] = strip[1::2, [1, 0, 2]]
        return strip
    if mode == _FAN and len(indices) > 2:
        center = np.full(len(indices) - 2, indices[0])
        return np.stack([center, indices[1:-1], indices[2:]], axis=1)
    return np.zeros((0, 3), int)
