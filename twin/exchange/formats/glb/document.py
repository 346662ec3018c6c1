"""Build a glTF document: meshes, materials, animations and their buffers, packed into the bytes of a .glb file."""

from __future__ import annotations

import json
import struct
from collections.abc import Mapping

import numpy as np

from twin.core.json_types import JsonMapping, JsonObject
from twin.core.spatial import Array
from twin.core.version import __version__
from twin.exchange.write.clip import Clip
from twin.exchange.write.player_interpolation import quaternions_xyzw
from twin.model.body import Body, Material
from twin.model.deformable import Bend
from twin.usd.write.geometry import corner_normals

# Types of components and uses of buffers, as glTF numbers them.
_FLOAT = 5126
_UINT16 = 5123
_UINT32 = 5125
_VERTEX_BUFFER = 34962
_INDEX_BUFFER = 34963

_NORMAL_STEPS = 10_000
"""Steps from 0 to 1 to which components of normals are rounded: normals in one step are equal."""

_STEP_OFFSET = _NORMAL_STEPS + 1
"""Number that makes the steps from -1 to 1 positive."""

_STEP_COUNT = 2 * _NORMAL_STEPS + 3
"""A number above the highest of these positive steps."""

_MAX_UINT16 = 65535
"""Maximum number of vertices with 16-bit indices; glTF reserves the highest index."""


def surface(vertices: Array, triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return (points (n, 3) in m, unit normals (n, 3), triangles (m, 3)) of a mesh, in single precision.

    Triangles share a vertex if their normals at it are equal, to 1e-4; so vertices on sharp edges are duplicated.
    Triangles of which two corners coincide in single precision are removed; their vertices are not.
    """
    corners = np.asarray(triangles).ravel()
    # Normals that differ by less than a step of 1e-4 are equal; the steps are 1 to 20001, and never negative.
    steps = np.round(corner_normals(vertices, triangles) * _NORMAL_STEPS).astype(np.int64) + _STEP_OFFSET
    # Vertex and normal are encoded as one integer: sorting rows of four numbers takes ten times as long.
    normal_key = (steps[:, 0] * _STEP_COUNT + steps[:, 1]) * _STEP_COUNT + steps[:, 2]
    _, normal_index = np.unique(normal_key, return_inverse=True)
    corner_key = corners.astype(np.int64) * len(corners) + normal_index
    _, first_corner_of_vertex, vertex_of_corner = np.unique(corner_key, return_index=True, return_inverse=True)
    # Adding 0 removes negative zeros.
    points = np.asarray(vertices, float)[corners[first_corner_of_vertex]].astype("<f4") + np.float32(0)
    normals = (steps[first_corner_of_vertex] - _STEP_OFFSET).astype(float)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    faces = vertex_of_corner.reshape(-1, 3)
    first_corner = points[faces[:, 0]]
    second_corner = points[faces[:, 1]]
    third_corner = points[faces[:, 2]]
    degenerate = (
        np.all(first_corner == second_corner, axis=1)
        | np.all(second_corner == third_corner, axis=1)
        | np.all(third_corner == first_corner, axis=1)
    )
    return points, (normals + 0.0).astype("<f4"), faces[~degenerate]


class GltfDocument:
    """Builder of a glTF document: collects meshes, materials, buffers and accessors.

    The binary chunk has four parts, each a buffer view: vertices, keys of animations, and indices of 16 and 32 bits.
    """

    def __init__(self) -> None:
        self._parts: dict[str, list[bytes]] = {"vertices": [], "keys": [], "uint16": [], "uint32": []}
        self._sizes = dict.fromkeys(self._parts, 0)
        self._accessors: list[tuple[str, JsonObject]] = []
        self._accessor_of_keys: dict[tuple[str, bool, bytes], int] = {}
        self._meshes: list[JsonObject] = []
        self._materials: dict[Material, int] = {}

    def mesh(self, body: Body, materials: Mapping[str, Material]) -> int | None:
        """Add one mesh for a body, with a primitive for each material, and return the index of the mesh.

        Return None if the body has no triangles.
        """
        by_material: dict[Material, list[tuple[np.ndarray, np.ndarray, np.ndarray]]] = {}
        for mesh in body.meshes:
            by_material.setdefault(materials[mesh.name], []).append(surface(mesh.vertices, mesh.triangles))
        primitives = []
        for material, surfaces in by_material.items():
            offset = 0
            shifted = []
            for part_points, _, part_faces in surfaces:
                shifted.append(part_faces + offset)
                offset += len(part_points)
            faces = np.concatenate(shifted)
            if not len(faces):
                continue
            all_points, all_normals, _ = zip(*surfaces, strict=True)
            points = np.concatenate(all_points)
            normals = np.concatenate(all_normals)
            primitives.append(self._primitive(points, normals, faces, material, len(points) <= _MAX_UINT16))
        if not primitives:
            return None
        self._meshes.append({"name": f"{body.name}_mesh", "primitives": primitives})
        return len(self._meshes) - 1

    def _primitive(
        self, points: np.ndarray, normals: np.ndarray, faces: np.ndarray, material: Material, has_short_indices: bool
    ) -> JsonObject:
        """Add triangles of one material and return their primitive. If `has_short_indices`, indices have 16 bits."""
        position = self._add("vertices", points.astype("<f4"), "VEC3", _FLOAT, bounds=True)
        normal = self._add("vertices", normals.astype("<f4"), "VEC3", _FLOAT)
        corners = faces.reshape(-1, 1)
        if has_short_indices:
            indices = self._add("uint16", corners.astype("<u2"), "SCALAR", _UINT16)
        else:
            indices = self._add("uint32", corners.astype("<u4"), "SCALAR", _UINT32)
        return {
            "attributes": {"POSITION": position, "NORMAL": normal},
            "indices": indices,
            "material": self._materials.setdefault(material, len(self._materials)),
        }

    def bending(self, bend: Bend, shapes: Array) -> int:
        """Add the mesh of a deformable and return the index of the mesh.

        The mesh has a morph target for each of the s shapes in `shapes` (s, n, 3), displacements of the vertices in m.
        It has the normals of the deformable at rest, and the vertices in their original order.
        """
        mesh = bend.mesh
        faces = mesh.triangles
        first_corner = mesh.vertices[faces[:, 0]]
        second_corner = mesh.vertices[faces[:, 1]]
        third_corner = mesh.vertices[faces[:, 2]]
        # The sum of the normals of the triangles at a vertex, weighted by their areas.
        normals = np.zeros_like(mesh.vertices)
        for corner in range(3):  # `add.at` also adds twice where two triangles share the vertex, unlike `+=`
            np.add.at(normals, faces[:, corner], np.cross(second_corner - first_corner, third_corner - first_corner))
        sizes = np.linalg.norm(normals, axis=1, keepdims=True)
        # A vertex without a triangle of some area has no normal; the arbitrary direction z avoids NaN.
        normals = np.where(sizes > 0, normals / np.where(sizes > 0, sizes, 1.0), [0.0, 0.0, 1.0])
        material = Material(mesh.name, mesh.color_rgba, mesh.finish)
        primitive = self._primitive(mesh.vertices, normals, faces, material, has_short_indices=False)
        entry: JsonObject = {"name": f"{mesh.name}_mesh", "primitives": [primitive]}
        if len(shapes):
            targets = []
            for shape in shapes:
                position = self._add("vertices", shape.astype("<f4"), "VEC3", _FLOAT, bounds=True)
                targets.append({"POSITION": position})
            primitive["targets"] = targets
            entry["weights"] = [0.0] * len(shapes)
        self._meshes.append(entry)
        return len(self._meshes) - 1

    def keys(self, times: Array, values: Array, kind: str) -> JsonObject:
        """Return a sampler of an animation, with linear interpolation between keys.

        `times` (k,) are in s. `values` has one row for each key; for morph targets, one row for each key and target.
        `kind` is the accessor type of the values, such as "VEC3".
        """
        key_times = self._add("keys", times.astype("<f4").reshape(-1, 1), "SCALAR", _FLOAT, bounds=True)
        output = self._add("keys", values.astype("<f4") + np.float32(0), kind, _FLOAT)
        return {"input": key_times, "interpolation": "LINEAR", "output": output}

    def animation(self, clip: Clip, nodes: Mapping[str, int], moving: set[tuple[str, str]]) -> JsonObject:
        """Return a clip as a glTF animation, with a channel for each pair (link, path) in `moving`."""
        channels: list[JsonObject] = []
        samplers: list[JsonObject] = []

        def animate(link: str, path: str, values: Array, kind: str) -> None:
            if (link, path) in moving:
                channels.append({"sampler": len(samplers), "target": {"node": nodes[link], "path": path}})
                samplers.append(self.keys(clip.times, values, kind))

        for name, Ts in clip.links.items():
            animate(name, "translation", Ts[:, :3, 3], "VEC3")
            animate(name, "rotation", quaternions_xyzw(Ts), "VEC4")
        extras = {"title": clip.title, "rate": clip.rate, **clip.between.numbers()}
        return {"name": clip.name, "channels": channels, "samplers": samplers, "extras": extras}

    def _add(self, part: str, values: np.ndarray, kind: str, component: int, bounds: bool = False) -> int:
        accessor = {
            "byteOffset": self._sizes[part],
            "componentType": component,
            "count": len(values),
            "type": kind,
        }
        if bounds:  # glTF requires them for positions and key times: viewers frame and time by them
            accessor |= {"min": values.min(axis=0).tolist(), "max": values.max(axis=0).tolist()}
        data = values.tobytes()
        # Links that move together have the same keys, which are stored once.
        if part == "keys":
            stored = self._accessor_of_keys.setdefault((kind, bounds, data), len(self._accessors))
            if stored < len(self._accessors):
                return stored
        self._parts[part].append(data)
        self._sizes[part] += len(data)
        self._accessors.append((part, accessor))
        return len(self._accessors) - 1

    def lists(self) -> JsonObject:
        """Return the lists of meshes, materials, accessors, buffer views and buffers, without empty lists.

        glTF forbids empty lists.
        """
        used_parts = [part for part in self._parts if self._sizes[part]]
        views = []
        start = 0
        for part in used_parts:
            view: JsonObject = {"buffer": 0, "byteOffset": start, "byteLength": self._sizes[part]}
            if part == "vertices":
                view |= {"byteStride": 12, "target": _VERTEX_BUFFER}
            elif part != "keys":
                view["target"] = _INDEX_BUFFER
            views.append(view)
            start += _aligned(self._sizes[part])
        lists: JsonObject = {
            "meshes": self._meshes,
            "materials": [_material(material) for material in self._materials],
            "accessors": [{"bufferView": used_parts.index(part), **accessor} for part, accessor in self._accessors],
            "bufferViews": views,
            "buffers": [{"byteLength": start}] if start else [],
        }
        for name in list(lists):
            if not lists[name]:
                del lists[name]
        return lists

    def packed(
        self, name: str, asset_extras: JsonMapping, nodes: list[JsonObject], animations: list[JsonObject]
    ) -> bytes:
        """Return the content of a .glb file with one scene, whose root is the first node.

        `asset_extras` is written as the `extras` of the glTF asset.
        """
        document: JsonObject = {
            "asset": {"version": "2.0", "generator": f"twin {__version__}", "extras": asset_extras},
            "scene": 0,
            "scenes": [{"name": name, "nodes": [0]}],
            "nodes": nodes,
            **self.lists(),
        }
        if animations:
            document["animations"] = animations
        binary = b""
        for part, chunks in self._parts.items():
            content = b"".join(chunks)
            binary += content.ljust(_aligned(self._sizes[part]), b"\0")
        return _container(document, binary)


def _aligned(size: int) -> int:
    """Return the smallest multiple of four bytes that is not below a size: every part of a GLB starts at one."""
    return (size + 3) // 4 * 4


def _material(material: Material) -> JsonObject:
    entry: JsonObject = {
        "name": material.name,
        "pbrMetallicRoughness": {
            "baseColorFactor": [float(c) for c in material.color_rgba],
            "metallicFactor": float(material.finish.metallic),
            "roughnessFactor": float(material.finish.roughness),
        },
        "doubleSided": False,
    }
    if material.color_rgba[3] < 1:  # the default alphaMode is opaque
        entry["alphaMode"] = "BLEND"
    return entry


def _container(document: JsonMapping, binary: bytes) -> bytes:
    content = json.dumps(document, separators=(",", ":"), ensure_ascii=False, allow_nan=False).encode()
    content = content.ljust(_aligned(len(content)), b" ")  # glTF fills up JSON by spaces, binary data by zeros
    chunks = struct.pack("<I4s", len(content), b"JSON") + content
    if binary:
        chunks += struct.pack("<I4s", len(binary), b"BIN\0") + binary
    header = struct.Struct("<4sII")  # mark, version, size of the whole file
    return header.pack(b"glTF", 2, header.size + len(chunks)) + chunks
