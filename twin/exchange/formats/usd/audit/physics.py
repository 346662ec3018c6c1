"""Read the mechanism data of a USD stage: UsdPhysics bodies, joints, drives and scene, named frames."""

from __future__ import annotations

import numpy as np
from pxr import Usd, UsdGeom, UsdPhysics

from twin.exchange.audit import poses
from twin.exchange.audit.physics import Drive, Frame, Joint, Mass, Motor, Physics, along
from twin.exchange.audit.poses import Array
from twin.exchange.formats.usd.audit.joints import AXES, SIX, is_locked, is_stated, joint_ends


def stage_physics(stage: Usd.Stage, bodies: list[Usd.Prim], meters: float, up: str) -> Physics:
    """Return the mechanism data of a stage, in m, kg and rad.

    `bodies` are the rigid bodies of the stage; `meters` is the stage's unit of length in m, and `up` its up axis, "Y"
    or "Z".
    """
    names = {str(p.GetPath()): p.GetName() for p in bodies}
    out = Physics(tuple(names.values()), complete=True, couplings=_couplings(stage, meters), opening=0.0)
    if robot := stage.GetDefaultPrim():
        out.motors, out.all_motors = _motors(robot), bool(robot.GetAttribute("twin:base"))
        out.marks = frozenset({"frame", "point"} if out.all_motors else ())
    kilograms = float(UsdPhysics.GetStageKilogramsPerUnit(stage))
    for prim in bodies:
        if (mass := _mass(prim, meters, kilograms)) is not None:
            out.masses[prim.GetName()] = mass
        if not _shows_all(prim, set(names)):
            out.partly |= {prim.GetName()}
    out.floats = {p.GetName(): float(bool(p.GetAttribute("physxRigidBody:disableGravity").Get())) for p in bodies}
    held = {p.GetName() for p in bodies if UsdPhysics.RigidBodyAPI(p).GetKinematicEnabledAttr().Get()}
    for prim in stage.Traverse():
        if prim.IsA(UsdPhysics.Joint) and is_stated(prim):
            joint = _joint(prim, names, meters, kilograms)
            if joint is None:
                continue
            if joint.kind == "fixed" and (joint.parent in names.values()) != (joint.child in names.values()):
                held.add(joint.child if joint.child in names.values() else joint.parent)
            out.joints.append(joint)
        elif prim.IsA(UsdPhysics.Scene):
            out.gravity = _gravity(UsdPhysics.Scene(prim), meters, up)
    out.held = frozenset(held)
    cache = UsdGeom.XformCache()
    for prim in (p for b in bodies for p in Usd.PrimRange(b)):
        kind = prim.GetAttribute("twin:kind").Get()
        if kind in ("frame", "point"):
            M = np.array(cache.GetLocalToWorldTransform(prim)).T
            above = prim.GetParent()
            while above and str(above.GetPath()) not in names:
                above = above.GetParent()
            T, _ = poses.split(np.linalg.inv(np.array(cache.GetLocalToWorldTransform(above)).T) @ M)
            T[:3, 3] *= meters
            name = str(prim.GetAttribute("twin:name").Get() or prim.GetName())
            if kind == "point":
                out.points[name] = Frame(above.GetName(), poses.pose(None, T[:3, 3]))
            else:
                out.frames[name] = Frame(above.GetName(), T)
    root = stage.GetDefaultPrim()
    if root:
        out.tool, trocar = (str(root.GetAttribute(f"twin:{n}").Get() or "") for n in ("tool", "trocar"))
        several = root.GetAttribute("twin:trocars").Get() or ()
        out.trocars = frozenset((trocar, *map(str, several))) - {""}
    return out


def _shows_all(body: Usd.Prim, bodies: set[str]) -> bool:
    """Return whether the meshes of a body show the whole body: the stage states it, or they are all of its shapes.

    If the stage does not state it, the body needs a collider, and shapes that are neither meshes nor guides are missing
    from the meshes. `bodies` are the prim paths of all bodies.
    """
    told = body.GetAttribute("twin:whole")
    if told and told.Get() is not None:
        return bool(told.Get())
    collides = False
    prims = iter(Usd.PrimRange(body, Usd.TraverseInstanceProxies()))
    for prim in prims:
        if prim != body and str(prim.GetPath()) in bodies:
            prims.PruneChildren()
            continue
        collides |= prim.HasAPI(UsdPhysics.CollisionAPI)
        if prim.IsA(UsdGeom.Gprim):
            guide = UsdGeom.Imageable(prim).ComputePurpose() == UsdGeom.Tokens.guide
            if guide or not prim.IsA(UsdGeom.Mesh):
                return False
    return collides


def _mass(prim: Usd.Prim, meters: float, kilograms: float) -> Mass | None:
    api = UsdPhysics.MassAPI(prim)
    mass, center = api.GetMassAttr().Get(), api.GetCenterOfMassAttr().Get()
    moments, axes = api.GetDiagonalInertiaAttr().Get(), api.GetPrincipalAxesAttr().Get()
    if not prim.HasAPI(UsdPhysics.MassAPI) or mass is None or not mass or moments is None or not any(moments):
        return None
    R = np.eye(3)
    if axes is not None and axes.GetLength() > 0:
        R = poses.rotation([*axes.GetImaginary(), axes.GetReal()])
    place = np.array(center if center is not None and np.all(np.isfinite(center)) else (0, 0, 0), float)
    inertia = R @ np.diag(np.array(moments, float)) @ R.T
    return Mass(float(mass) * kilograms, place * meters, inertia * kilograms * meters**2)


def _gravity(scene: UsdPhysics.Scene, meters: float, up: str) -> Array:
    """Return gravity (3,) in m/s2, z up; if the scene states no gravity, 9.81 downwards."""
    direction, size = scene.GetGravityDirectionAttr().Get(), scene.GetGravityMagnitudeAttr().Get()
    down = np.array([0.0, 0.0, -1.0])
    given = np.array(direction if direction is not None else (0, 0, 0), float)
    if np.linalg.norm(given) > 0:
        down = given / np.linalg.norm(given)
        down = poses.R_Z_UP_Y_UP @ down if up == "Y" else down
    return down * (float(size) * meters if size is not None and np.isfinite(size) and size >= 0 else 9.81)


def _joint(prim: Usd.Prim, names: dict[str, str], meters: float, kilograms: float) -> Joint | None:
    ends = joint_ends(prim, meters)
    (parent, T_parent), (child, T_child) = ((names.get(t[0], t[0]) if t else "", T) for t, T in ends)
    if parent == child:
        return None
    kind, axis = kind_and_axis(prim)
    return Joint(
        (prim.GetName(),),
        parent,
        child,
        T_parent @ poses.inverse(T_child),
        along(kind, T_parent, axis),
        _drive(prim, kind, meters, kilograms),
    )


def kind_and_axis(prim: Usd.Prim) -> tuple[str, int]:
    """Return (kind, axis) of a joint prim; axis 0, 1 or 2 is the x, y or z axis of the joint's frame."""
    for schema, kind in (
        (UsdPhysics.RevoluteJoint, "revolute"),
        (UsdPhysics.PrismaticJoint, "prismatic"),
        (UsdPhysics.SphericalJoint, "spherical"),
        (UsdPhysics.FixedJoint, "fixed"),
        (UsdPhysics.DistanceJoint, "free"),
    ):
        if prim.IsA(schema):
            axis = prim.GetAttribute("physics:axis").Get() if kind != "fixed" else "Z"
            return kind, AXES.get(str(axis), 0)
    free = [i for i, name in enumerate(SIX) if not is_locked(prim, name)]
    if len(free) == 2 and free[1] == free[0] + 3:
        return "cylindrical", free[0]
    known = {(): "fixed", (0, 1, 2, 3, 4, 5): "free", (3, 4, 5): "spherical"}
    if len(free) == 1:
        return ("prismatic" if free[0] < 3 else "revolute"), free[0] % 3
    return known.get(tuple(free), f"free along {', '.join(SIX[i] for i in free)}"), 2


def _drive(prim: Usd.Prim, kind: str, meters: float, kilograms: float) -> Drive:
    if kind not in ("revolute", "prismatic"):
        return Drive()
    turns = kind == "revolute"
    token, unit = ("angular", np.pi / 180) if turns else ("linear", meters)
    force = kilograms * meters * (meters if turns else 1.0)  # unit of effort in N or N m
    low, high = (prim.GetAttribute(f"physics:{n}Limit").Get() for n in ("lower", "upper"))
    drive = UsdPhysics.DriveAPI(prim, token)
    there = prim.HasAPI(UsdPhysics.DriveAPI, token)
    gains = (drive.GetStiffnessAttr().Get(), drive.GetDampingAttr().Get(), drive.GetMaxForceAttr().Get())
    stiffness, damping, effort = (None if not there or g is None else float(g) * force for g in gains)
    speed = prim.GetAttribute("physxJoint:maxJointVelocity").Get()
    marked = prim.GetAttribute("twin:active").Get()
    return Drive(
        (-np.inf if low is None else float(low) * unit, np.inf if high is None else float(high) * unit),
        there if marked is None else bool(marked),
        None if stiffness is None else stiffness / unit,
        None if damping is None else damping / unit,
        effort if effort is not None and np.isfinite(effort) else None,
        None if speed is None else float(speed) * unit,
        law=str(drive.GetTypeAttr().Get()) if there else None,
        breaks=float(UsdPhysics.Joint(prim).GetBreakForceAttr().Get()),
    )


def _motors(root: Usd.Prim) -> dict[str, Motor]:
    """Return {name: motor}, read from customData, because UsdPhysics cannot express transmissions."""
    rows = {}
    for told in (root.GetCustomDataByKey("twin:transmissions") or {}).values():
        joints, names = list(told["joints"]), list(told["actuators"])
        matrix = np.array(told["matrix"], float).reshape(len(joints), len(names))
        for name, row in zip(names, np.linalg.inv(matrix), strict=True):
            rows[name] = {j: float(c) for j, c in zip(joints, row, strict=True) if c}
    out = {}
    for name, told in (root.GetCustomDataByKey("twin:actuators") or {}).items():
        low, high = told.get("limits", (-np.inf, np.inf))
        effort, speed = (float(told.get(k, np.inf)) for k in ("max_effort", "max_speed"))
        rest = (float(told.get(k, 0.0)) for k in ("rotor_inertia", "stiffness", "damping"))
        out[name] = Motor(rows.get(name), str(told["kind"]), (float(low), float(high)), effort, speed, *rest)
    return out


def _couplings(stage: Usd.Stage, meters: float) -> dict[str, tuple[dict[str, float], float]]:
    """Return the couplings stated as PhysX tendons, or as PhysX mimic joints (q + gearing * leader + offset = 0)."""
    out: dict[str, tuple[dict[str, float], float]] = {}
    for prim in stage.Traverse():
        for name in map(
            str, prim.GetPrimTypeInfo().GetAppliedAPISchemas()
        ):  # including schemas unknown to this OpenUSD
            if name.startswith("PhysxMimicJointAPI:"):
                place = f"physxMimicJoint:{name.split(':', 1)[1]}"
                leader = prim.GetRelationship(f"{place}:referenceJoint")
                leaders = leader.GetTargets() if leader else ()
                said = (prim.GetAttribute(f"{place}:{n}").Get() for n in ("gearing", "offset"))
                gearing, offset = (d if v is None else float(v) for v, d in zip(said, (1.0, 0.0), strict=True))
                ratios = {prim.GetName(): 1.0, **{p.name: gearing for p in leaders}}
                out[f"{prim.GetName()} {name}"] = ratios, -offset * _unit(prim, meters)
            if name.startswith(("PhysxTendonAxisRootAPI:", "PhysxTendonAxisAPI:")):
                tendon = name.split(":", 1)[1]
                gearing = prim.GetAttribute(f"physxTendon:{tendon}:gearing").Get()
                ratios, total = out.get(tendon, ({}, 0.0))
                rest = prim.GetAttribute(f"physxTendon:{tendon}:restLength").Get()
                unit = _unit(prim, meters)
                ratios[prim.GetName()] = float(gearing[0]) if gearing else 0.0
                out[tendon] = (ratios, total if rest is None else float(rest) * unit)
    return out


def _unit(joint: Usd.Prim, meters: float) -> float:
    """Return the factor from the stage's unit of a joint coordinate to m or rad."""
    return np.pi / 180 if joint.IsA(UsdPhysics.RevoluteJoint) else meters
