"""Convert joint prims to joints of a mechanism, and select the base."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from pxr import Usd, UsdPhysics

from twin.core import spatial
from twin.core.errors import NoMechanismError, StageError, UnsupportedError
from twin.core.findings import Finding, info
from twin.core.spatial import Array
from twin.core.units import DEG
from twin.model.joint import Drive, Joint
from twin.usd import gf
from twin.usd.scan import JointSide, RawJoint, RawStage


@dataclass(frozen=True)
class Selection:
    """Bodies and joints of the selected robot of a stage.

    Bodies are prim paths in the order of the stage; the base "" is the world itself. Joints that close loops are last;
    the joint that only fixes the base to the world is not among them, but is `anchor`. `floats`: no joint connects the
    robot to the world, and its base can move.
    """

    base: str
    bodies: list[str]
    joints: list[RawJoint]
    anchor: RawJoint | None = None
    floats: bool = False


def select(scene: RawStage, root: str | None, notes: list[Finding]) -> Selection:
    """Select the robot of a stage and find its base.

    All prims below the prim path `root` form one robot, and other prims are ignored; None: the whole stage. `notes`
    receives findings on unconnected bodies and disabled joints, which are omitted.

    Raises:
        StageError: there are no bodies or joints, a joint is invalid, there are several robots, or several bodies are
            fixed to the world.
    """
    bodies = [path for path in scene.bodies if _is_below_root(path, root)]
    place = scene.path
    if root:
        place = f"{scene.path}, below {root}"
    if not bodies:
        raise NoMechanismError(
            f"{place}: the stage has no rigid bodies (PhysicsRigidBodyAPI), so there is no mechanism"
        )
    joints = _enabled_joints(scene, root, notes)
    if not joints:
        raise NoMechanismError(f"{place}: the stage has no joints, so there is no mechanism")
    robots = _robots(_groups(bodies, joints), joints)
    if not robots:
        raise NoMechanismError(f"{place}: no joint holds a rigid body, so there is no mechanism")
    if root and len(robots) > 1 and all(_is_grounded(group, joints) for group in robots):
        # several chains that start at the world form one robot
        connected: list[str] = []
        for group in robots:
            connected += group
        robots = [connected]
    if len(robots) > 1:
        firsts = ", ".join(group[0] for group in robots)
        raise UnsupportedError(
            f"{place}: the stage has {len(robots)} robots, with the first bodies {firsts}. Choose a robot by its root "
            "prim: twin new NAME --from FILE --root PRIM."
        )
    robot = set(robots[0])
    members: list[str] = []
    for path in bodies:
        if path in robot:
            members.append(path)
        else:
            notes.append(info("stage.read.prop", path, f"body {path} is left out: no joint of the robot moves it"))
    own_joints = [joint for joint in joints if joint.touches(robot)]
    base, anchor = _base(scene, place, members, own_joints, notes)
    moving = [joint for joint in own_joints if joint is not anchor]
    if not scene.is_stated_base(base):  # else the joints have the order of the description: the last ones close loops
        moving.sort(key=lambda joint: joint.excluded)
    floats = bool(base) and anchor is None
    if floats and (scene.is_stated_base(base) or scene.is_kinematic(base)):
        floats = False
    return Selection(base, members, moving, anchor, floats=floats)


def _is_below_root(path: str, root: str | None) -> bool:
    """Return whether a prim path is the path `root` or below it; without a root, every prim belongs to the robot."""
    return not root or path == root or path.startswith(f"{root}/")


def _enabled_joints(scene: RawStage, root: str | None, notes: list[Finding]) -> list[RawJoint]:
    """Return the enabled joints below `root`; `notes` receives a finding on each disabled joint.

    Raises:
        StageError: a joint is invalid.
    """
    enabled: list[RawJoint] = []
    for joint in scene.joints:
        if not _is_below_root(joint.path, root):
            continue
        if joint.enabled:
            enabled.append(joint)
        else:
            text = f"joint {joint.path} is disabled and left out"
            notes.append(info("stage.read.disabled", joint.path, text))
    for joint in enabled:
        if joint.problem:
            raise UnsupportedError(f"{scene.path}: joint {joint.path}: {joint.problem}")
        if joint.fault:
            raise StageError(f"{scene.path}: joint {joint.path}: {joint.fault}")
    return enabled


def _robots(groups: list[list[str]], joints: list[RawJoint]) -> list[list[str]]:
    """Return the groups of bodies that are robots: those with a joint that can move, else those with any joint."""
    # a body that is only fixed to the world is scenery
    movable = [joint for joint in joints if joint.type != "fixed" or not joint.is_grounded]
    robots = []
    jointed = []
    for group in groups:
        if _has_joint(group, movable):
            robots.append(group)
        if _has_joint(group, joints):
            jointed.append(group)
    return robots or jointed


def _has_joint(group: list[str], joints: list[RawJoint]) -> bool:
    return any(joint.touches(group) for joint in joints)


def _is_grounded(group: list[str], joints: list[RawJoint]) -> bool:
    """Return whether a joint connects a group of bodies to the world."""
    return any(joint.is_grounded and joint.touches(group) for joint in joints)


def convert(
    scene: RawStage,
    joint: RawJoint,
    name: str,
    names: Mapping[str, str],
    base: str,
    T_world_base: Array,
    notes: list[Finding],
) -> Joint:
    """Return a joint in SI units, from body0 to body1.

    `names` has identifiers of bodies by prim path. Joint sides on the world are attached to `base`, whose pose is
    `T_world_base` (4, 4).
    """

    def side(end: JointSide) -> tuple[str, Array]:
        if end.body:
            return names[end.body], end.T_body_joint
        return names[base], spatial.inverse(T_world_base) @ end.T_body_joint

    parent, T_parent = side(joint.ends[0])
    child, T_child = side(joint.ends[1])
    prim = joint.prim
    turn = prim.GetAttribute("twin:childTurn").Get()
    if turn is not None:  # a ball joint whose child frame the writer rotated so that both frames coincide at rest
        T_child = T_child @ spatial.pose(gf.rotation(turn))
    unit = scene.meters
    if joint.is_angle:
        unit = DEG
    limits = None
    if joint.limits is not None:
        limits = (joint.limits[0] * unit, joint.limits[1] * unit)
    soft_limits = None
    soft = prim.GetAttribute("twin:softLimits").Get()
    if soft is not None:
        soft_limits = (float(soft[0]), float(soft[1]))
    drive, driven = _drive(scene, joint, notes)
    active = driven
    stated_active = prim.GetAttribute("twin:active")
    if stated_active:
        active = bool(stated_active.Get())
    return Joint(
        name,
        joint.type,  # pyright: ignore[reportArgumentType]
        parent,
        child,
        T_parent,
        T_child,
        active=active,
        limits=limits,
        soft_limits=soft_limits,
        cone=_cone(joint),
        max_speed=_max_speed(joint, unit, notes),
        max_acceleration=_number(prim, "twin:maxAcceleration"),
        max_jerk=_number(prim, "twin:maxJerk"),
        drive=drive,
        mating=tuple(prim.GetAttribute("twin:mating").Get() or ()),
    )


def _number(prim: Usd.Prim, name: str) -> float | None:
    value = prim.GetAttribute(name).Get()
    if value is None:
        return None
    return float(value)


def _max_speed(joint: RawJoint, unit: float, notes: list[Finding]) -> float | None:
    """Return the maximum speed in SI units; None if the stage gives none, or an infinite one.

    `notes` receives a finding on a speed that is not positive, which is left out.
    """
    if not joint.instance:
        return None
    speed = joint.prim.GetAttribute("physxJoint:maxJointVelocity").Get()
    if speed is None or not np.isfinite(speed):
        return None
    if not speed > 0:
        text = f"the maximum speed {speed:g} of joint {joint.path} is left out, because it is not positive"
        notes.append(info("stage.read.speed", joint.path, text))
        return None
    return float(speed) * unit


def _groups(bodies: list[str], joints: list[RawJoint]) -> list[list[str]]:
    """Return the groups of bodies that are connected by joints; connections through the world are ignored."""
    # union-find: each body points towards the leader of its group
    leader = dict(zip(bodies, bodies, strict=True))

    def find(body: str) -> str:
        while leader[body] != body:
            body = leader[body]
        return body

    for joint in joints:
        parent = joint.ends[0].body
        child = joint.ends[1].body
        if parent in leader and child in leader:
            leader[find(child)] = find(parent)
    groups: dict[str, list[str]] = {}
    for body in bodies:
        groups.setdefault(find(body), []).append(body)
    return list(groups.values())


def _base(
    scene: RawStage, place: str, bodies: list[str], joints: list[RawJoint], notes: list[Finding]
) -> tuple[str, RawJoint | None]:
    """Return (prim path of the base, or "" for the world; joint that only fixes the base, or None).

    Each body of a robot without a joint to the world can be its base, because the robot floats; `notes` says which
    body was chosen.
    """
    grounded = [joint for joint in joints if joint.is_grounded]
    fixed: dict[str, RawJoint] = {}
    for joint in grounded:
        if joint.type == "fixed":
            fixed[joint.ends[0].body or joint.ends[1].body] = joint
    for body in bodies:
        if scene.is_stated_base(body):
            return body, fixed.get(body)
    if len(fixed) == 1:
        return next(iter(fixed.items()))
    if len(fixed) > 1:
        raise UnsupportedError(
            f"{place}: the base is ambiguous: several bodies are fixed to the world ({', '.join(fixed)}). Keep one of "
            "these fixed joints, and connect the other bodies to the base by joints."
        )
    if grounded:
        return "", None
    roots = [body for body in bodies if scene.bodies[body].HasAPI(UsdPhysics.ArticulationRootAPI)]
    if len(roots) == 1:
        return roots[0], None
    never_child = list(bodies)
    for joint in joints:
        child = joint.ends[1].body
        if not joint.excluded and child in never_child:
            never_child.remove(child)
    candidates = never_child or roots or bodies
    if len(candidates) > 1:
        text = (
            f"no joint fixes a body to the world, and the stage names no base: {candidates[0]} becomes the base of the "
            f"floating robot, which each of {len(candidates)} bodies could be"
        )
        notes.append(info("stage.read.base", candidates[0], text))
    return candidates[0], None


def _cone(joint: RawJoint) -> float | None:
    """Return the half angle in rad of the cone of a ball joint; None without one."""
    if joint.type != "spherical" or not joint.prim.IsA(UsdPhysics.SphericalJoint):
        return None
    own_cone = joint.prim.GetAttribute("twin:cone").Get()
    if own_cone is not None:
        return _possible_cone(joint, float(own_cone))
    schema = UsdPhysics.SphericalJoint(joint.prim)
    limited: list[float] = []
    for angle in (schema.GetConeAngle0LimitAttr().Get(), schema.GetConeAngle1LimitAttr().Get()):
        if angle is not None and angle >= 0:  # in the schema, a negative angle means "not limited"
            limited.append(angle)
    if not limited:
        return None
    # An elliptic cone is read as a circular cone with the smaller half angle, so that no forbidden pose is allowed.
    return _possible_cone(joint, min(limited) * DEG)


def _possible_cone(joint: RawJoint, cone: float) -> float:
    """Return the half angle of a cone in rad, which must be above 0.

    Raises:
        UnsupportedError: it is 0: the joint is then a hinge about its axis, and no ball.
    """
    if not cone > 0:
        raise UnsupportedError(
            f"joint {joint.path}: its cone has the half angle {cone:g}, which must be above 0; a ball that only turns "
            "about its axis is a revolute joint"
        )
    return cone


def _drive(scene: RawStage, joint: RawJoint, notes: list[Finding]) -> tuple[Drive | None, bool]:
    """Return (position drive in SI units or None, whether the joint is driven).

    A drive without gains is ignored, because converters add such a drive to every joint. The gains of an acceleration
    drive are relative to the effective mass, which is unknown; the joint counts as driven, but its gains are omitted.
    So are those of a drive without stiffness, which controls a speed.
    """
    if not joint.instance or not joint.prim.HasAPI(UsdPhysics.DriveAPI, joint.instance):
        return None, False
    drive = UsdPhysics.DriveAPI(joint.prim, joint.instance)
    stiffness = float(drive.GetStiffnessAttr().Get())
    damping = float(drive.GetDampingAttr().Get())
    limit = float(drive.GetMaxForceAttr().Get())
    if stiffness == 0 and damping == 0:
        return None, False
    is_position_drive = 0 < stiffness < np.inf and 0 <= damping < np.inf
    if not is_position_drive:
        text = (
            f"the gains of joint {joint.path} are left out, because they are not those of a position drive: stiffness "
            f"{stiffness:g} (must be above 0), damping {damping:g} (must not be negative)"
        )
        notes.append(info("stage.read.drive", joint.path, text))
        return None, stiffness > 0 or damping > 0
    if drive.GetTypeAttr().Get() == UsdPhysics.Tokens.acceleration:
        text = f"the gains of joint {joint.path} are left out, because the type of its drive is acceleration"
        notes.append(info("stage.read.drive", joint.path, text))
        return None, True
    force = scene.kilograms * scene.meters  # newtons per unit of force of the stage
    if joint.is_angle:
        effort = force * scene.meters
        gain = effort / DEG
    else:
        effort = force
        gain = force / scene.meters
    max_effort = None
    if np.isfinite(limit):
        max_effort = limit * effort
    return Drive(stiffness * gain, damping * gain, max_effort), True
