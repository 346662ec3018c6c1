"""Read the meshes of the links of an MJCF, after default classes and nested frames, with the rotation in any form."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np

from twin.exchange.audit import poses
from twin.exchange.audit.file_content import LinkShape
from twin.exchange.audit.mesh_files import named_mesh, placed_shape
from twin.exchange.audit.meshes import joined
from twin.exchange.audit.poses import Array
from twin.exchange.audit.report import Ledger, ReadError


def link_shapes(spec: mujoco.MjSpec, path: Path, ledger: Ledger) -> dict[str, LinkShape]:
    """Return {body: shape of its meshes in the body's frame}; mesh files are read here, not by MuJoCo.

    Raises:
        ReadError: a mesh has a scale or a refquat of 0.
    """
    folder = str(spec.meshdir)
    assets: dict[str, tuple[str, Array, Array]] = {}
    for mesh in spec.meshes:
        file = str(mesh.file)
        name = str(mesh.name) or Path(file).stem
        if folder:
            file = f"{folder}/{file}"
        scale = np.array(mesh.scale, float)
        assets[name] = (file, scale, _reference(mesh, name, scale))
    meshes: dict[str, tuple[Array, Array] | None] = {}
    shapes: dict[str, LinkShape] = {}
    for body in spec.bodies:
        parts: list[LinkShape] = []
        places = set()
        for geom in body.geoms:
            mesh_name = str(geom.meshname)
            # Another type with a mesh is a sphere, box, ... that MuJoCo fits to the mesh.
            if mesh_name not in assets or geom.type != mujoco.mjtGeom.mjGEOM_MESH:
                continue
            T_body_geom = _pose(spec, geom)
            place = (mesh_name, T_body_geom.tobytes())
            if place in places:  # the same mesh is used for display and collision
                continue
            places.add(place)
            file, scale, reference = assets[mesh_name]
            triangles = named_mesh(path, file, scale, meshes, ledger, "mjcf")
            if triangles is None:
                continue
            part = placed_shape(triangles, T_body_geom @ reference, "mjcf")
            if part is not None:
                parts.append(part)
        shape = joined(parts)
        if shape is not None and body.name:
            shapes[str(body.name)] = shape
    return shapes


def _pose(spec: mujoco.MjSpec, item: mujoco.MjsGeom | mujoco.MjsFrame) -> Array:
    """Return the pose (4, 4) of a shape or frame in its body."""
    q_wxyz = np.array(item.quat, float)
    if item.alt.type != mujoco.mjtOrientation.mjORIENTATION_QUAT:
        compiler = spec.compiler
        q_wxyz = np.array(
            spec.resolve_orientation(degree=bool(compiler.degree), sequence=compiler.eulerseq, orientation=item.alt)
        )
    T = poses.pose(poses.rotation(q_wxyz[[1, 2, 3, 0]]), np.array(item.pos, float))
    if item.frame is not None:
        T = _pose(spec, item.frame) @ T
    return T


def _reference(mesh: mujoco.MjsMesh, name: str, scale: Array) -> Array:
    """Return the affine map (4, 4) of scaled points of a mesh file to those that MuJoCo shows.

    MuJoCo subtracts `refpos` from the points of the file, turns them by the inverse of `refquat`, and scales them then.
    """
    T = poses.pose(None, -scale * np.array(mesh.refpos, float))
    q_wxyz = np.array(mesh.refquat, float)
    if not scale.all() or not q_wxyz.any():
        raise ReadError(f"mesh '{name}' has a scale or a refquat of 0")
    R = poses.rotation(q_wxyz[[1, 2, 3, 0]])
    turned = np.eye(4)
    turned[:3, :3] = np.diag(scale) @ R.T @ np.diag(1 / scale)
    return turned @ T
