"""Seed faults into a written stage and its motion; each fault changes an attribute, in the layer that defines it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from pxr import Gf, Sdf, Usd, UsdGeom, UsdPhysics, Vt

from twin.analysis.mutation.fault import SeededFault, drawn, some
from twin.core.units import DEG, MM

KINDS = (
    *("joint frame", "drive unit", "time samples", "inertia", "joint frame", "units", "loop joint", "limits"),
    *("body", "quaternion", "mesh", "rest pose", "time codes", "axis"),
)
"""Kinds of faults in the order of seeding."""

Edit = Callable[[Usd.Stage], None]
Made = tuple[str, Edit]


def faults(root: Path, rng: np.random.Generator, count: int) -> Iterator[SeededFault]:
    """Yield faults of a stage; `root` is the layer with the motion or, without motion, the robot's root layer."""
    stage = Usd.Stage.Open(str(root))
    for kind, (what, edit) in drawn(KINDS, _MAKERS, subject=stage, rng=rng, count=count):
        yield SeededFault("usd", kind, what, stage=_spoiler(root.name, edit))


def _spoiler(name: str, edit: Edit) -> Callable[[Path], None]:
    def spoil(folder: Path) -> None:
        stage = Usd.Stage.Open(str(folder / name))
        edit(stage)
        for layer in stage.GetUsedLayers():
            if layer.dirty and not layer.anonymous:
                layer.Save()

    return spoil


def _set(stage: Usd.Stage, path: str, value: object) -> None:
    """Set an attribute on the layer that currently defines its value."""
    attribute = stage.GetAttributeAtPath(path)
    stack = attribute.GetPropertyStack(Usd.TimeCode.Default())
    stage.SetEditTarget(Usd.EditTarget(stack[0].layer))
    attribute.Set(value, Usd.TimeCode.Default())


def _changed(path: str, change: Callable[[Any], object]) -> Edit:
    """Return the edit that replaces the value of an attribute by `change` of this value."""
    return lambda stage: _set(stage, path, change(stage.GetAttributeAtPath(path).Get()))


def _times(path: str, factor: float) -> Made:
    return f"{path} times {factor:.4g}", _changed(path, lambda x: factor * x)


def _joints(stage: Usd.Stage, kind: type = UsdPhysics.Joint) -> list[Usd.Prim]:
    """Return all joints of type `kind` that connect two bodies, except fixed joints."""
    joints = []
    for prim in stage.Traverse():
        if not prim.IsA(kind) or prim.IsA(UsdPhysics.FixedJoint):
            continue
        if prim.GetName() in ("root_joint", "world"):
            continue
        if UsdPhysics.Joint(prim).GetBody0Rel().GetTargets():
            joints.append(prim)
    return joints


def _bodies(stage: Usd.Stage) -> list[Usd.Prim]:
    return [prim for prim in stage.Traverse() if prim.HasAPI(UsdPhysics.RigidBodyAPI)]


def _frame(stage: Usd.Stage, rng: np.random.Generator) -> Made:
    joint = str(some(_joints(stage), rng).GetPath())
    side = int(rng.integers(2))
    if rng.integers(2):
        size = rng.uniform(0.1, 1.0) * MM
        direction = rng.normal(size=3)
        shift = size * direction / np.linalg.norm(direction)
        step = Gf.Vec3f(*shift.tolist())
        path = f"{joint}.physics:localPos{side}"
        return f"{path} moved by {size / MM:.2f} mm", _changed(path, lambda x: x + step)
    angle = rng.uniform(0.1, 1.0)
    axis = Gf.Vec3d(*rng.normal(size=3).tolist())
    turn = Gf.Quatf(Gf.Rotation(axis, angle).GetQuat())
    path = f"{joint}.physics:localRot{side}"
    return f"{path} turned by {angle:.2f} deg", _changed(path, lambda x: (x * turn).GetNormalized())


_DRIVE_GAINS = ("physics:stiffness", "physics:damping", "physics:maxForce")


def _drive(stage: Usd.Stage, rng: np.random.Generator) -> Made:
    gains = []
    for joint in _joints(stage):
        for attribute in joint.GetAuthoredAttributes():
            name = attribute.GetName()
            if name.startswith("drive:") and name.endswith(_DRIVE_GAINS) and attribute.Get():
                gains.append(str(attribute.GetPath()))
    path = some(gains, rng)
    factors = (180 / np.pi, np.pi / 180) if ":angular:" in path else (1000.0, 1e-3)
    return _times(path, float(some(factors, rng)))


def _sampled(stage: Usd.Stage) -> list[Usd.Attribute]:
    """Return the attributes of moving bodies that have time samples."""
    sampled = []
    for body in _bodies(stage):
        for attribute in body.GetAuthoredAttributes():
            if not attribute.GetName().startswith("xformOp"):
                continue
            codes = attribute.GetTimeSamples()
            if len(codes) <= 8:
                continue
            # a third of the way: a motion that ends where it began differs there
            start = _numbers(attribute.Get(codes[0]))
            later = _numbers(attribute.Get(codes[len(codes) // 3]))
            if not np.allclose(start, later):
                sampled.append(attribute)
    return sampled


def _numbers(value: Gf.Vec3d | Gf.Vec3f | Gf.Quatd | Gf.Quatf) -> list[float]:
    if isinstance(value, Gf.Vec3d | Gf.Vec3f):
        return [*value]
    return [value.GetReal(), *value.GetImaginary()]


def _samples(stage: Usd.Stage, rng: np.random.Generator) -> Made:
    sampled = _sampled(stage)
    if not sampled:
        return _inertia(stage, rng)
    path = str(some(sampled, rng).GetPath())
    lag = int(rng.integers(1, 12))

    def shift(s: Usd.Stage) -> None:
        attribute = s.GetAttributeAtPath(path)
        codes = attribute.GetTimeSamples()
        values = [attribute.Get(code) for code in codes]
        for k, code in enumerate(codes):
            stack = attribute.GetPropertyStack(Usd.TimeCode(code))
            spec = _strongest(stack, "timeSamples")
            spec.layer.SetTimeSample(path, code, values[max(k - lag, 0)])

    return f"samples of {path} delayed by {lag} time codes", shift


def _strongest(stack: list[Sdf.PropertySpec], key: str) -> Sdf.PropertySpec:
    """Return the strongest specification of an attribute that has this key; one has it."""
    return next(spec for spec in stack if spec.HasInfo(key))


def _inertia(stage: Usd.Stage, rng: np.random.Generator) -> Made:
    massive = [body for body in _bodies(stage) if UsdPhysics.MassAPI(body).GetMassAttr().Get()]
    body = str(some(massive, rng).GetPath())
    what = some(("mass", "turned", "unit", "centre"), rng)
    if what == "mass":
        return _times(f"{body}.physics:mass", float(some((10.0, 0.1, 1000.0, 1.5), rng)))
    if what == "centre":
        path = f"{body}.physics:centerOfMass"
        return f"{path} moved by 54 mm", _changed(path, lambda x: x + Gf.Vec3f(0.02, 0.03, -0.04))
    path = f"{body}.physics:diagonalInertia"
    if what == "unit":
        return f"{path} in kg mm2", _changed(path, lambda x: 1e6 * x)

    def exchanged(moments: Gf.Vec3f) -> Gf.Vec3f:
        smallest, _, largest = sorted(range(3), key=lambda i: moments[i])
        changed = Gf.Vec3f(moments)
        changed[smallest] = moments[largest]
        changed[largest] = moments[smallest]
        return changed

    return f"{path} with its largest and smallest value exchanged", _changed(path, exchanged)


def _units(stage: Usd.Stage, rng: np.random.Generator) -> Made:
    choices = (("metersPerUnit", 0.01), ("metersPerUnit", 0.001), ("upAxis", "Y"), ("kilogramsPerUnit", 0.001))
    name, value = some(choices, rng)
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
    joints = _joints(stage)
    closing = [joint for joint in joints if UsdPhysics.Joint(joint).GetExcludeFromArticulationAttr().Get()]
    path = str(some(closing or joints, rng).GetPath())
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
    candidates = []
    for joint in _joints(stage):
        for name in ("physics:lowerLimit", "physics:upperLimit"):
            limit = joint.GetAttribute(name)
            if not limit or not limit.HasAuthoredValue():
                continue
            value = limit.Get()
            if abs(value) > 1e-9 and np.isfinite(value):  # a factor changes neither 0 nor infinity
                candidates.append((joint, name))
    if not candidates:
        return _frame(stage, rng)
    joint, name = some(candidates, rng)
    factors = (DEG, 1 / DEG) if joint.IsA(UsdPhysics.RevoluteJoint) else (1000.0, 0.001)
    return _times(f"{joint.GetPath()}.{name}", float(some(factors, rng)))


def _body(stage: Usd.Stage, rng: np.random.Generator) -> Made:
    prim = some(_joints(stage), rng)
    path = str(prim.GetPath())
    joint = UsdPhysics.Joint(prim)
    now = joint.GetBody1Rel().GetTargets()[0]
    connected = {now, *joint.GetBody0Rel().GetTargets()}
    others = [body.GetPath() for body in _bodies(stage) if body.GetPath() not in connected]
    other = str(some(others, rng))

    def change(s: Usd.Stage) -> None:
        relation = UsdPhysics.Joint(s.GetPrimAtPath(path)).GetBody1Rel()
        s.SetEditTarget(Usd.EditTarget(relation.GetPropertyStack()[0].layer))
        relation.SetTargets([other])

    return f"{path} points to {other} instead of {now.name}", change


def _quaternion(stage: Usd.Stage, rng: np.random.Generator) -> Made:
    paths = []
    for joint in _joints(stage):
        for side in (0, 1):
            rotation = joint.GetAttribute(f"physics:localRot{side}")
            magnitudes = {round(abs(x), 4) for x in _numbers(rotation.Get())}
            # With fewer different magnitudes, another order can give the same rotation.
            if len(magnitudes) > 2:
                paths.append(str(rotation.GetPath()))
    if not paths:
        return _frame(stage, rng)
    path = some(paths, rng)

    def reordered(quat: Gf.Quatf) -> Gf.Quatf:
        w, x, y, z = _numbers(quat)
        return Gf.Quatf(x, Gf.Vec3f(y, z, w))

    return f"{path} read as x y z w", _changed(path, reordered)


def _mesh(stage: Usd.Stage, rng: np.random.Generator) -> Made:
    meshes = [prim for prim in stage.Traverse() if prim.IsA(UsdGeom.Mesh)]
    path = str(some(meshes, rng).GetPath())
    if rng.integers(2):
        name = f"{path}.points"
        return f"{name} in mm", _changed(name, _in_millimetres)
    return f"{path} turned inside out", _changed(f"{path}.faceVertexIndices", _reversed)


def _in_millimetres(points: Vt.Vec3fArray) -> Vt.Vec3fArray:
    return type(points)([1000 * point for point in points])


def _reversed(indices: Vt.IntArray) -> Vt.IntArray:
    return type(indices)([*indices][::-1])


def _rest(stage: Usd.Stage, rng: np.random.Generator) -> Made:
    moved = set()
    for joint in _joints(stage):
        moved |= set(UsdPhysics.Joint(joint).GetBody1Rel().GetTargets())
    shifts = []
    for body in _bodies(stage):
        if body.GetPath() not in moved:
            continue
        for attribute in body.GetAuthoredAttributes():
            if attribute.GetName().startswith("xformOp:translate"):
                shifts.append(attribute)
    path = str(some(shifts, rng).GetPath())
    size = rng.uniform(0.2, 2.0) * MM

    def move(s: Usd.Stage) -> None:
        attribute = s.GetAttributeAtPath(path)
        stack = attribute.GetPropertyStack(Usd.TimeCode.Default())
        spec = _strongest(stack, "default").layer.GetAttributeAtPath(path)
        spec.default = spec.default + type(spec.default)(0, size, 0)

    return f"{path} at rest moved by {size / MM:.2f} mm", move


def _codes(stage: Usd.Stage, rng: np.random.Generator) -> Made:
    end = stage.GetEndTimeCode()
    choices = (("timeCodesPerSecond", 24.0), ("endTimeCode", round(0.7 * end)), ("timeCodesPerSecond", 30.0))
    name, value = some(choices, rng)
    return f"{name} = {value:g}", _stated(name, value)


def _axis(stage: Usd.Stage, rng: np.random.Generator) -> Made:
    single = []
    for joint in _joints(stage):
        if joint.IsA(UsdPhysics.RevoluteJoint) or joint.IsA(UsdPhysics.PrismaticJoint):
            single.append(joint)
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
