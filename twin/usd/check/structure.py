"""The graph of bodies and joints, its articulation root and its self collision."""

from __future__ import annotations

from collections.abc import Iterator

from pxr import UsdPhysics

from twin.core.findings import Finding
from twin.usd.scan import RawJoint, Scene


def check_structure(scene: Scene) -> Iterator[Finding]:
    """Yield findings on what the joints make of the bodies as a whole."""
    joints = [j for j in scene.joints if j.enabled and not any(e.problem for e in j.ends)]
    if not scene.bodies or not joints:
        yield Finding(
            "stage.empty",
            "error",
            f"{len(scene.bodies)} rigid bodies and {len(joints)} joints: there is no mechanism to check.",
            where="/",
            suggestion="apply PhysicsRigidBodyAPI to the links and join them",
        )
        return
    yield from _check_tree(scene, joints)
    yield from _check_articulation(scene, joints)
    if not any(j.prim.HasAPI(UsdPhysics.DriveAPI) for j in joints):
        yield Finding(
            "stage.drive_missing",
            "warning",
            "no joint has a drive: in a simulator the robot collapses.",
            where="/",
            suggestion="apply PhysicsDriveAPI to the actuated joints",
        )


def _check_tree(scene: Scene, joints: list[RawJoint]) -> Iterator[Finding]:
    """Grow the tree joint by joint; one that joins what is joined already closes a loop."""
    ways: dict[str, dict[str, str]] = {}
    for joint in (j for j in joints if not j.excluded):
        a, b = (e.body for e in joint.ends)
        if a == b:
            continue
        if way := _way(ways, a, b):
            others = ", ".join(w.rpartition("/")[2] for w in way)
            yield Finding(
                "stage.loop",
                "disagreement",
                f"joint {joint.path} closes a loop with {others}, and none is "
                "excluded from the articulation: engines drop one silently, or refuse the robot.",
                where=joint.path,
                suggestion="author physics:excludeFromArticulation = true on the joint that closes the loop",
            )
            continue
        ways.setdefault(a, {})[b] = joint.path
        ways.setdefault(b, {})[a] = joint.path
    joined = {e.body for j in joints for e in j.ends}
    held = _reached(ways, "") if "" in ways else None
    for body in scene.bodies:
        if body not in joined:
            yield Finding(
                "stage.loose",
                "info",
                f"body {body} hangs on no joint.",
                where=body,
                suggestion="fine for a prop; join it if it is part of the robot",
            )
        elif body not in ways or (held is not None and body not in held):
            yield Finding(
                "stage.disconnected",
                "disagreement",
                f"only joints excluded from the articulation lead to body {body}: no link of the robot.",
                where=body,
                suggestion="exclude one joint of each loop, not more",
            )
    if held is None:
        yield Finding(
            "stage.floating",
            "info",
            "no joint holds the robot to the world: its base falls in a simulator.",
            where="/",
            suggestion="fix the base with a PhysicsFixedJoint, unless the robot walks or flies",
        )


def _way(ways: dict[str, dict[str, str]], start: str, goal: str) -> list[str]:
    """Return the joints that lead from one body to another, [] if none do."""
    came: dict[str, tuple[str, str]] = {start: ("", "")}
    pending = [start]
    while pending:
        here = pending.pop(0)
        for there, joint in ways.get(here, {}).items():
            if there not in came:
                came[there] = (here, joint)
                pending.append(there)
    path = []
    while goal in came and goal != start:
        goal, joint = came[goal]
        path.append(joint)
    return path[::-1]


def _reached(ways: dict[str, dict[str, str]], start: str) -> set[str]:
    reached, pending = {start}, [start]
    while pending:
        for there in ways.get(pending.pop(), {}):
            if there not in reached:
                reached.add(there)
                pending.append(there)
    return reached


def _check_articulation(scene: Scene, joints: list[RawJoint]) -> Iterator[Finding]:
    roots = [p for p in scene.prims if p.HasAPI(UsdPhysics.ArticulationRootAPI)]
    if not roots:
        yield Finding(
            "stage.articulation_root",
            "disagreement",
            "no articulation root: engines simulate loose bodies held by springs instead of a robot.",
            where=str(next(iter(scene.bodies.values())).GetParent().GetPath()),
            suggestion="apply PhysicsArticulationRootAPI to the root prim of the robot",
        )
    for inner in roots:
        outer = [r for r in roots if inner != r and inner.GetPath().HasPrefix(r.GetPath())]
        if outer:
            yield Finding(
                "stage.articulation_root",
                "disagreement",
                f"articulation root {inner.GetPath()} lies inside articulation root {outer[0].GetPath()}.",
                where=str(inner.GetPath()),
                suggestion="keep one root for each robot",
            )
    colliders = any(p.HasAPI(UsdPhysics.CollisionAPI) for p in scene.prims)
    if not (colliders and any(j.excluded for j in joints)):
        return  # without loops self collision is a choice
    for root in roots:
        attribute = root.GetAttribute("physxArticulation:enabledSelfCollisions")
        if not (attribute and attribute.Get() is False):
            yield Finding(
                "stage.self_collision",
                "warning",
                f"self collision of {root.GetPath()} is on (the default): hulls that overlap at the joints "
                "break closed loops silently.",
                where=str(root.GetPath()),
                suggestion="author physxArticulation:enabledSelfCollisions = false, or filter the pairs",
            )
