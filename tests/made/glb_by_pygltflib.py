"""What a GLB shows and how it moves, read by pygltflib for `audit_every_field`, without the readers of twin."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from pygltflib import GLTF2
from scipy.spatial.transform import Rotation, Slerp

_TYPES = {5120: "i1", 5121: "u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}


def same(a: Path, b: Path) -> bool:
    """Return whether two files show the same named nodes, surfaces and motions; False if one cannot be read."""
    try:
        return _equal(shown(a), shown(b))
    except Exception:
        return False


def _equal(a: Any, b: Any) -> bool:
    if isinstance(a, dict):
        return isinstance(b, dict) and a.keys() == b.keys() and all(_equal(a[key], b[key]) for key in a)
    if isinstance(a, np.ndarray):
        return isinstance(b, np.ndarray) and a.shape == b.shape and bool(np.allclose(a, b, rtol=0, atol=1e-7))
    if isinstance(a, list):
        return isinstance(b, list) and len(a) == len(b) and all(map(_equal, a, b))
    return a == b


def shown(path: Path) -> dict[str, Any]:
    """Return nodes at rest with surfaces and materials in the world, and poses of all nodes over each animation."""
    gltf = GLTF2().load(str(path))
    if gltf is None:
        raise ValueError("nothing is shown")
    blob = gltf.binary_blob()
    roots = gltf.scenes[gltf.scene or 0].nodes
    if blob is None or roots is None:
        raise ValueError("nothing is shown")
    rest = _world(gltf, roots, {})
    out: dict[str, Any] = {"nodes": {}, "clips": {}}
    for i, T in rest.items():
        node = gltf.nodes[i]
        entry: dict[str, Any] = {"pose": T, "extras": node.extras or {}}
        if node.mesh is not None:
            surfaces = [_surface(gltf, blob, p, T) for p in gltf.meshes[node.mesh].primitives]
            # The order of the parts of a mesh shows nowhere.
            entry["surfaces"] = sorted(surfaces, key=lambda s: (str(s["material"]), s["triangles"].tobytes()))
        out["nodes"][node.name or i] = entry
    for animation in gltf.animations:
        out["clips"][animation.name] = [_moved(gltf, blob, roots, animation), animation.extras or {}]
    return out


def _numbers(gltf: GLTF2, blob: bytes, index: int) -> np.ndarray:
    spec = gltf.accessors[index]
    view = gltf.bufferViews[spec.bufferView or 0]
    kind = np.dtype(_TYPES[spec.componentType])
    width = _WIDTHS[spec.type]
    start = (view.byteOffset or 0) + (spec.byteOffset or 0)
    stride = view.byteStride or kind.itemsize * width
    end = start + stride * (spec.count - 1) + kind.itemsize * width
    if end > (view.byteOffset or 0) + view.byteLength or end > gltf.buffers[view.buffer].byteLength:
        raise ValueError("an accessor is beyond its buffer")
    return np.ndarray((spec.count, width), kind, blob, start, (stride, kind.itemsize)).astype(float)


def _local(node: Any, moved: dict[str, np.ndarray]) -> np.ndarray:
    if node.matrix is not None and not moved:
        return np.array(node.matrix, float).reshape(4, 4).T
    T = np.eye(4)
    T[:3, :3] = Rotation.from_quat(moved.get("rotation", node.rotation or [0, 0, 0, 1])).as_matrix()
    T[:3, :3] *= np.array(moved.get("scale", node.scale or [1, 1, 1]), float)
    T[:3, 3] = moved.get("translation", node.translation or [0, 0, 0])
    return T


def _world(gltf: GLTF2, roots: list[int], moved: dict[int, dict[str, np.ndarray]]) -> dict[int, np.ndarray]:
    placed: dict[int, np.ndarray] = {}
    pending = [(i, np.eye(4)) for i in roots]
    while pending:
        i, T_world_parent = pending.pop()
        if i in placed:
            raise ValueError("a node has two parents")
        placed[i] = T_world_parent @ _local(gltf.nodes[i], moved.get(i, {}))
        pending += [(child, placed[i]) for child in gltf.nodes[i].children or []]
    return placed


def _surface(gltf: GLTF2, blob: bytes, primitive: Any, T: np.ndarray) -> dict[str, Any]:
    points = _numbers(gltf, blob, primitive.attributes.POSITION)
    corners = _numbers(gltf, blob, primitive.indices)[:, 0].astype(int)
    triangles = (points @ T[:3, :3].T + T[:3, 3])[corners]
    material: Any = {}
    if primitive.material is not None:
        spec = gltf.materials[primitive.material]
        pbr = spec.pbrMetallicRoughness
        material = [
            spec.alphaMode,
            spec.alphaCutoff,
            bool(spec.doubleSided),
            *(() if pbr is None else (pbr.baseColorFactor, pbr.metallicFactor, pbr.roughnessFactor)),
        ]
    normals = np.zeros(0)
    if primitive.attributes.NORMAL is not None:
        normals = _numbers(gltf, blob, primitive.attributes.NORMAL)[corners]
    return {"triangles": triangles, "normals": normals, "material": material, "mode": primitive.mode}


def _moved(gltf: GLTF2, blob: bytes, roots: list[int], animation: Any) -> np.ndarray:
    """Return the poses of all nodes at 60 times."""
    channels = []
    last = 0.0
    for channel in animation.channels:
        sampler = animation.samplers[channel.sampler]
        times = _numbers(gltf, blob, sampler.input)[:, 0]
        channels.append((channel.target, sampler, times, _numbers(gltf, blob, sampler.output)))
        last = max(last, float(times[-1]))
    frames = []
    for t in np.linspace(0.0, last, 60):
        moved: dict[int, dict[str, np.ndarray]] = {}
        for target, sampler, times, values in channels:
            moved.setdefault(target.node, {})[target.path] = _at(target.path, sampler, times, values, float(t))
        world = _world(gltf, roots, moved)
        frames.append([world[i] for i in sorted(world)])
    return np.array(frames)


def _at(path: str, sampler: Any, times: np.ndarray, values: np.ndarray, t: float) -> np.ndarray:
    t = min(max(t, times[0]), times[-1])
    if sampler.interpolation not in (None, "LINEAR"):
        return values[int(np.searchsorted(times, t, side="right")) - 1]
    if path == "rotation":
        return Slerp(times, Rotation.from_quat(values))(t).as_quat()
    return np.array([np.interp(t, times, column) for column in values.T])
