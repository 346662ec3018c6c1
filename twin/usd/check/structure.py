"""Check the graph of bodies and joints, its articulation root and its self collision."""

from __future__ import annotations

from collections.abc import Iterator

from pxr import UsdPhysics

from twin.core.findings import Finding, Kind, disagreement, warning
from twin.usd.scan import RawJoint, Scene

_EMPTY = Kind("stage.empty", "error", "apply PhysicsRigidBodyAPI to the links, and connect the links by joints")
_FLOATING = Kind("stage.floating", "info", "fix the base with a PhysicsFixedJoint, unless the robot walks or flies")
_LOOP = Kind(
    "stage.loop", "disagreement", "author physics:excludeFromArticulation = true on the joint that closes the loop"
)
_LOOSE = Kind(
    "stage.loose", "info", "if the body is part of the robot, connect it by a joint; a separate object needs no change"
)
_SELF_COLLISION = Kind(
    "stage.self_collision", "warning", "author physxArticulation:enabledSelfCollisions = false, or filter the pairs"
)
_DISCONNECTED = Kind("stage.disconnected", "disagreement", "exclude only one joint of each loop from the articulation")

_FOLDER = "; if the stage was made from a robot folder, add a [[drive]] to the robot's TOML file instead"
"""End of the suggestion on missing drives: what to do if the stage was made from a robot folder."""


def check_structure(scene: Scene) -> Iterator[Finding]:
    """Yield findings on loops, unconnected bodies, articulation roots, missing drives and a base that is not fixed."""
    joints = [j for j in scene.joints if j.enabled and not any(e.problem for e in j.ends)]
    if not scene.bodies or not joints:
        yield _EMPTY("/", f"there is no mechanism to check: {len(scene.bodies)} rigid bodies, {len(joints)} joints")
        return
    yield from _check_tree(scene, joints)
    yield from _check_articulation(scene, joints)
    yield from _check_drives(joints)


def _check_drives(joints: list[RawJoint]) -> Iterator[Finding]:
    """Yield one finding if no joint has a drive, else one for each active joint whose drive or gains are missing."""
    code, active = "stage.drive_missing", [j for j in joints if _is_active(j)]
    if not any(j.prim.HasAPI(UsdPhysics.DriveAPI) for j in joints):
        text = "no joint has a drive: in a simulator the robot collapses"
        text += f"; active joints: {', '.join(j.path for j in active)}" if active else ""
        yield warning(code, "/", text, suggestion=f"apply PhysicsDriveAPI to the actuated joints{_FOLDER}")
        return
    for joint in active:
        has = joint.prim.HasAPI(UsdPhysics.DriveAPI, joint.instance)
        drive = UsdPhysics.DriveAPI(joint.prim, joint.instance)
        if has and drive.GetStiffnessAttr().Get() + drive.GetDampingAttr().Get() > 0:
            continue
        yield warning(
            code,
            joint.path,
            f"joint {joint.path} is active, but {'its drive has no gains' if has else 'has no drive'}: it moves "
            "freely in a simulator",
            suggestion=f"apply PhysicsDriveAPI:{joint.instance} with stiffness and damping{_FOLDER}",
        )


def _is_active(joint: RawJoint) -> bool:
    active = joint.prim.GetAttribute("twin:active")
    return bool(joint.instance and active and active.Get())


def _check_tree(scene: Scene, joints: list[RawJoint]) -> Iterator[Finding]:
    """Yield findings on loops, unconnected bodies and a base that is not fixed.

    The tree is built one joint at a time; a joint between two bodies that are already connected closes a loop.
    """
    ways: dict[str, dict[str, str]] = {}
    for joint in (j for j in joints if not j.excluded):
        a, b = (e.body for e in joint.ends)
        if a == b:
            continue
        came = _reached(ways, a)
        if b in came:
            way = []
            while b != a:
                b, between = came[b]
                way.insert(0, between.rpartition("/")[2])
            others = ", ".join(way)
            text = (
                f"joint {joint.path} closes a loop with {others}, and no joint of this loop is excluded from the "
                "articulation: engines ignore one joint or reject the robot"
            )
            yield _LOOP(joint.path, text)
            continue
        ways.setdefault(a, {})[b] = joint.path
        ways.setdefault(b, {})[a] = joint.path
    for body in scene.bodies:
        if scene.is_kinematic(body):
            ways.setdefault("", {})[body] = ""
            ways.setdefault(body, {})[""] = ""
    joined = {e.body for j in joints for e in j.ends}
    held = _reached(ways, "") if "" in ways else None
    for body in scene.bodies:
        if body not in joined:
            yield _LOOSE(body, f"body {body} has no joint")
        elif body not in ways or (held is not None and body not in held):
            yield _DISCONNECTED(
                body, f"body {body} is not a link of the robot: no joint of the articulation connects it to the robot"
            )
    if held is None:
        yield _FLOATING("/", "no joint connects the robot to the world, so the robot falls in a simulator")


def _reached(ways: dict[str, dict[str, str]], start: str) -> dict[str, tuple[str, str]]:
    """Return {body: (previous body, joint between the two)} of each body that is connected to the body `start`."""
    came = {start: ("", "")}
    pending = [start]
    while pending:
        here = pending.pop(0)
        for there, joint in ways.get(here, {}).items():
            if there not in came:
                came[there] = (here, joint)
                pending.append(there)
    return came


def _check_articulation(scene: Scene, joints: list[RawJoint]) -> Iterator[Finding]:
    roots = [p for p in scene.prims if p.HasAPI(UsdPhysics.ArticulationRootAPI)]
    if not roots:
        yield disagreement(
            "stage.articulation_root",
            str(next(iter(scene.bodies.values())).GetParent().GetPath()),
            "no articulation root: engines simulate separate bodies held by springs instead of a robot",
            suggestion="apply PhysicsArticulationRootAPI to the root prim of the robot",
        )
    for inner in roots:
        outer = [r for r in roots if inner != r and inner.GetPath().HasPrefix(r.GetPath())]
        if outer:
            yield disagreement(
                "stage.articulation_root",
                str(inner.GetPath()),
                f"articulation root {inner.GetPath()} is nested in articulation root {outer[0].GetPath()}",
                suggestion="keep one articulation root for each robot",
            )
    colliders = any(p.HasAPI(UsdPhysics.CollisionAPI) for p in scene.prims)
    if not (colliders and any(j.excluded for j in joints)):
        return  # without loops, self collision may be on or off
    for root in roots:
        attribute = root.GetAttribute("physxArticulation:enabledSelfCollisions")
        if not (attribute and attribute.Get() is False):
            text = (
                f"self collision of {root.GetPath()} is on (the default): hulls that overlap at the joints push "
                "closed loops open"
            )
            yield _SELF_COLLISION(str(root.GetPath()), text)
