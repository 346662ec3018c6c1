"""Shared by the arms of the da Vinci Classic: yaw and pitch about the RCM, insertion, and the linkage that drives them.

Base frame of dVRK: origin at the RCM, z up. With all joints at zero the shaft points along -z; yaw turns about -y,
pitch about -x. No joint is at the RCM: two parallelograms (pins B, B2, C, C2) keep it fixed. The equations do not need
these pins; they are computed only to check the linkage.
"""

from __future__ import annotations

from math import hypot

from casadi import atan2, norm_2, pi, sqrt, vertcat

from twin.core.provenance import Parameter, Provenance
from twin.formula import symbolic
from twin.robots._authoring import mm, row

PAPER = "paper on the affordable console"
DVRK = "jhu-dvrk/sawIntuitiveResearchKit, share/kinematic"
LINKAGE = ("pin_b2", "pin_a", "pin_a2", "pin_c", "pin_a3", "pin_c2")
PINS = ("pin_b", "pin_b2", "pin_c", "pin_c2")


def standard(a, alpha, d, theta):
    """Return Rz(theta) Tz(d) Tx(a) Rx(alpha), (4, 4): one row of a standard Denavit-Hartenberg table."""
    R = symbolic.rotation_z(theta)
    return symbolic.pose(R @ symbolic.rotation_x(alpha), R @ vertcat(a, 0, d))


def to_insertion(q1, q2, q3, origin):
    """Return frame 3: z along the shaft, `origin` (m) above the RCM at q3 = 0."""
    return row(pi / 2, 0, q1 + pi / 2, 0) @ row(-pi / 2, 0, q2 - pi / 2, 0) @ row(pi / 2, 0, 0, q3 - origin)


def about_rcm(p):
    """Return (q1, q2, d): angles in rad and the distance in m from the RCM to a point p (3,) on the shaft below it."""
    return atan2(p[0], -p[2]), -atan2(p[1], sqrt(p[0] ** 2 + p[2] ** 2)), norm_2(p)


def linkage_angles(q2):
    """Return the angles of the six passive pins, in the order of LINKAGE: each is plus or minus the pitch."""
    return q2, -q2, -q2, q2, -q2, q2


def linkage_pins(q1, q2, reach, setback, rise, second_y, second_z, apart_y, apart_z):
    """Return pins B, B2 of the yaw link and C, C2 of the rail in base, each (3,): C is the moved end of the crank."""
    yaw, pitch = symbolic.rotation_y(-q1), symbolic.rotation_x(-q2)
    b = vertcat(0, -reach, 0)
    c = vertcat(0, -setback, rise)
    at = (
        b,
        b + vertcat(0, second_y, second_z),
        pitch @ c,
        pitch @ (c + vertcat(0, apart_y, apart_z)),
    )
    return tuple(yaw @ p for p in at)


def linkage(
    reach: float,
    crank: tuple[float, float],
    second: tuple[float, float],
    apart: tuple[float, float],
    provenance: Provenance,
    source: str,
) -> tuple[Parameter, ...]:
    """Return the lengths of a linkage as parameters, from its vectors in the pitch plane (y, z) in mm."""
    return (
        mm("reach", reach, provenance, f"{source}: pivot B to the RCM, and both couplers"),
        mm("setback", -crank[0], provenance, f"{source}: pin C behind the shaft"),
        mm("rise", crank[1], provenance, f"{source}: pin C above the RCM"),
        mm("crank", hypot(*crank), "DERIVED", "length of both cranks, of setback and rise"),
        mm("second_y", second[0], provenance, f"{source}: pivot B2 from B; behind it, ASSUMED"),
        mm("second_z", second[1], provenance, f"{source}: pivot B2 from B, height"),
        mm("second", hypot(*second), "DERIVED", "distance of the pivots of the yaw link"),
        mm("apart_y", apart[0], provenance, f"{source}: second coupler from the first, along y"),
        mm("apart_z", apart[1], provenance, f"{source}: second coupler from the first, height; its sign is ASSUMED"),
        mm("apart", hypot(*apart), "DERIVED", "distance of the pins of the rail"),
    )


def shaft_frame(q1, q2):
    """Return R03 (3, 3), its last column along the shaft."""
    return to_insertion(q1, q2, 0, 0)[0:3, 0:3]
