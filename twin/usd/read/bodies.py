"""Read meshes, colours, masses, named frames and points of one rigid body."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from pxr import Usd, UsdGeom, UsdPhysics, UsdShade

from twin.core.errors import StageError, UnsupportedError
from twin.core.findings import Finding, info
from twin.core.spatial import Array
from twin.model.body import Finish, Mesh
from twin.model.inertia import Inertia
from twin.usd import gf
from twin.usd.scan import SCALE_TOL, RawStage, rigid

_GREY = (0.6, 0.6, 0.6, 1.0)
"""Linear colour of a mesh without one."""


def bake_scale(scene: RawStage, body: Usd.Prim, notes: list[Finding]) -> None:
    """Add a note to `notes` if a body is scaled; the lengths of the body are read at the scaled size.

    The scale of the body may differ along its axes, as in UsdPhysics: it applies to shapes, joints and centre of mass,
    but not to mass and inertia. The scale of the body's ancestors must be uniform.

    Raises:
        StageError: the pose of the body is not finite; or the body is mirrored or sheared, or an ancestor is scaled
            non-uniformly, so that the shape of the body would change with its orientation.
    """
    transform = scene.raw_transform(body)
    if not np.isfinite(transform).all():
        raise StageError(f"{scene.path}: rigid body {body.GetPath()}: a number of its transform is not finite")
    axes = transform[:3, :3]
    parent_axes = np.eye(3)
    if UsdGeom.Xformable(body.GetParent()):
        parent_axes = scene.raw_transform(body.GetParent())[:3, :3]
    parent_size = np.full(3, np.cbrt(np.linalg.det(parent_axes)))
    size = scene.scale(body)
    handedness = np.linalg.det(axes)  # negative if mirrored
    if handedness > 0 and _is_scaled_rotation(axes, size) and _is_scaled_rotation(parent_axes, parent_size):
        if np.any(size != 1.0):
            where = str(body.GetPath())
            factor = _vector_text(size)
            if np.ptp(size) == 0:
                factor = f"{size[0]:.6g}"
            text = f"{where} is scaled by {factor} (including parents): lengths are read at the scaled size"
            notes.append(info("stage.read.scaled", where, text))
        return
    prim, scale = _unevenly_scaled_prim(body)
    factor = _vector_text(scale)
    if handedness < 0:
        factor += ", mirrored"
    reason = ""
    if prim != body:
        reason = f", because of the scale of its ancestor {prim.GetPath()}"
    raise UnsupportedError(
        f"{scene.path}: rigid body {body.GetPath()} is scaled by {factor}{reason}. Scale the meshes "
        "below the body instead, or write the stage in its final unit."
    )


def _is_scaled_rotation(axes: Array, size: Array) -> bool:
    """Return whether `axes` (3, 3) are a rotation times the scale `size` (3,) along the axes, without shear."""
    # for axes = R diag(size), the products of the columns are size^2 on the diagonal and 0 elsewhere
    difference = axes.T @ axes - np.diag(size**2)
    return bool(np.abs(difference).max() <= 2 * SCALE_TOL * size.max() ** 2)


def _vector_text(scale: Array) -> str:
    numbers = ", ".join(map("{:.6g}".format, scale))
    return f"({numbers})"


def _unevenly_scaled_prim(body: Usd.Prim) -> tuple[Usd.Prim, Array]:
    """Return (prim, scale (3,)) of the body that is mirrored or sheared, or of its ancestor with an uneven scale."""
    prim = body
    while prim and not prim.IsPseudoRoot():
        axes = np.eye(3)
        xformable = UsdGeom.Xformable(prim)
        if xformable:
            axes = gf.affine(xformable.GetLocalTransformation())[:3, :3]
        size = np.linalg.norm(axes, axis=0)
        is_uniform = np.ptp(size) <= SCALE_TOL * size.max()
        if np.linalg.det(axes) < 0 or not _is_scaled_rotation(axes, size):
            return prim, size
        if not is_uniform and prim != body:
            return prim, size
        prim = prim.GetParent()
    world = gf.affine(UsdGeom.XformCache().GetLocalToWorldTransform(body))
    return body, np.linalg.norm(world[:3, :3], axis=0)


def below(scene: RawStage, body: Usd.Prim) -> Iterator[Usd.Prim]:
    """Yield the prims that move with a body, except prims of nested bodies."""
    prims = iter(Usd.PrimRange(body, Usd.TraverseInstanceProxies()))
    for prim in prims:
        if prim != body and str(prim.GetPath()) in scene.bodies:
            prims.PruneChildren()
        else:
            yield prim


def original_name(prim: Usd.Prim) -> str:
    """Return the name of a prim in the original mechanism: the name stored in the stage, else its leaf name."""
    name = prim.GetAttribute("twin:name").Get()
    if name:
        return str(name)
    return prim.GetName()


def read_meshes(scene: RawStage, body: Usd.Prim, names: dict[str, str], notes: list[Finding]) -> tuple[Mesh, ...]:
    """Return the visible meshes of a body, triangulated; vertices are in m, relative to the body's frame.

    `names` has identifiers by prim path; `notes` receives findings on omitted shapes.

    Raises:
        StageError: a mesh uses vertices that do not exist.
    """
    meshes = []
    for prim in below(scene, body):
        if not prim.IsA(UsdGeom.Gprim):
            continue
        if UsdGeom.Imageable(prim).ComputePurpose() == UsdGeom.Tokens.guide:
            continue  # collision shapes from other software
        if not prim.IsA(UsdGeom.Mesh):
            text = f"{prim.GetTypeName()} {prim.GetPath()} is not shown: only meshes are read"
            notes.append(info("stage.read.shape", str(prim.GetPath()), text))
            continue
        mesh = _mesh(scene, body, UsdGeom.Mesh(prim), names[str(prim.GetPath())])
        if mesh is not None:
            meshes.append(mesh)
    return tuple(meshes)


def shows_all(scene: RawStage, body: Usd.Prim) -> bool:
    """Return whether the meshes of a body show the whole body, so that its mass can be judged by them.

    If twin did not write the stage: the body has colliders, and `read_meshes` omits none of its shapes.
    """
    stated_whole = body.GetAttribute("twin:whole").Get()
    if stated_whole is not None:
        return bool(stated_whole)
    has_collider = False
    for prim in below(scene, body):
        if prim.IsA(UsdGeom.Gprim):
            is_guide = UsdGeom.Imageable(prim).ComputePurpose() == UsdGeom.Tokens.guide
            if is_guide or not prim.IsA(UsdGeom.Mesh):
                return False  # `read_meshes` omits this shape
        if prim.HasAPI(UsdPhysics.CollisionAPI):
            has_collider = True
    return has_collider


def mesh_points(mesh: UsdGeom.Mesh) -> Array:
    """Return the points (n, 3) of a mesh, in the prim's frame and unit."""
    points = mesh.GetPointsAttr().Get() or []
    return np.array(points, float).reshape(-1, 3)


def mesh_triangles(mesh: UsdGeom.Mesh) -> np.ndarray:
    """Return the triangles (m, 3) of a mesh; polygons are split, and left-handed faces are reversed.

    Raises:
        StageError: counts and indices do not match, or an index exceeds the number of vertices.
    """
    counts = _integers(mesh.GetFaceVertexCountsAttr())
    indices = _integers(mesh.GetFaceVertexIndicesAttr())
    vertex_count = len(mesh.GetPointsAttr().Get() or [])
    where = mesh.GetPath()
    if counts.sum() != len(indices):
        raise StageError(f"mesh {where}: the faces require {counts.sum()} indices, but the mesh has {len(indices)}")
    if not len(indices):
        return np.zeros((0, 3), np.int32)
    wrong = None
    if indices.max() >= vertex_count:
        wrong = indices.max()
    if indices.min() < 0:
        wrong = indices.min()
    if wrong is not None:
        raise StageError(f"mesh {where}: an index refers to vertex {wrong}, but the mesh has {vertex_count} vertices")
    # Each polygon becomes a fan of triangles around its first corner.
    starts = np.concatenate([[0], np.cumsum(counts)[:-1]])
    fans = np.maximum(counts - 2, 0)  # triangles of each polygon
    first = np.repeat(starts, fans)
    first_triangle = np.cumsum(fans) - fans
    step = np.arange(fans.sum()) - np.repeat(first_triangle, fans)  # number of a triangle in its fan
    corners = np.column_stack([first, first + step + 1, first + step + 2])
    triangles = indices[corners]
    if mesh.GetOrientationAttr().Get() == UsdGeom.Tokens.leftHanded:
        triangles = triangles[:, ::-1]
    return np.ascontiguousarray(triangles, dtype=np.int32)


def _integers(attribute: Usd.Attribute) -> np.ndarray:
    return np.array(attribute.Get() or []).astype(int).ravel()


def _mesh(scene: RawStage, body: Usd.Prim, mesh: UsdGeom.Mesh, name: str) -> Mesh | None:
    triangles = mesh_triangles(mesh)
    if not len(triangles):
        return None
    points = mesh_points(mesh)
    M = scene.relative(mesh.GetPrim(), body)
    if np.linalg.det(M[:3, :3]) < 0:  # a mirrored mesh: exchange the sides of its faces
        triangles = triangles[:, ::-1].copy()
    if not np.array_equal(M, np.eye(4)):
        points = points @ M[:3, :3].T + M[:3, 3]
    vertices = points * scene.meters * scene.scale(body)
    color_rgba, finish = _color_and_finish(mesh)
    return Mesh(name, vertices, triangles, color_rgba, finish)


def _color_and_finish(mesh: UsdGeom.Mesh) -> tuple[tuple[float, float, float, float], Finish]:
    """Return (linear colour, finish) of the bound preview surface, else the display colour, else grey."""
    color_and_finish = _surface_color_and_finish(mesh)
    if color_and_finish is not None:
        return color_and_finish
    display_color = mesh.GetDisplayColorAttr().Get()
    if display_color:
        r, g, b = map(float, display_color[0])
        opacity = 1.0
        display_opacity = mesh.GetDisplayOpacityAttr().Get()
        if display_opacity:
            opacity = float(display_opacity[0])
        return (r, g, b, opacity), Finish()
    return _GREY, Finish()


def _surface_color_and_finish(mesh: UsdGeom.Mesh) -> tuple[tuple[float, float, float, float], Finish] | None:
    """Return (linear colour, finish) of the bound preview surface; None if there is none with a colour of its own."""
    material, _ = UsdShade.MaterialBindingAPI(mesh.GetPrim()).ComputeBoundMaterial()
    if not material:
        return None
    shader, *_ = material.ComputeSurfaceSource()
    if not shader or shader.GetIdAttr().Get() != "UsdPreviewSurface":
        return None
    diffuse = shader.GetInput("diffuseColor")
    rgb = diffuse.Get() if diffuse else None
    if rgb is None:
        return None
    r, g, b = map(float, rgb)
    metallic = _shader_value(shader, "metallic", 0.0)
    roughness = _shader_value(shader, "roughness", 0.5)
    finish = Finish(material.GetPrim().GetName(), metallic, roughness)
    return (r, g, b, _shader_value(shader, "opacity", 1.0)), finish


def _shader_value(shader: UsdShade.Shader, name: str, default: float) -> float:
    source = shader.GetInput(name)
    value = source.Get() if source else None
    if value is None:
        return default
    return round(float(value), 6)  # single precision: 0.35 is 0.3499999


def read_inertia(scene: RawStage, body: Usd.Prim, notes: list[Finding]) -> Inertia | None:
    """Return mass, centre of mass and inertia of a body in SI units; None if mass or inertia is missing.

    Raises:
        StageError: the centre of mass is not finite, or the principal axes are not a rotation.
    """
    mass = UsdPhysics.MassAPI(body)
    kilograms = 0.0
    if body.HasAPI(UsdPhysics.MassAPI):
        kilograms = mass.GetMassAttr().Get()
    diagonal = np.zeros(3)
    if kilograms:
        diagonal = np.array(mass.GetDiagonalInertiaAttr().Get() or (0, 0, 0), float)
    if not kilograms or not np.any(diagonal):
        text = f"{body.GetPath()} lacks a mass or an inertia, which simulators estimate from the body's colliders"
        notes.append(info("stage.read.inertia", str(body.GetPath()), text))
        return None
    center = np.array(mass.GetCenterOfMassAttr().Get(), float)
    if np.all(np.isneginf(center)):  # in the schema, -inf means "not given"
        center = np.zeros(3)
    if not np.all(np.isfinite(center)):
        raise StageError(f"{scene.path}: {body.GetPath()}: a number of its centre of mass is not finite")
    axes = mass.GetPrincipalAxesAttr().Get()
    R = np.eye(3)
    if np.any(gf.quat_wxyz(axes)):  # a zero quaternion means "not given"
        try:
            R = gf.rotation(axes)
        except ValueError as error:
            raise StageError(f"{scene.path}: {body.GetPath()}, principal axes: {error}") from error
    unit = scene.kilograms * scene.meters**2
    p_body_com = center * scene.meters * scene.scale(body)
    I_com = R @ np.diag(diagonal) @ R.T * unit
    return Inertia(float(kilograms) * scene.kilograms, p_body_com, I_com)


def read_frames_and_points(scene: RawStage, body: Usd.Prim) -> Iterator[tuple[str, str, Array]]:
    """Yield (kind, name, T_body_frame (4, 4) in m) for each named frame and named point of a body."""
    for prim in below(scene, body):
        kind = prim.GetAttribute("twin:kind")
        if kind and kind.Get() in ("frame", "point"):
            T = rigid(scene.relative(prim, body))
            T[:3, 3] *= scene.meters * scene.scale(body)
            yield str(kind.Get()), original_name(prim), T
