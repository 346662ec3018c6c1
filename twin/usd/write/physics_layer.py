"""Write physics.usda: overs with masses, colliders, joints, limits, drives and joint states.

UsdPhysics uses degrees for limits, cones, drives (per degree), joint states and speeds, and single precision for joint
frames; no frames in double precision are added. Data that UsdPhysics cannot hold are stored in `twin:` attributes in SI
units.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
from pxr import Gf, Sdf, Usd, UsdGeom, UsdPhysics, Vt

from twin.core import spatial
from twin.core.errors import StageError
from twin.core.provenance import Parameter
from twin.core.spatial import Array
from twin.core.units import DEG
from twin.model.inertia import Inertia
from twin.model.joint import FREE_AXES, Drive, Joint
from twin.model.mechanism import EARTH, Coupling, Mechanism
from twin.model.mimic_joints import Following, following
from twin.model.transmission import Actuator, joint_gains
from twin.usd import gf
from twin.usd.scan import DIRECTIONS, TURN_OF_AXIS
from twin.usd.write.geometry import mesh_paths
from twin.usd.write.layers import LeafNames, describe, new_layer, save
from twin.usd.write.spanning import spanning

SCHEMAS = {
    "fixed": UsdPhysics.FixedJoint,
    "revolute": UsdPhysics.RevoluteJoint,
    "prismatic": UsdPhysics.PrismaticJoint,
    "spherical": UsdPhysics.SphericalJoint,
    "cylindrical": UsdPhysics.Joint,
    "free": UsdPhysics.Joint,
}
"""USD schema of each joint type; cylindrical and free joints, which UsdPhysics lacks, become generic joints."""

POSITION_ITERATIONS = 128
"""Position iterations of the PhysX solver.

Measured sag of the platform of SILS under its weight at 1 kHz: 6 um with the default of 32 iterations, 5 um with 64,
0.4 um with 128.
"""

MAX_TENDON_RATIO = 0.25
"""Maximum of a tendon's stiffness * step^2 / inertia.

An explicitly integrated spring diverges at a value of 4. At 0.67, the jaws of the da Vinci PSM oscillate and move the
arm (measured).
"""

RIGID_TOL = 1e-6
"""Tolerance of the rotation of a joint frame that is rigid but for rounding."""

TENDON_TIME_STEP = 1e-3
"""Assumed time step in s of the simulator that integrates a tendon."""

MIMIC_AXIS = "rotZ"
"""Instance name of mimic joints: PhysX requires a rotation axis, also for slides (with "transZ" a slide is free)."""

CustomData = dict[str, dict[str, object]]
"""Rows by name, as they stand in the customData of the robot's prim."""


def drive_kind(joint: Joint) -> str:
    """Return the UsdPhysics instance name of the drive of a joint with one coordinate: "angular" or "linear"."""
    if joint.is_angle:
        return "angular"
    return "linear"


def to_usd(joint: Joint, value: float) -> float:
    """Return a coordinate, limit or speed in the unit of UsdPhysics: degrees for angles, else metres."""
    if joint.is_angle:
        return float(value / DEG)
    return float(value)


def write_physics(
    mechanism: Mechanism,
    path: Path,
    link_poses: Mapping[str, Array],
    q_full: Mapping[str, float],
    efforts: Mapping[str, float],
) -> Path:
    """Write the physics layer and return its path.

    `link_poses` has T_world_body (4, 4) by body; the base is fixed to the root prim of the robot at its pose in
    `link_poses`. `q_full` has, at the same poses, the coordinate in m or rad of each joint with a single coordinate.
    `efforts` has the static effort in N or N m of driven joints; the effort of other joints is 0.

    Raises:
        StageError: UsdPhysics cannot hold the data of a joint, or a joint of the tree has no coordinate in `q_full`
            (simulators start at the joint states, not at the authored poses).
    """
    layer = new_layer(path)
    describe(layer, mechanism.name)
    stage = Usd.Stage.Open(layer)
    root = stage.OverridePrim(f"/{mechanism.name}")
    UsdPhysics.ArticulationRootAPI.Apply(root)
    root.AddAppliedSchema("PhysxArticulationAPI")
    # No self collision: convex hulls of adjacent links overlap at joints; their contact opens loops unnoticed.
    root.AddAppliedSchema("NewtonArticulationRootAPI")
    _attribute(root, "physxArticulation:enabledSelfCollisions", Sdf.ValueTypeNames.Bool, False)
    _attribute(root, "newton:selfCollisionEnabled", Sdf.ValueTypeNames.Bool, False)
    _attribute(root, "physxArticulation:solverPositionIterationCount", Sdf.ValueTypeNames.Int, POSITION_ITERATIONS)
    _write_model(root, mechanism)
    _write_bodies(stage, mechanism)
    UsdGeom.Scope.Define(stage, f"/{mechanism.name}/joints")
    layer.GetPrimAtPath(root.GetPath()).specifier = Sdf.SpecifierOver  # defining the scope changed its parent to def
    if _floats(mechanism):
        base = stage.OverridePrim(f"/{mechanism.name}/{mechanism.base}")
        UsdPhysics.RigidBodyAPI(base).CreateKinematicEnabledAttr(True)  # stays in place without a joint
    else:
        _write_anchor(stage, mechanism, link_poses[mechanism.base])
    _write_joints(stage, mechanism, q_full, efforts)
    mimics = _mimic_joints(mechanism)
    for coupling in mechanism.couplings:
        if coupling.name in mimics:
            _write_mimic(stage, mechanism, mimics[coupling.name])
        else:
            _write_tendon(stage, mechanism, coupling, link_poses)
    for joint in spanning(mechanism).tree:
        if joint.type == "spherical":
            _align_ball_frames(stage, mechanism, joint, link_poses)
    return save(layer, path)


def _attribute(prim: Usd.Prim, name: str, kind: Sdf.ValueTypeName, value) -> None:
    """Set an attribute that is not part of UsdPhysics: an attribute of twin or of a simulator."""
    is_custom = name.startswith("twin:")
    attribute = prim.CreateAttribute(name, kind, is_custom, Sdf.VariabilityVarying)
    attribute.Set(value)


def _write_bodies(stage: Usd.Stage, mechanism: Mechanism) -> None:
    """Make each body a rigid body with its mass, and each mesh a collider."""
    for body in mechanism.bodies:
        prim = stage.OverridePrim(f"/{mechanism.name}/{body.name}")
        UsdPhysics.RigidBodyAPI.Apply(prim)
        if body.inertia is not None:
            write_inertia(prim, body.inertia)
        if not body.whole:
            _attribute(prim, "twin:whole", Sdf.ValueTypeNames.Bool, False)
    for mesh_path in mesh_paths(mechanism).values():
        prim = stage.OverridePrim(mesh_path)
        UsdPhysics.CollisionAPI.Apply(prim)
        # Engines do not support triangle meshes as colliders of moving bodies; all engines support convex hulls.
        UsdPhysics.MeshCollisionAPI.Apply(prim).CreateApproximationAttr(UsdPhysics.Tokens.convexHull)


def _write_joints(
    stage: Usd.Stage, mechanism: Mechanism, q_full: Mapping[str, float], efforts: Mapping[str, float]
) -> None:
    joints = spanning(mechanism)
    loops = {joint.name for joint in joints.cut}
    # Tree joints are written outwards: Newton rejects a tree joint whose parent is the outer body.
    outwards = {joint.name: joint for joint in joints.tree}
    for described in mechanism.joints:
        joint = outwards.get(described.name, described)
        closes_loop = joint.name in loops
        if len(joint.free_axes) == 1 and joint.name not in q_full and not closes_loop:
            raise StageError(f"{mechanism.name}: q_full lacks joint '{joint.name}'")
        driven = _as_driven(mechanism, joint)
        _write_joint(stage, mechanism, driven, closes_loop, q_full.get(joint.name), efforts.get(joint.name, 0.0))


def _write_model(root: Usd.Prim, mechanism: Mechanism) -> None:
    _attribute(root, "twin:base", Sdf.ValueTypeNames.Token, mechanism.base)
    _attribute(root, "twin:tool", Sdf.ValueTypeNames.Token, mechanism.tool)
    # Only the file name, because a path would depend on the machine.
    _attribute(root, "twin:source", Sdf.ValueTypeNames.String, Path(mechanism.source).name)
    if mechanism.gravity != EARTH:  # the robot's layers have no physics scene
        _attribute(root, "twin:gravity", Sdf.ValueTypeNames.Double3, Gf.Vec3d(*mechanism.gravity))
    if len(mechanism.trocars) == 1:
        _attribute(root, "twin:trocar", Sdf.ValueTypeNames.Token, mechanism.trocars[0])
    elif mechanism.trocars:
        _attribute(root, "twin:trocars", Sdf.ValueTypeNames.TokenArray, list(mechanism.trocars))
    postures: CustomData = {}
    for name, coordinates in mechanism.postures.items():
        postures[name] = {}
        for joint, q in coordinates.items():
            postures[name][joint] = float(q)
    model = {
        "postures": postures,
        "parameters": _with_index(_parameter_rows(mechanism)),
        "couplings": _with_index(_coupling_rows(mechanism)),
        "actuators": _with_index(_actuator_rows(mechanism)),
        "transmissions": _with_index(_transmission_rows(mechanism)),
    }
    for key, rows in model.items():
        if rows:
            root.SetCustomDataByKey(f"twin:{key}", rows)


def _parameter_rows(mechanism: Mechanism) -> CustomData:
    rows: CustomData = {}
    for parameter in mechanism.parameters:
        row = _fields_with_values(parameter)
        row["value"] = float(parameter.value)
        row["shown"] = float(parameter.shown)
        rows[parameter.name] = row
    return rows


def _coupling_rows(mechanism: Mechanism) -> CustomData:
    rows: CustomData = {}
    for coupling in mechanism.couplings:
        ratios = dict(zip(coupling.joints, map(float, coupling.ratios), strict=True))
        rows[coupling.name] = {"total": float(coupling.total), "ratios": ratios}
    return rows


def _actuator_rows(mechanism: Mechanism) -> CustomData:
    rows: CustomData = {}
    for actuator in mechanism.actuators:
        row = _fields_with_values(actuator)
        if actuator.limits is not None:
            row["limits"] = Gf.Vec2d(*actuator.limits)
        rows[actuator.name] = row
    return rows


def _transmission_rows(mechanism: Mechanism) -> CustomData:
    rows: CustomData = {}
    for transmission in mechanism.transmissions:
        rows[transmission.name] = {
            "joints": Vt.StringArray(transmission.joints),
            "actuators": Vt.StringArray(transmission.actuators),
            "matrix": Vt.DoubleArray(transmission.matrix.ravel().tolist()),
        }
    return rows


def _with_index(rows: CustomData) -> CustomData:
    """Return rows with their index: USD stores dictionaries by name, but the reader restores the order."""
    for index, row in enumerate(rows.values()):
        row["index"] = index
    return rows


def _fields_with_values(item: Parameter | Actuator) -> dict[str, object]:
    """Return the fields of a parameter or an actuator that have a value; its name is the key of its row."""
    fields = {}
    for field, value in vars(item).items():
        if field != "name" and value is not None:
            fields[field] = value
    return fields


def _as_driven(mechanism: Mechanism, joint: Joint) -> Joint:
    """Return a joint with a drive equivalent to its motors, because UsdPhysics drives each joint separately."""
    transmission = mechanism.transmission_of(joint.name)
    if not transmission:
        return joint
    gains = joint_gains(transmission, mechanism.actuators)
    if not gains:
        return joint
    index = transmission.joints.index(joint.name)
    stiffness, damping = gains
    return replace(joint, drive=Drive(float(stiffness[index]), float(damping[index])))


def write_inertia(prim: Usd.Prim, inertia: Inertia) -> None:
    """Apply the mass properties to the prim of a body."""
    moments, axes = inertia.principal()
    mass = UsdPhysics.MassAPI.Apply(prim)
    mass.CreateMassAttr(float(inertia.mass))
    mass.CreateCenterOfMassAttr(gf.vec3f(inertia.p_body_com))
    mass.CreateDiagonalInertiaAttr(gf.vec3f(moments))
    mass.CreatePrincipalAxesAttr(gf.quatf(axes))


def _floats(mechanism: Mechanism) -> bool:
    """Return whether only free joints connect the base to the robot, so that nothing fixes the robot to the world."""
    for joint in mechanism.joints:
        if mechanism.base in (joint.parent, joint.child) and joint.type != "free":
            return False
    return True


def _write_anchor(stage: Usd.Stage, mechanism: Mechanism, T_world_base: Array) -> None:
    """Fix the base to the robot's root prim.

    Parsers treat the root prim as the static world, because it is not a rigid body. If a scene references the robot at
    another pose, the anchor moves with the root prim. A joint with an empty target would not move with the robot.
    """
    joint_names = {joint.name for joint in mechanism.joints}
    name = LeafNames(joint_names).take("root_joint", "world")
    joint = UsdPhysics.FixedJoint.Define(stage, f"/{mechanism.name}/joints/{name}")
    joint.CreateBody0Rel().SetTargets([f"/{mechanism.name}"])
    joint.CreateBody1Rel().SetTargets([f"/{mechanism.name}/{mechanism.base}"])
    _write_frames(joint, T_world_base, np.eye(4))
    joint.CreateCollisionEnabledAttr(False)


def _write_frames(joint: UsdPhysics.Joint, T_body0_joint: Array, T_body1_joint: Array) -> None:
    joint.CreateLocalPos0Attr(gf.vec3f(T_body0_joint[:3, 3]))
    joint.CreateLocalRot0Attr(gf.quatf(T_body0_joint[:3, :3]))
    joint.CreateLocalPos1Attr(gf.vec3f(T_body1_joint[:3, 3]))
    joint.CreateLocalRot1Attr(gf.quatf(T_body1_joint[:3, :3]))


def _write_joint(
    stage: Usd.Stage, mechanism: Mechanism, joint: Joint, closes_loop: bool, q: float | None, effort: float
) -> None:
    _refuse_unstorable(joint)
    usd_joint = SCHEMAS[joint.type].Define(stage, f"/{mechanism.name}/joints/{joint.name}")
    prim = usd_joint.GetPrim()
    usd_joint.CreateBody0Rel().SetTargets([f"/{mechanism.name}/{joint.parent}"])
    usd_joint.CreateBody1Rel().SetTargets([f"/{mechanism.name}/{joint.child}"])
    _write_frames(usd_joint, joint.T_parent_joint, joint.T_child_joint)
    usd_joint.CreateCollisionEnabledAttr(False)
    if closes_loop:
        usd_joint.CreateExcludeFromArticulationAttr(True)
    if joint.type == "free":
        # It constrains nothing, and no engine has such a joint in an articulation: engines skip a disabled joint.
        usd_joint.CreateJointEnabledAttr(False)
        _attribute(prim, "twin:free", Sdf.ValueTypeNames.Bool, True)
    if joint.type in ("revolute", "prismatic", "spherical"):
        usd_joint.CreateAxisAttr(UsdPhysics.Tokens.z)
    if joint.type == "cylindrical":
        for axis, direction in enumerate(DIRECTIONS):
            if axis in FREE_AXES["cylindrical"]:
                continue
            lock = UsdPhysics.LimitAPI.Apply(prim, direction)
            lock.CreateLowAttr(1.0)  # in UsdPhysics, low > high locks an axis
            lock.CreateHighAttr(-1.0)
    if joint.limits is not None:
        low, high = joint.limits
        usd_joint.CreateLowerLimitAttr(to_usd(joint, low))
        usd_joint.CreateUpperLimitAttr(to_usd(joint, high))
    if joint.cone is not None:
        cone = float(joint.cone / DEG)
        usd_joint.CreateConeAngle0LimitAttr(cone)
        usd_joint.CreateConeAngle1LimitAttr(cone)
    if q is not None and len(joint.free_axes) == 1:
        _write_state(prim, joint, to_usd(joint, q))
    _write_actuation(prim, joint, q, effort)


def _write_state(prim: Usd.Prim, joint: Joint, position: float) -> None:
    """Write the joint state, at which simulations start; `position` is in the unit of UsdPhysics."""
    kind = drive_kind(joint)
    prim.AddAppliedSchema(f"PhysicsJointStateAPI:{kind}")
    _attribute(prim, f"state:{kind}:physics:position", Sdf.ValueTypeNames.Float, position)
    _attribute(prim, f"state:{kind}:physics:velocity", Sdf.ValueTypeNames.Float, 0.0)
    # With its default settings, Newton reads the joint state only from this attribute.
    _attribute(prim, f"newton:{kind}:position", Sdf.ValueTypeNames.Float, position)


def _align_ball_frames(stage: Usd.Stage, mechanism: Mechanism, joint: Joint, link_poses: Mapping[str, Array]) -> None:
    """Rotate the child frame of a ball joint in the tree so that both joint frames coincide at the written poses.

    Simulators start the ball joints of an articulation at zero and ignore their joint states (in PhysX, SILS started
    with a gap of 21 mm, SHER with 0.28 m). The original frame is stored in an attribute. A cone is relative to the
    original axes; UsdPhysics cannot express such a cone. The axis is X, because PhysX's tensor interface accepts no
    other axis for ball joints.
    """
    usd_joint = UsdPhysics.SphericalJoint(stage.GetPrimAtPath(f"/{mechanism.name}/joints/{joint.name}"))
    prim = usd_joint.GetPrim()
    R_parent_joint = joint.T_parent_joint[:3, :3] @ TURN_OF_AXIS["X"].T
    R_child_parent = link_poses[joint.child][:3, :3].T @ link_poses[joint.parent][:3, :3]
    R_child_joint = R_child_parent @ R_parent_joint
    usd_joint.GetAxisAttr().Set(UsdPhysics.Tokens.x)
    usd_joint.GetLocalRot0Attr().Set(gf.quatf(R_parent_joint))
    usd_joint.GetLocalRot1Attr().Set(gf.quatf(R_child_joint))
    turn = (R_child_joint @ TURN_OF_AXIS["X"]).T @ joint.T_child_joint[:3, :3]
    _attribute(prim, "twin:childTurn", Sdf.ValueTypeNames.Quatd, gf.quatd(turn))
    if joint.cone is not None:
        for limit in (usd_joint.GetConeAngle0LimitAttr(), usd_joint.GetConeAngle1LimitAttr()):
            prim.RemoveProperty(limit.GetName())
        _attribute(prim, "twin:cone", Sdf.ValueTypeNames.Double, float(joint.cone))


def _mimic_joints(mechanism: Mechanism) -> dict[str, Following]:
    """Return {coupling: its leader and follower} for the couplings that a mimic joint can express.

    PhysX and Newton accept only joints of the articulation as mimic joints, and PhysX requires limits on hinges. The
    offset must be zero, because PhysX reads it in degrees and Newton in rad.
    """
    accepted: set[str] = set()
    for joint in spanning(mechanism).tree:
        if joint.type == "prismatic" or (joint.type == "revolute" and joint.limits):
            accepted.add(joint.name)
    mimics: dict[str, Following] = {}
    for coupling, follower in following(mechanism, accepted).items():
        if follower.offset == 0:
            mimics[coupling] = follower
    return mimics


def _write_mimic(stage: Usd.Stage, mechanism: Mechanism, following_joint: Following) -> None:
    """Write a joint that follows another: joint + gearing * leader = 0. PhysX solves this exactly at any time step."""
    joints = f"/{mechanism.name}/joints"
    prim = stage.GetPrimAtPath(f"{joints}/{following_joint.joint}")
    prim.AddAppliedSchema(f"PhysxMimicJointAPI:{MIMIC_AXIS}")
    place = f"physxMimicJoint:{MIMIC_AXIS}"
    prim.CreateRelationship(f"{place}:referenceJoint", False).SetTargets([f"{joints}/{following_joint.leader}"])
    axis = prim.CreateAttribute(f"{place}:referenceJointAxis", Sdf.ValueTypeNames.Token, False, Sdf.VariabilityUniform)
    axis.Set(MIMIC_AXIS)
    _attribute(prim, f"{place}:gearing", Sdf.ValueTypeNames.Float, -following_joint.multiplier)


def _write_tendon(stage: Usd.Stage, mechanism: Mechanism, coupling: Coupling, link_poses: Mapping[str, Array]) -> None:
    """Write a PhysX tendon for a coupling that mimic joints cannot express; its root is the joint nearest to the base.

    UsdPhysics cannot express couplings; without the tendon, a passive joint of a belt drive moves freely in PhysX. The
    tendon has the stiffness of the drives: PhysX integrates tendons explicitly, and a tendon with damping or much
    higher stiffness is unstable at 1 kHz. The tendon is softer if one of its joints moves little inertia.
    """
    ratios = dict(zip(coupling.joints, coupling.ratios, strict=True))
    drive_stiffnesses = []
    for name in coupling.joints:
        drive = mechanism.joint(name).drive
        if drive:
            drive_stiffnesses.append(drive.stiffness)
    stiffness = max(drive_stiffnesses, default=np.inf)
    joints = [joint for joint in spanning(mechanism).tree if joint.name in ratios]
    for joint in joints:
        # inertia of the joint as the tendon feels it
        inertia = _inertia_beyond(mechanism, joint, link_poses) / ratios[joint.name] ** 2
        if inertia > 0:
            stiffness = min(stiffness, MAX_TENDON_RATIO * inertia / TENDON_TIME_STEP**2)
    if not np.isfinite(stiffness):  # no joint has a drive, and all of them are in loops
        stiffness = 1.0
    place = f"physxTendon:{coupling.name}"
    for joint in joints:
        prim = stage.GetPrimAtPath(f"/{mechanism.name}/joints/{joint.name}")
        gearing = [float(ratios[joint.name])]
        if joint is not joints[0]:
            prim.AddAppliedSchema(f"PhysxTendonAxisAPI:{coupling.name}")
            _attribute(prim, f"{place}:gearing", Sdf.ValueTypeNames.FloatArray, gearing)
            continue
        prim.AddAppliedSchema(f"PhysxTendonAxisRootAPI:{coupling.name}")
        _attribute(prim, f"{place}:gearing", Sdf.ValueTypeNames.FloatArray, gearing)
        _attribute(prim, f"{place}:stiffness", Sdf.ValueTypeNames.Float, stiffness)
        _attribute(prim, f"{place}:damping", Sdf.ValueTypeNames.Float, 0.0)
        _attribute(prim, f"{place}:restLength", Sdf.ValueTypeNames.Float, to_usd(joint, coupling.total))


def _inertia_beyond(mechanism: Mechanism, joint: Joint, link_poses: Mapping[str, Array]) -> float:
    """Return the inertia in kg or kg m2 of all bodies beyond a joint with one coordinate.

    The result is infinite if the joint is part of a loop, because bodies outside the joint's branch then also move.
    """
    joints = spanning(mechanism)
    branch = {joint.child}
    for outer_joint in joints.tree:  # parents come first
        if outer_joint.parent in branch:
            branch.add(outer_joint.child)
    for closure in joints.cut:
        if (closure.parent in branch) != (closure.child in branch):
            return np.inf
    T_world_joint = link_poses[joint.parent] @ joint.T_parent_joint
    inertia_beyond = 0.0
    for name in sorted(branch):
        inertia = mechanism.body(name).inertia
        if inertia is None:
            continue
        if not joint.is_angle:
            inertia_beyond += float(inertia.mass)
            continue
        R = link_poses[name][:3, :3]
        p = link_poses[name][:3, 3]
        # axis of the joint, and arm from the axis to the centre of mass, both in the body's frame
        axis = R.T @ T_world_joint[:3, 2]
        arm = inertia.p_body_com - R.T @ (T_world_joint[:3, 3] - p)
        about_center = axis @ inertia.I_com @ axis
        squared_distance = arm @ arm - (arm @ axis) ** 2
        inertia_beyond += float(about_center + inertia.mass * squared_distance)  # parallel axes
    return inertia_beyond


def _write_actuation(prim: Usd.Prim, joint: Joint, q: float | None, effort: float) -> None:
    if joint.drive is not None:
        _write_drive(prim, joint, joint.drive, q, effort)
    if joint.max_speed is not None:
        prim.AddAppliedSchema("PhysxJointAPI")
        _attribute(prim, "physxJoint:maxJointVelocity", Sdf.ValueTypeNames.Float, to_usd(joint, joint.max_speed))
    if joint.active:
        _attribute(prim, "twin:active", Sdf.ValueTypeNames.Bool, True)
    if joint.max_acceleration is not None:
        _attribute(prim, "twin:maxAcceleration", Sdf.ValueTypeNames.Double, float(joint.max_acceleration))
    if joint.max_jerk is not None:
        _attribute(prim, "twin:maxJerk", Sdf.ValueTypeNames.Double, float(joint.max_jerk))
    if joint.soft_limits is not None:
        low, high = joint.soft_limits
        _attribute(prim, "twin:softLimits", Sdf.ValueTypeNames.Double2, Gf.Vec2d(float(low), float(high)))
    if joint.mating:
        _attribute(prim, "twin:mating", Sdf.ValueTypeNames.StringArray, list(joint.mating))


def _write_drive(prim: Usd.Prim, joint: Joint, gains: Drive, q: float | None, effort: float) -> None:
    drive = UsdPhysics.DriveAPI.Apply(prim, drive_kind(joint))
    unit = 1.0
    if joint.is_angle:
        unit = DEG  # the gains of UsdPhysics are per degree
    drive.CreateTypeAttr(UsdPhysics.Tokens.force)
    drive.CreateStiffnessAttr(float(gains.stiffness * unit))
    drive.CreateDampingAttr(float(gains.damping * unit))
    if gains.max_effort is not None:
        drive.CreateMaxForceAttr(float(gains.max_effort))
    # The target holds the authored pose: coordinate at this pose, plus the deflection of the drive's spring under
    # the static effort, without which the robot would sag.
    deflection = 0.0
    if gains.stiffness > 0:
        deflection = effort / gains.stiffness
    target = deflection
    if q is not None:
        target = q + deflection
    if joint.limits is not None:
        low, high = joint.limits
        target = np.clip(target, low, high)
    drive.CreateTargetPositionAttr(to_usd(joint, target))


def _refuse_unstorable(joint: Joint) -> None:
    """Raise `StageError` for data that UsdPhysics cannot hold; otherwise the data would be lost unnoticed."""
    scalar = {
        "limits": joint.limits,
        "soft limits": joint.soft_limits,
        "a maximum speed": joint.max_speed,
        "a maximum acceleration": joint.max_acceleration,
        "a maximum jerk": joint.max_jerk,
        "a drive": joint.drive,
    }
    refused: list[str] = []
    if len(joint.free_axes) != 1:
        for name, value in scalar.items():
            if value is not None:
                refused.append(name)
    if joint.cone is not None and joint.type != "spherical":
        refused.append("a cone")
    if refused:
        raise StageError(
            f"joint '{joint.name}' is {joint.type} and has {', '.join(refused)}, which UsdPhysics cannot hold for this "
            "type. Only joints with one coordinate can have limits, and only spherical joints can have cones."
        )
    for T in (joint.T_parent_joint, joint.T_child_joint):
        if not spatial.is_pose(T, RIGID_TOL):
            raise StageError(f"joint '{joint.name}': a joint frame is not a rigid pose")
