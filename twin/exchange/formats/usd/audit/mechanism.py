"""Read the mechanism data of a USD stage: UsdPhysics bodies, joints, drives and scene, named frames."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from pxr import Usd, UsdGeom, UsdPhysics

from twin.exchange.audit import poses
from twin.exchange.audit.file_drives import FileDrive, FileMotor, JointDynamics
from twin.exchange.audit.file_joints import FileJoint
from twin.exchange.audit.mechanism_data import VACUUM, FileFrame, FileMass, FileMechanism
from twin.exchange.audit.motion_lines import motion_lines
from twin.exchange.audit.poses import Array
from twin.exchange.formats.usd.audit.declared import is_ours
from twin.exchange.formats.usd.audit.joint_gaps import AXES, SIX, is_locked, is_stated, joint_ends
from twin.exchange.formats.usd.audit.unread_attributes import further_declarations

_EARTH = 9.81
"""Gravity in m/s2 of a scene that states none."""


def stage_mechanism(stage: Usd.Stage, bodies: list[Usd.Prim], meters: float, up: str) -> FileMechanism:
    """Return the mechanism data of a stage, in m, kg and rad.

    `bodies` are the rigid bodies of the stage; `meters` is the stage's unit of length in m, and `up` its up axis, "Y"
    or "Z".
    """
    names = {}
    for body in bodies:
        names[str(body.GetPath())] = body.GetName()
    mechanism = FileMechanism(tuple(names.values()), complete=True, couplings=_couplings(stage, meters), opening=0.0)
    mechanism.medium = VACUUM
    for prim in stage.Traverse():
        collides = prim.GetAttribute("physxArticulation:enabledSelfCollisions")
        if collides and collides.HasAuthoredValue():
            mechanism.self_collision = bool(collides.Get()) or bool(mechanism.self_collision)
    robot = stage.GetDefaultPrim()
    if robot:
        mechanism.motors = _motors(robot)
        mechanism.all_motors = is_ours(stage)
        if mechanism.all_motors:
            mechanism.robot = robot.GetName()
            mechanism.motion_declarations, mechanism.contact_declarations = further_declarations(stage)
            mechanism.program_settings = {}
            mechanism.postures = _postures(robot)
            mechanism.fully_listed = frozenset({"frame", "point"})
        _add_tool(mechanism, robot)
    kilograms = float(UsdPhysics.GetStageKilogramsPerUnit(stage))
    paths = set(names)
    fixed_to_world: set[str] = set()
    weight_shares: dict[str, float] = {}
    for prim in bodies:
        name = prim.GetName()
        mass = _mass(prim, meters, kilograms)
        if mass is not None:
            mechanism.masses[name] = mass
        if not _shows_all(prim, paths):
            mechanism.partly_shown |= {name}
        weightless = prim.GetAttribute("physxRigidBody:disableGravity").Get()
        weight_shares[name] = float(bool(weightless))
        # Physics does not move a kinematic body, as if it were fixed to the world.
        if UsdPhysics.RigidBodyAPI(prim).GetKinematicEnabledAttr().Get():
            fixed_to_world.add(name)
    mechanism.weight_shares = weight_shares
    links = set(names.values())
    joints_with_motors: set[str] = set()  # joints behind transmissions, whose motors have the efforts
    for motor in (mechanism.motors or {}).values():
        joints_with_motors |= set(motor.row or ())
    for prim in stage.Traverse():
        if prim.IsA(UsdPhysics.Joint) and is_stated(prim):
            joint = _joint(prim, names, meters, kilograms)
            if joint is None:
                continue
            if mechanism.all_motors and joint.kind in ("revolute", "prismatic"):
                joint = replace(joint, drive=_completed(joint.drive, prim.GetName() not in joints_with_motors))
            parent_moves = joint.parent in links
            child_moves = joint.child in links
            if joint.kind == "fixed" and parent_moves != child_moves:
                fixed_to_world.add(joint.child if child_moves else joint.parent)
            mechanism.joints.append(joint)
        elif prim.IsA(UsdPhysics.Scene):
            mechanism.gravity = _gravity(UsdPhysics.Scene(prim), meters, up)
    mechanism.fixed_to_world = frozenset(fixed_to_world)
    cache = UsdGeom.XformCache()
    for body in bodies:
        for prim in Usd.PrimRange(body):
            kind = prim.GetAttribute("twin:kind").Get()
            if kind in ("frame", "point"):
                _add_mark(mechanism, prim, kind, paths, cache, meters)
    return mechanism


def _postures(robot: Usd.Prim) -> dict[str, dict[str, float]]:
    """Return {posture: {joint: coordinate in m or rad}} that the prim of the robot states."""
    postures = {}
    for name, coordinates in (robot.GetCustomDataByKey("twin:postures") or {}).items():
        postures[name] = {}
        for joint, q in coordinates.items():
            postures[name][joint] = float(q)
    return postures


def _add_tool(mechanism: FileMechanism, robot: Usd.Prim) -> None:
    """Add the tool and the trocars that the prim of the robot states."""
    mechanism.tool = str(robot.GetAttribute("twin:tool").Get() or "")
    trocars = {str(robot.GetAttribute("twin:trocar").Get() or "")}
    for trocar in robot.GetAttribute("twin:trocars").Get() or ():
        trocars.add(str(trocar))
    mechanism.trocars = frozenset(trocars) - {""}


def _add_mark(
    mechanism: FileMechanism, prim: Usd.Prim, kind: str, bodies: set[str], cache: UsdGeom.XformCache, meters: float
) -> None:
    """Add a named frame or point, with its pose on the body above it. `bodies` are the prim paths of all bodies."""
    body = prim.GetParent()
    while body and str(body.GetPath()) not in bodies:
        body = body.GetParent()
    # OpenUSD multiplies row vectors by matrices, so its matrices are the transposes of ours.
    M_world_mark = np.array(cache.GetLocalToWorldTransform(prim)).T
    M_world_body = np.array(cache.GetLocalToWorldTransform(body)).T
    T_body_mark, _ = poses.split(np.linalg.inv(M_world_body) @ M_world_mark)
    T_body_mark[:3, 3] *= meters
    name = str(prim.GetAttribute("twin:name").Get() or prim.GetName())
    if kind == "point":
        T_body_point = poses.pose(None, T_body_mark[:3, 3])
        mechanism.points[name] = FileFrame(body.GetName(), T_body_point)
    else:
        mechanism.frames[name] = FileFrame(body.GetName(), T_body_mark)


def _shows_all(body: Usd.Prim, bodies: set[str]) -> bool:
    """Return whether the meshes of a body show the whole body: the stage states it, or they are all of its shapes.

    If the stage does not state it, the body needs a collider, and shapes that are neither meshes nor guides are missing
    from the meshes. `bodies` are the prim paths of all bodies.
    """
    stated_whole = body.GetAttribute("twin:whole")
    if stated_whole and stated_whole.Get() is not None:
        return bool(stated_whole.Get())
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


def _mass(prim: Usd.Prim, meters: float, kilograms: float) -> FileMass | None:
    """Return the mass of a body in kg, m and kg m2; None if the stage does not state both mass and inertia."""
    if not prim.HasAPI(UsdPhysics.MassAPI):
        return None
    api = UsdPhysics.MassAPI(prim)
    # In UsdPhysics, a mass of 0 and moments of 0 mean "not stated".
    mass = api.GetMassAttr().Get()
    if not mass:
        return None
    moments = api.GetDiagonalInertiaAttr().Get()
    if moments is None or not any(moments):
        return None
    R = np.eye(3)
    axes = api.GetPrincipalAxesAttr().Get()
    # The fallback of the principal axes is a quaternion of length 0.
    if axes is not None and axes.GetLength() > 0:
        R = poses.rotation([*axes.GetImaginary(), axes.GetReal()])
    com = np.zeros(3)
    center = api.GetCenterOfMassAttr().Get()
    # The fallback of the centre of mass is -inf.
    if center is not None and np.all(np.isfinite(center)):
        com = np.array(center, float)
    inertia = R @ np.diag(np.array(moments, float)) @ R.T
    return FileMass(float(mass) * kilograms, com * meters, inertia * kilograms * meters**2)


def _gravity(scene: UsdPhysics.Scene, meters: float, up: str) -> Array:
    """Return gravity (3,) in m/s2, z up; if the scene states no gravity, 9.81 downwards."""
    down = np.array([0.0, 0.0, -1.0])
    direction = scene.GetGravityDirectionAttr().Get()
    if direction is not None and np.linalg.norm(np.array(direction, float)) > 0:
        down = np.array(direction, float)
        down = down / np.linalg.norm(down)
        if up == "Y":
            down = poses.R_Z_UP_Y_UP @ down
    magnitude = _EARTH
    stated = scene.GetGravityMagnitudeAttr().Get()
    # The fallback of the magnitude is -inf: gravity of the earth.
    if stated is not None and np.isfinite(stated) and stated >= 0:
        magnitude = float(stated) * meters
    return down * magnitude


def _joint(prim: Usd.Prim, names: dict[str, str], meters: float, kilograms: float) -> FileJoint | None:
    """Return a joint; None if both of its ends are on the same body."""
    (parent_paths, T_parent_joint), (child_paths, T_child_joint) = joint_ends(prim, meters)
    parent = _end_name(parent_paths, names)
    child = _end_name(child_paths, names)
    if parent == child:
        return None
    kind, axis = kind_and_axis(prim)
    T_parent_child = T_parent_joint @ poses.inverse(T_child_joint)
    motions = motion_lines(kind, T_parent_joint, axis)
    drive = _drive(prim, kind, meters, kilograms)
    if drive.cone is not None and np.isfinite(max(drive.cone)):
        drive = replace(drive, cone_axis=T_parent_joint[:3, axis].copy())
    return FileJoint((prim.GetName(),), parent, child, T_parent_child, motions, drive)


def _end_name(paths: Sequence[str], names: dict[str, str]) -> str:
    """Return the name of the body at an end of a joint, or its prim path if it is no body; "" is the world."""
    if not paths:
        return ""
    return names.get(paths[0], paths[0])


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
            axis = "Z"
            if kind != "fixed":  # a fixed joint has no axis
                axis = prim.GetAttribute("physics:axis").Get()
            return kind, AXES.get(str(axis), 0)
    free_directions = []
    for direction, name in enumerate(SIX):
        if not is_locked(prim, name):
            free_directions.append(direction)
    free = tuple(free_directions)
    if len(free) == 2 and free[1] == free[0] + 3:
        return "cylindrical", free[0]
    if len(free) == 1:
        kind = "revolute"
        if free[0] < 3:
            kind = "prismatic"
        return kind, free[0] % 3
    named_kinds = {(): "fixed", (0, 1, 2, 3, 4, 5): "free", (3, 4, 5): "spherical"}
    directions = ", ".join(SIX[direction] for direction in free)
    return named_kinds.get(free, f"free along {directions}"), 2


def _cone(prim: Usd.Prim) -> tuple[float, float] | None:
    """Return the half angles in rad of the cone of a ball joint; None for a joint that is not PhysicsSphericalJoint."""
    ball = UsdPhysics.SphericalJoint(prim)
    if not ball:
        return None
    stated_cone = prim.GetAttribute("twin:cone").Get()  # in rad: the schema cannot express a cone about turned axes
    if stated_cone is not None:
        return float(stated_cone), float(stated_cone)
    half_angles: list[float] = []
    for attribute in (ball.GetConeAngle0LimitAttr(), ball.GetConeAngle1LimitAttr()):
        stated = attribute.Get()  # a blocked attribute has no value
        degrees = -1.0 if stated is None else float(stated)
        if degrees < 0:  # the schema's value for a joint without a cone
            degrees = np.inf
        half_angles.append(degrees * np.pi / 180)
    return half_angles[0], half_angles[1]


def _drive(prim: Usd.Prim, kind: str, meters: float, kilograms: float) -> FileDrive:
    if kind == "spherical":
        return FileDrive(cone=_cone(prim))
    if kind not in ("revolute", "prismatic"):
        return FileDrive()
    # `unit` is the stage's unit of the coordinate in rad or m, `effort_unit` that of the effort in N m or N.
    if kind == "revolute":
        token = "angular"
        unit = np.pi / 180
        effort_unit = kilograms * meters * meters
    else:
        token = "linear"
        unit = meters
        effort_unit = kilograms * meters
    low = prim.GetAttribute("physics:lowerLimit").Get()
    high = prim.GetAttribute("physics:upperLimit").Get()
    lower = -np.inf if low is None else float(low) * unit
    upper = np.inf if high is None else float(high) * unit
    drive = UsdPhysics.DriveAPI(prim, token)
    driven = prim.HasAPI(UsdPhysics.DriveAPI, token)
    stiffness = None
    damping = None
    effort = None
    law = None
    if driven:
        # A blocked attribute has no value, as if it were not authored: the schema's is 0.
        stiffness = _scaled(drive.GetStiffnessAttr().Get() or 0.0, effort_unit, unit)
        damping = _scaled(drive.GetDampingAttr().Get() or 0.0, effort_unit, unit)
        effort = _scaled(drive.GetMaxForceAttr().Get(), effort_unit, 1.0)
        if effort is not None and not np.isfinite(effort):
            effort = None
        law = str(drive.GetTypeAttr().Get())
    speed = _scaled(prim.GetAttribute("physxJoint:maxJointVelocity").Get(), unit, 1.0)
    stated_active = prim.GetAttribute("twin:active").Get()
    active = driven if stated_active is None else bool(stated_active)
    break_force = UsdPhysics.Joint(prim).GetBreakForceAttr().Get()
    breaks = np.inf if break_force is None else float(break_force)
    limits = (lower, upper)
    own_soft = prim.GetAttribute("twin:softLimits").Get()  # in m or rad
    soft = None if stated_active is None else limits  # stages of others do not state soft limits
    if own_soft is not None:
        soft = float(own_soft[0]), float(own_soft[1])
    control = limits if active else None
    return FileDrive(
        limits=limits,
        driven=active,
        stiffness=stiffness,
        damping=damping,
        effort=effort,
        speed=speed,
        law=law,
        breaks=breaks,
        soft=soft,
        control=control,
        acceleration=_scaled(prim.GetAttribute("twin:maxAcceleration").Get(), 1.0, 1.0),
        jerk=_scaled(prim.GetAttribute("twin:maxJerk").Get(), 1.0, 1.0),
    )


def _completed(drive: FileDrive, is_at_joint: bool) -> FileDrive:
    """Return the drive of a joint with one coordinate in a stage of this project: what is not stated has no limit.

    Such a stage holds no spring, damper or friction of a joint itself, so it states that there is none.

    `is_at_joint`: whether the drive is at the joint itself; motors behind a transmission have speeds and efforts of
    their own.
    """
    drive = replace(drive, joint_dynamics=JointDynamics())
    if drive.soft is None:
        drive = replace(drive, soft=drive.limits)
    if not drive.driven:
        return drive
    unlimited: dict[str, float] = {}
    if is_at_joint and drive.speed is None:
        unlimited["speed"] = np.inf
    if is_at_joint and drive.effort is None:
        unlimited["effort"] = np.inf
    if drive.acceleration is None:
        unlimited["acceleration"] = np.inf
    if drive.jerk is None:
        unlimited["jerk"] = np.inf
    return replace(drive, **unlimited)


def _scaled(value: float | None, unit: float, per: float) -> float | None:
    """Return a value times `unit` / `per`; None if the stage does not state it."""
    if value is None:
        return None
    return float(value) * unit / per


def _motors(root: Usd.Prim) -> dict[str, FileMotor]:
    """Return {name: motor}, read from customData, because UsdPhysics cannot express transmissions."""
    ratios: dict[str, dict[str, float]] = {}  # {motor: {joint: motor coordinate / joint coordinate}}
    transmissions = root.GetCustomDataByKey("twin:transmissions") or {}
    for transmission in transmissions.values():
        joints = list(transmission["joints"])
        actuators = list(transmission["actuators"])
        matrix = np.array(transmission["matrix"], float).reshape(len(joints), len(actuators))
        # The stage states joint coordinates by motor coordinates; `FileMotor` has the inverse.
        for actuator, row in zip(actuators, np.linalg.inv(matrix), strict=True):
            ratios[actuator] = {}
            for joint, ratio in zip(joints, row, strict=True):
                if ratio:
                    ratios[actuator][joint] = float(ratio)
    motors: dict[str, FileMotor] = {}
    stated = root.GetCustomDataByKey("twin:actuators") or {}
    for name, values in stated.items():
        low, high = values.get("limits", (-np.inf, np.inf))
        motors[name] = FileMotor(
            row=ratios.get(name),
            kind=str(values["kind"]),
            limits=(float(low), float(high)),
            effort=float(values.get("max_effort", np.inf)),
            speed=float(values.get("max_speed", np.inf)),
            inertia=float(values.get("rotor_inertia", 0.0)),
            stiffness=float(values.get("stiffness", 0.0)),
            damping=float(values.get("damping", 0.0)),
            law="force",
        )
    return motors


def _couplings(stage: Usd.Stage, meters: float) -> dict[str, tuple[dict[str, float], float]]:
    """Return the couplings stated as PhysX tendons, or as PhysX mimic joints (q + gearing * leader + offset = 0)."""
    couplings: dict[str, tuple[dict[str, float], float]] = {}
    for prim in stage.Traverse():
        # The applied schemas of the type info contain also those that this OpenUSD does not know.
        for schema in map(str, prim.GetPrimTypeInfo().GetAppliedAPISchemas()):
            kind, colon, instance = schema.partition(":")
            if not colon:
                continue
            if kind == "PhysxMimicJointAPI":
                couplings[f"{prim.GetName()} {schema}"] = _mimic(prim, instance, meters)
            elif kind in ("PhysxTendonAxisRootAPI", "PhysxTendonAxisAPI"):
                ratios, constant = couplings.get(instance, ({}, 0.0))
                gearing = prim.GetAttribute(f"physxTendon:{instance}:gearing").Get()
                ratios[prim.GetName()] = 0.0
                if gearing:
                    ratios[prim.GetName()] = float(gearing[0])
                # Only the root of a tendon states its length.
                length = prim.GetAttribute(f"physxTendon:{instance}:restLength").Get()
                if length is not None:
                    constant = float(length) * _unit(prim, meters)
                couplings[instance] = (ratios, constant)
    return couplings


def _mimic(prim: Usd.Prim, instance: str, meters: float) -> tuple[dict[str, float], float]:
    """Return the coupling ({joint: ratio}, constant) of a joint that follows other joints."""
    place = f"physxMimicJoint:{instance}"
    ratios = {prim.GetName(): 1.0}
    gearing = prim.GetAttribute(f"{place}:gearing").Get()
    leaders = prim.GetRelationship(f"{place}:referenceJoint")
    if leaders:
        for path in leaders.GetTargets():
            ratios[path.name] = 1.0 if gearing is None else float(gearing)
    offset = prim.GetAttribute(f"{place}:offset").Get()
    if offset is None:
        offset = 0.0
    return ratios, -float(offset) * _unit(prim, meters)


def _unit(joint: Usd.Prim, meters: float) -> float:
    """Return the factor from the stage's unit of a joint coordinate to m or rad."""
    if joint.IsA(UsdPhysics.RevoluteJoint):
        return np.pi / 180
    return meters
