"""Write <robot>.glb: glTF 2.0 in one file, written without a library so that the file is reproducible byte by byte.

glTF is y up. The root node rotates the robot to y up. Link nodes are children of the root node. Poses of link nodes are
relative to the robot's base frame (z up), so that link poses from a track or a stream can be assigned to the nodes
unchanged.
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
from twin.exchange.write.clip import Clip, home_poses, model_hash, quaternions_xyzw
from twin.exchange.write.order import Order
from twin.model.body import Body, Material
from twin.model.deformable import Bend
from twin.model.mechanism import Mechanism
from twin.usd.write.geometry import corner_normals

UP_XYZW = (-float(np.sqrt(0.5)), 0.0, 0.0, float(np.sqrt(0.5)))
"""Rotation of the root node as a quaternion: -90 degrees about x, from z up to y up."""

_FLOAT, _UINT16, _UINT32 = 5126, 5123, 5125
_VERTICES, _INDICES = 34962, 34963
_STILL = 1e-10
"""Maximum change of a pose (in m, and in entries of the rotation matrix) that is not animated."""

_MOST_UINT16 = 65535
"""Maximum number of vertices with 16-bit indices; glTF reserves the highest index."""


def write_glb(mechanism: Mechanism, clips: Sequence[Clip], path: Path) -> Path:
    """Write a robot at home with its clips as a .glb file, and return the path of the file."""
    path.write_bytes(glb_bytes(mechanism, clips))
    return path


def glb_bytes(mechanism: Mechanism, clips: Sequence[Clip] = (), link_poses: Mapping[str, Array] | None = None) -> bytes:
    """Return the content of a .glb file; each clip becomes an animation with its name.

    `link_poses` contains T_world_body (4, 4) of every body at rest; None: the poses at home with closed loops.
    """
    rest = home_poses(mechanism) if link_poses is None else link_poses
    out = _Document()
    root, frames = node_names(mechanism, clips)
    nodes: list[JsonObject] = [{"name": root, "rotation": list(UP_XYZW), "children": []}]
    index = {}
    for body in mechanism.bodies:
        index[body.name] = len(nodes)
        nodes[0]["children"].append(len(nodes))
        extras: JsonObject = {"link": body.name}
        if body.inertia is not None:
            extras["mass"] = float(f"{body.inertia.mass:.9g}")
        if not body.whole:
            extras["whole"] = False
        extras["joints"] = [j.name for j in mechanism.joints if j.child == body.name]
        nodes.append({"name": body.name, **_trs(rest[body.name]), "extras": extras})
        if (mesh := out.mesh(body, mechanism.materials)) is not None:
            nodes[-1]["mesh"] = mesh
    for frame in mechanism.frames:
        if frame.name not in frames:
            continue
        nodes[index[frame.body]].setdefault("children", []).append(len(nodes))
        nodes.append({"name": frames[frame.name], **_trs(frame.T_body_frame), "extras": {"frame": frame.name}})
    nodes = [{k: v for k, v in n.items() if k != "children" or v} for n in nodes]
    moving = moving_paths(clips, rest)
    animations = [out.animation(clip, index, moving) for clip in clips] if moving else []
    about = {
        "schema": "twin-glb",
        "version": 1,
        "robot": mechanism.name,
        "model_hash": model_hash(mechanism),
        "units": "m, kg, s",
        "frame": "links below the root node: z-up right-handed",
    }
    return out.packed(mechanism.name, about, nodes, animations)


def bends_glb(name: str, bends: Sequence[Bend]) -> bytes:
    """Return a .glb file of moving deformables, such as organs; each deformable is a mesh with morph targets.

    The only animation is `motion`. Vertices are relative to the World frame (z up); the root node rotates the meshes to
    y up.
    """
    out = _Document()
    nodes: list[JsonObject] = [{"name": name, "rotation": list(UP_XYZW), "children": []}]
    channels, samplers = [], []
    for bend in bends:
        shapes, factors = bend.shapes()
        nodes[0]["children"].append(len(nodes))
        nodes.append({"name": bend.name, "mesh": out.bending(bend, shapes)})
        if len(shapes):
            keys = bend.changes()
            channels.append({"sampler": len(samplers), "target": {"node": len(nodes) - 1, "path": "weights"}})
            samplers.append(out.keys(bend.times[keys], factors[keys].reshape(-1, 1), "SCALAR"))
    about = {"schema": "twin-deformables", "version": 1, "units": "m, kg, s"}
    motion = [{"name": "motion", "channels": channels, "samplers": samplers}] if channels else []
    return out.packed(name, about, nodes, motion)


def node_names(mechanism: Mechanism, clips: Sequence[Clip]) -> tuple[str, dict[str, str]]:
    """Return (name of the root node, {frame: name of its node}). Link nodes have the names of their bodies.

    All names are unique, because Unity and three.js address nodes by name only.
    """
    taken = {b.name for b in mechanism.bodies}

    def free(name: str) -> str:
        while name in taken:
            name += "_"
        taken.add(name)
        return name

    wanted = {mechanism.tool, *(c.frame for c in clips)}
    root = free(mechanism.name)
    return root, {f.name: free(f"frame_{f.name}") for f in mechanism.frames if f.name in wanted}


def moving_paths(clips: Sequence[Clip], rest: Mapping[str, Array]) -> set[tuple[str, str]]:
    """Return (link, "translation" or "rotation") for each link property that changes in at least one clip.

    Every clip animates all these properties. Otherwise, if a clip did not animate a property, players would keep the
    value from the clip before.
    """
    out = set()
    for clip in clips:
        for name, Ts in clip.links.items():
            off = np.abs(Ts - rest[name])
            if off[:, :3, 3].max() > _STILL:
                out.add((name, "translation"))
            if off[:, :3, :3].max() > _STILL:
                out.add((name, "rotation"))
    return out


def surface(vertices: Array, triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return (points (n, 3) in m, unit normals (n, 3), triangles (m, 3)) of a mesh, in single precision.

    Triangles share vertices with equal normals; vertices on sharp edges are duplicated. Triangles that become
    degenerate in single precision are removed.
    """
    corners = np.asarray(triangles).ravel()
    steps = np.round(corner_normals(vertices, triangles) * 1e4).astype(np.int64) + 10001
    # Vertex and normal are encoded as one integer: sorting rows of four numbers takes ten times as long.
    normal_key = (steps[:, 0] * 20003 + steps[:, 1]) * 20003 + steps[:, 2]
    _, normal = np.unique(normal_key, return_inverse=True)
    _, first, index = np.unique(
        corners.astype(np.int64) * len(corners) + normal, return_index=True, return_inverse=True
    )
    points = np.asarray(vertices, float)[corners[first]].astype("<f4") + np.float32(0)
    normals = (steps[first] - 10001).astype(float)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    faces = index.reshape(-1, 3)
    p = points[faces]
    same = [np.all(p[:, i] == p[:, j], axis=1) for i, j in ((0, 1), (1, 2), (2, 0))]
    return points, (normals + 0.0).astype("<f4"), faces[~np.any(same, axis=0)]


class _Document:
    """Builder of a glTF document: collects meshes, materials, buffers and accessors."""

    def __init__(self) -> None:
        self._parts: dict[str, list[bytes]] = {"vertices": [], "keys": [], "uint16": [], "uint32": []}
        self._sizes = dict.fromkeys(self._parts, 0)
        self._accessors: list[tuple[str, JsonObject]] = []
        self._known: dict[tuple[str, str, bool, bytes], int] = {}
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
        for material, parts in by_material.items():
            starts = np.cumsum([0, *(len(p) for p, _, _ in parts)])
            faces = np.concatenate([f + s for (_, _, f), s in zip(parts, starts[:-1], strict=True)])
            if not len(faces):
                continue
            points, normals = (np.concatenate([part[i] for part in parts]) for i in (0, 1))
            primitives.append(self._primitive(points, normals, faces, material, len(points) <= _MOST_UINT16))
        if not primitives:
            return None
        self._meshes.append({"name": f"{body.name}_mesh", "primitives": primitives})
        return len(self._meshes) - 1

    def _primitive(
        self, points: np.ndarray, normals: np.ndarray, faces: np.ndarray, material: Material, short: bool
    ) -> JsonObject:
        """Add triangles of one material and return their primitive. If `short` is True, indices have 16 bits."""
        part, dtype, component = ("uint16", "<u2", _UINT16) if short else ("uint32", "<u4", _UINT32)
        return {
            "attributes": {
                "POSITION": self._add("vertices", points.astype("<f4"), "VEC3", _FLOAT, bounds=True),
                "NORMAL": self._add("vertices", normals.astype("<f4"), "VEC3", _FLOAT),
            },
            "indices": self._add(part, faces.astype(dtype).reshape(-1, 1), "SCALAR", component),
            "material": self._materials.setdefault(material, len(self._materials)),
        }

    def bending(self, bend: Bend, shapes: Array) -> int:
        """Add the mesh of a deformable and return the index of the mesh.

        The mesh has a morph target for each of the s shapes in `shapes` (s, n, 3). It has the normals of the
        deformable at rest, and the vertices in their original order.
        """
        mesh, faces = bend.mesh, bend.mesh.triangles
        normals = np.zeros_like(mesh.vertices)
        a, b, c = (mesh.vertices[faces[:, k]] for k in range(3))
        for k in range(3):
            np.add.at(normals, faces[:, k], np.cross(b - a, c - a))
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        material = Material(mesh.name, mesh.color_rgba, mesh.finish)
        primitive = self._primitive(mesh.vertices, normals, faces, material, short=False)
        out: JsonObject = {"name": f"{mesh.name}_mesh", "primitives": [primitive]}
        if len(shapes):
            primitive["targets"] = [
                {"POSITION": self._add("vertices", s.astype("<f4"), "VEC3", _FLOAT, bounds=True)} for s in shapes
            ]
            out["weights"] = [0.0] * len(shapes)
        self._meshes.append(out)
        return len(self._meshes) - 1

    def keys(self, times: Array, values: Array, kind: str) -> JsonObject:
        """Return a sampler of an animation, with linear interpolation between keys.

        `times` (k,) are in s. `values` has one row for each key; for morph targets, one row for each key and target.
        `kind` is the accessor type of the values, such as "VEC3".
        """
        at = self._add("keys", times.astype("<f4").reshape(-1, 1), "SCALAR", _FLOAT, bounds=True)
        output = self._add("keys", values.astype("<f4") + np.float32(0), kind, _FLOAT)
        return {"input": at, "interpolation": "LINEAR", "output": output}

    def animation(self, clip: Clip, nodes: Mapping[str, int], moving: set[tuple[str, str]]) -> JsonObject:
        """Return a clip as a glTF animation, with a channel for each pair (link, path) in `moving`."""
        channels, samplers = [], []
        for name, Ts in clip.links.items():
            for path, kind, values in (
                ("translation", "VEC3", Ts[:, :3, 3]),
                ("rotation", "VEC4", quaternions_xyzw(Ts)),
            ):
                if (name, path) not in moving:
                    continue
                channels.append({"sampler": len(samplers), "target": {"node": nodes[name], "path": path}})
                samplers.append(self.keys(clip.times, values, kind))
        extras = {"title": clip.title, "rate": clip.rate, **clip.between.numbers()}
        return {"name": clip.name, "channels": channels, "samplers": samplers, "extras": extras}

    def _add(self, part: str, values: np.ndarray, kind: str, component: int, bounds: bool = False) -> int:
        accessor = {
            "byteOffset": self._sizes[part],
            "componentType": component,
            "count": len(values),
            "type": kind,
        }
        if bounds:
            accessor |= {"min": values.min(axis=0).tolist(), "max": values.max(axis=0).tolist()}
        data = values.tobytes()
        # Links that move together have the same keys, which are stored once.
        same = (part, kind, bounds, data)
        if part == "keys" and same in self._known:
            return self._known[same]
        self._known[same] = len(self._accessors)
        self._parts[part].append(data)
        self._sizes[part] += len(data)
        self._accessors.append((part, accessor))
        return len(self._accessors) - 1

    def lists(self) -> JsonObject:
        """Return the lists of meshes, materials, accessors, buffer views and buffers, without empty lists.

        glTF forbids empty lists.
        """
        used = [p for p in self._parts if self._sizes[p]]
        views, start = [], 0
        for part in used:
            view: JsonObject = {"buffer": 0, "byteOffset": start, "byteLength": self._sizes[part]}
            if part == "vertices":
                view |= {"byteStride": 12, "target": _VERTICES}
            elif part != "keys":
                view["target"] = _INDICES
            views.append(view)
            start += _aligned(self._sizes[part])
        accessors = [{"bufferView": used.index(part), **a} for part, a in self._accessors]
        lists = {
            "meshes": self._meshes,
            "materials": [_material(material) for material in self._materials],
            "accessors": accessors,
            "bufferViews": views,
            "buffers": [{"byteLength": start}] if start else [],
        }
        return {k: v for k, v in lists.items() if v}

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
        # each part starts at a multiple of four bytes
        parts = (b"".join(p).ljust(_aligned(self._sizes[n]), b"\0") for n, p in self._parts.items())
        return _pack(document, b"".join(parts))


def _aligned(size: int) -> int:
    return (size + 3) // 4 * 4


def _trs(T: Array) -> JsonObject:
    """Return a node's pose as translation and rotation, because glTF cannot animate nodes with a matrix."""
    q = quaternions_xyzw(T[None])[0]
    return {"translation": (T[:3, 3] + 0.0).tolist(), "rotation": (q + 0.0).tolist()}


def _material(material: Material) -> JsonObject:
    out: JsonObject = {
        "name": material.name,
        "pbrMetallicRoughness": {
            "baseColorFactor": [float(c) for c in material.color_rgba],
            "metallicFactor": float(material.finish.metallic),
            "roughnessFactor": float(material.finish.roughness),
        },
        "doubleSided": False,
    }
    if material.color_rgba[3] < 1:  # the default alphaMode is opaque
        out["alphaMode"] = "BLEND"
    return out


def _pack(document: JsonMapping, binary: bytes) -> bytes:
    text = json.dumps(document, separators=(",", ":"), ensure_ascii=False, allow_nan=False).encode()
    text = text.ljust(_aligned(len(text)), b" ")
    chunks = struct.pack("<II", len(text), 0x4E4F534A) + text
    if binary:
        chunks += struct.pack("<II", len(binary), 0x004E4942) + binary
    return struct.pack("<III", 0x46546C67, 2, 12 + len(chunks)) + chunks


def write(order: Order, folder: Path) -> list[Finding]:
    """Write one file with the shapes and all motions of a robot into `folder`."""
    write_glb(order.mechanism, order.clips, folder / f"{order.mechanism.name}.glb")
    return []


def files(order: Order) -> list[tuple[str, str]]:
    """Return (file, content) for README.txt."""
    return [(f"{order.mechanism.name}.glb", "shapes and all motions, y up" if order.clips else "shapes, y up")]
