"""Check the general settings of prims and layers: units, time settings, transform ops and names."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from pxr import Sdf, Usd, UsdGeom, UsdPhysics

from twin.core.findings import Finding, Kind, Severity, disagreement, finding, warning
from twin.core.quantity import Quantity
from twin.usd.scan import RawStage

_VECTORS = ("double3", "float3", "half3")
_SCALARS = ("double", "float", "half")
OP_TYPES = {
    "translate": _VECTORS,
    "scale": _VECTORS,
    "orient": ("quatd", "quatf", "quath"),
    "transform": ("matrix4d",),
    **dict.fromkeys(("rotateX", "rotateY", "rotateZ"), _SCALARS),
    **dict.fromkeys(("rotateXYZ", "rotateXZY", "rotateYXZ", "rotateYZX", "rotateZXY", "rotateZYX"), _VECTORS),
    **dict.fromkeys(("translateX", "translateY", "translateZ"), _SCALARS),
    **dict.fromkeys(("scaleX", "scaleY", "scaleZ"), _SCALARS),
}
"""Value types that USD accepts for each kind of transform op; USD ignores ops of other types."""

SCALE_TOL = 1e-4
"""Maximum difference of a scale from 1 that is taken as a rounding error."""

LAYER_FIELDS = {
    "upAxis": "stage.layer_units",
    "metersPerUnit": "stage.layer_units",
    "kilogramsPerUnit": "stage.layer_units",
    "timeCodesPerSecond": "stage.frame_rate",
}
"""Metadata that must be equal in all layers, each with the code of the finding on unequal values."""


_DEFAULT_PRIM = Kind("stage.default_prim", "disagreement", "set defaultPrim to the root prim of the robot")
_FRAME_RATE = Kind(
    "stage.frame_rate", "disagreement", "author both entries with the same value", word="framesPerSecond"
)
_MIRRORED = Kind("stage.mirrored", "disagreement", "mirror the mesh points instead, and reverse the vertex order")
_XFORM_RESET = Kind(
    "stage.xform_reset", "warning", "remove !resetXformStack! and author the pose relative to the parent"
)
_DUPLICATE_NAME = Kind("stage.duplicate_name", "warning", "give each body and mesh a unique name")
_SCALE = Kind(
    "stage.scale",
    "disagreement",
    "scale the mesh points instead: engines disagree on scaled joint frames and masses",
    word="expected",
)
_NOT_FINITE = Kind("stage.not_finite", "disagreement", "author finite numbers in the transform ops")
_XFORM_TYPE = Kind("stage.xform_type", "disagreement", "author the op in the correct type")


def check_units(scene: RawStage) -> Iterator[Finding]:
    """Yield findings on the default prim, up axis, units and frame rates of the stage and its layers."""
    stage = scene.stage
    if not stage.GetDefaultPrim():
        yield _DEFAULT_PRIM("/", "no default prim: other stages cannot reference this stage")
    yield from _check_up_axis(stage)
    yield from _check_unit(
        "stage.meters_per_unit",
        "metersPerUnit",
        UsdGeom.StageHasAuthoredMetersPerUnit(stage),
        scene.meters,
        "0.01 (centimetres)",
    )
    yield from _check_unit(
        "stage.kilograms_per_unit",
        "kilogramsPerUnit",
        UsdPhysics.StageHasAuthoredKilogramsPerUnit(stage),
        scene.kilograms,
        "1",
    )
    codes = stage.GetTimeCodesPerSecond()
    frames = stage.GetFramesPerSecond()
    if codes != frames:
        ratio = codes / frames
        text = f"viewers that use framesPerSecond play the motion in {ratio:.3g} times the duration: timeCodesPerSecond"
        yield _FRAME_RATE("/", text, Quantity(codes, "1/s"), Quantity(frames, "1/s"))
    yield from _check_layers(scene)


def _check_up_axis(stage: Usd.Stage) -> Iterator[Finding]:
    severity: Severity = "disagreement"
    problem = "is not authored, so USD assumes Y"
    if stage.HasAuthoredMetadata("upAxis"):
        up = str(UsdGeom.GetStageUpAxis(stage))
        if up == "Z":
            return
        severity = "warning"
        problem = f"is {up}"
    yield finding(
        severity,
        "stage.up_axis",
        "/",
        f"upAxis {problem}; twin, Isaac Sim and Newton expect Z",
        suggestion='author upAxis = "Z" and rotate the geometry once',
    )


def _check_unit(code: str, name: str, authored: bool, value: float, default: str) -> Iterator[Finding]:
    """Yield a finding if the stage does not state the unit `name` as 1; `default` is the value that USD assumes."""
    severity: Severity = "disagreement"
    problem = f"is not authored, so USD assumes {default}"
    if authored:
        if value == 1:
            return
        severity = "warning"
        problem = f"is {value:g}"
    yield finding(
        severity,
        code,
        "/",
        f"{name} {problem}; USD references do not convert units: parts in another unit get wrong values",
        Quantity(value),
        1.0,
        f"author {name} = 1 and convert the numbers",
        word="",
    )


def _check_layers(scene: RawStage) -> Iterator[Finding]:
    """Compare the metadata of each used layer with the root layer: USD converts time, but not units, between layers."""
    root_layer = scene.stage.GetRootLayer()
    layers = []
    for layer in scene.stage.GetUsedLayers(includeClipLayers=False):
        if not layer.anonymous and layer != root_layer:
            layers.append(layer)
    layers.sort(key=lambda layer: layer.identifier)  # USD returns them in the order of their addresses in memory
    for layer in layers:
        layer_name = layer.GetDisplayName()
        for field, code in LAYER_FIELDS.items():
            if not layer.pseudoRoot.HasInfo(field) or not root_layer.pseudoRoot.HasInfo(field):
                continue
            in_root = root_layer.pseudoRoot.GetInfo(field)
            in_layer = layer.pseudoRoot.GetInfo(field)
            if in_root != in_layer:
                yield disagreement(
                    code,
                    layer_name,
                    f"layer {layer_name} has {field} {in_layer}, but the root layer has {in_root}",
                    suggestion="give all layers the same value: USD rescales times, but not units, between layers",
                )


def check_ops(scene: RawStage) -> Iterator[Finding]:
    """Yield findings on types and order of transform ops; with wrong ops, poses cannot be computed."""
    for prim in scene.prims:
        if prim.IsA(UsdGeom.Xformable):
            yield from _check_prim_ops(prim, str(prim.GetPath()) in scene.bodies)


def check_transforms(scene: RawStage) -> Iterator[Finding]:
    """Yield findings on transforms that are not finite, ignore their parents, are mirrored, or are scaled."""
    for prim in scene.prims:
        if not prim.IsA(UsdGeom.Xformable):
            continue
        path = str(prim.GetPath())
        is_body = path in scene.bodies
        yield from _check_reset(scene, prim)
        transform = scene.raw_transform(prim)
        if not np.isfinite(transform).all():
            # What is below the prim is displaced too; the first prim on the path says where to look.
            if not _has_transform_not_finite(scene, prim.GetParent()):
                yield _NOT_FINITE(path, f"{path}: a number of its transform is not finite: it has no place")
            continue
        axes = transform[:3, :3]
        size = np.linalg.norm(axes, axis=0)
        deviations = np.abs(size - 1)
        if np.linalg.det(axes) < 0 and (is_body or prim.IsA(UsdGeom.Gprim)):
            text = f"{path} is mirrored, so its faces are inside out: determinant of the transform"
            yield _MIRRORED(path, text, Quantity(np.linalg.det(axes)), 0.0)
        elif is_body and np.max(deviations) > SCALE_TOL:
            worst = size[np.argmax(deviations)]
            yield _SCALE(path, f"rigid body {path} is scaled", Quantity(worst), 1.0)


def _has_transform_not_finite(scene: RawStage, prim: Usd.Prim) -> bool:
    if prim.IsPseudoRoot() or not prim.IsA(UsdGeom.Xformable):
        return False
    return not np.isfinite(scene.raw_transform(prim)).all()


def _check_reset(scene: RawStage, prim: Usd.Prim) -> Iterator[Finding]:
    path = str(prim.GetPath())
    reset = UsdGeom.Xformable(prim).GetResetXformStack()
    if reset and prim.GetParent() and not prim.GetParent().IsPseudoRoot():
        parent = scene.raw_transform(prim.GetParent())
        # Below a parent without a transform, the reset changes nothing.
        if not np.allclose(parent, np.eye(4), atol=1e-9):
            yield _XFORM_RESET(
                path, f"{path} resets the transform stack, so it does not move with its parent, which has a transform"
            )


def _check_prim_ops(prim: Usd.Prim, is_body: bool) -> Iterator[Finding]:
    path = str(prim.GetPath())
    names = _op_order(prim)
    authored = set()
    for authored_attribute in prim.GetAuthoredAttributes():
        if authored_attribute.GetName().startswith("xformOp:"):
            authored.add(authored_attribute.GetName())
    for name in sorted(authored | set(names)):
        kind = name.split(":")[1]
        attribute = prim.GetAttribute(name)
        if name in names and not attribute:
            yield disagreement(
                "stage.xform_order",
                path,
                f"{path}: xformOpOrder names {name}, which does not exist",
                suggestion="author the op or remove it from xformOpOrder",
            )
        elif kind not in OP_TYPES or str(attribute.GetTypeName()) not in OP_TYPES[kind]:
            known_types = " or ".join(OP_TYPES.get(kind, ())) or "the type of a known op"
            yield _XFORM_TYPE(
                path,
                f"{path}: {name} has type {attribute.GetTypeName()}, expected {known_types}; readers ignore the op or "
                "fail",
            )
        elif name not in names:
            text = f"{path}: {name} has no effect, because it is not in xformOpOrder"
            yield disagreement("stage.xform_order", path, text, suggestion="list the op in xformOpOrder")
    # an op with a suffix, such as xformOp:translate:pivot, may stand anywhere
    rank = []
    for name in names:
        if name.count(":") == 1:
            rank.append(_rank(name))
    if is_body and rank != sorted(rank):
        text = (
            f"{path}: the order of the transform ops is {', '.join(names)}; in this order, a rotation or scale also "
            "transforms the ops after it"
        )
        yield warning("stage.xform_order", path, text, suggestion="list the ops in the order translate, orient, scale")


def _op_order(prim: Usd.Prim) -> list[str]:
    """Return the names of the transform ops in their order, without resets and without the mark of inverse ops."""
    names: list[str] = []
    for token in UsdGeom.Xformable(prim).GetXformOpOrderAttr().Get() or []:
        if token != "!resetXformStack!":
            names.append(str(token).removeprefix("!invert!"))
    return names


def _rank(name: str) -> int:
    """Return the position of an op in the usual order translate, rotate, scale."""
    kind = name.split(":")[1]
    if kind.startswith("translate"):
        return 0
    if kind.startswith("scale"):
        return 2
    return 1


def check_names(scene: RawStage) -> Iterator[Finding]:
    """Yield findings on bodies and meshes with equal leaf names, which Blender and Unity clips confuse."""
    first_paths: dict[str, Sdf.Path] = {}
    for prim in scene.prims:
        if not (str(prim.GetPath()) in scene.bodies or prim.IsA(UsdGeom.Mesh)):
            continue
        first = first_paths.setdefault(prim.GetName(), prim.GetPath())
        if first != prim.GetPath():
            text = (
                f"{prim.GetPath()} and {first} have the same leaf name: Blender renames one of them, and Unity clips "
                "may move the wrong one"
            )
            yield _DUPLICATE_NAME(str(prim.GetPath()), text)
