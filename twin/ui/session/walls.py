"""Name, as a text, the limit that keeps an arm from its goal, or the camera from moving further."""

from __future__ import annotations

import numpy as np

from twin.core import spatial
from twin.core.spatial import Array
from twin.core.units import DEG, MM
from twin.simulation.controllers.camera import Drag
from twin.simulation.setup import Member

_WALL = (0.5 * MM, 1 * DEG)
"""Minimum distance in m and angle in rad between goal and tool at which a joint limit is reported."""


def of_arm(member: Member, q: Array, goal: Array) -> str | None:
    """Return a text on the joint limit that keeps an arm at q (n,) from its goal (4, 4) in base; None if none does."""
    T = member.kin.forward(q, goal)
    way = float(np.linalg.norm(goal[:3, 3] - T[:3, 3]))
    if way < _WALL[0] and float(spatial.rotation_angle(goal[:3, :3] @ T[:3, :3].T)) < _WALL[1]:
        return None
    for k, joint in enumerate(member.mechanism.active):
        low, high = joint.limits or (-np.inf, np.inf)
        if not member.kin.auxiliary[k] and (q[k] - low < 1e-6 or high - q[k] < 1e-6):
            shown, unit = (q[k] / DEG, "°") if joint.is_angle else (q[k] / MM, " mm")
            return f"{joint.name} is at its limit, {shown:.0f}{unit}"
    return None


def of_camera(at: Array, drag: Drag) -> str | None:
    """Return a text on the limit that one of pan, tilt, depth, roll `at` (4,) in rad and m has reached, else None."""
    names, units = ("pan", "tilt", "depth", "roll"), (DEG, DEG, MM, DEG)
    for k, (name, unit) in enumerate(zip(names, units, strict=True)):
        if at[k] - drag.lower[k] < 1e-9 or drag.upper[k] - at[k] < 1e-9:
            return f"{name} is at its limit, {at[k] / unit:.0f}{'°' if unit == DEG else ' mm'}"
    return None
