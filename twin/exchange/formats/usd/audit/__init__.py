"""Read a USD stage: link poses at its time samples, joint values, meshes, joint gaps.

Poses are read with OpenUSD (pxr) directly, without `twin.usd`. Findings of the stage checker `twin.usd.check` are
included; the checker is also independent of the writer.
"""

from __future__ import annotations

import contextlib
import re
from collections.abc import Iterator, Sequence, Set
from pathlib import Path

import numpy as np
from pxr import Sdf, Tf, Usd, UsdGeom, UsdPhysics, UsdShade

from twin.core.foreign.admit import admit
from twin.core.foreign.budget import check_size
from twin.exchange.audit import poses
from twin.exchange.audit.colors import Palette, Rgba
from twin.exchange.audit.context import Context
from twin.exchange.audit.meshes import check_mesh, joined
from twin.exchange.audit.motion import Content, FileClip, LinkShape, check_poses
from twin.exchange.audit.poses import Array
from twin.exchange.audit.report import Ledger, Measured, ReadError, quantity, um
from twin.exchange.formats.usd.audit.checks import check_usd, version
from twin.exchange.formats.usd.audit.header import trouble
from twin.exchange.formats.usd.audit.joints import joint_gaps, joint_values
from twin.exchange.formats.usd.audit.physics import stage_physics

GAP_TOL = 1e-5
"""Maximum gap in m between the two frames of a joint; UsdPhysics stores the frames in single precision."""


def read_usd(path: Path, ledger: Ledger) -> Content:
    """Return the content of a stage, and report faults of its materials, meshes and joints.

    Raises:
        ReadError: the file is not a stage, or a layer is missing.
    """
    stage = _open(path)
    with _evaluating():
        return _read(stage, path, ledger)


def _read(stage: Usd.Stage, path: Path, ledger: Ledger) -> Content:
    prims = [p for p in stage.Traverse(Usd.TraverseInstanceProxies()) if p.IsA(UsdGeom.Xformable)]
    bodies = [p for p in prims if _is_body(p)]
    world = StageWorld(stage)
    out = Content(ledger, path.suffix.lstrip(".").lower())
    out.declared = tuple(p.GetName() for p in bodies) or None
    codes_s, frames_s = stage.GetTimeCodesPerSecond(), stage.GetFramesPerSecond()
    out.facts = {
        "units": f"{world.meters:g} m" + ("" if UsdGeom.StageHasAuthoredMetersPerUnit(stage) else " (not authored)"),
        "up_axis": world.up + ("" if stage.HasAuthoredMetadata("upAxis") else " (not authored)"),
        "handedness": "right (USD)",
        "time_codes_per_second": codes_s,
        "frames_per_second": frames_s,
    }
    out.extra["physics"] = bool(bodies)
    shown: dict[str, Usd.Prim] = {}
    # If several prims have the same name, use the prim that moves.
    for prim in bodies or sorted(prims, key=lambda p: not _sampled(p)):
        shown.setdefault(prim.GetName(), prim)
    out.rest = {name: world.poses(prim, [Usd.TimeCode.Default()])[0] for name, prim in shown.items()}
    codes = np.unique([c for p in shown.values() for c in _codes(p)])
    if len(codes):
        start = stage.GetStartTimeCode() if stage.HasAuthoredTimeCodeRange() else 0.0
        links = world.along(shown, codes)
        clip = FileClip(path.stem, (codes - start) / codes_s, links, joint_values(stage, codes, world.meters))
        check_poses(ledger, clip, "usd")
        out.clips.append(clip)
    _check_materials(prims, ledger)
    if bodies:
        _check_stray(prims, {p.GetPath() for p in bodies}, ledger)
    out.shapes, out.colors = _shapes(prims, {p.GetPath() for p in shown.values()} if bodies else None, world, ledger)
    if bodies:
        out.physics = stage_physics(stage, bodies, world.meters, world.up)
    out.extra["assumed"] = _assumed(stage)
    _check_gaps(stage, world, bodies, codes, codes_s, ledger)
    return out


class StageWorld:
    """Conversion of a stage's poses to a world frame in metres with z up."""

    def __init__(self, stage: Usd.Stage) -> None:
        self.meters = float(UsdGeom.GetStageMetersPerUnit(stage))
        self.up = str(UsdGeom.GetStageUpAxis(stage))
        self._R = poses.R_Z_UP_Y_UP if self.up == "Y" else np.eye(3)
        self._cache = UsdGeom.XformCache()

    def maps(self, prims: Sequence[Usd.Prim], codes: Sequence[Usd.TimeCode]) -> Array:
        """Return T_stage_prim (n, k, 4, 4) of n prims at k time codes, with scale, in the stage's units and axes."""
        out = np.zeros((len(prims), len(codes), 4, 4))
        for k, code in enumerate(codes):  # time is the outer loop, because SetTime clears the cache
            self._cache.SetTime(code)
            for i, prim in enumerate(prims):
                out[i, k] = self._cache.GetLocalToWorldTransform(prim)
        return np.swapaxes(out, -1, -2)  # Gf matrices act on row vectors

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
        times = [Usd.TimeCode(c) for c in codes.tolist()]
        moving = {n: p for n, p in prims.items() if _codes(p)}
        moved = dict(zip(moving, self.placed(self.maps(list(moving.values()), times)), strict=True))
        shape = (len(codes), 4, 4)
        still = (n for n in prims if n not in moving)
        moved |= {n: np.broadcast_to(self.poses(prims[n], times[:1]), shape) for n in still}
        return {name: moved[name] for name in prims}


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
    if found := _SAID.search(text):
        return re.sub(r"parse error matching \S*pxr\S* ", "syntax error ", found[1].strip())[:200]
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    return lines[-1][:200] if lines else "unknown format"


def _is_body(prim: Usd.Prim) -> bool:
    return prim.HasAPI(UsdPhysics.RigidBodyAPI) and (
        UsdPhysics.RigidBodyAPI(prim).GetRigidBodyEnabledAttr().Get() is not False
    )


def _sampled(prim: Usd.Prim) -> bool:
    return UsdGeom.Xformable(prim).TransformMightBeTimeVarying()


def _codes(prim: Usd.Prim) -> list[float]:
    """Return the time codes at which a prim or one of its ancestors has samples."""
    out: set[float] = set()
    while prim and not prim.IsPseudoRoot():
        if prim.IsA(UsdGeom.Xformable):
            out.update(UsdGeom.Xformable(prim).GetTimeSamples())
        prim = prim.GetParent()
    return sorted(out)


def _assumed(stage: Usd.Stage) -> dict[str, str]:
    """Return {name: reason} for the assumed numbers of a stage."""
    root = stage.GetDefaultPrim()
    told = root.GetCustomDataByKey("twin:parameters") if root else None
    return {n: str(p.get("note", "")) for n, p in (told or {}).items() if p.get("provenance") == "ASSUMED"}


def _check_materials(prims: list[Usd.Prim], ledger: Ledger) -> None:
    for prim in prims:
        binding = prim.GetRelationship("material:binding")
        if not binding or not binding.HasAuthoredTargets():
            continue
        path = str(prim.GetPath())
        if not prim.HasAPI(UsdShade.MaterialBindingAPI):
            text = f"{path} binds a material without MaterialBindingAPI: strict readers show it grey."
            ledger.wrong("usd.material_api", text, path, suggestion="apply MaterialBindingAPI")
        for target in binding.GetTargets():
            there = prim.GetStage().GetPrimAtPath(target)
            if not there or not there.IsA(UsdShade.Material):
                text = f"{path} binds {target}, which is not a material."
                ledger.wrong("usd.material", text, path, suggestion="bind an existing material")


def _check_stray(prims: list[Usd.Prim], bodies: Set[Sdf.Path], ledger: Ledger) -> None:
    """Report visible shapes that belong to no link, and shapes without a material if others have one."""
    shapes = [p for p in prims if p.IsA(UsdGeom.Gprim)]
    shown = [p for p in shapes if UsdGeom.Imageable(p).ComputePurpose() in ("default", "render")]
    colored = {p.GetPath() for p in shown if _has_material(p)}
    for prim in shown:
        path = str(prim.GetPath())
        if bodies.isdisjoint(prim.GetPath().GetAncestorsRange()):
            text = f"the shape {path} belongs to no link: it stays in place while the robot moves."
            ledger.add("usd.stray", "warning", text, path, suggestion="move the shape below its link, or delete it")
        elif colored and prim.GetPath() not in colored:
            text = f"the shape {path} has no material, but {len(colored)} other shapes have one."
            ledger.add("usd.no_material", "warning", text, path, suggestion="bind the material again")


def _has_material(prim: Usd.Prim) -> bool:
    """Return whether a material is bound to a shape, or to some of its faces."""
    if UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial()[0]:
        return True
    return prim.IsA(UsdGeom.Mesh) and bool(UsdGeom.Subset.GetAllGeomSubsets(UsdGeom.Mesh(prim)))


def _shapes(
    prims: list[Usd.Prim], links: set | None, world: StageWorld, ledger: Ledger
) -> tuple[dict[str, LinkShape], dict[str, dict[Rgba, float]]]:
    """Check all normals; return ({link: shape in the link's frame}, {link: {colour: fraction of area}})."""
    palette = Palette()
    found: dict[str, list[LinkShape]] = {}
    for prim in prims:
        if not prim.IsA(UsdGeom.Mesh) or UsdGeom.Imageable(prim).ComputePurpose() not in ("default", "render"):
            continue
        if UsdGeom.Imageable(prim).ComputeVisibility() == UsdGeom.Tokens.invisible:
            continue
        vertices, triangles, normals = _corners(UsdGeom.Mesh(prim))
        if not len(triangles):
            continue
        owner = prim if links is not None else prim.GetParent()
        while owner and links is not None and owner.GetPath() not in links:
            owner = owner.GetParent()
        here = Ledger("")
        path = str(prim.GetPath())
        if owner and not owner.IsPseudoRoot():
            M, N = world.maps([owner, prim], [Usd.TimeCode.Default()])[:, 0]
            T, _ = poses.split(M)
            relative = poses.inverse(T) @ N
            vertices = (vertices @ relative[:3, :3].T + relative[:3, 3]) * world.meters
            if normals is not None:
                turned = normals @ np.linalg.inv(relative[:3, :3])
                size = np.linalg.norm(turned, axis=1, keepdims=True)
                normals = turned / np.where(size > 0, size, 1.0) * np.linalg.norm(normals, axis=1, keepdims=True)
        shape = check_mesh(here, path, vertices, triangles, normals, "usd")
        for f in here.found:  # winding and indices are checked by the stage checker
            if f.code not in ("usd.winding", "usd.index"):
                ledger.add(f.code, f.severity, f.message, path, size=Measured(f.size, f.limit))
        if shape is not None and owner and not owner.IsPseudoRoot():
            found.setdefault(owner.GetName(), []).append(shape)
            if (rgba := _mesh_color(prim)) is not None:
                palette.add(owner.GetName(), rgba, shape.area)
    out = {name: joined(shapes) for name, shapes in found.items()}
    return {name: shape for name, shape in out.items() if shape is not None}, palette.shares()


def _mesh_color(prim: Usd.Prim) -> Rgba | None:
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


def _corners(mesh: UsdGeom.Mesh) -> tuple[Array, Array, Array | None]:
    """Return (points (n, 3), triangles (m, 3), corner normals (3 m, 3) or None); polygons are split into triangles."""
    nothing = np.zeros((0, 3)), np.zeros((0, 3), int), None
    points = np.array(mesh.GetPointsAttr().Get() or [], float).reshape(-1, 3)
    counts = np.array(mesh.GetFaceVertexCountsAttr().Get() or [], int)
    indices = np.array(mesh.GetFaceVertexIndicesAttr().Get() or [], int)
    if not len(counts) or counts.sum() != len(indices) or counts.min() < 0 or not len(points):
        return nothing
    if np.all(counts == 3):
        corners = np.arange(len(indices)).reshape(-1, 3)
    else:
        first = np.concatenate([[0], np.cumsum(counts)[:-1]])
        fans = [
            [f, f + i, f + i + 1] for f, n in zip(first.tolist(), counts.tolist(), strict=True) for i in range(1, n - 1)
        ]
        corners = np.array(fans, int).reshape(-1, 3)
    if mesh.GetOrientationAttr().Get() == UsdGeom.Tokens.leftHanded:
        corners = corners[:, [0, 2, 1]]
    triangles = indices[corners]
    return points, triangles, _normals(mesh, corners.ravel(), triangles.ravel())


def _normals(mesh: UsdGeom.Mesh, corners: Array, vertices: Array) -> Array | None:
    primvar = UsdGeom.PrimvarsAPI(mesh).GetPrimvar("normals")
    if primvar and primvar.HasValue():
        values, kind = primvar.ComputeFlattened(), primvar.GetInterpolation()
    else:
        values, kind = mesh.GetNormalsAttr().Get(), mesh.GetNormalsInterpolation()
    values = np.array(values if values is not None else [], float).reshape(-1, 3)
    index = {"faceVarying": corners, "vertex": vertices, "varying": vertices}.get(str(kind))
    if index is None or not len(values) or index.min() < 0 or index.max() >= len(values):
        return None
    return values[index]


def _check_gaps(
    stage: Usd.Stage, world: StageWorld, bodies: list[Usd.Prim], codes: Array, per_second: float, ledger: Ledger
) -> None:
    """Measure the gap between the two frames of every joint, at rest and along the motion."""
    times = [Usd.TimeCode.Default(), *(Usd.TimeCode(c) for c in codes.tolist())]
    placed = dict(zip((str(p.GetPath()) for p in bodies), world.placed(world.maps(bodies, times)), strict=True))
    worst, where, when = 0.0, "", ""
    for path, gap in joint_gaps(stage, placed, world):
        k = int(np.argmax(gap))
        if gap[k] > worst:
            worst, where = float(gap[k]), path
            when = "at rest" if not k else f"t = {codes[k - 1] / per_second:.4g} s"
    if placed:
        ledger.row("joint gap along the motion", worst, "m", GAP_TOL, where=where, when=when)
    if worst > GAP_TOL:
        text = f"joint {where}: the joint frames on the two bodies are {quantity(worst, 'm')} apart."
        ledger.wrong("usd.joint_gap", text, where, size=um(worst, GAP_TOL), when=when)


def read(path: Path, ledger: Ledger, context: Context) -> Content:
    """Return the content of a stage, and report its faults; the size and the header are checked first.

    Raises:
        ReadError: the header is wrong, or OpenUSD cannot read the stage.
    """
    ledger.tool, ledger.version = "twin.exchange.audit on usd-core", version()
    check_size(path, "USD")
    return read_layer(path, ledger, context)


def read_layer(path: Path, ledger: Ledger, context: Context) -> Content:
    """Return the content of a stage or archive whose size has been checked; see `read`."""
    if broken := trouble(path.read_bytes()):
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
