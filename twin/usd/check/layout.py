"""Units, time settings, transform ops and names: what every prim and layer is read by."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from pxr import Sdf, Usd, UsdGeom, UsdPhysics

from twin.core.findings import Finding
from twin.usd.scan import Scene

_VECTORS = ("double3", "float3", "half3")
_SCALARS = ("double", "float", "half")
OP_TYPES = {
    "translate": _VECTORS,
    "scale": _VECTORS,
    "orient": ("quatd", "quatf", "quath"),
    "transform": ("matrix4d",),
    **{f"rotate{a}": _SCALARS for a in "XYZ"},
    **{f"rotate{a}": _VECTORS for a in ("XYZ", "XZY", "YXZ", "YZX", "ZXY", "ZYX")},
    **{f"translate{a}": _SCALARS for a in "XYZ"},
    **{f"scale{a}": _SCALARS for a in "XYZ"},
}
"""Value types that USD accepts for each kind of transform op; it ignores others with a log line at most."""

SCALE_TOL = 1e-4
"""Relative deviation from unit scale that is still rounding."""

LAYER_FIELDS = {
    "upAxis": "stage.layer_units",
    "metersPerUnit": "stage.layer_units",
    "kilogramsPerUnit": "stage.layer_units",
    "timeCodesPerSecond": "stage.frame_rate",
}


def check_units(scene: Scene) -> Iterator[Finding]:
    """Yield findings on default prim, up axis, units and frame rates of the stage and its layers."""
    stage = scene.stage
    if not stage.GetDefaultPrim():
        yield Finding(
            "stage.default_prim",
            "disagreement",
            "no default prim: the stage cannot be referenced into another.",
            where="/",
            suggestion="set defaultPrim to the root prim of the robot",
        )
    up = str(UsdGeom.GetStageUpAxis(stage)) if stage.HasAuthoredMetadata("upAxis") else ""
    if up != "Z":
        said = f"is {up}" if up else "is not authored and means Y"
        yield Finding(
            "stage.up_axis",
            "warning" if up else "disagreement",
            f"upAxis {said}; twin, Isaac Sim and Newton expect Z.",
            where="/",
            suggestion='author upAxis = "Z" and turn the geometry once',
        )
    for code, name, authored, value, default in (
        (
            "stage.meters_per_unit",
            "metersPerUnit",
            UsdGeom.StageHasAuthoredMetersPerUnit(stage),
            scene.meters,
            "0.01: centimetres",
        ),
        (
            "stage.kilograms_per_unit",
            "kilogramsPerUnit",
            UsdPhysics.StageHasAuthoredKilogramsPerUnit(stage),
            scene.kilograms,
            "1",
        ),
    ):
        if not authored or value != 1:
            said = f"is {value:g}" if authored else f"is not authored and means {default}"
            yield Finding(
                code,
                "warning" if authored else "disagreement",
                f"{name} {said}; references never convert it, so that parts of another unit come out wrong.",
                where="/",
                size=float(value),
                limit=1.0,
                suggestion=f"author {name} = 1 and convert the numbers",
            )
    codes, frames = stage.GetTimeCodesPerSecond(), stage.GetFramesPerSecond()
    if codes != frames:
        yield Finding(
            "stage.frame_rate",
            "disagreement",
            f"timeCodesPerSecond {codes:g} and framesPerSecond {frames:g} differ: viewers use either, so "
            f"that the motion plays {codes / frames:.3g} times as long in some.",
            where="/",
            size=codes,
            unit="1/s",
            limit=frames,
            suggestion="author both alike",
        )
    yield from _check_layers(scene)


def _check_layers(scene: Scene) -> Iterator[Finding]:
    """Compare what each used layer says of itself with the root layer: USD converts none of it but time."""
    root = scene.stage.GetRootLayer().pseudoRoot
    for layer in scene.stage.GetUsedLayers(includeClipLayers=False):
        if layer.anonymous or layer == scene.stage.GetRootLayer():
            continue
        for field, code in LAYER_FIELDS.items():
            if not layer.pseudoRoot.HasInfo(field) or not root.HasInfo(field):
                continue
            mine, its = root.GetInfo(field), layer.pseudoRoot.GetInfo(field)
            if mine != its:
                yield Finding(
                    code,
                    "disagreement",
                    f"layer {layer.GetDisplayName()} has {field} {its}, the root layer {mine}.",
                    where=layer.GetDisplayName(),
                    suggestion="give all layers the same; nothing converts between them",
                )


def check_ops(scene: Scene) -> Iterator[Finding]:
    """Yield findings on types and order of transform ops; without them there are no poses."""
    for prim in scene.prims:
        if prim.IsA(UsdGeom.Xformable):
            yield from _check_prim_ops(prim, str(prim.GetPath()) in scene.bodies)


def check_transforms(scene: Scene) -> Iterator[Finding]:
    """Yield findings on reset stacks, and on mirrored and scaled transforms."""
    for prim in scene.prims:
        if not prim.IsA(UsdGeom.Xformable):
            continue
        is_body = str(prim.GetPath()) in scene.bodies
        yield from _check_reset(scene, prim)
        axes = scene.raw_transform(prim)[:3, :3]
        size = np.linalg.norm(axes, axis=0)
        if np.linalg.det(axes) < 0 and (is_body or prim.IsA(UsdGeom.Gprim)):
            yield Finding(
                "stage.mirrored",
                "disagreement",
                f"{prim.GetPath()} is mirrored (determinant {np.linalg.det(axes):.3g}): "
                "no rotation of a rigid body, and faces turn inside out.",
                where=str(prim.GetPath()),
                size=float(np.linalg.det(axes)),
                limit=0.0,
                suggestion="mirror the points of the mesh and turn its faces round",
            )
        elif is_body and np.max(np.abs(size - 1)) > SCALE_TOL:
            yield Finding(
                "stage.scale",
                "disagreement",
                f"rigid body {prim.GetPath()} is scaled by {size[0]:.5g}, {size[1]:.5g}, {size[2]:.5g}; "
                "engines differ in what that does to joint frames and masses.",
                where=str(prim.GetPath()),
                size=float(size[np.argmax(np.abs(size - 1))]),
                limit=1.0,
                suggestion="scale the mesh points instead",
            )


def _check_reset(scene: Scene, prim: Usd.Prim) -> Iterator[Finding]:
    path = str(prim.GetPath())
    reset = UsdGeom.Xformable(prim).GetResetXformStack()
    if reset and prim.GetParent() and not prim.GetParent().IsPseudoRoot():
        parent = scene.raw_transform(prim.GetParent())
        if not np.allclose(parent, np.eye(4), atol=1e-9):
            yield Finding(
                "stage.xform_reset",
                "warning",
                f"{path} resets the transform stack below a moved parent: it stays where it is when the parent moves.",
                where=path,
                suggestion="drop !resetXformStack! and author the pose relative to the parent",
            )


def _check_prim_ops(prim: Usd.Prim, is_body: bool) -> Iterator[Finding]:
    path = str(prim.GetPath())
    order = [str(t) for t in UsdGeom.Xformable(prim).GetXformOpOrderAttr().Get() or []]
    names = [t.removeprefix("!invert!") for t in order if t != "!resetXformStack!"]
    authored = [a.GetName() for a in prim.GetAuthoredAttributes() if a.GetName().startswith("xformOp:")]
    for name in sorted(set(authored) | set(names)):
        kind = name.split(":")[1]
        attribute = prim.GetAttribute(name)
        if name in names and not attribute:
            yield Finding(
                "stage.xform_order",
                "disagreement",
                f"{path}: xformOpOrder names {name}, which does not exist.",
                where=path,
                suggestion="author the op or take it out of xformOpOrder",
            )
        elif kind not in OP_TYPES or str(attribute.GetTypeName()) not in OP_TYPES[kind]:
            known = " or ".join(OP_TYPES.get(kind, ())) or "one of an op that exists"
            yield Finding(
                "stage.xform_type",
                "disagreement",
                f"{path}: {name} is of type {attribute.GetTypeName()}, not {known}; readers leave it out, or fail.",
                where=path,
                suggestion="author it in the right type",
            )
        elif name not in names:
            yield Finding(
                "stage.xform_order",
                "disagreement",
                f"{path}: {name} is not in xformOpOrder and has no effect.",
                where=path,
                suggestion="list it in xformOpOrder",
            )
    rank = [_rank(n) for n in names if n.count(":") == 1]
    if is_body and rank != sorted(rank):
        yield Finding(
            "stage.xform_order",
            "warning",
            f"{path}: ops come as {', '.join(names)}; a turn before the translation turns that too.",
            where=path,
            suggestion="order them translate, orient",
        )


def _rank(name: str) -> int:
    """Return the place of an op in the usual order translate, rotate, scale."""
    kind = name.split(":")[1]
    return 0 if kind.startswith("translate") else 2 if kind.startswith("scale") else 1


def check_names(scene: Scene) -> Iterator[Finding]:
    """Yield findings on equal leaf names of bodies and meshes, which Blender and Unity clips mix up."""
    seen: dict[str, Sdf.Path] = {}
    for prim in scene.prims:
        if not (str(prim.GetPath()) in scene.bodies or prim.IsA(UsdGeom.Mesh)):
            continue
        first = seen.setdefault(prim.GetName(), prim.GetPath())
        if first != prim.GetPath():
            yield Finding(
                "stage.duplicate_name",
                "warning",
                f"{prim.GetPath()} and {first} share a leaf name: Blender renames one, and Unity clips move "
                "the wrong one.",
                where=str(prim.GetPath()),
                suggestion="give each body and mesh a name of its own",
            )
