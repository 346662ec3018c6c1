"""Check that the two frames of a joint coincide in its locked directions, at rest and at every time sample.

UsdPhysics stores redundant data: body poses, joint frames, joint states, limits. Public validators check each of these
data separately; `check_joints` compares the data with each other.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from pxr import UsdPhysics

from twin.core import spatial
from twin.core.findings import Finding, Kind
from twin.core.quantity import Quantity, deg, mm
from twin.core.spatial import Array
from twin.core.units import DEG, UM
from twin.usd.check.coordinates import check_coordinate, coordinate
from twin.usd.check.timeline import Timeline
from twin.usd.scan import RawJoint, RawStage

ANCHOR_TOL = 10 * UM
"""Maximum gap in m between the two frames of a joint; single precision causes less than 1 um on a robot of 2 m."""

AXIS_TOL = 0.01 * DEG
"""Maximum angle in rad between the two frames about the locked directions of a joint."""


_ANCHOR = Kind(
    "stage.anchor",
    "disagreement",
    "check localPos0 and localPos1 (each in the frame and unit of its body) and the poses of the bodies",
    word="tolerance",
)
_AXIS = Kind(
    "stage.axis",
    "disagreement",
    "check physics:axis, localRot0 and localRot1, and the poses of the bodies",
    word="tolerance",
)
_JOINT = Kind(
    "stage.joint",
    "disagreement",
    "connect the joint to two different bodies, or to one body (an empty side is the world)",
)
_LIMITS = Kind(
    "stage.limits",
    "disagreement",
    "exchange the limits: otherwise, engines lock the joint, exchange its limits or ignore them",
    word="upper",
)
_NOT_FINITE = Kind(
    "stage.not_finite", "disagreement", "author finite numbers in the joint's frames and in the poses of its bodies"
)
_JOINT_COLLISION = Kind("stage.joint_collision", "warning", "author physics:collisionEnabled = false")


def deviation(kind: str, T_0_1: Array) -> tuple[Array, Array]:
    """Return (distances (k,) in m, angles (k,) in rad) between the two frames of a joint in its locked directions.

    `T_0_1` (k, 4, 4) is the pose of the frame on body1 relative to the frame on body0; `kind` is the joint type.
    """
    p = T_0_1[:, :3, 3]
    offset = np.linalg.norm(p, axis=1)
    across = np.hypot(p[:, 0], p[:, 1])
    turn = spatial.rotation_angle(T_0_1[:, :3, :3])
    tilt = np.arctan2(np.hypot(T_0_1[:, 0, 2], T_0_1[:, 1, 2]), T_0_1[:, 2, 2])
    none = np.zeros(len(T_0_1))
    return {
        "fixed": (offset, turn),
        "revolute": (offset, tilt),
        "prismatic": (across, turn),
        "cylindrical": (across, tilt),
        "spherical": (offset, none),
    }.get(kind, (none, none))


def check_joints(scene: RawStage, timeline: Timeline) -> Iterator[Finding]:
    """Yield findings on each enabled joint."""
    for joint in scene.joints:
        if not joint.enabled:
            continue
        if joint.fault:
            yield _JOINT(joint.path, f"joint {joint.path}: {joint.fault}")
            continue
        T_0_1 = timeline.relative(joint)
        is_finite = np.isfinite(T_0_1).all(axis=(1, 2))
        if not is_finite.all():
            # Every comparison with NaN is false: the frames would seem to meet.
            first = int(np.argmin(is_finite))
            text = f"joint {joint.path}: its frames cannot be compared, because a number of their poses is not finite"
            yield _NOT_FINITE(joint.path, text, when=timeline.labels[first])
            continue
        yield from _check_meeting(joint, timeline, T_0_1)
        ordered = True
        if joint.limits and not joint.limits[0] <= joint.limits[1]:
            ordered = False
            low, high = joint.limits
            unit = "m"
            if joint.is_angle:
                unit = "deg"
            text = f"joint {joint.path}: the lower limit is above the upper limit"
            yield _LIMITS(joint.path, text, Quantity(low, unit), high)
        if UsdPhysics.Joint(joint.prim).GetCollisionEnabledAttr().Get():
            message = (
                f"joint {joint.path} lets its two bodies collide: the hulls overlap at the joint and push the bodies "
                "apart"
            )
            yield _JOINT_COLLISION(joint.path, message)
        if joint.type in ("revolute", "prismatic"):
            yield from check_coordinate(joint, timeline, coordinate(joint, T_0_1), ordered)


def _check_meeting(joint: RawJoint, timeline: Timeline, T_0_1: Array) -> Iterator[Finding]:
    offset, angle = deviation(joint.type, T_0_1)
    worst = int(np.argmax(offset))
    if offset[worst] > ANCHOR_TOL:
        text = f"joint {joint.path} ({joint.type}): distance between the joint's anchor points on the two bodies"
        yield _ANCHOR(joint.path, text, mm(offset[worst]), mm(ANCHOR_TOL), when=timeline.labels[worst])
    worst = int(np.argmax(angle))
    if angle[worst] > AXIS_TOL:
        text = f"joint {joint.path} ({joint.type}): angle between the two joint frames about locked directions"
        yield _AXIS(joint.path, text, deg(angle[worst]), deg(AXIS_TOL), when=timeline.labels[worst])
