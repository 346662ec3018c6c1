"""Shared by the arms of the da Vinci: yaw, pitch and insertion about the RCM.

Base frame of dVRK: origin at the RCM, z up. With all joints at zero the shaft points along -z; yaw turns about -y,
pitch about -x. No joint is at the RCM: the linkage keeps it fixed, and the equations do not need the linkage.
"""

from __future__ import annotations

from casadi import atan2, norm_2, pi, sqrt

from twin.formula import symbolic
from twin.robots._authoring import row

DVRK = "jhu-dvrk/sawIntuitiveResearchKit, share/kinematic"


def to_insertion(q1, q2, q3, origin):
    """Return frame 3: z along the shaft, `origin` (m) above the RCM at q3 = 0."""
    return row(pi / 2, 0, q1 + pi / 2, 0) @ row(-pi / 2, 0, q2 - pi / 2, 0) @ row(pi / 2, 0, 0, q3 - origin)


def about_rcm(p):
    """Return (q1, q2, d): angles in rad and the distance in m from the RCM to a point p (3,) on the shaft below it."""
    return atan2(p[0], -p[2]), -atan2(p[1], sqrt(p[0] ** 2 + p[2] ** 2)), norm_2(p)


def shaft_frame(q1, q2):
    """Return R03 (3, 3), its last column along the shaft."""
    return to_insertion(q1, q2, 0, 0)[0:3, 0:3]


def in_base(q1, q2, *points):
    """Return points (3,) of the rail, given as they stand at yaw and pitch zero, in base."""
    turn = symbolic.rotation_y(-q1) @ symbolic.rotation_x(-q2)
    return tuple(turn @ p for p in points)


def on_yaw_link(q1, *points):
    """Return points (3,) of the yaw link, given as they stand at yaw zero, in base."""
    return tuple(symbolic.rotation_y(-q1) @ p for p in points)


def depth(P, origin, shaft_long):
    """Yaw, pitch and insertion at which the shaft ends in P (3,), which is beyond the RCM."""
    q1, q2, beyond = about_rcm(P)
    return q1, q2, beyond + origin - shaft_long
