"""The certificate of a proved workspace: loops, limits and boxes as plain data, for programs without the prover."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from twin.core.json_types import JsonObject
from twin.core.spatial import Array
from twin.model.joint import Joint
from twin.proof.limits import LinearLimit
from twin.proof.loops import ClosingConditions
from twin.proof.regular_workspace import RegularWorkspace

SCHEMA = "twin/workspace-certificate/1"


def loops_as_data(loops: ClosingConditions) -> JsonObject:
    """Return joints and closing joints; each frame is at the end of a path from the base or from the tool.

    A step of a path is ["frame", 3 rows of 4 numbers], ["inverse", the same], or ["turn" or "slide", number of the
    coordinate, 1 or -1]: the joint is passed from parent to child, or back.
    """
    closures = []
    for closure in loops.closures:
        joint = closure.joint
        ends = ((joint.parent, joint.T_parent_joint), (joint.child, joint.T_child_joint))
        paths = [_path(loops, body, T_body_joint) for body, T_body_joint in ends]
        closures.append({"name": joint.name, "type": joint.type, "cone": joint.cone, "paths": paths})
    return {"joints": list(loops.names), "active": [bool(a) for a in loops.active], "closures": closures}


def _path(loops: ClosingConditions, body: str, T_body_joint: Array) -> JsonObject:
    """Return the path to a joint's frame on a body."""
    from_tool, route = loops.route(body)
    steps: list[list[object]] = []
    if from_tool:
        tool = loops.mechanism.frame(loops.mechanism.tool)
        steps.append(["inverse", _numbers(tool.T_body_frame)])
    for joint, sign in route:
        first, second = joint.T_parent_joint, joint.T_child_joint
        if sign < 0:
            first, second = second, first
        steps.append(["frame", _numbers(first)])
        steps += _motion(loops, joint, sign)
        steps.append(["inverse", _numbers(second)])
    steps.append(["frame", _numbers(T_body_joint)])
    return {"from_tool": from_tool, "steps": steps}


def _motion(loops: ClosingConditions, joint: Joint, sign: int) -> list[list[object]]:
    """Return the step of a joint's coordinate; none if it has none."""
    if joint.type == "fixed":
        return []
    return [["turn" if joint.type == "revolute" else "slide", loops.names.index(joint.name), sign]]


def limits_as_data(limits: Sequence[LinearLimit]) -> list[JsonObject]:
    """Return limits of sums of joint values, in m and rad."""
    return [{"name": limit.name, "weights": dict(limit.weights), "least": limit.least} for limit in limits]


def boxes_as_data(proof: RegularWorkspace, joints: Array) -> list[list[list[float]]]:
    """Return [lower corner, upper corner, joint values (k,) near the middle] of each proved box, in m and rad."""
    near = np.round(joints, 9).tolist()  # they only begin the search for the exact ones
    boxes = zip(proof.low.tolist(), proof.high.tolist(), near, strict=True)
    return [[low, high, values] for low, high, values in boxes]


def _numbers(T: Array) -> list[list[float]]:
    """Return the first three rows of a pose (4, 4)."""
    return [[float(entry) for entry in row] for row in T[:3]]
