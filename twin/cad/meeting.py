"""Whether the two sides of each joint meet in the drawing."""

from __future__ import annotations

import numpy as np

from twin.cad.description import Description
from twin.cad.frames import Drawn
from twin.core import spatial
from twin.core.findings import Finding
from twin.core.spatial import Array
from twin.core.units import DEG, MM, UM


def meetings(d: Description, at: Drawn) -> list[Finding]:
    """Return where the two sides of a joint do not meet in the drawing, with the size in the locked directions."""
    found = []
    for joint in d.joint:
        offset, tilt = locked_error(between(at, joint.name), joint.type)
        for size, limit, unit, code in (
            (offset / MM, d.tolerance.meeting_um * UM / MM, "mm", "cad.meeting"),
            (tilt / DEG, d.tolerance.meeting_deg, "deg", "cad.tilt"),
        ):
            if size > limit:
                what = "apart" if unit == "mm" else "out of line"
                found.append(
                    Finding(
                        code,
                        "disagreement",
                        f"joint '{joint.name}': the faces on '{joint.parent}' and '{joint.child}' are "
                        f"{size:.4g}{' mm' if unit == 'mm' else '°'} {what} as drawn",
                        where=joint.name,
                        when="as drawn",
                        size=size,
                        unit=unit,
                        limit=limit,
                        suggestion=f"compare the bores of '{joint.parent}' and '{joint.child}' in the CAD",
                    )
                )
    return found


def between(at: Drawn, joint: str) -> Array:
    """Return the pose (4, 4) of the child's joint frame in the parent's, as drawn."""
    return spatial.inverse(at.on[joint][0]) @ at.on[joint][1]


def locked(T: Array, joint_type: str) -> tuple[Array, Array]:
    """Return offset (m) and turn (rad) between a joint's two frames, (3,) each, zero in the directions it leaves free.

    A turn that is left after the free one is that from one axis to the other.
    """
    p, turn = T[:3, 3].copy(), np.zeros(3)
    if joint_type == "free":
        return np.zeros(3), turn
    if joint_type in ("prismatic", "cylindrical"):
        p[2] = 0.0
    if joint_type in ("revolute", "cylindrical"):
        x, y, z = T[:3, 2]
        across = np.hypot(x, y)
        if across > 0:
            turn = np.arctan2(across, z) / across * np.array([-y, x, 0.0])
    elif joint_type != "spherical":
        turn = np.asarray(spatial.log_so3(T[:3, :3]), float)
    return p, turn


def locked_error(T: Array, joint_type: str) -> tuple[float, float]:
    """Return the offset in m and the tilt in rad of a joint's two frames in the directions it locks."""
    offset, turn = locked(T, joint_type)
    return float(np.linalg.norm(offset)), float(np.linalg.norm(turn))
