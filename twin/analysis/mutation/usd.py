"""Seed faults into a written stage and its motion; each fault changes an attribute, in the layer that defines it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from pxr import Gf, Usd, UsdGeom, UsdPhysics

from twin.analysis.mutation.fault import Fault, drawn, some
from twin.core.units import DEG, MM

KINDS = (
    *("joint frame", "drive unit", "time samples", "inertia", "joint frame", "units", "loop joint", "limits"),
    *("body", "quaternion", "mesh", "rest pose", "time codes", "axis"),
)
"""Kinds of faults in the order of seeding."""

Edit = Callable[[Usd.Stage], None]
Made = tuple[str, Edit]


def faults(root: Path, rng: np.random.Generator, count: int) -> Iterator[Fault]:
    """Yield faults of a stage; `root` is the layer with the motion or, without motion, the robot's root layer."""
    stage = Usd.Stage.Open(str(root))
    for kind, (what, edit) in drawn(KINDS, _MAKERS, stage, rng, count):
        yield Fault("usd", kind, what, stage=_spoiler(root.name, edit))


def _spoiler(name: str, edit: Edit) -> Callable[[Path], None]:
    def spoil(folder: Path) -> None:
        stage = Usd.Stage.Open(str(folder / name))
        edit(stage)
        for layer in stage.GetUsedLayers():
            if layer.dirty and not layer.anonymous:
                layer.Save()

    return spoil


def _set(stage: Usd.Stage, path: str, value: object, code: float | None = None) -> None:
    """Set an attribute on the layer that currently defines its value."""
    attribute = stage.GetAttributeAtPath(path)
    stage.SetEditTarget(Usd.EditTarget(attribute.GetPropertyStack(Usd.TimeCode.Default())[0].layer))
    attribute.Set(value, Usd.TimeCode.Default() if code is None else code)


def _changed(path: str, change: Callable[[Any], object]) -> Edit:
    """Return the edit that replaces the value of an attribute by `change` of this value."""
    return lambda stage: _set(stage, path, change(stage.GetAttributeAtPath(path).Get()))


def _times(path: str, factor: float) -> Made:
    return f"{path} times {factor:.4g}", _changed(path, lambda x: factor * x)


def _joints(stage: Usd.Stage, kind: type = UsdPhysics.Joint) -> list[Usd.Prim]:
    """Return all joints of type `kind` that connect two bodies, except fixed joints."""
    found = [p for p in stage.Traverse() if p.IsA(kind) and UsdPhysics.Joint(p).GetBody0Rel().GetTargets()]
    return [p for p in found if p.GetName() not in ("root_joint", "world") and not p.IsA(UsdPhysics.FixedJoint)]


def _bodies(stage: Usd.Stage) -> list[Usd.Prim]:
    return [p for p in stage.Traverse() if p.HasAPI(UsdPhysics.RigidBodyAPI)]


def _frame(stage: Usd.Stage, rng: np.random.Generator) -> Made:
    joint, side = str(some(_joints(stage), rng).GetPath()), int(rng.integers(2))
    if rng.integers(2):
        size, direction = rng.uniform(0.1, 1.0) * MM, rng.normal(size=3)
        step = Gf.Vec3f(*(size * direction / np.linalg.norm(direction)).tolist())
        path = f"{joint}.physics:localPos{side}"
        return f"{path} moved by {size / MM:.2f} mm", _changed(path, lambda x: x + step)
    size, axis = rng.uniform(0.1, 1.0), rng.normal(size=3)
    turn = Gf.Quatf(Gf.Rotation(Gf.Vec3d(*axis.tolist()), size).GetQuat())
    path = f"{joint}.physics:localRot{side}"
    return f"{path} turned by {size:.2f} deg", _changed(path, lambda x: (x * turn).GetNormalized())


def _drive(stage: Usd.Stage, rng: np.random.Generator) -> Made:
    names = ("physics:stiffness", "physics:damping", "physics:maxForce")
    found = [
        (p, a.GetName())
        for p in _joints(stage)
        for a in p.GetAuthoredAttributes()
        if a.GetName().startswith("drive:") and a.GetName().endswith(names) and a.Get()
    ]
    prim, name = some(found, rng)
    return _times(
        f"{prim.GetPath()}.{name}",
        float(some((180 / np.pi, np.pi / 180) if ":angular:" in name else (1000.0, 1e-3), rng)),
    )


def _sampled(stage: Usd.Stage) -> list[Usd.Attribute]:
    """Return the attributes of moving bodies that have time samples."""
    found = []
    for body in _bodies(stage):
        for a in body.GetAuthoredAttributes():
            codes = a.GetTimeSamples() if a.GetName().startswith("xformOp") else []
            if len(codes) > 8 and not np.allclose(_numbers(a.Get(codes[0])), _numbers(a.Get(codes[len(codes) // 3]))):
                found.append(a)
    return found


def _numbers(value) -> list[float]:
    return [*value] if isinstance(value, Gf.Vec3d | Gf.Vec3f) else [value.GetReal(), *value.GetImaginary()]


def _samples(stage: Usd.Stage, rng: np.random.Generator) -> Made:
    found = _sampled(stage)
    if not found:
        return _inertia(stage, rng)
    path, lag = str(some(found, rng).GetPath()), int(rng.integers(1, 12))

    def shift(s: Usd.Stage) -> None:
        attribute = s.GetAttributeAtPath(path)
        codes = attribute.GetTimeSamples()
        values = [attribute.Get(c) for c in codes]
        for k, code in enumerate(codes):
            _sample(s, path, values[max(k - lag, 0)], code)

    return f"samples of {path} delayed by {lag} time codes", shift


def _sample(stage: Usd.Stage, path: str, value: object, code: float) -> None:
    layer = next(
        x.layer for x in stage.GetAttributeAtPath(path).GetPropertyStack(Usd.TimeCode(code)) if x.HasInfo("timeSamples")
    )
    layer.SetTimeSample(path, code, value)


def _inertia(stage: Usd.Stage, rng: np.random.Generator) -> Made:
    body = str(some([b for b in _bodies(stage) if UsdPhysics.MassAPI(b).GetMassAttr().Get()], rng).GetPath())
    what = some(("mass", "turned", "unit", "centre"), rng)
    if what == "mass":
        return _times(f"{body}.physics:mass", float(some((10.0, 0.1, 1000.0, 1.5), rng)))
    if what == "centre":
        path = f"{body}.physics:centerOfMass"
        return f"{path} moved by 54 mm", _changed(path, lambda x: x + Gf.Vec3f(0.02, 0.03, -0.04))
    path = f"{body}.physics:diagonalInertia"
    if what == "unit":
        return f"{path} in kg mm2", _changed(path, lambda x: 1e6 * x)

    def turned(x: Gf.Vec3f) -> Gf.Vec3f:
        low, high = sorted(range(3), key=lambda i: x[i])[::2]
        y = Gf.Vec3f(x)
        y[low], y[high] = x[high], x[low]
        return y

    return f"{path} with its largest and smallest value exchanged", _changed(path, turned)


def _units(stage: Usd.Stage, rng: np.random.Generator) -> Made:
    name, value = some(
        (("metersPerUnit", 0.01), ("metersPerUnit", 0.001), ("upAxis", "Y"), ("kilogramsPerUnit", 0.001)), rng
    )
    return f"{name} = {value}", _stated(name, value)


def _stated(name: str, value: object) -> Edit:
    """Return the edit that sets a metadata value in all layers, as a faulty converter would."""

    def spoil(s: Usd.Stage) -> None:
        for layer in s.GetUsedLayers():
            if not layer.anonymous and layer.pseudoRoot.HasInfo(name):
                layer.pseudoRoot.SetInfo(name, value)
                if name == "timeCodesPerSecond":
                    layer.pseudoRoot.SetInfo("framesPerSecond", value)

    return spoil


def _loop(stage: Usd.Stage, rng: np.random.Generator) -> Made:
    closing = [p for p in _joints(stage) if UsdPhysics.Joint(p).GetExcludeFromArticulationAttr().Get()]
    joint = some(closing or _joints(stage), rng)
    path = str(joint.GetPath())
    if closing and rng.integers(3) == 0:
        name = f"{path}.physics:excludeFromArticulation"
        return f"{name} false", lambda s: _set(s, name, False)

    def drop(s: Usd.Stage) -> None:
        for layer in s.GetUsedLayers():
            spec = layer.GetPrimAtPath(path)
            if spec is not None:
                del spec.nameParent.nameChildren[spec.name]

    return f"joint {path} missing", drop


def _limits(stage: Usd.Stage, rng: np.random.Generator) -> Made:
    found = [
        (p, a)
        for p in _joints(stage)
        for a in ("physics:lowerLimit", "physics:upperLimit")
        if p.GetAttribute(a)
        and p.GetAttribute(a).HasAuthoredValue()
        and abs(p.GetAttribute(a).Get()) > 1e-9
        and np.isfinite(p.GetAttribute(a).Get())
    ]
    if not found:
        return _frame(stage, rng)
    prim, name = some(found, rng)
    factor = float(some((DEG, 1 / DEG) if prim.IsA(UsdPhysics.RevoluteJoint) else (1000.0, 0.001), rng))
    return _times(f"{prim.GetPath()}.{name}", factor)


def _body(stage: Usd.Stage, rng: np.random.Generator) -> Made:
    joint = some(_joints(stage), rng)
    path, now = str(joint.GetPath()), UsdPhysics.Joint(joint).GetBody1Rel().GetTargets()[0]
    keep = {now, *UsdPhysics.Joint(joint).GetBody0Rel().GetTargets()}
    other = str(some([b.GetPath() for b in _bodies(stage) if b.GetPath() not in keep], rng))

    def change(s: Usd.Stage) -> None:
        relation = UsdPhysics.Joint(s.GetPrimAtPath(path)).GetBody1Rel()
        s.SetEditTarget(Usd.EditTarget(relation.GetPropertyStack()[0].layer))
        relation.SetTargets([other])

    return f"{path} points to {other} instead of {now.name}", change


def _quaternion(stage: Usd.Stage, rng: np.random.Generator) -> Made:
    found = [
        (p, s)
        for p in _joints(stage)
        for s in (0, 1)
        if len({round(abs(x), 4) for x in _numbers(p.GetAttribute(f"physics:localRot{s}").Get())}) > 2
    ]
    if not found:
        return _frame(stage, rng)
    prim, side = some(found, rng)
    path = f"{prim.GetPath()}.physics:localRot{side}"

    def turned(quat: Gf.Quatf) -> Gf.Quatf:
        w, x, y, z = _numbers(quat)
        return Gf.Quatf(x, Gf.Vec3f(y, z, w))

    return f"{path} read as x y z w", _changed(path, turned)


def _mesh(stage: Usd.Stage, rng: np.random.Generator) -> Made:
    path = str(some([p for p in stage.Traverse() if p.IsA(UsdGeom.Mesh)], rng).GetPath())
    if rng.integers(2):
        name = f"{path}.points"
        return f"{name} in mm", _changed(name, lambda points: type(points)([1000 * p for p in points]))
    return f"{path} turned inside out", _changed(f"{path}.faceVertexIndices", lambda x: type(x)([*x][::-1]))


def _rest(stage: Usd.Stage, rng: np.random.Generator) -> Made:
    found = [
        a
        for b in _bodies(stage)
        for a in b.GetAuthoredAttributes()
        if a.GetName().startswith("xformOp:translate") and _moves(stage, b)
    ]
    path, size = str(some(found, rng).GetPath()), rng.uniform(0.2, 2.0) * MM

    def move(s: Usd.Stage) -> None:
        attribute = s.GetAttributeAtPath(path)
        stack = attribute.GetPropertyStack(Usd.TimeCode.Default())
        layer = next(x.layer for x in stack if x.HasInfo("default"))
        spec = layer.GetAttributeAtPath(path)
        spec.default = spec.default + type(spec.default)(0, size, 0)

    return f"{path} at rest moved by {size / MM:.2f} mm", move


def _moves(stage: Usd.Stage, body: Usd.Prim) -> bool:
    return any(body.GetPath() in UsdPhysics.Joint(j).GetBody1Rel().GetTargets() for j in _joints(stage))


def _codes(stage: Usd.Stage, rng: np.random.Generator) -> Made:
    end = stage.GetEndTimeCode()
    name, value = some(
        (("timeCodesPerSecond", 24.0), ("endTimeCode", round(0.7 * end)), ("timeCodesPerSecond", 30.0)), rng
    )
    return f"{name} = {value:g}", _stated(name, value)


def _axis(stage: Usd.Stage, rng: np.random.Generator) -> Made:
    single = [p for p in _joints(stage) if p.IsA(UsdPhysics.RevoluteJoint) or p.IsA(UsdPhysics.PrismaticJoint)]
    path = f"{some(single, rng).GetPath()}.physics:axis"
    value = some(("X", "Y"), rng)
    return f"{path} = {value}", lambda s: _set(s, path, value)


_MAKERS: dict[str, Callable[[Usd.Stage, np.random.Generator], Made]] = {
    "joint frame": _frame,
    "drive unit": _drive,
    "time samples": _samples,
    "inertia": _inertia,
    "units": _units,
    "loop joint": _loop,
    "limits": _limits,
    "body": _body,
    "quaternion": _quaternion,
    "mesh": _mesh,
    "rest pose": _rest,
    "time codes": _codes,
    "axis": _axis,
}
