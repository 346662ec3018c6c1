"""Measure the colours and finishes of the meshes of an MJCF, by body and area."""

from __future__ import annotations

import mujoco
import numpy as np

from twin.exchange.audit.colors import Palette, Rgba, linear, surface_area

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
