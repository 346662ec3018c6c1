"""Check that the two frames of each joint, on the parent and on the child, coincide in the CAD within tolerance."""

from __future__ import annotations

import numpy as np

from twin.cad.description import Description
from twin.cad.frames import DrawnFrames
from twin.core import spatial
from twin.core.findings import Finding, disagreement
from twin.core.quantity import Quantity, deg, mm
from twin.core.spatial import Array
from twin.core.units import UM


def meetings(description: Description, drawn_frames: DrawnFrames) -> list[Finding]:
    """Return findings on joints whose two frames are offset or tilted in the CAD; free directions are ignored."""
    findings = []
    for joint in description.joint:
        offset, tilt = locked_gap_sizes(child_in_parent(drawn_frames, joint.name), joint.type)
        for code, what, size, limit in (
            ("cad.meeting", "apart", mm(offset), mm(description.tolerance.meeting_um * UM)),
            ("cad.tilt", "tilted", deg(tilt), Quantity(description.tolerance.meeting_deg, "deg")),
        ):
            if size.value > limit.value:
                findings.append(
                    disagreement(
                        code,
                        joint.name,
                        f"joint '{joint.name}': faces on '{joint.parent}' and '{joint.child}' are {what} in the CAD",
                        size,
                        limit,
                        f"compare the bores of '{joint.parent}' and '{joint.child}' in the CAD",
                        when="as drawn",
                        word="tolerance",
                    )
                )
    return findings


def child_in_parent(drawn_frames: DrawnFrames, joint: str) -> Array:
    """Return the pose (4, 4) of the child's joint frame in the parent's joint frame, as in the CAD."""
    return spatial.inverse(drawn_frames.on[joint][0]) @ drawn_frames.on[joint][1]


def locked_gap(T: Array, joint_type: str) -> tuple[Array, Array]:
    """Return (offset in m, rotation vector in rad), (3,) each, of a joint's child frame relative to its parent frame.

    `T` (4, 4) is the pose from `child_in_parent`. Components in the free directions of the joint are 0.
    For revolute and cylindrical joints, the rotation is the one that turns the parent's axis to the child's axis.
    """
    offset, turn = T[:3, 3].copy(), np.zeros(3)
    if joint_type == "free":
        return np.zeros(3), turn
    if joint_type in ("prismatic", "cylindrical"):
        offset[2] = 0.0
    if joint_type in ("revolute", "cylindrical"):
        x, y, z = T[:3, 2]
        across = np.hypot(x, y)
        if across > 0:
            turn = np.arctan2(across, z) / across * np.array([-y, x, 0.0])
        elif z < 0:  # exactly opposite axes: a half turn about any axis perpendicular to them
            turn = np.array([np.pi, 0.0, 0.0])
    elif joint_type != "spherical":
        turn = np.asarray(spatial.log_so3(T[:3, :3]), float)
    return offset, turn


def locked_gap_sizes(T: Array, joint_type: str) -> tuple[float, float]:
    """Return (offset in m, angle in rad) between a joint's two frames; motion that the joint allows is not counted."""
    offset, turn = locked_gap(T, joint_type)
    return float(np.linalg.norm(offset)), float(np.linalg.norm(turn))
