"""Endoscope arm (ECM) of the da Vinci Classic: yaw and pitch about the RCM, insertion, then roll.

The table is dVRK's, in modified Denavit-Hartenberg form. Frame {tool} is frame 4 of the table: it is at the tip of the
endoscope, and z points forward along the shaft. Four joints control four degrees of freedom: the position of the tip,
and the roll. The shaft always passes through the RCM, so the position of the tip determines the viewing direction.
"""

from __future__ import annotations

from casadi import atan2, vertcat

from twin.core.units import DEG
from twin.formula import symbolic
from twin.formula.contract import Aspect, Coordinates, Formula
from twin.formula.equations import Equations
from twin.robots._authoring import active_joints, mm, place_names, row
from twin.robots._davinci import DVRK, about_rcm, depth, shaft_frame, to_insertion
from twin.robots._davinci_classic import LINKAGE, PINS, linkage, linkage_angles, linkage_pins

_POINTS = (*PINS, "rcm", "tip")

equation = Equations("DERIVED from the table of dVRK", variant="derived")


@equation("forward", "joints -> pose", gives="T_base_tool", source=DVRK, variant="modified")
def table(q1, q2, q3, q4, origin, shaft_long):
    """Return the pose of the tool: the product of the rows of the modified table."""
    return to_insertion(q1, q2, q3, origin) @ row(0, 0, q4, shaft_long)


@equation("inverse", "tip -> q1, q2, q3", gives="q1 q2 q3")
def arm(T_base_tool, origin, shaft_long):
    """Return yaw, pitch and insertion of the assembly with the tip beyond the RCM."""
    return depth(T_base_tool[0:3, 3], origin, shaft_long)


@equation("inverse", "rotation about the shaft -> q4", gives="q4")
def roll(T_base_tool, q1, q2):
    """Return the roll, from the rotation of the tool relative to the frame after yaw and pitch."""
    X = shaft_frame(q1, q2).T @ T_base_tool[0:3, 0:3]
    return atan2(X[1, 0], X[0, 0])


@equation("helper", "points in base", gives=place_names(_POINTS))
def places(T_base_tool, q1, q2, reach, setback, rise, second_y, second_z, apart_y, apart_z):
    """Return the pins of the linkage, the RCM and the tip in base, each (3,)."""
    pins = linkage_pins(q1, q2, reach, setback, rise, second_y, second_z, apart_y, apart_z)
    return *pins, vertcat(0, 0, 0), T_base_tool[0:3, 3]


@equation("helper", "pitch -> passive pins", gives=LINKAGE)
def pins(q2):
    """Return the angles of the pins of both parallelograms."""
    return linkage_angles(q2)


@equation("helper", "position of the tip beyond the RCM", gives="depth")
def margins(q3, origin, shaft_long, crank):
    """Return the distance of the tip beyond the RCM, divided by the length of the crank."""
    return (q3 + shaft_long - origin) / crank


def _pose(x, y, z, roll):
    """Return the pose with the tip at (x, y, z) and the shaft through the RCM, rotated by `roll` about the shaft."""
    p = vertcat(x, y, z)
    q1, q2, _ = about_rcm(p)
    return symbolic.pose(shaft_frame(q1, q2) @ symbolic.rotation_z(roll), p)


def _coordinates(T):
    """Return the tip and the roll of a pose."""
    q1, q2, _ = about_rcm(T[0:3, 3])
    X = shaft_frame(q1, q2).T @ T[0:3, 0:3]
    return T[0, 3], T[1, 3], T[2, 3], atan2(X[1, 0], X[0, 0])


FORMULA = Formula(
    name="davinci_ecm",
    title="da Vinci Classic endoscope arm (ECM)",
    source=f"{DVRK}; linkage: jhu-dvrk/dvrk_model",
    parameters=(
        mm("origin", 382.2, "CITED", f"{DVRK}: height of the insertion origin above the RCM at q3 = 0"),
        mm(
            "shaft_long",
            382.9,
            "CITED",
            f"{DVRK}: distance from the insertion origin to the tip; dvrk_model has 383.64",
        ),
        *linkage(
            reach=340.4,
            crank=(-103.001, 286.805),
            second=(-162.43, -9.8),
            apart=(-5.471, 37.452),
            provenance="CITED",
            source="jhu-dvrk/dvrk_model, ECM",
        ),
    ),
    joints=active_joints("q1 q2 q3 q4", slides="q3"),
    coordinates=Coordinates(
        names=("x", "y", "z", "roll"), units=("m", "m", "m", "rad"), to_pose=_pose, from_pose=_coordinates
    ),
    equations=tuple(equation),
    characteristic_length=lambda crank: crank,
    points=dict(zip(_POINTS, place_names(_POINTS), strict=True)),
    passive=LINKAGE,
    aspects=(Aspect("depth", 1, "the tip is beyond the RCM, on the patient's side"),),
    seeds=((0.0, 0.0, -0.1207, 0.0), (0.04, 0.03, -0.12, 20 * DEG), (-0.05, 0.02, -0.15, -20 * DEG)),
)
