"""Read the visual shapes of an MJCF."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from twin.core import spatial
from twin.core.identifiers import unique
from twin.core.spatial import Array
from twin.exchange.read.imported_robot import Findings
from twin.exchange.read.shapes import placed_mesh, primitive
from twin.model.body import Mesh

_SHAPES = {"BOX": "box", "CYLINDER": "cylinder", "SPHERE": "sphere", "CAPSULE": "capsule", "ELLIPSOID": "ellipsoid"}

_UNSTATED_RGBA = np.array([0.5, 0.5, 0.5, 1.0], np.float32)
"""Colour of a shape for which the file states none."""


def read_geoms(
    model, bodies: Sequence[str], name: Callable[[str, int], str], findings: Findings
) -> tuple[list[list[Mesh]], set[int]]:
    """Return (meshes of each body, numbers of the bodies whose meshes do not show the whole body).

    The meshes are the visual shapes of a body or, without visual shapes, its colliders. Visual shapes are for display,
    and need not show what has mass.

    `bodies` contains the names of the bodies in the mechanism. `name` is a function (kind, number) that returns the
    name of an object.
    """
    import mujoco

    meshes: list[list[Mesh]] = [[] for _ in range(model.nbody)]  # a list of its own for each body
    labels: list[tuple[str, str]] = []
    bodies_with_visuals: set[int] = set()
    for geom in range(model.ngeom):
        body = int(model.geom_bodyid[geom])
        labels.append((str(geom), f"{name('BODY', body)}_shape"))
        if not _collides(model, geom):
            bodies_with_visuals.add(body)
    names = unique(labels)
    bodies_with_unused_colliders: set[int] = set()
    partly_shown = set(bodies_with_visuals)
    for geom in range(model.ngeom):
        body = int(model.geom_bodyid[geom])
        if body in bodies_with_visuals and _collides(model, geom):
            bodies_with_unused_colliders.add(body)
            continue
        kind = mujoco.mjtGeom(int(model.geom_type[geom])).name.removeprefix("mjGEOM_")
        if kind == "MESH":
            vertices, triangles = _mesh(model, int(model.geom_dataid[geom]))
        elif kind in _SHAPES:
            vertices, triangles = primitive(_SHAPES[kind], _size(kind, model.geom_size[geom].tolist()))
        else:
            text = f"body '{bodies[body]}': a shape of type {kind.lower()} is not shown."
            findings.warn("shape", text, bodies[body])
            partly_shown.add(body)
            continue
        rgba = model.geom_rgba[geom]
        material = int(model.geom_matid[geom])
        if material >= 0:
            # MuJoCo shows the colour of the shape itself if one is stated, else that of its material.
            if np.array_equal(rgba, _UNSTATED_RGBA):
                rgba = model.mat_rgba[material]
            if np.any(model.mat_texid[material] >= 0):
                label = name("MATERIAL", material)
                text = f"body '{bodies[body]}': the texture of material '{label}' is not imported."
                findings.warn("texture", text, bodies[body])
        red, green, blue, alpha = map(float, rgba)
        T_body_geom = spatial.pose(spatial.matrix_from_quat_wxyz(model.geom_quat[geom]), model.geom_pos[geom])
        mesh = placed_mesh(names[str(geom)], vertices, triangles, T_body_geom, (red, green, blue, alpha))
        meshes[body].append(mesh)
    for body in sorted(bodies_with_unused_colliders):
        text = f"body '{bodies[body]}': the colliders are not imported; the visual meshes are used for collision."
        findings.note("collision", text, bodies[body])
    return meshes, partly_shown


def _collides(model, geom: int) -> bool:
    return bool(model.geom_contype[geom] or model.geom_conaffinity[geom])


def _mesh(model, mesh: int) -> tuple[Array, np.ndarray]:
    first_vertex = model.mesh_vertadr[mesh]
    first_face = model.mesh_faceadr[mesh]
    vertices = model.mesh_vert[first_vertex : first_vertex + model.mesh_vertnum[mesh]].astype(float)
    return vertices, model.mesh_face[first_face : first_face + model.mesh_facenum[mesh]]


def _size(kind: str, size: list[float]) -> list[float]:
    """Return the size of a shape as `primitive` takes it, for its size in MuJoCo.

    In MuJoCo, sizes are half the edges of boxes, and half the lengths of cylinders and capsules.
    """
    if kind in ("CYLINDER", "CAPSULE"):
        return [size[0], 2 * size[1]]
    if kind == "BOX":
        return [2 * edge for edge in size]
    return size
