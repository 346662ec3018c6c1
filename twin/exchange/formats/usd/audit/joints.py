"""Compute the gaps of UsdPhysics joints along a motion, and read the sampled joint coordinates."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Protocol

import numpy as np
from pxr import Usd, UsdGeom, UsdPhysics

from twin.exchange.audit import poses
from twin.exchange.audit.poses import Array

AXES = {"X": 0, "Y": 1, "Z": 2}
"""Index of each axis, for USD's axis tokens X, Y and Z."""

SIX = ("transX", "transY", "transZ", "rotX", "rotY", "rotZ")
"""The six directions of a generic joint, as instance names of the joint's limits in USD."""


class _World(Protocol):
    meters: float

    def poses(self, prim: Usd.Prim, codes) -> Array: ...

    def placed(self, M: Array) -> Array: ...


def joint_gaps(stage: Usd.Stage, placed: Mapping[str, Array], world: _World) -> Iterator[tuple[str, Array]]:
    """Yield (path, gap) of each joint; gap (k,) is the distance in m between the two frames in the locked directions.

    `placed` maps prim paths to T_world_body (k, 4, 4).
    """
    count = len(next(iter(placed.values()))) if placed else 0
    for prim in stage.Traverse():
        if not prim.IsA(UsdPhysics.Joint) or not is_stated(prim):
            continue
        ends = [_frame(stage, *end, placed, world, count) for end in joint_ends(prim, world.meters)]
        if ends[0] is None or ends[1] is None:
            continue  # the stage checker reports a missing target
        apart = (poses.inverse(ends[0]) @ ends[1])[:, :3, 3]
        yield str(prim.GetPath()), np.linalg.norm(apart[:, _locked(prim)], axis=1)


def is_stated(prim: Usd.Prim) -> bool:
    """Return whether a joint belongs to the robot: it is enabled, or is the free joint of a floating base.

    A free joint is disabled, because it constrains nothing.
    """
    return UsdPhysics.Joint(prim).GetJointEnabledAttr().Get() is not False or bool(prim.GetAttribute("twin:free").Get())


def joint_ends(prim: Usd.Prim, meters: float) -> list[tuple[list[str], Array]]:
    """Return, for each of a joint's two sides, (paths of the target prims, pose (4, 4) of the joint).

    The pose is relative to the target prim, in m.
    """
    joint, out = UsdPhysics.Joint(prim), []
    for rel, pos, rot in (
        (joint.GetBody0Rel(), joint.GetLocalPos0Attr(), joint.GetLocalRot0Attr()),
        (joint.GetBody1Rel(), joint.GetLocalPos1Attr(), joint.GetLocalRot1Attr()),
    ):
        p, q = pos.Get(), rot.Get()
        R = np.eye(3) if q is None else poses.rotation([*q.GetImaginary(), q.GetReal()])
        T = poses.pose(R, np.array(p if p is not None else (0, 0, 0), float) * meters)
        out.append(([str(t) for t in rel.GetForwardedTargets()] if rel else [], T))
    return out


def _frame(
    stage: Usd.Stage, targets: list[str], local: Array, placed: Mapping[str, Array], world: _World, count: int
) -> Array | None:
    """Return T_world_joint (k, 4, 4) of one side of a joint; None if its target body is missing."""
    if not targets:  # no target: the joint is attached to the world of the stage
        return np.broadcast_to(world.placed(np.eye(4)[None]) @ local, (count, 4, 4))
    if len(targets) > 1:
        return None
    if targets[0] in placed:
        return placed[targets[0]] @ local
    prim = stage.GetPrimAtPath(targets[0])
    if not prim or not prim.IsA(UsdGeom.Xformable):
        return None
    above = prim
    while above and str(above.GetPath()) not in placed:
        above = above.GetParent()
    still = world.poses(prim, [Usd.TimeCode.Default()])[0] @ local
    if not above:
        return np.broadcast_to(still, (count, 4, 4))
    T = placed[str(above.GetPath())]
    return T @ (poses.inverse(world.poses(above, [Usd.TimeCode.Default()])[0]) @ still)


def _locked(prim: Usd.Prim) -> list[int]:
    """Return the axes of the joint's frame (0, 1, 2 for x, y, z) along which translation is locked."""
    if prim.IsA(UsdPhysics.PrismaticJoint):
        free = AXES.get(str(UsdPhysics.PrismaticJoint(prim).GetAxisAttr().Get()), 2)
        return [i for i in range(3) if i != free]
    if prim.GetTypeName() == "PhysicsJoint":
        return [i for i in range(3) if is_locked(prim, SIX[i])]
    if prim.IsA(UsdPhysics.DistanceJoint):
        return []
    return [0, 1, 2]


def is_locked(prim: Usd.Prim, name: str) -> bool:
    """Return whether a generic joint cannot move in the direction `name`, one of `SIX`.

    A direction is locked if its lower limit is above its upper limit.
    """
    if not prim.HasAPI(UsdPhysics.LimitAPI, name):
        return False
    limit = UsdPhysics.LimitAPI(prim, name)
    return limit.GetLowAttr().Get() > limit.GetHighAttr().Get()


def joint_values(stage: Usd.Stage, codes: Array, meters: float) -> dict[str, Array]:
    """Return {joint name: sampled joint values (k,) in rad or m}; joints without samples are omitted."""
    out = {}
    for prim in stage.Traverse():
        if not prim.IsA(UsdPhysics.Joint):
            continue
        for attribute in prim.GetAuthoredAttributes():
            parts = attribute.GetName().split(":")
            if len(parts) != 4 or parts[0] != "state" or parts[2:] != ["physics", "position"]:
                continue
            if attribute.GetNumTimeSamples():
                unit = np.pi / 180 if parts[1] in ("angular", "rotX", "rotY", "rotZ") else meters
                query = Usd.AttributeQuery(attribute)
                out[prim.GetName()] = np.array([float(query.Get(Usd.TimeCode(c))) for c in codes.tolist()]) * unit
    return out
