"""Read the colour of a mesh in a stage: the colour of its bound material, else its display colour."""

from __future__ import annotations

from pxr import Usd, UsdGeom, UsdShade

from twin.exchange.audit.colors import Rgba


def mesh_color(prim: Usd.Prim) -> Rgba | None:
    """Return the linear colour of a mesh; None if it has no colour, several colours, or a texture."""
    if UsdGeom.Subset.GetAllGeomSubsets(UsdGeom.Mesh(prim)):
        return None
    material = UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial()[0]
    shader = material.ComputeSurfaceSource()[0] if material else None
    if shader:
        color, opacity = (shader.GetInput(n) for n in ("diffuseColor", "opacity"))
        value = color.Get() if color and not color.HasConnectedSource() else None
        if value is not None:
            alpha = opacity.Get() if opacity else None
            return _rgba(value, 1.0 if alpha is None else float(alpha))
    shown = UsdGeom.Gprim(prim).GetDisplayColorAttr().Get()
    return _rgba(shown[0], 1.0) if shown is not None and len(shown) == 1 else None


def _rgba(color, alpha: float) -> Rgba:
    r, g, b = map(float, color)
    return r, g, b, alpha
