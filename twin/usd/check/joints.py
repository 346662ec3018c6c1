"""Joint frames against the authored poses: they must meet, at rest and at every time sample.

UsdPhysics says the same thing several times: body poses, joint frames, joint states, limits. Public
validators look at each alone; here they are held against each other, through the joint's free directions.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from pxr import UsdPhysics

from twin.core import spatial
from twin.core.findings import Finding
from twin.core.spatial import Array
from twin.core.units import DEG, MM, UM
from twin.usd.check.coordinates import check_coordinate, coordinate
from twin.usd.check.timeline import Timeline
from twin.usd.scan import RawJoint, Scene

ANCHOR_TOL = 10 * UM
"""Gap between the two frames of a joint; single precision joint frames cost below 1 um on a robot of 2 m."""

AXIS_TOL = 0.01 * DEG
"""Angle between the two frames, along directions that the joint locks."""


def deviation(kind: str, A: Array) -> tuple[Array, Array]:
    """Return how far poses A (k, 4, 4) leave what a joint allows: offset (k,) in m, angle (k,) in rad."""
    p = A[:, :3, 3]
    offset = np.linalg.norm(p, axis=1)
    across = np.hypot(p[:, 0], p[:, 1])
    turn = spatial.rotation_angle(A[:, :3, :3])
    tilt = np.arctan2(np.hypot(A[:, 0, 2], A[:, 1, 2]), A[:, 2, 2])
    none = np.zeros(len(A))
    return {
        "fixed": (offset, turn),
        "revolute": (offset, tilt),
        "prismatic": (across, turn),
        "cylindrical": (across, tilt),
        "spherical": (offset, none),
    }.get(kind, (none, none))


def check_joints(scene: Scene, line: Timeline) -> Iterator[Finding]:
    """Yield findings on each joint that is switched on."""
    for joint in scene.joints:
        if not joint.enabled:
            continue
        problem = joint.problem or next((e.problem for e in joint.ends if e.problem), "")
        same = joint.ends[0].body == joint.ends[1].body
        if problem or same:
            text = problem or f"both sides hold to {joint.ends[0].body or 'the world'}"
            yield Finding(
                "stage.joint",
                "disagreement",
                f"joint {joint.path}: {text}.",
                where=joint.path,
                suggestion="a joint needs two different bodies, or a body and nothing for the world",
            )
            continue
        A = line.relative(joint)
        yield from _check_meeting(joint, line, A)
        ordered = True
        if joint.limits and not joint.limits[0] <= joint.limits[1]:
            ordered = False
            yield Finding(
                "stage.limits",
                "disagreement",
                f"joint {joint.path}: lower limit {joint.limits[0]:g} lies above upper limit "
                f"{joint.limits[1]:g}; engines lock it, swap them or ignore both.",
                where=joint.path,
                size=joint.limits[0],
                unit="deg" if joint.is_angle else "m",
                limit=joint.limits[1],
                suggestion="swap them",
            )
        if UsdPhysics.Joint(joint.prim).GetCollisionEnabledAttr().Get():
            yield Finding(
                "stage.joint_collision",
                "warning",
                f"joint {joint.path} lets its two bodies collide: their hulls overlap at the joint and push it apart.",
                where=joint.path,
                suggestion="author physics:collisionEnabled = false",
            )
        if joint.type in ("revolute", "prismatic"):
            yield from check_coordinate(joint, line, coordinate(joint, A), ordered)


def _check_meeting(joint: RawJoint, line: Timeline, A: Array) -> Iterator[Finding]:
    offset, angle = deviation(joint.type, A)
    worst = int(np.argmax(offset))
    if offset[worst] > ANCHOR_TOL:
        yield Finding(
            "stage.anchor",
            "disagreement",
            f"joint {joint.path} ({joint.type}): its anchors are {offset[worst] / MM:.4g} mm apart "
            f"{line.labels[worst]} (tolerance {ANCHOR_TOL / MM:g} mm).",
            where=joint.path,
            when=line.labels[worst],
            size=float(offset[worst] / MM),
            unit="mm",
            limit=ANCHOR_TOL / MM,
            suggestion="check localPos0 and localPos1 (in the frame and unit of their bodies) and the poses",
        )
    worst = int(np.argmax(angle))
    if angle[worst] > AXIS_TOL:
        yield Finding(
            "stage.axis",
            "disagreement",
            f"joint {joint.path} ({joint.type}): its frames are {angle[worst] / DEG:.4g} deg apart "
            f"{line.labels[worst]}, across its free directions (tolerance {AXIS_TOL / DEG:g} deg).",
            where=joint.path,
            when=line.labels[worst],
            size=float(angle[worst] / DEG),
            unit="deg",
            limit=AXIS_TOL / DEG,
            suggestion="check physics:axis, localRot0 and localRot1, and the poses",
        )
