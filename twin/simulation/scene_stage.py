"""Write one USD stage for a scene. The stage has props and cameras, and references each robot's stage at its place.

Props do not move: they are static colliders with their exact triangles. Engines accept exact triangles only for static
colliders. Collisions of bodies that touch by design are switched off. Movable objects are rigid bodies in start pose.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from pxr import Gf, Kind, Sdf, Usd, UsdGeom, UsdPhysics, UsdShade

from twin.core import spatial
from twin.core.spatial import Array
from twin.core.units import DEG
from twin.model.console import CameraTable
from twin.model.deformable import Bend
from twin.model.mechanism import Mechanism
from twin.model.movable import objects_as_mechanism
from twin.model.scene import Scene
from twin.reference import ReferenceModel
from twin.usd import gf
from twin.usd.write.deformables import write_deformables
from twin.usd.write.geometry import mesh_paths, write_geometry
from twin.usd.write.layers import describe, new_layer, save
from twin.usd.write.physics_layer import write_inertia

ORGANS = "organs"
"""Name of the prim, and of the layer, that contains the deformables."""

APERTURE_MM = 20.955
"""Horizontal aperture of the USD cameras in mm (USD's default); the focal length follows from the angle of view."""

OBJECTS = "objects"
"""Name of the prim that contains the movable objects, and of their layer."""

LOOK = spatial.pose(np.diag([1.0, -1.0, -1.0]))
"""Rotation from a scope's frame (view along z) to a USD camera (view along -z, y up)."""


def write_scene(
    scene: Scene,
    folder: Path,
    stages: Mapping[str, Path],
    mechanisms: Mapping[str, Mechanism],
    props: Mechanism | None,
    duration: float,
    bends: Sequence[Bend] = (),
) -> Path:
    """Write the root layer of the scene, and the props in the same folder; return the path of the root layer.

    Args:
        scene: the scene.
        folder: output folder, created if it does not exist.
        stages: {robot: path of the layer with the robot's motion, as written into the root layer}.
        mechanisms: {robot: mechanism}, to find the bodies that carry cameras.
        props: mechanism of the props; None: no props.
        duration: duration of the longest motion in s.
        bends: motions of the deformables.
    """
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{scene.name}.usda"
    layer = new_layer(path)
    describe(layer, scene.name, round(duration * 60.0))
    layer.comment = f"{scene.title}. Robots are references to their own stages. Z up, metres."
    stage = Usd.Stage.Open(layer)
    references: dict[str, str] = {}
    root = UsdGeom.Xform.Define(stage, f"/{scene.name}")
    Usd.ModelAPI(root.GetPrim()).SetKind(Kind.Tokens.assembly)
    if props is not None:
        shapes = write_geometry(props, folder / f"{props.name}.usdc", ReferenceModel(props).home().link_poses)
        UsdGeom.Xform.Define(stage, f"/{scene.name}/{props.name}")
        references[f"/{scene.name}/{props.name}"] = f"./{shapes.name}"
        for mesh in mesh_paths(props).values():
            collider = stage.OverridePrim(f"/{scene.name}{mesh}")
            UsdPhysics.CollisionAPI.Apply(collider)
            # the mesh itself: a convex hull would close the openings of fixed parts
            UsdPhysics.MeshCollisionAPI.Apply(collider).CreateApproximationAttr(UsdPhysics.Tokens.none)
    if scene.objects:
        shapes = _objects(stage, scene, folder)
        references[f"/{scene.name}/{OBJECTS}"] = f"./{shapes.name}"
    if bends:
        UsdGeom.Xform.Define(stage, f"/{scene.name}/{ORGANS}")
        shapes = write_deformables(ORGANS, bends, folder / f"{ORGANS}.usdc")
        references[f"/{scene.name}/{ORGANS}"] = f"./{shapes.name}"
    for place in scene.places:
        base = UsdGeom.Xform.Define(stage, f"/{scene.name}/{place.name}")
        references[f"/{scene.name}/{place.name}"] = os.fspath(stages[place.name])
        _pose(base, place.T_world_base)
    for name, camera in scene.cameras.items():
        _camera(stage, scene, name, camera, mechanisms[camera.robot])
    _let_touch(stage, scene, props)
    del stage  # references can be resolved only after the layer has a path
    for prim, asset in references.items():
        layer.GetPrimAtPath(prim).referenceList.Prepend(Sdf.Reference(asset))
    return save(layer, path)


def _objects(stage: Usd.Stage, scene: Scene, folder: Path) -> Path:
    """Write the shapes of the movable objects, and make them rigid bodies of the scene; return the shapes' layer."""
    mechanism = objects_as_mechanism(scene.objects, OBJECTS)
    shapes = write_geometry(mechanism, folder / f"{OBJECTS}.usdc", mechanism.rest)
    UsdGeom.Xform.Define(stage, f"/{scene.name}/{OBJECTS}")
    for item in scene.objects:
        body = stage.OverridePrim(f"/{scene.name}/{OBJECTS}/{item.name}")
        UsdPhysics.RigidBodyAPI.Apply(body)
        write_inertia(body, item.inertia())
        collider = stage.OverridePrim(f"/{scene.name}{mesh_paths(mechanism)[item.name]}")
        UsdPhysics.CollisionAPI.Apply(collider)
        # a convex hull would close the hole of a ring
        UsdPhysics.MeshCollisionAPI.Apply(collider).CreateApproximationAttr(UsdPhysics.Tokens.convexDecomposition)
        material = UsdShade.Material.Define(stage, f"/{scene.name}/{OBJECTS}/{item.name}/friction")
        surface = UsdPhysics.MaterialAPI.Apply(material.GetPrim())
        surface.CreateStaticFrictionAttr(float(item.friction))
        surface.CreateDynamicFrictionAttr(float(item.friction))
        binding = UsdShade.MaterialBindingAPI.Apply(collider)
        binding.Bind(material, UsdShade.Tokens.weakerThanDescendants, "physics")
    return shapes


def _let_touch(stage: Usd.Stage, scene: Scene, props: Mechanism | None) -> None:
    """Switch off collisions between bodies that touch by design; a static body is listed by its colliders."""
    for pair in sorted(sorted(p) for p in scene.touching):
        first, second = (_colliding(scene, name, props) for name in pair)
        for path in first:
            filtered = UsdPhysics.FilteredPairsAPI.Apply(stage.OverridePrim(path))
            for second_path in second:
                filtered.CreateFilteredPairsRel().AddTarget(second_path)


def _colliding(scene: Scene, name: str, props: Mechanism | None) -> list[str]:
    """Return the paths for collision filters of "owner/body": a robot's body, or the meshes of a body of the props."""
    owner, body = name.split("/")
    if props is None or owner != props.name:
        return [f"/{scene.name}/{name}"]
    meshes = mesh_paths(props)
    return [f"/{scene.name}{meshes[mesh.name]}" for mesh in props.body(body).meshes]


def _pose(prim: UsdGeom.Xform | UsdGeom.Camera, T: Array) -> None:
    prim.ClearXformOpOrder()
    prim.AddTranslateOp().Set(Gf.Vec3d(*map(float, T[:3, 3])))
    prim.AddOrientOp(UsdGeom.XformOp.PrecisionDouble).Set(gf.quatd(T[:3, :3]))


def _camera(stage: Usd.Stage, scene: Scene, name: str, camera: CameraTable, mechanism: Mechanism) -> None:
    frame = mechanism.frame(camera.frame)
    usd_camera = UsdGeom.Camera.Define(stage, f"/{scene.name}/{camera.robot}/{frame.body}/{name}")
    _pose(usd_camera, frame.T_body_frame @ camera.in_frame @ LOOK)
    usd_camera.CreateHorizontalApertureAttr(APERTURE_MM)
    usd_camera.CreateVerticalApertureAttr(APERTURE_MM)
    usd_camera.CreateFocalLengthAttr(float(APERTURE_MM / 2 / np.tan(camera.view_deg * DEG / 2)))
    usd_camera.CreateClippingRangeAttr(Gf.Vec2f(0.001, 10.0))
    stage.GetPrimAtPath(usd_camera.GetPath().GetParentPath()).SetSpecifier(Sdf.SpecifierOver)
