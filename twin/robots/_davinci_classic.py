"""Functions for the da Vinci Classic arms: the double parallelogram that keeps the RCM fixed.

Pins B and B2 are on the yaw link, pins C and C2 on the rail. Their positions are computed to check the linkage.
"""

from __future__ import annotations

from math import hypot

from casadi import vertcat

from twin.core.provenance import Parameter, Provenance
from twin.robots._authoring import mm
from twin.robots._davinci import in_base, on_yaw_link

LINKAGE = ("pin_b2", "pin_a", "pin_a2", "pin_c", "pin_a3", "pin_c2")
PINS = ("pin_b", "pin_b2", "pin_c", "pin_c2")


def linkage_angles(q2):
    """Return the angles of the six passive pins, in the order of LINKAGE; each is q2 (the pitch) or -q2."""
    return q2, -q2, -q2, q2, -q2, q2


def linkage_pins(q1, q2, reach, setback, rise, second_y, second_z, apart_y, apart_z):
    """Return pins B, B2 of the yaw link and C, C2 of the rail in base, each (3,); C is the moving end of the crank."""
    b = vertcat(0, -reach, 0)
    c = vertcat(0, -setback, rise)
    on_yaw = on_yaw_link(q1, b, b + vertcat(0, second_y, second_z))
    on_rail = in_base(q1, q2, c, c + vertcat(0, apart_y, apart_z))
    return *on_yaw, *on_rail


def linkage(
    reach: float,
    crank: tuple[float, float],
    second: tuple[float, float],
    apart: tuple[float, float],
    provenance: Provenance,
    source: str,
) -> tuple[Parameter, ...]:
    """Return the lengths of a linkage as parameters.

    Args:
        reach: distance in mm from pivot B to the RCM.
        crank: vector (y, z) in mm in the pitch plane from the RCM to pin C of the rail, at yaw and pitch 0.
        second: the same from pivot B to B2 of the yaw link.
        apart: the same from pin C to C2 of the rail.
        provenance: provenance of these lengths.
        source: their source, named in the notes.
    """
    return (
        mm("reach", reach, provenance, f"{source}: distance from pivot B to the RCM, and length of both couplers"),
        mm("setback", -crank[0], provenance, f"{source}: distance of pin C behind the shaft"),
        mm("rise", crank[1], provenance, f"{source}: height of pin C above the RCM"),
        mm("crank", hypot(*crank), "DERIVED", "length of both cranks, from setback and rise"),
        mm(
            "second_y",
            second[0],
            provenance,
            f"{source}: distance of pivot B2 from B along y; that B2 is behind B is ASSUMED",
        ),
        mm("second_z", second[1], provenance, f"{source}: height of pivot B2 above B"),
        mm("second", hypot(*second), "DERIVED", "distance between the pivots B and B2 of the yaw link"),
        mm("apart_y", apart[0], provenance, f"{source}: distance of the second coupler from the first, along y"),
        mm(
            "apart_z",
            apart[1],
            provenance,
            f"{source}: height of the second coupler above the first; its sign is ASSUMED",
        ),
        mm("apart", hypot(*apart), "DERIVED", "distance between the pins C and C2 of the rail"),
    )
