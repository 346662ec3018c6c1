"""Write geometry.usdc: bodies at rest, meshes, materials, named frames and points."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from pxr import Gf, Kind, Sdf, Usd, UsdGeom, UsdShade

from twin.core.spatial import Array
from twin.core.units import DEG
from twin.model.body import Frame, Material, Mesh
from twin.model.mechanism import Mechanism, Point
from twin.usd import gf
from twin.usd.write.layers import LeafNames, describe, new_layer, save

CREASE_ANGLE = 30 * DEG
"""Angle in rad between two faces, below which their normals are averaged: bores look smooth, edges stay visible."""

_NORMAL_DIGITS = 4
"""Decimals to which normals are rounded before equal ones become one; the error of 0.005 degrees is not seen."""

RESERVED_NAMES = {"joints", "materials"}
"""Names of the scopes below the robot's prim; bodies must not have these names."""


def mesh_paths(mechanism: Mechanism) -> dict[str, str]:
    """Return the prim path of every mesh, by mesh name."""
    return _paths_of_meshes(mechanism, _free_leaf_names(mechanism))


def write_geometry(mechanism: Mechanism, path: Path, link_poses: Mapping[str, Array]) -> Path:
    """Write the geometry layer: an Xform for each body, directly below the robot's prim, with the body's meshes.

    `link_poses` has T_world_body (4, 4) of every body; poses are written in double precision.
    """
    layer = new_layer(path)
    describe(layer, mechanism.name)
    stage = Usd.Stage.Open(layer)
    root = UsdGeom.Xform.Define(stage, f"/{mechanism.name}")
    Usd.ModelAPI(root).SetKind(Kind.Tokens.component)
    for body in mechanism.bodies:
        xform = UsdGeom.Xform.Define(stage, f"/{mechanism.name}/{body.name}")
        Usd.ModelAPI(xform).SetKind(Kind.Tokens.subcomponent)
        T = link_poses[body.name]
        xform.AddTranslateOp(UsdGeom.XformOp.PrecisionDouble).Set(gf.vec3d(T[:3, 3]))
        # Double precision: USD converts an orient op to angle and axis with an arc cosine; in single precision,
        # rotations below 3e-4 rad are lost (measured, usd-core 26.11).
        xform.AddOrientOp(UsdGeom.XformOp.PrecisionDouble).Set(gf.quatd(T[:3, :3]))
    materials: dict[str, UsdShade.Material] = {}
    leaf_names = _free_leaf_names(mechanism)
    paths = _paths_of_meshes(mechanism, leaf_names)
    for body in mechanism.bodies:
        for mesh in body.meshes:
            prim = _write_mesh(stage, paths[mesh.name], mesh).GetPrim()
            _store_name(prim, mesh.name)
            material = mechanism.materials[mesh.name]
            if material.name not in materials:
                place = f"/{mechanism.name}/materials/{material.name}"
                materials[material.name] = _write_material(stage, place, material)
            UsdShade.MaterialBindingAPI.Apply(prim).Bind(materials[material.name])
    _write_frames_and_points(stage, mechanism, leaf_names)
    return save(layer, path)


def _free_leaf_names(mechanism: Mechanism) -> LeafNames:
    """Return the leaf names that are still free, beside those of the robot, its scopes, bodies and joints."""
    used_names = {mechanism.name, *RESERVED_NAMES}
    for body in mechanism.bodies:
        used_names.add(body.name)
    for joint in mechanism.joints:
        used_names.add(joint.name)
    return LeafNames(used_names)


def _paths_of_meshes(mechanism: Mechanism, leaf_names: LeafNames) -> dict[str, str]:
    """Return the prim path of every mesh, by mesh name; their leaf names are taken from `leaf_names`."""
    paths: dict[str, str] = {}
    for body in mechanism.bodies:
        for mesh in body.meshes:
            paths[mesh.name] = f"/{mechanism.name}/{body.name}/{leaf_names.take(mesh.name, 'mesh')}"
    return paths


def _store_name(prim: Usd.Prim, name: str) -> None:
    """Store the mechanism's name of an object in its prim, if the prim has a different leaf name."""
    if prim.GetName() != name:
        attribute = prim.CreateAttribute("twin:name", Sdf.ValueTypeNames.String, True, Sdf.VariabilityUniform)
        attribute.Set(name)


def _write_mesh(stage: Usd.Stage, path: str, mesh: Mesh) -> UsdGeom.Mesh:
    """Write points in single precision, triangles, extent, indexed normals, and the display colour of a mesh."""
    usd_mesh = UsdGeom.Mesh.Define(stage, path)
    points = gf.vec3f_array(mesh.vertices)
    usd_mesh.CreatePointsAttr(points)
    usd_mesh.CreateFaceVertexCountsAttr(gf.int_array(np.full(len(mesh.triangles), 3)))
    usd_mesh.CreateFaceVertexIndicesAttr(gf.int_array(mesh.triangles))
    # The default, Catmull-Clark subdivision, would round the edges.
    usd_mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    usd_mesh.CreateExtentAttr(UsdGeom.PointBased.ComputeExtent(points))
    # Indexed: most corners of planes and cylinders share a few normals, so that the file is four times smaller.
    rounded = np.round(corner_normals(mesh.vertices, mesh.triangles), _NORMAL_DIGITS)
    normals, index = np.unique(rounded, axis=0, return_inverse=True)
    normals = normals / np.linalg.norm(normals, axis=1, keepdims=True)
    primvar = UsdGeom.PrimvarsAPI(usd_mesh).CreatePrimvar(
        "normals", Sdf.ValueTypeNames.Normal3fArray, UsdGeom.Tokens.faceVarying
    )
    primvar.Set(gf.vec3f_array(normals))
    primvar.SetIndices(gf.int_array(index))
    color = gf.vec3f(mesh.color_rgba[:3])
    usd_mesh.CreateDisplayColorPrimvar(UsdGeom.Tokens.constant).Set([color])
    return usd_mesh


def corner_normals(vertices: Array, triangles: np.ndarray, crease: float = CREASE_ANGLE) -> Array:
    """Return unit normals (3 m, 3), one per triangle corner, averaged over faces that meet at angles below `crease`.

    Triangles (m, 3) are indices of vertices (n, 3); normals are averaged only over faces that share a vertex. Angles
    are in rad. A GLB has the same normals as the stage.
    """
    triangles = np.asarray(triangles)
    corners = triangles.ravel()
    vertices = np.asarray(vertices, float)
    a = vertices[triangles[:, 0]]
    b = vertices[triangles[:, 1]]
    c = vertices[triangles[:, 2]]
    doubled_areas = np.cross(b - a, c - a)
    length = np.linalg.norm(doubled_areas, axis=1, keepdims=True)
    x, y, z = (doubled_areas / np.where(length > 0, length, 1.0)).T
    corner, mate = _corner_pairs(corners, len(vertices))
    triangle = corner // 3
    mate_triangle = mate // 3
    cosine = x[triangle] * x[mate_triangle] + y[triangle] * y[mate_triangle] + z[triangle] * z[mate_triangle]
    # a face without area is smooth with no other, but a corner counts for itself
    is_smooth = (cosine >= np.cos(crease)) | (corner == mate)
    corner = corner[is_smooth]
    mate_triangle = mate_triangle[is_smooth]
    # weighted by area, because the cross products are not normalised
    total = np.zeros((len(corners), 3))
    for axis in range(3):
        total[:, axis] = np.bincount(corner, doubled_areas[mate_triangle, axis], len(corners))
    size = np.linalg.norm(total, axis=1, keepdims=True)
    # A triangle without area has no normal; the arbitrary direction z avoids NaN.
    return np.where(size > 0, total / np.where(size > 0, size, 1.0), [0.0, 0.0, 1.0])


def _corner_pairs(corners: np.ndarray, vertex_count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return all ordered pairs (m,), (m,) of corners at one vertex, each corner also with itself.

    `corners` (k,) are the vertices of the corners, which are numbered from 0. The pairs are formed without a loop:
    each corner is repeated as often as its vertex has corners.
    """
    order = np.argsort(corners, kind="stable")
    count = np.bincount(corners, minlength=vertex_count)
    first = np.concatenate([[0], np.cumsum(count)[:-1]])  # place in `order` of the first corner of each vertex
    vertex_of = corners[order]
    mates = count[vertex_of]
    start = np.concatenate([[0], np.cumsum(mates)[:-1]])  # row of the first pair of each corner
    corner = np.repeat(order, mates)
    offset = np.repeat(first[vertex_of] - start, mates)
    mate = order[offset + np.arange(len(corner))]
    return corner, mate


def _write_material(stage: Usd.Stage, path: str, look: Material) -> UsdShade.Material:
    """Write a preview surface; the opacity only if it is below 1."""
    UsdGeom.Scope.Define(stage, Sdf.Path(path).GetParentPath())
    material = UsdShade.Material.Define(stage, path)
    color_rgba = look.color_rgba
    shader = UsdShade.Shader.Define(stage, f"{path}/surface")
    shader.CreateIdAttr("UsdPreviewSurface")
    shader.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f).Set(Gf.Vec3f(*color_rgba[:3]))
    shader.CreateInput("roughness", Sdf.ValueTypeNames.Float).Set(look.finish.roughness)
    shader.CreateInput("metallic", Sdf.ValueTypeNames.Float).Set(look.finish.metallic)
    if color_rgba[3] < 1:
        shader.CreateInput("opacity", Sdf.ValueTypeNames.Float).Set(float(color_rgba[3]))
    surface = shader.CreateOutput("surface", Sdf.ValueTypeNames.Token)
    material.CreateSurfaceOutput().ConnectToSource(surface)
    return material


def _write_frames_and_points(stage: Usd.Stage, mechanism: Mechanism, leaf_names: LeafNames) -> None:
    """Write named frames and points as guide prims below their body, in double precision.

    Their names are taken from `leaf_names`, from which the meshes already have theirs.
    """
    for frame in mechanism.frames:
        xform = _write_guide(stage, mechanism, leaf_names, frame, "frame", frame.T_body_frame[:3, 3])
        orient = xform.AddOrientOp(UsdGeom.XformOp.PrecisionDouble)
        orient.Set(gf.quatd(frame.T_body_frame[:3, :3]))
    for point in mechanism.points:
        _write_guide(stage, mechanism, leaf_names, point, "point", point.p_body)


def _write_guide(
    stage: Usd.Stage, mechanism: Mechanism, leaf_names: LeafNames, named: Frame | Point, kind: str, p_body: Array
) -> UsdGeom.Xform:
    leaf = leaf_names.take(named.name, kind)
    xform = UsdGeom.Xform.Define(stage, f"/{mechanism.name}/{named.body}/{leaf}")
    xform.CreatePurposeAttr(UsdGeom.Tokens.guide)
    prim = xform.GetPrim()
    _store_name(prim, named.name)
    prim.CreateAttribute("twin:kind", Sdf.ValueTypeNames.Token, True, Sdf.VariabilityUniform).Set(kind)
    translate = xform.AddTranslateOp(UsdGeom.XformOp.PrecisionDouble)
    translate.Set(gf.vec3d(p_body))
    return xform
