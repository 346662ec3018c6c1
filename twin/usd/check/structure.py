"""Check the graph of bodies and joints, its articulation root and its self collision."""

from __future__ import annotations

from collections.abc import Iterator

from pxr import UsdPhysics

from twin.core.findings import Finding, Kind, disagreement, warning
from twin.usd.scan import RawJoint, RawStage

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

_ADVICE_FOR_FOLDERS = "; if the stage was made from a robot folder, add a [[drive]] to the robot's TOML file instead"
"""End of the suggestion on missing drives: what to do if the stage was made from a robot folder."""


def check_structure(scene: RawStage) -> Iterator[Finding]:
    """Yield findings on loops, unconnected bodies, articulation roots, missing drives and a base that is not fixed."""
    joints: list[RawJoint] = []
    for joint in scene.joints:
        if joint.enabled and not (joint.ends[0].problem or joint.ends[1].problem):
            joints.append(joint)
    if not scene.bodies or not joints:
        yield _EMPTY("/", f"there is no mechanism to check: {len(scene.bodies)} rigid bodies, {len(joints)} joints")
        return
    yield from _check_tree(scene, joints)
    yield from _check_articulation(scene, joints)
    yield from _check_drives(joints)


def _check_drives(joints: list[RawJoint]) -> Iterator[Finding]:
    """Yield one finding if no joint has a drive, else one for each active joint whose drive or gains are missing."""
    code = "stage.drive_missing"
    active = [joint for joint in joints if _is_active(joint)]
    if not any(joint.prim.HasAPI(UsdPhysics.DriveAPI) for joint in joints):
        text = "no joint has a drive: in a simulator the robot collapses"
        if active:
            paths = ", ".join(joint.path for joint in active)
            text += f"; active joints: {paths}"
        yield warning(code, "/", text, suggestion=f"apply PhysicsDriveAPI to the actuated joints{_ADVICE_FOR_FOLDERS}")
        return
    for joint in active:
        lack = "has no drive"
        if joint.prim.HasAPI(UsdPhysics.DriveAPI, joint.instance):
            drive = UsdPhysics.DriveAPI(joint.prim, joint.instance)
            gains = (drive.GetStiffnessAttr().Get() or 0.0) + (drive.GetDampingAttr().Get() or 0.0)
            if gains > 0:
                continue
            lack = "its drive has no gains"
        yield warning(
            code,
            joint.path,
            f"joint {joint.path} is active, but {lack}: it moves freely in a simulator",
            suggestion=f"apply PhysicsDriveAPI:{joint.instance} with stiffness and damping{_ADVICE_FOR_FOLDERS}",
        )


def _is_active(joint: RawJoint) -> bool:
    active = joint.prim.GetAttribute("twin:active")
    return bool(joint.instance and active and active.Get())


def _check_tree(scene: RawStage, joints: list[RawJoint]) -> Iterator[Finding]:
    """Yield findings on loops, unconnected bodies and a base that is not fixed.

    The tree is built one joint at a time; a joint between two bodies that are already connected closes a loop.
    """
    links: dict[str, dict[str, str]] = {}  # {body: {neighbour: joint between the two}}
    for joint in joints:
        parent = joint.ends[0].body
        child = joint.ends[1].body
        if joint.excluded or parent == child:
            continue
        previous = _connected_bodies(links, parent)
        if child in previous:
            others = ", ".join(_joints_between(previous, parent, child))
            text = (
                f"joint {joint.path} closes a loop with {others}, and no joint of this loop is excluded from the "
                "articulation: engines ignore one joint or reject the robot"
            )
            yield _LOOP(joint.path, text)
            continue
        links.setdefault(parent, {})[child] = joint.path
        links.setdefault(child, {})[parent] = joint.path
    for body in scene.bodies:
        if scene.is_kinematic(body):
            links.setdefault("", {})[body] = ""
            links.setdefault(body, {})[""] = ""
    jointed: set[str] = set()
    for joint in joints:
        jointed.update((joint.ends[0].body, joint.ends[1].body))
    floats = "" not in links
    reached = set(links)
    if not floats:
        reached = set(_connected_bodies(links, ""))
    for body in scene.bodies:
        if body not in jointed:
            yield _LOOSE(body, f"body {body} has no joint")
        elif body not in links or body not in reached:
            yield _DISCONNECTED(
                body, f"body {body} is not a link of the robot: no joint of the articulation connects it to the robot"
            )
    if floats:
        yield _FLOATING("/", "no joint connects the robot to the world, so the robot falls in a simulator")


def _connected_bodies(links: dict[str, dict[str, str]], start: str) -> dict[str, tuple[str, str]]:
    """Return {body: (previous body, joint between the two)} of each body that is connected to the body `start`."""
    previous = {start: ("", "")}
    pending = [start]
    while pending:
        body = pending.pop(0)
        for neighbour, joint in links.get(body, {}).items():
            if neighbour not in previous:
                previous[neighbour] = (body, joint)
                pending.append(neighbour)
    return previous


def _joints_between(previous: dict[str, tuple[str, str]], start: str, end: str) -> list[str]:
    """Return the leaf names of the joints from the body `start` to the body `end`."""
    names: list[str] = []
    body = end
    while body != start:
        body, joint = previous[body]
        names.insert(0, joint.rpartition("/")[2])
    return names


def _check_articulation(scene: RawStage, joints: list[RawJoint]) -> Iterator[Finding]:
    roots = [prim for prim in scene.prims if prim.HasAPI(UsdPhysics.ArticulationRootAPI)]
    if not roots:
        first_body = next(iter(scene.bodies.values()))
        yield disagreement(
            "stage.articulation_root",
            str(first_body.GetParent().GetPath()),
            "no articulation root: engines simulate separate bodies held by springs instead of a robot",
            suggestion="apply PhysicsArticulationRootAPI to the root prim of the robot",
        )
    for inner in roots:
        for outer in roots:
            if outer == inner or not inner.GetPath().HasPrefix(outer.GetPath()):
                continue
            yield disagreement(
                "stage.articulation_root",
                str(inner.GetPath()),
                f"articulation root {inner.GetPath()} is nested in articulation root {outer.GetPath()}",
                suggestion="keep one articulation root for each robot",
            )
            break  # one finding for each nested root
    if not any(joint.excluded for joint in joints):
        return  # without loops, self collision may be on or off
    if not any(prim.HasAPI(UsdPhysics.CollisionAPI) for prim in scene.prims):
        return
    for root in roots:
        attribute = root.GetAttribute("physxArticulation:enabledSelfCollisions")
        if not (attribute and attribute.Get() is False):
            text = (
                f"self collision of {root.GetPath()} is on (the default): hulls that overlap at the joints push "
                "closed loops open"
            )
            yield _SELF_COLLISION(str(root.GetPath()), text)
