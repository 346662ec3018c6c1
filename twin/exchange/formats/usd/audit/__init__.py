"""Read a USD stage: link poses at its time samples, joint values, meshes, joint gaps.

Poses are read with OpenUSD (pxr) directly, without `twin.usd`. Findings of the stage checker `twin.usd.check` are
included; the checker is also independent of the writer.
"""

from __future__ import annotations

import contextlib
import re
from collections.abc import Iterable, Iterator, Sequence, Set
from pathlib import Path
from typing import Any

import numpy as np
from pxr import Sdf, Tf, Usd, UsdGeom, UsdPhysics, UsdShade

from twin.core.foreign.admit import admit
from twin.core.foreign.budget import check_size
from twin.core.json_types import JsonObject
from twin.exchange.audit import poses
from twin.exchange.audit.colors import Palette, Rgba
from twin.exchange.audit.file_content import Content, FileClip, LinkShape, check_poses
from twin.exchange.audit.mechanism_comparison import solved
from twin.exchange.audit.mechanism_data import FileMechanism
from twin.exchange.audit.meshes import check_mesh, joined
from twin.exchange.audit.parameter_claims import PARAMETERS
from twin.exchange.audit.poses import Array
from twin.exchange.audit.reader_context import Context
from twin.exchange.audit.report import Ledger, Measured, ReadError, quantity, um
from twin.exchange.formats.usd.audit.checks import check_usd, version
from twin.exchange.formats.usd.audit.declared import check_declared, check_primvars
from twin.exchange.formats.usd.audit.drive_targets import check_drive_targets
from twin.exchange.formats.usd.audit.header import trouble
from twin.exchange.formats.usd.audit.joint_gaps import joint_gaps, joint_values
from twin.exchange.formats.usd.audit.layers import check_default_prim, missing_physics
from twin.exchange.formats.usd.audit.mechanism import stage_mechanism

_CONE_TOL = 1e-5
"""Difference in rad of two equal half angles of a cone: the schema has them in degrees, in single precision."""

GAP_TOL = 1e-5
"""Maximum gap in m between the two frames of a joint; UsdPhysics stores the frames in single precision."""


def read_usd(path: Path, ledger: Ledger) -> Content:
    """Return the content of a stage, and report faults of its materials, meshes and joints.

    Raises:
        ReadError: the file is not a stage, or a layer is missing.
    """
    stage = _open(path)
    check_default_prim(stage, ledger)
    with _evaluating():
        return _read(stage, path, ledger)


def _read(stage: Usd.Stage, path: Path, ledger: Ledger) -> Content:
    prims = []
    bodies = []
    for prim in stage.Traverse(Usd.TraverseInstanceProxies()):
        if prim.IsA(UsdGeom.Xformable):
            prims.append(prim)
            if _is_body(prim):
                bodies.append(prim)
    body_paths = {prim.GetPath() for prim in bodies}
    world = StageWorld(stage)
    content = Content(ledger, path.suffix.lstrip(".").lower())
    content.declared = tuple(prim.GetName() for prim in bodies) or None
    content.facts = _conventions(stage, world)
    content.extra["physics"] = bool(bodies)
    # If several prims have the same name, use the prim that moves.
    displayed: dict[str, Usd.Prim] = {}
    for prim in bodies or sorted(prims, key=lambda p: not _sampled(p)):
        displayed.setdefault(prim.GetName(), prim)
    for name, prim in displayed.items():
        content.rest[name] = world.poses(prim, [Usd.TimeCode.Default()])[0]
    codes = _all_codes(displayed.values())
    per_second = stage.GetTimeCodesPerSecond()
    if len(codes):
        start = 0.0
        if stage.HasAuthoredTimeCodeRange():
            start = stage.GetStartTimeCode()
        links = world.along(displayed, codes)
        joints = joint_values(stage, codes, world.meters)
        clip = FileClip(path.stem, (codes - start) / per_second, links, joints)
        check_poses(ledger, clip, "usd")
        content.clips.append(clip)
    _check_materials(prims, ledger)
    check_primvars(stage, ledger)
    if bodies:
        _check_stray(prims, body_paths, ledger)
        _check_colliders(prims, ledger)
        shown_paths = {prim.GetPath() for prim in displayed.values()}
        content.shapes, content.colors, content.finishes = _shapes(prims, shown_paths, world, ledger)
        content.mechanism = stage_mechanism(stage, bodies, world.meters, world.up)
        hidden: dict[str, bool] = {}
        for name, prim in displayed.items():
            if name not in content.shapes and not _has_shape(prim, shown_paths):
                hidden[name] = False
        content.mechanism.shown = hidden
        content.mechanism.collides = _colliding(prims, shown_paths)
        if content.mechanism.all_motors:
            check_declared(stage, content.mechanism, codes, ledger)
        _check_cones(stage, content.mechanism, ledger)
        _check_couplings(stage, content.mechanism, ledger)
        check_drive_targets(stage, content.rest, content.mechanism, world.meters, ledger, moving=len(codes) > 0)
    else:
        content.shapes, content.colors, content.finishes = _shapes(prims, None, world, ledger)
        missing = missing_physics(stage)
        if missing:
            ledger.wrong("usd.layer", missing, "subLayers", suggestion="add the layer with the physics")
    content.extra["assumed"] = _assumed(stage)
    content.extra[PARAMETERS] = _custom_data(stage, "twin:parameters")
    _check_gaps(stage, world, bodies, codes, ledger)
    return content


def _conventions(stage: Usd.Stage, world: StageWorld) -> JsonObject:
    """Return units, axes and rates of a stage, and whether the stage states them, for the report."""
    units = f"{world.meters:g} m"
    if not UsdGeom.StageHasAuthoredMetersPerUnit(stage):
        units += " (not authored)"
    up_axis = world.up
    if not stage.HasAuthoredMetadata("upAxis"):
        up_axis += " (not authored)"
    return {
        "units": units,
        "up_axis": up_axis,
        "handedness": "right (USD)",
        "time_codes_per_second": stage.GetTimeCodesPerSecond(),
        "frames_per_second": stage.GetFramesPerSecond(),
    }


class StageWorld:
    """Conversion of a stage's poses to a world frame in metres with z up."""

    def __init__(self, stage: Usd.Stage) -> None:
        self.meters = float(UsdGeom.GetStageMetersPerUnit(stage))
        self.up = str(UsdGeom.GetStageUpAxis(stage))
        self._R = np.eye(3)
        if self.up == "Y":
            self._R = poses.R_Z_UP_Y_UP
        self._cache = UsdGeom.XformCache()

    def maps(self, prims: Sequence[Usd.Prim], codes: Sequence[Usd.TimeCode]) -> Array:
        """Return T_stage_prim (n, k, 4, 4) of n prims at k time codes, with scale, in the stage's units and axes."""
        matrices = np.zeros((len(prims), len(codes), 4, 4))
        for k, code in enumerate(codes):  # time is the outer loop, because SetTime clears the cache
            self._cache.SetTime(code)
            for i, prim in enumerate(prims):
                matrices[i, k] = self._cache.GetLocalToWorldTransform(prim)
        return np.swapaxes(matrices, -1, -2)  # Gf matrices act on row vectors

    def poses(self, prim: Usd.Prim, codes: Sequence[Usd.TimeCode]) -> Array:
        """Return the poses T_world_prim (k, 4, 4) of a prim at the time codes, in metres, z up."""
        return self.placed(self.maps([prim], codes)[0])

    def placed(self, M: Array) -> Array:
        """Convert matrices T_stage_prim (..., 4, 4) to poses T_world_prim (..., 4, 4) in metres, z up."""
        T, _ = poses.split(M)
        T[..., :3, 3] *= self.meters
        return poses.pose(self._R) @ T

    def along(self, prims: dict[str, Usd.Prim], codes: Array) -> dict[str, Array]:
        """Return {name in `prims`: T_world_prim (k, 4, 4)} at k time codes, in metres with z up."""
        times = list(map(Usd.TimeCode, codes.tolist()))
        # Most prims do not move: evaluating them at every time code would take most of the time.
        moving = {}
        for name, prim in prims.items():
            if _codes(prim):
                moving[name] = prim
        poses_of_moving = self.placed(self.maps(list(moving.values()), times))
        poses_by_name = dict(zip(moving, poses_of_moving, strict=True))
        placed = {}
        for name, prim in prims.items():
            if name in poses_by_name:
                placed[name] = poses_by_name[name]
            else:
                placed[name] = np.broadcast_to(self.poses(prim, times[:1]), (len(codes), 4, 4))
        return placed


_SAID = re.compile(r" at line \d+ in file \S+ : '([^\n]*?)'?$", re.MULTILINE)


def _open(path: Path) -> Usd.Stage:
    try:
        stage = Usd.Stage.Open(str(path))
    except (Tf.ErrorException, RuntimeError) as error:
        raise ReadError(f"the file is not a readable USD file: {_reason(error)}") from error
    if not stage:
        raise ReadError("the file is not a readable USD file")
    with contextlib.suppress(Tf.ErrorException):
        stage.Reload()  # USD caches layers in memory, but the file may have changed
    for error in stage.GetCompositionErrors():
        raise ReadError(f"the layers of the stage cannot be composed: {str(error).strip()[:200]}")
    return stage


@contextlib.contextmanager
def _evaluating() -> Iterator[None]:
    try:
        yield
    except (Tf.ErrorException, RuntimeError) as error:
        raise ReadError(f"the stage cannot be evaluated: {_reason(error)}") from error


def _reason(error: Exception) -> str:
    """Return the first reason in the message of a USD error, without the location in USD's source code."""
    text = str(error)
    match = _SAID.search(text)
    if match:
        return re.sub(r"parse error matching \S*pxr\S* ", "syntax error ", match[1].strip())[:200]
    lines = text.strip().splitlines()
    if not lines:
        return "unknown format"
    return lines[-1].strip()[:200]


def _is_body(prim: Usd.Prim) -> bool:
    if not prim.HasAPI(UsdPhysics.RigidBodyAPI):
        return False
    return UsdPhysics.RigidBodyAPI(prim).GetRigidBodyEnabledAttr().Get() is not False


def _sampled(prim: Usd.Prim) -> bool:
    return UsdGeom.Xformable(prim).TransformMightBeTimeVarying()


def _codes(prim: Usd.Prim) -> list[float]:
    """Return the time codes at which a prim or one of its ancestors has samples."""
    codes: set[float] = set()
    while prim and not prim.IsPseudoRoot():
        if prim.IsA(UsdGeom.Xformable):
            codes.update(UsdGeom.Xformable(prim).GetTimeSamples())
        prim = prim.GetParent()
    return sorted(codes)


def _all_codes(prims: Iterable[Usd.Prim]) -> Array:
    """Return the time codes (k,) at which one of the prims or of their ancestors has samples."""
    codes: set[float] = set()
    for prim in prims:
        codes.update(_codes(prim))
    return np.array(sorted(codes))


def _assumed(stage: Usd.Stage) -> dict[str, str]:
    """Return {name: reason} for the assumed numbers of a stage."""
    root = stage.GetDefaultPrim()
    if not root:
        return {}
    parameters = root.GetCustomDataByKey("twin:parameters") or {}
    reasons = {}
    for name, parameter in parameters.items():
        if parameter.get("provenance") == "ASSUMED":
            reasons[name] = str(parameter.get("note", ""))
    return reasons


def _check_cones(stage: Usd.Stage, mechanism: FileMechanism, ledger: Ledger) -> None:
    """Compare the cones of ball joints with the parameters "<joint>,<joint> cone" that the stage itself lists."""
    listed: dict[str, float] = {}
    for parameter, row in _custom_data(stage, "twin:parameters").items():
        joints, _, field = str(parameter).rpartition(" ")
        if field == "cone" and "value" in row:
            for joint_name in joints.split(","):
                listed[joint_name] = float(row["value"])
    for joint in mechanism.joints:
        name = " ".join(joint.names)
        if name not in listed or joint.drive.cone is None:
            continue
        expected = listed[name]
        stated = max(joint.drive.cone, key=lambda half_angle: abs(half_angle - expected))
        if not abs(stated - expected) < _CONE_TOL:
            difference_text = f"{stated * 180 / np.pi:.6g} deg, but its parameter is {expected * 180 / np.pi:.6g} deg"
            text = f"joint '{name}' has a cone of {difference_text}."
            ledger.wrong("usd.cone", text, name, suggestion="export the stage again")


def _custom_data(stage: Usd.Stage, key: str) -> JsonObject:
    """Return an entry of the customData of the default prim; {} without one."""
    root = stage.GetDefaultPrim()
    if not root:
        return {}
    return root.GetCustomDataByKey(key) or {}


def _check_couplings(stage: Usd.Stage, mechanism: FileMechanism, ledger: Ledger) -> None:
    """Compare the couplings that the stage lists for twin with those that it states for physics engines."""
    listed: dict[str, tuple[dict[str, float], float]] = {}
    for name, coupling in _custom_data(stage, "twin:couplings").items():
        listed[name] = (dict(coupling["ratios"]), float(coupling["total"]))
    stated = mechanism.couplings or {}
    if len(listed) != len(stated):  # engines cannot hold every coupling
        return
    for_engines = solved(stated)
    for joint, (ratios, total) in solved(listed).items():
        others, other_total = for_engines.get(joint, ({}, 0.0))
        off = abs(total - other_total)
        for name in {*ratios, *others}:
            off = max(off, abs(ratios.get(name, 0.0) - others.get(name, 0.0)))
        if off > 1e-5:  # engines get single precision
            text = f"the coupling of joint '{joint}' in the list for twin is not that for physics engines."
            ledger.wrong("usd.coupling", text, joint, suggestion="export the stage again")


def _check_materials(prims: list[Usd.Prim], ledger: Ledger) -> None:
    """Report shapes that bind no material or cannot bind it, and materials without their shader."""
    bound: dict[Sdf.Path, UsdShade.Material] = {}
    for prim in prims:
        binding = prim.GetRelationship("material:binding")
        if not binding or not binding.HasAuthoredTargets():
            continue
        path = str(prim.GetPath())
        if not prim.HasAPI(UsdShade.MaterialBindingAPI):
            text = f"{path} binds a material without MaterialBindingAPI: strict readers show it grey."
            ledger.wrong("usd.material_api", text, path, suggestion="apply MaterialBindingAPI")
        for target in binding.GetTargets():
            material = prim.GetStage().GetPrimAtPath(target)
            if not material or not material.IsA(UsdShade.Material):
                text = f"{path} binds {target}, which is not a material."
                ledger.wrong("usd.material", text, path, suggestion="bind an existing material")
            else:
                bound.setdefault(target, UsdShade.Material(material))
    for target, material in bound.items():
        if _has_lost_shader(material):
            text = f"the material {target} has no shader: its surface is connected to nothing that the stage shows."
            ledger.wrong("usd.material", text, str(target), suggestion="define and activate the shader again")


def _has_lost_shader(material: UsdShade.Material) -> bool:
    """Return whether a material has shaders that its surface is not connected to, or is connected to a lost one.

    Lost are shaders that are not there, are inactive, or are classes. A material without shaders may be one of physics.
    """
    outputs = [*material.GetSurfaceOutputs(), *material.GetVolumeOutputs()]
    if not any(output.GetAttr().HasAuthoredConnections() for output in outputs):
        return any(child.IsA(UsdShade.Shader) for child in material.GetPrim().GetChildren())
    output = material.GetSurfaceOutput()
    if not output or not output.GetAttr().HasAuthoredConnections():
        return False
    shader, *_ = material.ComputeSurfaceSource()
    if not shader:
        return True
    prim = shader.GetPrim()
    return not prim.IsActive() or prim.IsAbstract()


def _check_stray(prims: list[Usd.Prim], bodies: Set[Sdf.Path], ledger: Ledger) -> None:
    """Report visible shapes that belong to no link, and shapes without a material if others have one."""
    shown = [prim for prim in prims if prim.IsA(UsdGeom.Gprim) and _is_for_display(prim)]
    colored = {prim.GetPath() for prim in shown if _has_material(prim)}
    for prim in shown:
        path = str(prim.GetPath())
        if bodies.isdisjoint(prim.GetPath().GetAncestorsRange()):
            text = f"the shape {path} belongs to no link: it stays in place while the robot moves."
            ledger.add("usd.stray", "warning", text, path, suggestion="move the shape below its link, or delete it")
        elif colored and prim.GetPath() not in colored:
            text = f"the shape {path} has no material, but {len(colored)} other shapes have one."
            ledger.add("usd.no_material", "warning", text, path, suggestion="bind the material again")


def _check_colliders(prims: list[Usd.Prim], ledger: Ledger) -> None:
    """Report colliders that are disabled while others of the stage are enabled."""
    enabled_count = 0
    disabled = []
    for prim in prims:
        if not prim.HasAPI(UsdPhysics.CollisionAPI):
            continue
        if UsdPhysics.CollisionAPI(prim).GetCollisionEnabledAttr().Get() is False:
            disabled.append(prim)
        else:
            enabled_count += 1
    if not enabled_count:  # a stage to look at, without contacts
        return
    for prim in disabled:
        path = str(prim.GetPath())
        text = f"the collider {path} is disabled, but {enabled_count} others are enabled."
        ledger.add("usd.collider", "warning", text, path, suggestion="enable the collider, or remove its CollisionAPI")


def _colliding(prims: list[Usd.Prim], links: Set[Sdf.Path]) -> dict[str, bool]:
    """Return {link: False} of the links that show a mesh whose collider is disabled, True of others that collide.

    Links whose shown meshes have disabled colliders may collide by simpler shapes, which are guides: such are True. A
    stage all of whose colliders are disabled states nothing: it is one to look at.
    """
    collides: dict[str, bool] = {}
    by_guides: set[str] = set()
    for prim in prims:
        if not prim.HasAPI(UsdPhysics.CollisionAPI):
            continue
        owner = _owner(prim, links)
        if owner is None:
            continue
        link = owner.GetName()
        is_enabled = UsdPhysics.CollisionAPI(prim).GetCollisionEnabledAttr().Get() is not False
        if is_enabled and not _is_for_display(prim):
            by_guides.add(link)
        collides[link] = collides.get(link, True) and is_enabled
    collides |= dict.fromkeys(by_guides, True)
    if not any(collides.values()):
        return {}
    return collides


def _has_shape(body: Usd.Prim, bodies: Set[Sdf.Path]) -> bool:
    """Return whether viewers show any shape of a body; shapes of bodies below it do not count."""
    prims = iter(Usd.PrimRange(body, Usd.TraverseInstanceProxies()))
    for prim in prims:
        if prim != body and prim.GetPath() in bodies:
            prims.PruneChildren()
            continue
        invisible = UsdGeom.Imageable(prim).ComputeVisibility() == UsdGeom.Tokens.invisible
        if prim.IsA(UsdGeom.Gprim) and _is_for_display(prim) and not invisible:
            return True
    return False


def _is_for_display(prim: Usd.Prim) -> bool:
    """Return whether viewers show a prim; they hide proxies and guides, such as colliders."""
    return UsdGeom.Imageable(prim).ComputePurpose() in ("default", "render")


def _has_material(prim: Usd.Prim) -> bool:
    """Return whether a material is bound to a shape, or to some of its faces."""
    if UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial()[0]:
        return True
    return prim.IsA(UsdGeom.Mesh) and bool(UsdGeom.Subset.GetAllGeomSubsets(UsdGeom.Mesh(prim)))


def _shapes(
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
        if not prim.IsA(UsdGeom.Mesh) or not _is_for_display(prim):
            continue
        if UsdGeom.Imageable(prim).ComputeVisibility() == UsdGeom.Tokens.invisible:
            continue
        mesh = _corners(UsdGeom.Mesh(prim))
        if mesh is None:
            continue
        vertices, triangles, normals = mesh
        owner = _owner(prim, links)
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


def _owner(mesh: Usd.Prim, links: Set[Sdf.Path] | None) -> Usd.Prim | None:
    """Return the link of a mesh: the mesh itself or a prim above it, see `_shapes`; None if it has none."""
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
        color = _constant(shader, "diffuseColor")
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


def _constant(shader: UsdShade.Shader, name: str) -> Any:
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
        corners = _fans(counts)
    if not len(corners):
        return None
    if mesh.GetOrientationAttr().Get() == UsdGeom.Tokens.leftHanded:
        corners = corners[:, [0, 2, 1]]
    triangles = indices[corners]
    return points, triangles, _normals(mesh, corners.ravel(), triangles.ravel())


def _fans(counts: Array) -> Array:
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


def _check_gaps(stage: Usd.Stage, world: StageWorld, bodies: list[Usd.Prim], codes: Array, ledger: Ledger) -> None:
    """Measure the gap between the two frames of every joint, at rest and along the motion."""
    if not bodies:
        return
    moments = ["at rest"]
    times = [Usd.TimeCode.Default()]
    for code in codes.tolist():
        moments.append(f"t = {code / stage.GetTimeCodesPerSecond():.4g} s")
        times.append(Usd.TimeCode(code))
    paths = [str(body.GetPath()) for body in bodies]
    placed = dict(zip(paths, world.placed(world.maps(bodies, times)), strict=True))
    worst = 0.0
    where = ""
    when = ""
    for path, gap in joint_gaps(stage, placed, world):
        worst_sample = int(np.argmax(gap))
        if gap[worst_sample] > worst:
            worst = float(gap[worst_sample])
            where = path
            when = moments[worst_sample]
    ledger.row("joint gap along the motion", worst, "m", GAP_TOL, where=where, when=when)
    if worst > GAP_TOL:
        ends = _ends_of_joint(stage.GetPrimAtPath(where))
        text = f"joint {where}: the joint frames on {ends} are {quantity(worst, 'm')} apart."
        ledger.wrong("usd.joint_gap", text, where, size=um(worst, GAP_TOL), when=when)


def _ends_of_joint(joint: Usd.Prim) -> str:
    """Return the names of the two bodies of a joint as text."""
    names = []
    for relationship in (UsdPhysics.Joint(joint).GetBody0Rel(), UsdPhysics.Joint(joint).GetBody1Rel()):
        targets = relationship.GetTargets()
        name = "the world"
        if targets:
            name = f"'{targets[0].name}'"
        names.append(name)
    return " and ".join(names)


def read(path: Path, ledger: Ledger, context: Context) -> Content:
    """Return the content of a stage, and report its faults; the size and the header are checked first.

    Raises:
        ReadError: the header is wrong, or OpenUSD cannot read the stage.
    """
    ledger.tool = "twin.exchange.audit on usd-core"
    ledger.version = version()
    check_size(path, "USD")
    return read_layer(path, ledger, context)


def read_layer(path: Path, ledger: Ledger, context: Context) -> Content:
    """Return the content of a stage or archive whose size has been checked; see `read`."""
    broken = trouble(path.read_bytes())
    if broken:
        raise ReadError(broken, "usd.header")
    if path not in context.admitted:
        admit(path)
    try:
        content = read_usd(path, ledger)
        check_usd(path, bool(content.extra["physics"]), ledger)
    except Tf.ErrorException as error:  # OpenUSD detects some faults only when it reads the data
        reason = str(error).strip().splitlines()[-1].strip()[:200]
        raise ReadError(f"OpenUSD cannot read the stage: {reason}") from error
    return content
