"""Read the meshes of a stage: the shapes of its links in their frames, and their colours and finishes."""

from __future__ import annotations

from collections.abc import Iterable, Set
from typing import Any

import numpy as np
from pxr import Sdf, Usd, UsdGeom, UsdShade

from twin.exchange.audit import poses
from twin.exchange.audit.colors import Palette, Rgba
from twin.exchange.audit.file_content import LinkShape
from twin.exchange.audit.ledger import Ledger, Measured
from twin.exchange.audit.meshes import check_mesh, joined
from twin.exchange.audit.poses import Array
from twin.exchange.formats.usd.audit.stage_world import StageWorld


def is_for_display(prim: Usd.Prim) -> bool:
    """Return whether viewers show a prim; they hide proxies and guides, such as colliders."""
    return UsdGeom.Imageable(prim).ComputePurpose() in ("default", "render")


def read_shapes(
    prims: list[Usd.Prim], links: Set[Sdf.Path] | None, world: StageWorld, ledger: Ledger
) -> tuple[dict[str, LinkShape], dict[str, dict[Rgba, float]], dict[str, dict[Rgba, float]]]:
    """Check all normals; return ({link: shape in the link's frame}, {link: {colour: fraction of area}}, finishes).

    Finishes are as colours, (metallic, roughness, 0, 1).
    `links` are the paths of the links; None: the stage has no links, and the parent of each mesh takes their place.
    """
    palette = Palette()
    finishes = Palette()
    parts: dict[str, list[LinkShape]] = {}
    for prim in prims:
        if not prim.IsA(UsdGeom.Mesh) or not is_for_display(prim):
            continue
        if UsdGeom.Imageable(prim).ComputeVisibility() == UsdGeom.Tokens.invisible:
            continue
        mesh = _corners(UsdGeom.Mesh(prim))
        if mesh is None:
            continue
        vertices, triangles, normals = mesh
        owner = owner_of(prim, links)
        if owner is not None:
            T_stage_owner, T_stage_prim = world.maps([owner, prim], [Usd.TimeCode.Default()])[:, 0]
            rigid, _ = poses.split(T_stage_owner)
            M = poses.inverse(rigid) @ T_stage_prim
            vertices = (vertices @ M[:3, :3].T + M[:3, 3]) * world.meters
            if normals is not None:
                normals = _transformed_normals(normals, M)
        path = str(prim.GetPath())
        mesh_ledger = Ledger("")
        shape = check_mesh(mesh_ledger, path, vertices, triangles, normals, "usd")
        for finding in mesh_ledger.found:  # winding and indices are checked by the stage checker
            if finding.code not in ("usd.winding", "usd.index"):
                size = Measured(finding.size, finding.limit)
                ledger.add(finding.code, finding.severity, finding.message, path, size=size)
        if shape is None or owner is None:
            continue
        parts.setdefault(owner.GetName(), []).append(shape)
        rgba = _mesh_color(prim)
        if rgba is not None:
            palette.add(owner.GetName(), rgba, shape.area)
        finish = _mesh_finish(prim)
        if finish is not None:
            finishes.add_finish(owner.GetName(), *finish, shape.area)
    shapes = {}
    for link, meshes in parts.items():
        shape = joined(meshes)
        if shape is not None:
            shapes[link] = shape
    return shapes, palette.shares(), finishes.shares()


def owner_of(mesh: Usd.Prim, links: Set[Sdf.Path] | None) -> Usd.Prim | None:
    """Return the link of a mesh: the mesh itself or a prim above it, see `read_shapes`; None if it has none."""
    if links is None:
        owner = mesh.GetParent()
    else:
        owner = mesh
        while owner and owner.GetPath() not in links:
            owner = owner.GetParent()
    if not owner or owner.IsPseudoRoot():
        return None
    return owner


def _transformed_normals(normals: Array, M: Array) -> Array:
    """Return normals (n, 3) of a mesh that is transformed by M (4, 4). Their lengths stay: wrong ones must be found.

    Normals are transformed by the inverse transpose, because a scale that differs by axis tilts them the other way.
    """
    turned = normals @ np.linalg.inv(M[:3, :3])
    size = np.linalg.norm(turned, axis=1, keepdims=True)
    return turned / np.where(size > 0, size, 1.0) * np.linalg.norm(normals, axis=1, keepdims=True)


def _mesh_color(prim: Usd.Prim) -> Rgba | None:
    """Return the linear colour of a mesh; None if it has no colour, several colours, or a texture."""
    if UsdGeom.Subset.GetAllGeomSubsets(UsdGeom.Mesh(prim)):
        return None
    material, _ = UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial()
    if material:
        shader, *_ = material.ComputeSurfaceSource()
        color = _constant_input(shader, "diffuseColor")
        if color is not None:
            return _rgba(color, _input_number(shader, "opacity", 1.0))
    displayed = UsdGeom.Gprim(prim).GetDisplayColorAttr().Get()
    if displayed is None or len(displayed) != 1:
        return None
    return _rgba(displayed[0], 1.0)


def _mesh_finish(prim: Usd.Prim) -> tuple[float, float] | None:
    """Return (metallic, roughness) of a mesh with one preview surface; None without one, or with a texture."""
    if UsdGeom.Subset.GetAllGeomSubsets(UsdGeom.Mesh(prim)):
        return None
    material, _ = UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial()
    if not material:
        return None
    shader, *_ = material.ComputeSurfaceSource()
    if not shader or shader.GetPrim().GetAttribute("info:id").Get() != "UsdPreviewSurface":
        return None
    for name in ("metallic", "roughness"):
        shader_input = shader.GetInput(name)
        if shader_input and shader_input.HasConnectedSource():
            return None
    # the fallbacks are those of the specification of UsdPreviewSurface
    return _input_number(shader, "metallic", 0.0), _input_number(shader, "roughness", 0.5)


def _input_number(shader: UsdShade.Shader, name: str, fallback: float) -> float:
    """Return the number of an input of a shader; the fallback without the input, or without its value."""
    shader_input = shader.GetInput(name)
    if not shader_input:
        return fallback
    value = shader_input.Get()
    if value is None:
        return fallback
    return float(value)


def _constant_input(shader: UsdShade.Shader, name: str) -> Any:
    """Return the value of an input of a shader; None if there is none, or if it comes from a texture."""
    if not shader:
        return None
    shader_input = shader.GetInput(name)
    if not shader_input or shader_input.HasConnectedSource():
        return None
    return shader_input.Get()


def _rgba(color: Iterable[float], alpha: float) -> Rgba:
    r, g, b = map(float, color)
    return r, g, b, alpha


def _corners(mesh: UsdGeom.Mesh) -> tuple[Array, Array, Array | None] | None:
    """Return (points (n, 3), triangles (m, 3), corner normals (3 m, 3) or None); polygons are split into triangles.

    Return None if the mesh has no triangles, or if its arrays do not fit together.
    """
    points = np.array(mesh.GetPointsAttr().Get() or [], float).reshape(-1, 3)
    counts = np.array(mesh.GetFaceVertexCountsAttr().Get() or [], int)
    indices = np.array(mesh.GetFaceVertexIndicesAttr().Get() or [], int)
    if not len(counts) or counts.sum() != len(indices) or counts.min() < 0 or not len(points):
        return None
    if np.all(counts == 3):  # almost all meshes, without the slow loop
        corners = np.arange(len(indices)).reshape(-1, 3)
    else:
        corners = _polygon_triangles(counts)
    if not len(corners):
        return None
    if mesh.GetOrientationAttr().Get() == UsdGeom.Tokens.leftHanded:
        corners = corners[:, [0, 2, 1]]
    triangles = indices[corners]
    return points, triangles, _normals(mesh, corners.ravel(), triangles.ravel())


def _polygon_triangles(counts: Array) -> Array:
    """Return the triangles (m, 3) of polygons with counts (k,) of corners; the corners are numbered through."""
    fans = []
    first = 0
    for count in counts.tolist():
        for i in range(1, count - 1):
            fans.append([first, first + i, first + i + 1])
        first += count
    return np.array(fans, int).reshape(-1, 3)


def _normals(mesh: UsdGeom.Mesh, corners: Array, vertices: Array) -> Array | None:
    """Return the normals (n, 3) at the corners (n,) of a mesh, which use the points `vertices` (n,); None without."""
    # The primvar takes precedence over the attribute of the same name.
    primvar = UsdGeom.PrimvarsAPI(mesh).GetPrimvar("normals")
    if primvar and primvar.HasValue():
        values = primvar.ComputeFlattened()
        kind = primvar.GetInterpolation()
    else:
        values = mesh.GetNormalsAttr().Get()
        kind = mesh.GetNormalsInterpolation()
    if values is None or not len(values):
        return None
    normals = np.array(values, float).reshape(-1, 3)
    index = {"faceVarying": corners, "vertex": vertices, "varying": vertices}.get(str(kind))
    if index is None or index.min() < 0 or index.max() >= len(normals):
        return None
    return normals[index]
