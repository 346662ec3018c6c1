"""The certificate of a proved workspace: loops, limits and boxes as plain data, for programs without the prover."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from twin.core.json_types import JsonObject
from twin.core.spatial import Array
from twin.proof.linear_limit import LinearLimit
from twin.proof.loops import ClosingConditions
from twin.proof.regular_workspace import RegularWorkspace

SCHEMA = "twin/workspace-certificate/1"

_NEAR_DECIMALS = 9
"""Decimals of joint values near the middle of a box, in m or rad: they only begin the search for the exact ones."""


def loops_as_data(loops: ClosingConditions) -> JsonObject:
    """Return joints and closing joints; each frame is at the end of a path from the base or from the tool.

    A step of a path is ["frame", 3 rows of 4 numbers], ["inverse", the same], or ["turn" or "slide", number of the
    coordinate, 1 or -1]: the joint is passed from parent to child, or back.
    """
    closures = []
    for closure in loops.closures:
        joint = closure.joint
        to_parent = _path(loops, joint.parent, joint.T_parent_joint)
        to_child = _path(loops, joint.child, joint.T_child_joint)
        closures.append({"name": joint.name, "type": joint.type, "cone": joint.cone, "paths": [to_parent, to_child]})
    return {"joints": list(loops.names), "active": loops.active.tolist(), "closures": closures}


def _path(loops: ClosingConditions, body: str, T_body_joint: Array) -> JsonObject:
    """Return the path to a joint's frame on a body."""
    from_tool, route = loops.route(body)
    steps: list[list[object]] = []
    if from_tool:
        tool = loops.mechanism.frame(loops.mechanism.tool)
        steps.append(["inverse", _numbers(tool.T_body_frame)])
    for joint, sign in route:
        first = joint.T_parent_joint
        second = joint.T_child_joint
        # Passed from child to parent, a joint is entered by its frame on the child.
        if sign < 0:
            first = joint.T_child_joint
            second = joint.T_parent_joint
        steps.append(["frame", _numbers(first)])
        if joint.type != "fixed":
            motion = "slide"
            if joint.type == "revolute":
                motion = "turn"
            steps.append([motion, loops.names.index(joint.name), sign])
        steps.append(["inverse", _numbers(second)])
    steps.append(["frame", _numbers(T_body_joint)])
    return {"from_tool": from_tool, "steps": steps}


def limits_as_data(limits: Sequence[LinearLimit]) -> list[JsonObject]:
    """Return limits of sums of joint values, in m and rad."""
    rows = []
    for limit in limits:
        rows.append({"name": limit.name, "weights": dict(limit.weights), "least": limit.least})
    return rows


def boxes_as_data(proof: RegularWorkspace, joints: Array) -> list[list[list[float]]]:
    """Return [lower corner, upper corner, joint values (k,) near the middle] of each proved box, in m and rad."""
    joint_values = np.round(joints, _NEAR_DECIMALS).tolist()
    return list(map(list, zip(proof.low.tolist(), proof.high.tolist(), joint_values, strict=True)))


def _numbers(T: Array) -> list[list[float]]:
    """Return the first three rows of a pose (4, 4)."""
    return np.asarray(T[:3], float).tolist()
