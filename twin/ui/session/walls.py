"""Texts on limits: the joint limit that keeps an arm from its goal, and the limit that a camera has reached."""

from __future__ import annotations

import numpy as np

from twin.core import spatial
from twin.core.spatial import Array
from twin.core.units import DEG, MM
from twin.simulation.controllers.camera import Drag
from twin.simulation.setup import Member

_WALL = (0.5 * MM, 1 * DEG)
"""A joint limit is reported if goal and tool differ by at least this distance in m or this angle in rad."""


def of_arm(member: Member, q: Array, goal: Array) -> str | None:
    """Return a text on the joint limit that keeps an arm, now at q (n,), from its goal T_base_tool (4, 4), or None."""
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
    """Return a text on the limit that the camera has reached, or None; `at` (4,): see `LiveConsole.camera_at`."""
    names, units = ("pan", "tilt", "depth", "roll"), (DEG, DEG, MM, DEG)
    for k, (name, unit) in enumerate(zip(names, units, strict=True)):
        if at[k] - drag.lower[k] < 1e-9 or drag.upper[k] - at[k] < 1e-9:
            return f"{name} is at its limit, {at[k] / unit:.0f}{'°' if unit == DEG else ' mm'}"
    return None
