"""Convert joint prims to joints of a mechanism, and select the base."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from pxr import UsdPhysics

from twin.core import spatial
from twin.core.errors import StageError
from twin.core.findings import Finding, info
from twin.core.spatial import Array
from twin.core.units import DEG
from twin.model.joint import Drive, Joint
from twin.usd import gf
from twin.usd.scan import End, RawJoint, Scene


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


def select(scene: Scene, root: str | None, notes: list[Finding]) -> Selection:
    """Select the robot of a stage and find its base.

    All prims below the prim path `root` form one robot, and other prims are ignored; None: the whole stage. `notes`
    receives findings on unconnected bodies and disabled joints, which are omitted.

    Raises:
        StageError: there are no bodies or joints, a joint is invalid, there are several robots, or several bodies are
            fixed to the world.
    """
    within = (lambda path: path == root or path.startswith(f"{root}/")) if root else (lambda path: True)
    bodies = [p for p in scene.bodies if within(p)]
    joints = [j for j in scene.joints if within(j.path)]
    place = f"{scene.path}{f', below {root}' if root else ''}"
    if not bodies:
        raise StageError(f"{place}: the stage has no rigid bodies (PhysicsRigidBodyAPI), so there is no mechanism")
    notes.extend(
        info("stage.read.disabled", j.path, f"joint {j.path} is disabled and left out") for j in joints if not j.enabled
    )
    joints = [j for j in joints if j.enabled]
    for joint in (j for j in joints if j.fault):
        raise StageError(f"{scene.path}: joint {joint.path}: {joint.fault}")
    if not joints:
        raise StageError(f"{place}: the stage has no joints, so there is no mechanism")
    groups = _groups(bodies, joints)
    robots = [g for g in groups if any(_moves(j) and _touches(j, g) for j in joints)]
    robots = robots or [g for g in groups if any(_touches(j, g) for j in joints)]
    grounded = [j for j in joints if not all(e.body for e in j.ends)]
    if root and len(robots) > 1 and all(any(_touches(j, g) for j in grounded) for g in robots):
        robots = [[p for g in robots for p in g]]  # several chains that start at the world form one robot
    if len(robots) > 1:
        firsts = ", ".join(g[0] for g in robots)
        raise StageError(
            f"{place}: the stage has {len(robots)} robots, with the first bodies {firsts}. Choose a robot by its root "
            "prim: "
            "twin new NAME --from FILE --root PRIM."
        )
    members = [p for p in bodies if p in set(robots[0])]
    notes.extend(
        info("stage.read.prop", p, f"body {p} is left out: no joint of the robot moves it")
        for p in bodies
        if p not in robots[0]
    )
    joints = [j for j in joints if _touches(j, robots[0])]
    base, anchor = _base(scene, place, members, joints, notes)
    joints = [j for j in joints if j is not anchor]
    if not scene.is_stated_base(base):  # else the joints have the order of the description: the last ones close loops
        joints = sorted(joints, key=lambda j: j.excluded)
    held = anchor is not None or scene.is_stated_base(base) or (base and scene.is_kinematic(base))
    return Selection(base, members, joints, anchor, floats=bool(base) and not held)


def convert(
    scene: Scene,
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

    def side(end: End) -> tuple[str, Array]:
        if end.body:
            return names[end.body], end.T_body_joint
        return names[base], spatial.inverse(T_world_base) @ end.T_body_joint

    (parent, T_parent), (child, T_child) = map(side, joint.ends)
    turn = joint.prim.GetAttribute("twin:childTurn").Get()
    if turn is not None:  # a ball joint whose child frame the writer rotated so that both frames coincide at rest
        T_child = T_child @ spatial.pose(gf.rotation(turn))
    unit = DEG if joint.is_angle else scene.meters
    prim = joint.prim
    drive, driven = _drive(scene, joint, notes)
    active = prim.GetAttribute("twin:active")
    limits = joint.limits and (joint.limits[0] * unit, joint.limits[1] * unit)
    speed = prim.GetAttribute("physxJoint:maxJointVelocity").Get() if joint.instance else None
    soft = prim.GetAttribute("twin:softLimits").Get()
    acceleration, jerk = (prim.GetAttribute(f"twin:max{what}").Get() for what in ("Acceleration", "Jerk"))
    return Joint(
        name,
        joint.type,  # pyright: ignore[reportArgumentType]
        parent,
        child,
        T_parent,
        T_child,
        active=bool(active.Get()) if active else driven,
        limits=limits,
        soft_limits=None if soft is None else (float(soft[0]), float(soft[1])),
        cone=_cone(joint),
        max_speed=None if speed is None or not np.isfinite(speed) else float(speed) * unit,
        max_acceleration=None if acceleration is None else float(acceleration),
        max_jerk=None if jerk is None else float(jerk),
        drive=drive,
        mating=tuple(prim.GetAttribute("twin:mating").Get() or ()),
    )


def _moves(joint: RawJoint) -> bool:
    return joint.type != "fixed" or all(e.body for e in joint.ends)


def _touches(joint: RawJoint, group: list[str]) -> bool:
    return any(e.body in group for e in joint.ends)


def _groups(bodies: list[str], joints: list[RawJoint]) -> list[list[str]]:
    """Return the groups of bodies that are connected by joints; connections through the world are ignored."""
    leader = {b: b for b in bodies}

    def find(b: str) -> str:
        while leader[b] != b:
            b = leader[b]
        return b

    for joint in joints:
        a, b = (e.body for e in joint.ends)
        if a in leader and b in leader:
            leader[find(b)] = find(a)
    groups: dict[str, list[str]] = {}
    for body in bodies:
        groups.setdefault(find(body), []).append(body)
    return list(groups.values())


def _base(
    scene: Scene, place: str, bodies: list[str], joints: list[RawJoint], notes: list[Finding]
) -> tuple[str, RawJoint | None]:
    """Return (prim path of the base, or "" for the world; joint that only fixes the base, or None).

    Each body of a robot without a joint to the world can be its base, because the robot floats; `notes` says which
    body was chosen.
    """
    grounded = [j for j in joints if not all(e.body for e in j.ends)]
    fixed = {next(e.body for e in j.ends if e.body): j for j in grounded if j.type == "fixed"}
    for body in bodies:
        if scene.is_stated_base(body):
            return body, fixed.get(body)
    if len(fixed) == 1:
        return next(iter(fixed.items()))
    if len(fixed) > 1:
        raise StageError(
            f"{place}: the base is ambiguous: several bodies are fixed to the world ({', '.join(fixed)}). Keep one of "
            "these fixed joints, and connect the other bodies to the base by joints."
        )
    if grounded:
        return "", None
    roots = [b for b in bodies if scene.bodies[b].HasAPI(UsdPhysics.ArticulationRootAPI)]
    if len(roots) == 1:
        return roots[0], None
    children = {j.ends[1].body for j in joints if not j.excluded}
    never = [b for b in bodies if b not in children]
    candidates = never or roots or bodies
    if len(candidates) > 1:
        text = (
            f"no joint fixes a body to the world, and the stage names no base: {candidates[0]} becomes the base of the "
            f"floating robot, which each of {len(candidates)} bodies could be"
        )
        notes.append(info("stage.read.base", candidates[0], text))
    return candidates[0], None


def _cone(joint: RawJoint) -> float | None:
    if joint.type != "spherical" or not joint.prim.IsA(UsdPhysics.SphericalJoint):
        return None
    name = joint.prim.GetAttribute("twin:cone").Get()
    if name is not None:
        return float(name)
    schema = UsdPhysics.SphericalJoint(joint.prim)
    # An elliptic cone is read as a circular cone with the smaller half angle, so that no forbidden pose is allowed.
    angles = [schema.GetConeAngle0LimitAttr().Get(), schema.GetConeAngle1LimitAttr().Get()]
    limited = [a for a in angles if a is not None and a >= 0]
    return min(limited) * DEG if limited else None


def _drive(scene: Scene, joint: RawJoint, notes: list[Finding]) -> tuple[Drive | None, bool]:
    """Return (position drive in SI units or None, whether the joint is driven).

    A drive without gains is ignored, because converters add such a drive to every joint. The gains of an acceleration
    drive are relative to the effective mass, which is unknown; the joint counts as driven, but its gains are omitted.
    """
    if not joint.instance or not joint.prim.HasAPI(UsdPhysics.DriveAPI, joint.instance):
        return None, False
    drive = UsdPhysics.DriveAPI(joint.prim, joint.instance)
    stiffness, damping, limit = (
        float(a.Get()) for a in (drive.GetStiffnessAttr(), drive.GetDampingAttr(), drive.GetMaxForceAttr())
    )
    if not (stiffness > 0 or damping > 0):
        return None, False
    if drive.GetTypeAttr().Get() == UsdPhysics.Tokens.acceleration:
        text = f"the gains of joint {joint.path} are left out, because the type of its drive is acceleration"
        notes.append(info("stage.read.drive", joint.path, text))
        return None, True
    force = scene.kilograms * scene.meters  # newtons per unit of force of the stage
    effort = force * scene.meters if joint.is_angle else force
    gain = effort / DEG if joint.is_angle else force / scene.meters
    return Drive(stiffness * gain, damping * gain, limit * effort if np.isfinite(limit) else None), True
