"""Functions for all da Vinci arms: yaw and pitch about the RCM, and insertion through it.

The base frame is the base frame of dVRK: its origin is at the RCM, and z points up. With all joints at zero, the shaft
points along -z. Yaw is a rotation about -y, pitch about -x. No joint is at the RCM; the linkage keeps the RCM fixed,
but the equations do not need the linkage.
"""

from __future__ import annotations

from casadi import atan2, norm_2, pi, sqrt

from twin.formula import symbolic
from twin.robots._authoring import row

DVRK = "jhu-dvrk/sawIntuitiveResearchKit, share/kinematic"


def to_insertion(q1, q2, q3, origin):
    """Return the pose (4, 4) of frame 3: z is along the shaft; at q3 = 0 the frame is `origin` (m) above the RCM."""
    return row(pi / 2, 0, q1 + pi / 2, 0) @ row(-pi / 2, 0, q2 - pi / 2, 0) @ row(pi / 2, 0, 0, q3 - origin)


def about_rcm(p):
    """Return yaw and pitch in rad at which the shaft passes through p (3,) below the RCM, and the length of p in m."""
    return atan2(p[0], -p[2]), -atan2(p[1], sqrt(p[0] ** 2 + p[2] ** 2)), norm_2(p)


def shaft_frame(q1, q2):
    """Return the rotation (3, 3) of frame 3 in base; its last column is the shaft direction."""
    return to_insertion(q1, q2, 0, 0)[0:3, 0:3]


def in_base(q1, q2, *points):
    """Return positions (3,) in base of points on the rail, from the positions of these points at yaw 0 and pitch 0."""
    turn = symbolic.rotation_y(-q1) @ symbolic.rotation_x(-q2)
    return tuple(turn @ p for p in points)


def on_yaw_link(q1, *points):
    """Return positions (3,) in base of points on the yaw link, from the positions of these points at yaw 0."""
    return tuple(symbolic.rotation_y(-q1) @ p for p in points)


def depth(P, origin, shaft_long):
    """Return yaw, pitch and insertion at which the end of the shaft is at P (3,), a point beyond the RCM."""
    q1, q2, beyond = about_rcm(P)
    return q1, q2, beyond + origin - shaft_long
