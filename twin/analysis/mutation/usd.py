"""Seed faults into a written stage and its motion; each fault changes an attribute, in the layer that defines it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from pxr import Gf, Sdf, Usd, UsdGeom, UsdPhysics, Vt

from twin.analysis.mutation.fault import SeededFault, faults_in_turn, random_item
from twin.core.units import DEG, MM

KINDS = (
    *("joint frame", "drive unit", "time samples", "inertia", "joint frame", "units", "loop joint", "limits"),
    *("body", "quaternion", "mesh", "rest pose", "time codes", "axis"),
)
"""Kinds of faults in the order of seeding."""

_FEWEST_SAMPLES = 8
"""Attributes with at most so many time samples are not delayed: a delay of several samples would leave nothing."""

_ZERO_LIMIT = 1e-9
"""Limit in deg or m that counts as zero, which no factor changes."""

Edit = Callable[[Usd.Stage], None]
"""Function that changes a stage."""

NamedEdit = tuple[str, Edit]
"""(what the edit changes, as text; the edit)."""


def faults(root: Path, rng: np.random.Generator, count: int) -> Iterator[SeededFault]:
    """Yield faults of a stage; `root` is the layer with the motion or, without motion, the robot's root layer."""
    stage = Usd.Stage.Open(str(root))
    for kind, (what, edit) in faults_in_turn(KINDS, _FAULT_OF_KIND, subject=stage, rng=rng, count=count):
        yield SeededFault("usd", kind, what, stage=_spoiler(root.name, edit))


def _spoiler(name: str, edit: Edit) -> Callable[[Path], None]:
    """Return the function that applies an edit to the stage `name` in a folder, and saves its layers."""

    def spoil(folder: Path) -> None:
        stage = Usd.Stage.Open(str(folder / name))
        edit(stage)
        for layer in stage.GetUsedLayers():
            if layer.dirty and not layer.anonymous:  # the session layer has no file
                layer.Save()

    return spoil


def _set_value(stage: Usd.Stage, path: str, value: object) -> None:
    """Set an attribute on the layer that currently defines its value."""
    attribute = stage.GetAttributeAtPath(path)
    stack = attribute.GetPropertyStack(Usd.TimeCode.Default())
    # strongest first: a value in a weaker layer would stay hidden
    stage.SetEditTarget(Usd.EditTarget(stack[0].layer))
    attribute.Set(value, Usd.TimeCode.Default())


def _value_edit(path: str, change: Callable[[Any], object]) -> Edit:
    """Return the edit that replaces the value of an attribute by `change` of this value."""
    return lambda stage: _set_value(stage, path, change(stage.GetAttributeAtPath(path).Get()))


def _multiplied(path: str, factor: float) -> NamedEdit:
    """Return the edit that multiplies the value of an attribute."""
    return f"{path} times {factor:.4g}", _value_edit(path, lambda x: factor * x)


def _connecting_joints(stage: Usd.Stage) -> list[Usd.Prim]:
    """Return all joints that connect two bodies, except fixed joints."""
    joints = []
    for prim in stage.Traverse():
        if not prim.IsA(UsdPhysics.Joint) or prim.IsA(UsdPhysics.FixedJoint):
            continue
        if prim.GetName() in ("root_joint", "world"):
            continue
        if UsdPhysics.Joint(prim).GetBody0Rel().GetTargets():
            joints.append(prim)
    return joints


def _bodies(stage: Usd.Stage) -> list[Usd.Prim]:
    """Return all rigid bodies."""
    bodies = []
    for prim in stage.Traverse():
        if prim.HasAPI(UsdPhysics.RigidBodyAPI):
            bodies.append(prim)
    return bodies


def _joint_frame_fault(stage: Usd.Stage, rng: np.random.Generator) -> NamedEdit:
    """Move or rotate the frame of a joint on one of its bodies, by 0.1 to 1 mm or degrees."""
    joint = str(random_item(_connecting_joints(stage), rng).GetPath())
    side = int(rng.integers(2))
    if rng.integers(2):
        size = rng.uniform(0.1, 1.0) * MM
        direction = rng.normal(size=3)
        shift = size * direction / np.linalg.norm(direction)
        step = Gf.Vec3f(*shift.tolist())
        path = f"{joint}.physics:localPos{side}"
        return f"{path} moved by {size / MM:.2f} mm", _value_edit(path, lambda x: x + step)
    angle = rng.uniform(0.1, 1.0)
    axis = Gf.Vec3d(*rng.normal(size=3).tolist())
    turn = Gf.Quatf(Gf.Rotation(axis, angle).GetQuat())
    path = f"{joint}.physics:localRot{side}"
    return f"{path} turned by {angle:.2f} deg", _value_edit(path, lambda x: (x * turn).GetNormalized())


_DRIVE_GAINS = ("physics:stiffness", "physics:damping", "physics:maxForce")
"""Ends of the names of attributes of drives that have a unit."""


def _drive_unit_fault(stage: Usd.Stage, rng: np.random.Generator) -> NamedEdit:
    """Give one gain of a drive in another unit: per radian for per degree, or in millimetres."""
    gains = []
    for joint in _connecting_joints(stage):
        for attribute in joint.GetAuthoredAttributes():
            name = attribute.GetName()
            if name.startswith("drive:") and name.endswith(_DRIVE_GAINS) and attribute.Get():
                gains.append(str(attribute.GetPath()))
    path = random_item(gains, rng)
    factors = (1000.0, 1e-3)
    if ":angular:" in path:
        factors = (180 / np.pi, np.pi / 180)
    return _multiplied(path, float(random_item(factors, rng)))


def _moving_attributes(stage: Usd.Stage) -> list[Usd.Attribute]:
    """Return the attributes of moving bodies that have time samples."""
    moving = []
    for body in _bodies(stage):
        for attribute in body.GetAuthoredAttributes():
            if not attribute.GetName().startswith("xformOp"):
                continue
            codes = attribute.GetTimeSamples()
            if len(codes) <= _FEWEST_SAMPLES:
                continue
            # a third of the way: a motion that ends where it began differs there
            start = _components(attribute.Get(codes[0]))
            later = _components(attribute.Get(codes[len(codes) // 3]))
            if not np.allclose(start, later):
                moving.append(attribute)
    return moving


def _components(value: Gf.Vec3d | Gf.Vec3f | Gf.Quatd | Gf.Quatf) -> list[float]:
    """Return the components of a vector, or of a quaternion, real part first."""
    if isinstance(value, Gf.Vec3d | Gf.Vec3f):
        return [*value]
    return [value.GetReal(), *value.GetImaginary()]


def _time_samples_fault(stage: Usd.Stage, rng: np.random.Generator) -> NamedEdit:
    """Delay the motion of one body; without a motion, seed a fault of an inertia."""
    moving = _moving_attributes(stage)
    if not moving:
        return _inertia_fault(stage, rng)
    path = str(random_item(moving, rng).GetPath())
    lag = int(rng.integers(1, 12))

    def shift(spoiled_stage: Usd.Stage) -> None:
        attribute = spoiled_stage.GetAttributeAtPath(path)
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


def _inertia_fault(stage: Usd.Stage, rng: np.random.Generator) -> NamedEdit:
    """Change the mass, the mass centre or the moments of a body, as mistakes of units and axes do."""
    bodies_with_mass = []
    for prim in _bodies(stage):
        if UsdPhysics.MassAPI(prim).GetMassAttr().Get():
            bodies_with_mass.append(prim)
    body = str(random_item(bodies_with_mass, rng).GetPath())
    what = random_item(("mass", "turned", "unit", "centre"), rng)
    if what == "mass":
        return _multiplied(f"{body}.physics:mass", float(random_item((10.0, 0.1, 1000.0, 1.5), rng)))
    if what == "centre":
        path = f"{body}.physics:centerOfMass"
        return f"{path} moved by 54 mm", _value_edit(path, lambda x: x + Gf.Vec3f(0.02, 0.03, -0.04))
    path = f"{body}.physics:diagonalInertia"
    if what == "unit":
        return f"{path} in kg mm2", _value_edit(path, lambda x: 1e6 * x)

    def exchanged(moments: Gf.Vec3f) -> Gf.Vec3f:
        smallest, _, largest = sorted(range(3), key=lambda i: moments[i])
        changed = Gf.Vec3f(moments)
        changed[smallest] = moments[largest]
        changed[largest] = moments[smallest]
        return changed

    return f"{path} with its largest and smallest value exchanged", _value_edit(path, exchanged)


def _stage_units_fault(stage: Usd.Stage, rng: np.random.Generator) -> NamedEdit:
    """State another unit of length or mass, or another axis that points up."""
    choices = (("metersPerUnit", 0.01), ("metersPerUnit", 0.001), ("upAxis", "Y"), ("kilogramsPerUnit", 0.001))
    name, value = random_item(choices, rng)
    return f"{name} = {value}", _metadata_edit(name, value)


def _metadata_edit(name: str, value: object) -> Edit:
    """Return the edit that sets a metadata value in all layers, as a faulty converter would."""

    def spoil(spoiled_stage: Usd.Stage) -> None:
        for layer in spoiled_stage.GetUsedLayers():
            if not layer.anonymous and layer.pseudoRoot.HasInfo(name):
                layer.pseudoRoot.SetInfo(name, value)
                if name == "timeCodesPerSecond":
                    # a stage whose two rates differ would be found by this alone
                    layer.pseudoRoot.SetInfo("framesPerSecond", value)

    return spoil


def _loop_joint_fault(stage: Usd.Stage, rng: np.random.Generator) -> NamedEdit:
    """Drop a joint that closes a loop, or make it a part of the articulation."""
    joints = _connecting_joints(stage)
    closing = []
    for joint in joints:
        if UsdPhysics.Joint(joint).GetExcludeFromArticulationAttr().Get():
            closing.append(joint)
    path = str(random_item(closing or joints, rng).GetPath())
    if closing and rng.integers(3) == 0:
        name = f"{path}.physics:excludeFromArticulation"
        return f"{name} false", lambda s: _set_value(s, name, False)

    def drop(spoiled_stage: Usd.Stage) -> None:
        # an opinion that remains in another layer would leave a prim at this path
        for layer in spoiled_stage.GetUsedLayers():
            spec = layer.GetPrimAtPath(path)
            if spec is not None:
                del spec.nameParent.nameChildren[spec.name]

    return f"joint {path} missing", drop


def _limit_unit_fault(stage: Usd.Stage, rng: np.random.Generator) -> NamedEdit:
    """Give a limit in another unit; without a limit that a factor changes, move a joint frame."""
    candidates = []
    for joint in _connecting_joints(stage):
        for name in ("physics:lowerLimit", "physics:upperLimit"):
            limit = joint.GetAttribute(name)
            if not limit or not limit.HasAuthoredValue():
                continue
            value = limit.Get()
            if abs(value) > _ZERO_LIMIT and np.isfinite(value):  # a factor changes neither 0 nor infinity
                candidates.append((joint, name))
    if not candidates:
        return _joint_frame_fault(stage, rng)
    joint, name = random_item(candidates, rng)
    factors = (1000.0, 0.001)
    if joint.IsA(UsdPhysics.RevoluteJoint):
        factors = (DEG, 1 / DEG)
    return _multiplied(f"{joint.GetPath()}.{name}", float(random_item(factors, rng)))


def _wrong_body_fault(stage: Usd.Stage, rng: np.random.Generator) -> NamedEdit:
    """Connect a joint to a body to which it does not belong."""
    prim = random_item(_connecting_joints(stage), rng)
    path = str(prim.GetPath())
    joint = UsdPhysics.Joint(prim)
    body_before = joint.GetBody1Rel().GetTargets()[0]
    connected = {body_before, *joint.GetBody0Rel().GetTargets()}
    other_bodies = []
    for body in _bodies(stage):
        if body.GetPath() not in connected:
            other_bodies.append(body.GetPath())
    other_body = str(random_item(other_bodies, rng))

    def change(spoiled_stage: Usd.Stage) -> None:
        relation = UsdPhysics.Joint(spoiled_stage.GetPrimAtPath(path)).GetBody1Rel()
        spoiled_stage.SetEditTarget(Usd.EditTarget(relation.GetPropertyStack()[0].layer))
        relation.SetTargets([other_body])

    return f"{path} points to {other_body} instead of {body_before.name}", change


def _quaternion_order_fault(stage: Usd.Stage, rng: np.random.Generator) -> NamedEdit:
    """Read the rotation of a joint frame with the real part last."""
    paths = []
    for joint in _connecting_joints(stage):
        for side in (0, 1):
            rotation = joint.GetAttribute(f"physics:localRot{side}")
            magnitudes = set()
            for component in _components(rotation.Get()):
                magnitudes.add(round(abs(component), 4))
            # With fewer different magnitudes, another order can give the same rotation.
            if len(magnitudes) > 2:
                paths.append(str(rotation.GetPath()))
    if not paths:
        return _joint_frame_fault(stage, rng)
    path = random_item(paths, rng)

    def reordered(quat: Gf.Quatf) -> Gf.Quatf:
        w, x, y, z = _components(quat)
        return Gf.Quatf(x, Gf.Vec3f(y, z, w))

    return f"{path} read as x y z w", _value_edit(path, reordered)


def _mesh_fault(stage: Usd.Stage, rng: np.random.Generator) -> NamedEdit:
    """Give a mesh in millimetres, or turn it inside out."""
    meshes = []
    for prim in stage.Traverse():
        if prim.IsA(UsdGeom.Mesh):
            meshes.append(prim)
    path = str(random_item(meshes, rng).GetPath())
    if rng.integers(2):
        name = f"{path}.points"
        return f"{name} in mm", _value_edit(name, _in_millimetres)
    return f"{path} turned inside out", _value_edit(f"{path}.faceVertexIndices", _reversed)


def _in_millimetres(points: Vt.Vec3fArray) -> Vt.Vec3fArray:
    """Return points in m as if they were in mm."""
    return type(points)([1000 * point for point in points])


def _reversed(indices: Vt.IntArray) -> Vt.IntArray:
    """Return the vertices of all faces in reverse order, so that the faces point inwards."""
    return type(indices)([*indices][::-1])


def _rest_pose_fault(stage: Usd.Stage, rng: np.random.Generator) -> NamedEdit:
    """Move a body in the rest pose of the stage, by 0.2 to 2 mm."""
    child_paths = set()
    for joint in _connecting_joints(stage):
        child_paths |= set(UsdPhysics.Joint(joint).GetBody1Rel().GetTargets())
    shifts = []
    for body in _bodies(stage):
        if body.GetPath() not in child_paths:
            continue
        for attribute in body.GetAuthoredAttributes():
            if attribute.GetName().startswith("xformOp:translate"):
                shifts.append(attribute)
    path = str(random_item(shifts, rng).GetPath())
    size = rng.uniform(0.2, 2.0) * MM

    def move(spoiled_stage: Usd.Stage) -> None:
        attribute = spoiled_stage.GetAttributeAtPath(path)
        stack = attribute.GetPropertyStack(Usd.TimeCode.Default())
        spec = _strongest(stack, "default").layer.GetAttributeAtPath(path)
        spec.default = spec.default + type(spec.default)(0, size, 0)

    return f"{path} at rest moved by {size / MM:.2f} mm", move


def _time_codes_fault(stage: Usd.Stage, rng: np.random.Generator) -> NamedEdit:
    """State another rate, or another end, of the time codes."""
    end = stage.GetEndTimeCode()
    choices = (("timeCodesPerSecond", 24.0), ("endTimeCode", round(0.7 * end)), ("timeCodesPerSecond", 30.0))
    name, value = random_item(choices, rng)
    return f"{name} = {value:g}", _metadata_edit(name, value)


def _axis_fault(stage: Usd.Stage, rng: np.random.Generator) -> NamedEdit:
    """Let a joint turn about, or slide along, another axis of its frame."""
    single_axis_joints = []
    for joint in _connecting_joints(stage):
        if joint.IsA(UsdPhysics.RevoluteJoint) or joint.IsA(UsdPhysics.PrismaticJoint):
            single_axis_joints.append(joint)
    path = f"{random_item(single_axis_joints, rng).GetPath()}.physics:axis"
    value = random_item(("X", "Y"), rng)
    return f"{path} = {value}", lambda s: _set_value(s, path, value)


_FAULT_OF_KIND: dict[str, Callable[[Usd.Stage, np.random.Generator], NamedEdit]] = {
    "joint frame": _joint_frame_fault,
    "drive unit": _drive_unit_fault,
    "time samples": _time_samples_fault,
    "inertia": _inertia_fault,
    "units": _stage_units_fault,
    "loop joint": _loop_joint_fault,
    "limits": _limit_unit_fault,
    "body": _wrong_body_fault,
    "quaternion": _quaternion_order_fault,
    "mesh": _mesh_fault,
    "rest pose": _rest_pose_fault,
    "time codes": _time_codes_fault,
    "axis": _axis_fault,
}
