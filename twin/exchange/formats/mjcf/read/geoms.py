"""Read the visual shapes of an MJCF."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from twin.core import spatial
from twin.core.spatial import Array
from twin.exchange.read.shapes import placed, primitive
from twin.exchange.read.source import Findings
from twin.model.body import Mesh
from twin.usd.read.names import unique

_SHAPES = {"BOX": "box", "CYLINDER": "cylinder", "SPHERE": "sphere", "CAPSULE": "capsule", "ELLIPSOID": "ellipsoid"}

_UNSTATED_RGBA = np.array([0.5, 0.5, 0.5, 1.0], np.float32)
"""Colour of a shape for which the file states none."""


def shown(
    m, bodies: Sequence[str], name: Callable[[str, int], str], findings: Findings
) -> tuple[list[list[Mesh]], set[int]]:
    """Return (meshes of each body, numbers of the bodies whose meshes do not show the whole body).

    The meshes are the visual shapes of a body or, without visual shapes, its colliders. Visual shapes are for display,
    and need not show what has mass.

    `bodies` contains the names of the bodies in the mechanism. `name` is a function (kind, number) that returns the
    name of an object.
    """
    import mujoco

    out: list[list[Mesh]] = [[] for _ in range(m.nbody)]
    labels: list[tuple[str, str]] = []
    visual: set[int] = set()
    for i in range(m.ngeom):
        body = int(m.geom_bodyid[i])
        labels.append((str(i), f"{name('BODY', body)}_shape"))
        if not _collides(m, i):
            visual.add(body)
    names = unique(labels)
    hidden: set[int] = set()
    partly = set(visual)
    for i in range(m.ngeom):
        body = int(m.geom_bodyid[i])
        if body in visual and _collides(m, i):
            hidden.add(body)
            continue
        kind = mujoco.mjtGeom(int(m.geom_type[i])).name.removeprefix("mjGEOM_")
        if kind == "MESH":
            vertices, triangles = _mesh(m, int(m.geom_dataid[i]))
        elif kind in _SHAPES:
            vertices, triangles = primitive(_SHAPES[kind], _size(kind, m.geom_size[i].tolist()))
        else:
            text = f"body '{bodies[body]}': a shape of type {kind.lower()} is not shown."
            findings.warn("shape", text, bodies[body])
            partly.add(body)
            continue
        rgba = m.geom_rgba[i]
        material = int(m.geom_matid[i])
        if material >= 0:
            # MuJoCo shows the colour of the shape itself if one is stated, else that of its material.
            if np.array_equal(rgba, _UNSTATED_RGBA):
                rgba = m.mat_rgba[material]
            if np.any(m.mat_texid[material] >= 0):
                label = name("MATERIAL", material)
                text = f"body '{bodies[body]}': the texture of material '{label}' is not imported."
                findings.warn("texture", text, bodies[body])
        r, g, b, a = map(float, rgba)
        T = spatial.pose(spatial.matrix_from_quat_wxyz(m.geom_quat[i]), m.geom_pos[i])
        out[body].append(placed(names[str(i)], vertices, triangles, T, (r, g, b, a)))
    for body in sorted(hidden):
        text = f"body '{bodies[body]}': the colliders are not imported; the visual meshes are used for collision."
        findings.note("collision", text, bodies[body])
    return out, partly


def _collides(m, geom: int) -> bool:
    return bool(m.geom_contype[geom] or m.geom_conaffinity[geom])


def _mesh(m, mesh: int) -> tuple[Array, np.ndarray]:
    vertex = m.mesh_vertadr[mesh]
    face = m.mesh_faceadr[mesh]
    vertices = m.mesh_vert[vertex : vertex + m.mesh_vertnum[mesh]].astype(float)
    return vertices, m.mesh_face[face : face + m.mesh_facenum[mesh]]


def _size(kind: str, size: list[float]) -> list[float]:
    """Return the size of a shape as `primitive` takes it, for its size in MuJoCo.

    In MuJoCo, sizes are half the edges of boxes, and half the lengths of cylinders and capsules.
    """
    if kind in ("CYLINDER", "CAPSULE"):
        return [size[0], 2 * size[1]]
    if kind == "BOX":
        return [2 * edge for edge in size]
    return size
