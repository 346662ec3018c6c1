"""Write the layer of the deformables: one mesh for each deformable, with time samples of its points."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from pxr import Usd, UsdGeom

from twin.model.deformable import Bend
from twin.usd import gf
from twin.usd.write.layers import TIME_CODES_PER_SECOND, describe, new_layer, save


def write_deformables(name: str, bends: Sequence[Bend], path: Path) -> Path:
    """Write the motions of deformables below the prim `name` and return the path of the layer.

    While a deformable does not move, only the first and the last sample of this interval are written.
    """
    layer = new_layer(path)
    duration = max(float(bend.times[-1]) for bend in bends)
    describe(layer, name, duration * TIME_CODES_PER_SECOND)
    stage = Usd.Stage.Open(layer)
    UsdGeom.Xform.Define(stage, f"/{name}")
    for bend in bends:
        mesh = UsdGeom.Mesh.Define(stage, f"/{name}/{bend.name}")
        faces = bend.mesh.triangles
        mesh.CreateFaceVertexCountsAttr(gf.int_array([3] * len(faces)))
        mesh.CreateFaceVertexIndicesAttr(gf.int_array(faces))
        mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
        color = gf.vec3f(bend.mesh.color_rgba[:3])
        mesh.CreateDisplayColorPrimvar(UsdGeom.Tokens.constant).Set([color])
        points = mesh.CreatePointsAttr()
        extent = mesh.CreateExtentAttr()
        for k in bend.changes().tolist():
            code = Usd.TimeCode(float(bend.times[k]) * TIME_CODES_PER_SECOND)
            vertices = gf.vec3f_array(bend.vertices(k))
            points.Set(vertices, code)
            extent.Set(UsdGeom.PointBased.ComputeExtent(vertices), code)
    return save(layer, path)
