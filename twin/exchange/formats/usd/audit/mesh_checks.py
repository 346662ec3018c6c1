"""Check the meshes of a stage: their primvars, bounding boxes, normals, colliders and displayed colours."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from pxr import Gf, Usd, UsdGeom, UsdPhysics, UsdShade

from twin.exchange.audit.ledger import Ledger
from twin.exchange.formats.usd.audit.odd_values import differing_from_most

_NORMAL_ANGLE_LIMIT = 60.0
"""Angle in degrees between a normal and its face that no smooth surface of an export has."""


def check_mesh_colliders(stage: Usd.Stage, ledger: Ledger) -> None:
    """Report meshes that collide in another way than most others, or not at all."""
    forms: dict[str, tuple[str, ...]] = {}
    for prim in stage.Traverse(Usd.TraverseInstanceProxies()):
        if not prim.IsA(UsdGeom.Mesh):
            continue
        form = []
        if prim.HasAPI(UsdPhysics.CollisionAPI):
            form.append("PhysicsCollisionAPI")
        if prim.HasAPI(UsdPhysics.MeshCollisionAPI):
            form.append("PhysicsMeshCollisionAPI")
        form.append(f"approximation {prim.GetAttribute('physics:approximation').Get() or 'none'}")
        forms[str(prim.GetPath())] = tuple(form)
    for path, own_form, common_form, count in differing_from_most(forms):
        differing = ", ".join(sorted({*own_form} ^ {*common_form}))
        text = f"the mesh {path} collides in another way than {count} others: {differing}."
        ledger.add("usd.collider", "warning", text, path, suggestion="export the stage again")


def check_meshes(stage: Usd.Stage, ledger: Ledger) -> None:
    """Report meshes that state other primvars than most others, no bounding box, or normals far from their faces."""
    forms: dict[str, tuple[str, ...]] = {}
    for prim in stage.Traverse(Usd.TraverseInstanceProxies()):
        if not prim.IsA(UsdGeom.Mesh):
            continue
        path = str(prim.GetPath())
        primvars = UsdGeom.PrimvarsAPI(prim).GetPrimvarsWithAuthoredValues()
        names = [str(primvar.GetPrimvarName()) for primvar in primvars]
        forms[path] = tuple(sorted(names))
        box = UsdGeom.Mesh(prim).GetExtentAttr().Get()
        if box is None or len(box) != 2:
            text = f"the mesh {path} states no bounding box (extent) of two points."
            ledger.add("usd.extent", "warning", text, path, suggestion="write the extent of the points")
        turned = _turned_normals(UsdGeom.Mesh(prim))
        if turned:
            text = (
                f"{turned} normals of the mesh {path} are more than {_NORMAL_ANGLE_LIMIT:g} degrees from their faces."
            )
            ledger.add("usd.normal_turned", "warning", text, path, suggestion="export the stage again")
    for path, own_form, common_form, count in differing_from_most(forms):
        differing = ", ".join(sorted({*own_form} ^ {*common_form}))
        text = f"the mesh {path} states other primvars than {count} others: {differing}."
        ledger.add("usd.primvar", "warning", text, path, suggestion="export the stage again")


def _turned_normals(mesh: UsdGeom.Mesh) -> int:
    """Return how many normals at corners of triangles are far from the normals of these; 0 for other meshes."""
    primvar = UsdGeom.PrimvarsAPI(mesh).GetPrimvar("normals")
    counts = mesh.GetFaceVertexCountsAttr().Get()
    if not primvar or primvar.GetInterpolation() != "faceVarying" or not counts or set(counts) != {3}:
        return 0
    points = np.array(mesh.GetPointsAttr().Get() or [], float)
    indices = np.array(mesh.GetFaceVertexIndicesAttr().Get() or [], int)
    normals = np.array(primvar.ComputeFlattened() or [], float)
    if len(normals) != len(indices) or not len(indices) or indices.min() < 0 or indices.max() >= len(points):
        return 0  # reported by other checks
    a, b, c = points[indices.reshape(-1, 3)].transpose(1, 0, 2)
    across = np.cross(b - a, c - a)
    areas = np.linalg.norm(across, axis=1)
    solid = areas > _THIN_TRIANGLE * areas.max(initial=0.0)
    cosines = np.einsum("ij,ikj->ik", across / np.where(areas, areas, 1.0)[:, None], normals.reshape(-1, 3, 3))
    return int(np.count_nonzero(cosines[solid] < np.cos(np.radians(_NORMAL_ANGLE_LIMIT))))


_THIN_TRIANGLE = 1e-3
"""Area of a triangle, as a share of the largest of its mesh, up to which its computed normal is inexact."""

_COLOR_ROUNDING = 1e-4
"""Difference of linear colour components (0..1) that is only rounding."""


def check_primvars(stage: Usd.Stage, ledger: Ledger) -> None:
    """Report primvars of meshes with another number of values than their interpolation needs: readers ignore them."""
    for prim in stage.Traverse(Usd.TraverseInstanceProxies()):
        if not prim.IsA(UsdGeom.Mesh):
            continue
        mesh = UsdGeom.Mesh(prim)
        needed = {
            "constant": 1,
            "uniform": len(mesh.GetFaceVertexCountsAttr().Get() or ()),
            "varying": len(mesh.GetPointsAttr().Get() or ()),
            "vertex": len(mesh.GetPointsAttr().Get() or ()),
            "faceVarying": len(mesh.GetFaceVertexIndicesAttr().Get() or ()),
        }
        for primvar in UsdGeom.PrimvarsAPI(prim).GetPrimvarsWithAuthoredValues():
            name = str(primvar.GetPrimvarName())
            interpolation = str(primvar.GetInterpolation())
            values = primvar.Get()
            is_known = name in ("normals", "displayColor", "displayOpacity") and interpolation in needed
            if not is_known or values is None or primvar.GetElementSize() != 1:
                continue
            count = len(values)
            indices = np.arange(count)
            if primvar.IsIndexed():
                indices = np.array(primvar.GetIndices(), int)
            path = str(prim.GetPath())
            if len(indices) != needed[interpolation]:
                text = (
                    f"primvar {name} of {path} has {len(indices)} values; the interpolation '{interpolation}' needs "
                    f"{needed[interpolation]}: readers ignore it."
                )
                ledger.wrong("usd.primvar", text, path, suggestion="correct its interpolation or its values")
            elif len(indices) and (indices.min() < 0 or indices.max() >= count):
                text = f"primvar {name} of {path} has {count} values, but indices {indices.min()} .. {indices.max()}."
                ledger.wrong("usd.primvar", text, path, suggestion="correct its indices")


def check_display_colors(stage: Usd.Stage, ledger: Ledger) -> None:
    """Report meshes whose displayColor is not the colour of their material, or a shader that is no preview surface."""
    for prim in stage.Traverse(Usd.TraverseInstanceProxies()):
        if prim.IsA(UsdShade.Shader) and prim.GetAttribute("info:id").Get() != "UsdPreviewSurface":
            text = f"{prim.GetPath()} is no UsdPreviewSurface: viewers show its material grey."
            ledger.wrong("usd.shader", text, str(prim.GetPath()), suggestion="write info:id UsdPreviewSurface")
        if not prim.IsA(UsdGeom.Mesh):
            continue
        displayed = UsdGeom.Gprim(prim).GetDisplayColorAttr().Get()
        material, _ = UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial()
        if not material or not displayed or len(displayed) != 1:
            continue
        shader, *_ = material.ComputeSurfaceSource()
        color = None
        if shader and shader.GetInput("diffuseColor"):
            color = shader.GetInput("diffuseColor").Get()
        if color is not None and not Gf.IsClose(Gf.Vec3f(displayed[0]), Gf.Vec3f(color), _COLOR_ROUNDING):
            path = str(prim.GetPath())
            text = f"the displayColor of {path} is {_color_text(displayed[0])}, its material has {_color_text(color)}."
            ledger.add("usd.display_color", "warning", text, path, suggestion="export the stage again")


def _color_text(color: Iterable[float]) -> str:
    return " ".join(map("{:.4g}".format, map(float, color)))
