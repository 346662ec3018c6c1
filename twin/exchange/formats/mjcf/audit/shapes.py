"""Read the shapes of the links of an MJCF: their meshes with their places, and the colours and finishes of surfaces."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np

from twin.exchange.audit import poses
from twin.exchange.audit.colors import Palette, Rgba, linear, surface_area
from twin.exchange.audit.file_content import LinkShape
from twin.exchange.audit.ledger import Ledger, ReadError
from twin.exchange.audit.mesh_files import named_mesh, placed_shape
from twin.exchange.audit.meshes import joined
from twin.exchange.audit.poses import Array


def link_shapes(spec: mujoco.MjSpec, path: Path, ledger: Ledger) -> dict[str, LinkShape]:
    """Return {body: shape of its meshes in the body's frame}; mesh files are read here, not by MuJoCo.

    Shapes have the properties of default classes, may be in nested frames, and state their rotation in any form.

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


Shares = dict[str, dict[Rgba, float]]
"""{body: {colour: fraction of the body's area}}."""

_DEFAULT_COLOR = np.array([0.5, 0.5, 0.5, 1.0], np.float32)
"""`rgba` of a geom for which a file states none."""


def surface_colors(model: mujoco.MjModel) -> tuple[Shares, Shares]:
    """Return the linear colours of the bodies, and their finishes as (metallic, roughness, 0, 1).

    A mesh that is used for both display and collision counts once. Materials without a finish have none.
    """
    colors = Palette()
    finishes = Palette()
    # MuJoCo has -1 for what a material does not state; a file in which none states it has no finishes.
    has_finishes = bool(np.any(model.mat_metallic >= 0) or np.any(model.mat_roughness >= 0))
    measured: set[tuple[int, int, bytes]] = set()
    for geom in range(model.ngeom):
        mesh = int(model.geom_dataid[geom])
        if model.geom_type[geom] != mujoco.mjtGeom.mjGEOM_MESH or mesh < 0:
            continue
        place = (int(model.geom_bodyid[geom]), mesh, model.geom_pos[geom].tobytes())
        if place in measured:
            continue
        measured.add(place)
        body = model.body(int(model.geom_bodyid[geom])).name
        area = _mesh_area(model, mesh)
        rgba = model.geom_rgba[geom]
        material = int(model.geom_matid[geom])
        if material >= 0:
            # MuJoCo shows the colour of a material only on shapes whose own colour is the one that it gives by default.
            if np.array_equal(rgba, _DEFAULT_COLOR):
                rgba = model.mat_rgba[material]
            if has_finishes:
                finishes.add_finish(
                    body, float(model.mat_metallic[material]), float(model.mat_roughness[material]), area
                )
        red, green, blue = linear(rgba[:3]).tolist()
        colors.add(body, (red, green, blue, float(rgba[3])), area)
    return colors.shares(), finishes.shares()


def _mesh_area(model: mujoco.MjModel, mesh: int) -> float:
    """Return the area of a mesh in m2."""
    vertex = int(model.mesh_vertadr[mesh])
    face = int(model.mesh_faceadr[mesh])
    vertices = model.mesh_vert[vertex : vertex + model.mesh_vertnum[mesh]].astype(float)
    return surface_area(vertices, model.mesh_face[face : face + model.mesh_facenum[mesh]])
