"""Read the visual shapes of an MJCF."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from twin.core import spatial
from twin.exchange.read.shapes import placed, primitive
from twin.exchange.read.source import Findings
from twin.model.body import Mesh
from twin.usd.read.names import unique

_SHAPES = {"BOX": "box", "CYLINDER": "cylinder", "SPHERE": "sphere", "CAPSULE": "capsule", "ELLIPSOID": "ellipsoid"}


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

    geom = mujoco.mjtGeom
    out: list[list[Mesh]] = [[] for _ in range(m.nbody)]
    free = {i: bool(m.geom_contype[i] == m.geom_conaffinity[i] == 0) for i in range(m.ngeom)}
    visual = {int(m.geom_bodyid[i]) for i in range(m.ngeom) if free[i]}
    names = unique((str(i), f"{name('BODY', int(m.geom_bodyid[i]))}_shape") for i in range(m.ngeom))
    hidden: set[int] = set()
    partly = set(visual)
    for i in range(m.ngeom):
        body, kind, size = int(m.geom_bodyid[i]), geom(int(m.geom_type[i])).name[7:], m.geom_size[i]
        if body in visual and not free[i]:
            hidden.add(body)
            continue
        if kind == "MESH":
            k = m.geom_dataid[i]
            v, f = m.mesh_vertadr[k], m.mesh_faceadr[k]
            solid = (m.mesh_vert[v : v + m.mesh_vertnum[k]].astype(float), m.mesh_face[f : f + m.mesh_facenum[k]])
        elif kind in _SHAPES:
            # In MuJoCo, sizes are half the edges of boxes, and half the lengths of cylinders and capsules.
            wanted = (size[0], 2 * size[1]) if kind in ("CYLINDER", "CAPSULE") else 2 * size if kind == "BOX" else size
            solid = primitive(_SHAPES[kind], [float(v) for v in wanted])
        else:
            text = f"body '{bodies[body]}': a shape of type {kind.lower()} is not shown."
            findings.warn("shape", text, bodies[body])
            partly.add(body)
            continue
        material = int(m.geom_matid[i])
        r, g, b, a = map(float, m.geom_rgba[i] if material < 0 else m.mat_rgba[material])
        if material >= 0 and np.any(m.mat_texid[material] >= 0):
            text = f"body '{bodies[body]}': the texture of material '{name('MATERIAL', material)}' is not imported."
            findings.warn("texture", text, bodies[body])
        T = spatial.pose(spatial.matrix_from_quat_wxyz(m.geom_quat[i]), m.geom_pos[i])
        out[body].append(placed(names[str(i)], *solid, T, (r, g, b, a)))
    for body in sorted(hidden):
        text = f"body '{bodies[body]}': the colliders are not imported; the visual meshes are used for collision."
        findings.note("collision", text, bodies[body])
    return out, partly
