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

    `placed` maps prim paths to T_world_body (k, 4, 4), at least of one body.
    """
    count = len(next(iter(placed.values())))
    for prim in stage.Traverse():
        if not prim.IsA(UsdPhysics.Joint) or not is_stated(prim):
            continue
        (targets_0, local_0), (targets_1, local_1) = joint_ends(prim, world.meters)
        T_world_0 = _frame(stage, targets_0, local_0, placed, world, count)
        T_world_1 = _frame(stage, targets_1, local_1, placed, world, count)
        if T_world_0 is None or T_world_1 is None:
            continue  # the stage checker reports a missing target
        T_0_1 = poses.inverse(T_world_0) @ T_world_1
        yield str(prim.GetPath()), np.linalg.norm(T_0_1[:, _locked(prim), 3], axis=1)


def is_stated(prim: Usd.Prim) -> bool:
    """Return whether a joint belongs to the robot: it is enabled, or is the free joint of a floating base.

    A free joint is disabled, because it constrains nothing.
    """
    enabled = UsdPhysics.Joint(prim).GetJointEnabledAttr().Get() is not False
    return enabled or bool(prim.GetAttribute("twin:free").Get())


def joint_ends(prim: Usd.Prim, meters: float) -> list[tuple[list[str], Array]]:
    """Return, for each of a joint's two sides, (paths of the target prims, pose (4, 4) of the joint).

    The pose is relative to the target prim, in m.
    """
    joint = UsdPhysics.Joint(prim)
    ends = []
    for targets, position, rotation in (
        (joint.GetBody0Rel(), joint.GetLocalPos0Attr(), joint.GetLocalRot0Attr()),
        (joint.GetBody1Rel(), joint.GetLocalPos1Attr(), joint.GetLocalRot1Attr()),
    ):
        T = np.eye(4)
        p = position.Get()
        if p is not None:
            T[:3, 3] = np.array(p, float) * meters
        q = rotation.Get()
        if q is not None:
            T[:3, :3] = poses.rotation([*q.GetImaginary(), q.GetReal()])
        paths = []
        if targets:
            paths = list(map(str, targets.GetForwardedTargets()))
        ends.append((paths, T))
    return ends


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
    default_time = [Usd.TimeCode.Default()]
    T_world_joint = world.poses(prim, default_time)[0] @ local
    if not above:
        return np.broadcast_to(T_world_joint, (count, 4, 4))
    # The target is no body itself, but moves with the body above it.
    T_body_joint = poses.inverse(world.poses(above, default_time)[0]) @ T_world_joint
    return placed[str(above.GetPath())] @ T_body_joint


def _locked(prim: Usd.Prim) -> list[int]:
    """Return the axes of the joint's frame (0, 1, 2 for x, y, z) along which translation is locked."""
    if prim.IsA(UsdPhysics.PrismaticJoint):
        axis = UsdPhysics.PrismaticJoint(prim).GetAxisAttr().Get()
        free = AXES.get(str(axis), 2)
        return [axis for axis in range(3) if axis != free]
    if prim.GetTypeName() == "PhysicsJoint":
        return [axis for axis in range(3) if is_locked(prim, SIX[axis])]
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
    times = list(map(Usd.TimeCode, codes.tolist()))
    values = {}
    for prim in stage.Traverse():
        if not prim.IsA(UsdPhysics.Joint):
            continue
        for attribute in prim.GetAuthoredAttributes():
            direction = _state_direction(attribute.GetName())
            if not direction or not attribute.GetNumTimeSamples():
                continue
            unit = meters
            if direction in ("angular", "rotX", "rotY", "rotZ"):
                unit = np.pi / 180
            query = Usd.AttributeQuery(attribute)
            samples = [float(query.Get(time)) for time in times]
            values[prim.GetName()] = np.array(samples) * unit
    return values


def _state_direction(name: str) -> str:
    """Return the direction of an attribute "state:<direction>:physics:position"; "" for another attribute."""
    parts = name.split(":")
    if len(parts) != 4 or parts[0] != "state" or parts[2:] != ["physics", "position"]:
        return ""
    return parts[1]
