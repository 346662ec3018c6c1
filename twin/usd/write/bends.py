"""Write the layer of the deformables: one mesh for each deformable, with time samples of its points."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from pxr import Usd, UsdGeom

from twin.model.deformable import Bend
from twin.usd import gf
from twin.usd.write.layers import TIME_CODES_PER_SECOND, describe, new_layer, save


def write_bends(name: str, bends: Sequence[Bend], path: Path) -> Path:
    """Write the motions of deformables below the prim `name` and return the path of the layer.

    While a deformable does not move, only the first and the last sample of this interval are written.
    """
    layer = new_layer(path)
    describe(layer, name, max(float(b.times[-1]) for b in bends) * TIME_CODES_PER_SECOND)
    stage = Usd.Stage.Open(layer)
    UsdGeom.Xform.Define(stage, f"/{name}")
    for bend in bends:
        mesh = UsdGeom.Mesh.Define(stage, f"/{name}/{bend.name}")
        faces = bend.mesh.triangles
        mesh.CreateFaceVertexCountsAttr(gf.int_array([3] * len(faces)))
        mesh.CreateFaceVertexIndicesAttr(gf.int_array(faces))
        mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
        mesh.CreateDisplayColorPrimvar(UsdGeom.Tokens.constant).Set([gf.vec3f(bend.mesh.color_rgba[:3])])
        points, extent = mesh.CreatePointsAttr(), mesh.CreateExtentAttr()
        for k in bend.changes().tolist():
            code = Usd.TimeCode(float(bend.times[k]) * TIME_CODES_PER_SECOND)
            values = gf.vec3f_array(bend.vertices(k))
            points.Set(values, code)
            extent.Set(UsdGeom.PointBased.ComputeExtent(values), code)
    return save(layer, path)
