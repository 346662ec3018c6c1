"""Write <robot>.glb: glTF 2.0 in one file, written without a library so that the file is reproducible byte by byte.

glTF is y up. The root node rotates the robot to y up. Link nodes are children of the root node. Poses of link nodes are
relative to the robot's base frame (z up), which is the world frame of a mechanism, so that link poses from a track or a
stream can be assigned to the nodes unchanged.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from twin.core.findings import Finding
from twin.core.json_types import JsonMapping, JsonObject
from twin.core.spatial import Array
from twin.core.version import __version__
from twin.exchange.write.clip import Clip
from twin.exchange.write.home_poses import home_poses
from twin.exchange.write.model_hash import model_hash
from twin.exchange.write.order import Order
from twin.exchange.write.player_interpolation import quaternions_xyzw
from twin.model.body import Body, Material
from twin.model.deformable import Bend
from twin.model.mechanism import Mechanism
from twin.usd.write.geometry import corner_normals

UP_XYZW = (-float(np.sqrt(0.5)), 0.0, 0.0, float(np.sqrt(0.5)))
"""Rotation of the root node as a quaternion: -90 degrees about x, from z up to y up."""

# Types of components and uses of buffers, as glTF numbers them.
_FLOAT = 5126
_UINT16 = 5123
_UINT32 = 5125
_VERTICES = 34962
_INDICES = 34963

_STILL = 1e-10
"""Maximum change of a pose (in m, and in entries of the rotation matrix) that is not animated."""

_NORMAL_STEPS = 10_000
"""Steps from 0 to 1 to which components of normals are rounded: normals in one step are equal."""

_STEP_OFFSET = _NORMAL_STEPS + 1
_STEP_COUNT = 2 * _NORMAL_STEPS + 3
"""Number that makes the steps from -1 to 1 positive, and a number above the highest of these steps."""

_MOST_UINT16 = 65535
"""Maximum number of vertices with 16-bit indices; glTF reserves the highest index."""


def write_glb(mechanism: Mechanism, clips: Sequence[Clip], path: Path) -> Path:
    """Write a robot at home with its clips as a .glb file, and return the path of the file."""
    path.write_bytes(glb_bytes(mechanism, clips))
    return path


def glb_bytes(mechanism: Mechanism, clips: Sequence[Clip] = (), link_poses: Mapping[str, Array] | None = None) -> bytes:
    """Return the content of a .glb file; each clip becomes an animation with its name, unless no clip moves a link.

    `link_poses` contains T_world_body (4, 4) of every body at rest; None: the poses at home with closed loops.
    """
    rest_poses = home_poses(mechanism) if link_poses is None else link_poses
    document = _Document()
    root, frames = node_names(mechanism, clips)
    children: list[int] = []
    nodes: list[JsonObject] = [{"name": root, "rotation": list(UP_XYZW), "children": children}]
    node_of_body = {}
    for body in mechanism.bodies:
        node_of_body[body.name] = len(nodes)
        children.append(len(nodes))
        node: JsonObject = {
            "name": body.name,
            **_translation_and_rotation(rest_poses[body.name]),
            "extras": _link_extras(mechanism, body),
        }
        mesh = document.mesh(body, mechanism.materials)
        if mesh is not None:
            node["mesh"] = mesh
        nodes.append(node)
    for frame in mechanism.frames:
        if frame.name not in frames:
            continue
        link = nodes[node_of_body[frame.body]]
        link.setdefault("children", []).append(len(nodes))
        nodes.append(
            {
                "name": frames[frame.name],
                **_translation_and_rotation(frame.T_body_frame),
                "extras": {"frame": frame.name},
            }
        )
    moving = moving_paths(clips, rest_poses)
    animations = []
    if moving:
        for clip in clips:
            animations.append(document.animation(clip, node_of_body, moving))
    asset_extras = {
        "schema": "twin-glb",
        "version": 1,
        "robot": mechanism.name,
        "model_hash": model_hash(mechanism),
        "units": "m, kg, s",
        "frame": "links below the root node: z-up right-handed",
    }
    return document.packed(mechanism.name, asset_extras, nodes, animations)


def _link_extras(mechanism: Mechanism, body: Body) -> JsonObject:
    """Return the data of a link that glTF cannot express: mass, and names of the joints that move it."""
    extras: JsonObject = {"link": body.name}
    if body.inertia is not None:
        extras["mass"] = float(f"{body.inertia.mass:.9g}")
    if not body.whole:
        extras["whole"] = False
    extras["joints"] = [joint.name for joint in mechanism.joints if joint.child == body.name]
    return extras


def bends_glb(name: str, bends: Sequence[Bend]) -> bytes:
    """Return a .glb file of moving deformables, such as organs; each deformable is a mesh with morph targets.

    The only animation is `motion`. Vertices are relative to the World frame (z up); the root node rotates the meshes to
    y up.
    """
    document = _Document()
    children: list[int] = []
    nodes: list[JsonObject] = [{"name": name, "rotation": list(UP_XYZW), "children": children}]
    channels: list[JsonObject] = []
    samplers: list[JsonObject] = []
    for bend in bends:
        shapes, factors = bend.shapes()
        node = len(nodes)
        children.append(node)
        nodes.append({"name": bend.name, "mesh": document.bending(bend, shapes)})
        if len(shapes):
            keys = bend.changes()
            channels.append({"sampler": len(samplers), "target": {"node": node, "path": "weights"}})
            samplers.append(document.keys(bend.times[keys], factors[keys].reshape(-1, 1), "SCALAR"))
    asset_extras = {"schema": "twin-deformables", "version": 1, "units": "m, kg, s"}
    animations: list[JsonObject] = []
    if channels:
        animations.append({"name": "motion", "channels": channels, "samplers": samplers})
    return document.packed(name, asset_extras, nodes, animations)


def node_names(mechanism: Mechanism, clips: Sequence[Clip]) -> tuple[str, dict[str, str]]:
    """Return (name of the root node, {frame: name of its node}). Link nodes have the names of their bodies.

    All names are unique, because Unity and three.js address nodes by name only.
    """
    used_names = {body.name for body in mechanism.bodies}

    def free(name: str) -> str:
        while name in used_names:
            name += "_"
        used_names.add(name)
        return name

    root = free(mechanism.name)
    frames_of_clips = {mechanism.tool}
    frames_of_clips.update(clip.frame for clip in clips)
    names = {}
    for frame in mechanism.frames:
        if frame.name in frames_of_clips:
            names[frame.name] = free(f"frame_{frame.name}")
    return root, names


def moving_paths(clips: Sequence[Clip], rest_poses: Mapping[str, Array]) -> set[tuple[str, str]]:
    """Return (link, "translation" or "rotation") for each link property that changes in at least one clip.

    Every clip animates all these properties. Otherwise, if a clip did not animate a property, players would keep the
    value from the clip before.
    """
    moving = set()
    for clip in clips:
        for name, Ts in clip.links.items():
            change = np.abs(Ts - rest_poses[name])
            if change[:, :3, 3].max() > _STILL:
                moving.add((name, "translation"))
            if change[:, :3, :3].max() > _STILL:
                moving.add((name, "rotation"))
    return moving


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


class _Document:
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
            primitives.append(self._primitive(points, normals, faces, material, len(points) <= _MOST_UINT16))
        if not primitives:
            return None
        self._meshes.append({"name": f"{body.name}_mesh", "primitives": primitives})
        return len(self._meshes) - 1

    def _primitive(
        self, points: np.ndarray, normals: np.ndarray, faces: np.ndarray, material: Material, short: bool
    ) -> JsonObject:
        """Add triangles of one material and return their primitive. If `short` is True, indices have 16 bits."""
        position = self._add("vertices", points.astype("<f4"), "VEC3", _FLOAT, bounds=True)
        normal = self._add("vertices", normals.astype("<f4"), "VEC3", _FLOAT)
        corners = faces.reshape(-1, 1)
        if short:
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
        primitive = self._primitive(mesh.vertices, normals, faces, material, short=False)
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
                view |= {"byteStride": 12, "target": _VERTICES}
            elif part != "keys":
                view["target"] = _INDICES
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

    def packed(self, name: str, about: JsonMapping, nodes: list[JsonObject], animations: list[JsonObject]) -> bytes:
        """Return the content of a .glb file with one scene, whose root is the first node.

        `about` is written as the `extras` of the glTF asset.
        """
        document: JsonObject = {
            "asset": {"version": "2.0", "generator": f"twin {__version__}", "extras": about},
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


def _translation_and_rotation(T: Array) -> JsonObject:
    """Return a node's pose as translation and rotation, because glTF cannot animate nodes with a matrix."""
    xyzw = quaternions_xyzw(T[None])[0]
    return {"translation": (T[:3, 3] + 0.0).tolist(), "rotation": (xyzw + 0.0).tolist()}


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


def write(order: Order, folder: Path) -> list[Finding]:
    """Write one file with the shapes and all motions of a robot into `folder`."""
    write_glb(order.mechanism, order.clips, folder / f"{order.mechanism.name}.glb")
    return []


def files(order: Order) -> list[tuple[str, str]]:
    """Return (file, content) for README.txt."""
    content = "shapes and all motions, y up" if order.clips else "shapes, y up"
    return [(f"{order.mechanism.name}.glb", content)]
