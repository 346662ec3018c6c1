"""Colours of a stage's meshes: of the material that is bound, or else the display colour."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np
from pxr import Sdf, Usd, UsdGeom, UsdShade

from twin.audit.colors import Palette, Rgba, surface_area


def stage_colors(prims: list[Usd.Prim], links: Collection[Sdf.Path] | None) -> dict[str, dict[Rgba, float]]:
    """Return colours by link, or by the parent of a mesh in a stage without links."""
    out = Palette()
    for prim in prims:
        if not prim.IsA(UsdGeom.Mesh) or UsdGeom.Imageable(prim).ComputePurpose() not in ("default", "render"):
            continue
        owner = prim if links is not None else prim.GetParent()
        while owner and links is not None and owner.GetPath() not in links:
            owner = owner.GetParent()
        rgba = _rgba(prim)
        if not owner or owner.IsPseudoRoot() or rgba is None or UsdGeom.Subset.GetAllGeomSubsets(UsdGeom.Mesh(prim)):
            continue
        out.add(owner.GetName(), rgba, _area(UsdGeom.Mesh(prim)))
    return out.shares()


def _rgba(prim: Usd.Prim) -> Rgba | None:
    material = UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial()[0]
    shader = material.ComputeSurfaceSource()[0] if material else None
    if shader:
        color, opacity = (shader.GetInput(n) for n in ("diffuseColor", "opacity"))
        value = color.Get() if color and not color.HasConnectedSource() else None
        if value is not None:
            alpha = opacity.Get() if opacity else None
            return (*map(float, value), 1.0 if alpha is None else float(alpha))
    shown = UsdGeom.Gprim(prim).GetDisplayColorAttr().Get()
    return (*map(float, shown[0]), 1.0) if shown is not None and len(shown) == 1 else None


def _area(mesh: UsdGeom.Mesh) -> float:
    """Return the area in squared units of the mesh's own frame; faces with more corners count as fans."""
    points = np.array(mesh.GetPointsAttr().Get() or [], float).reshape(-1, 3)
    counts = np.array(mesh.GetFaceVertexCountsAttr().Get() or [], int)
    indices = np.array(mesh.GetFaceVertexIndicesAttr().Get() or [], int)
    if not len(points) or counts.sum() != len(indices) or not len(indices) or indices.max() >= len(points):
        return 0.0
    first = np.repeat(np.cumsum(counts) - counts, np.maximum(counts - 2, 0))
    step = np.concatenate([np.arange(1, max(n - 1, 1)) for n in counts.tolist()]) if len(counts) else np.zeros(0, int)
    fans = np.stack([first, first + step, first + step + 1], axis=1)
    return surface_area(points, indices[fans])
