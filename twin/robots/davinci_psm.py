"""Instrument arm (PSM) of the da Vinci Classic: yaw and pitch about the RCM, insertion, roll, and a two-axis wrist.

Table 1 of the paper on the affordable console is a standard Denavit-Hartenberg table without offsets and without a
value of a5. dVRK has a table of the same arm in modified form, with all numbers; the default variant uses the table of
dVRK. Table 1 becomes equal to that table with these changes: 90 deg is added to q2 and q5; `shaft_long` (offset along
the shaft to the wrist's pitch axis) minus `origin` (height of frame 3 above the RCM at q3 = 0) is added to q3; a5 has
the value of dVRK; base and tool have fixed rotations.

Frame {tool} is at the control point of dVRK, on the wrist's yaw axis; its z is along the closed jaws. The tip is at
distance `tip` (m) along z. The jaw does not move the tool and is in no equation.
"""

from __future__ import annotations

from casadi import pi, vertcat

from twin.formula import symbolic
from twin.formula.contract import Formula
from twin.formula.equations import Equations
from twin.robots import _davinci_instrument as instrument
from twin.robots._authoring import ZYX, place_names, row
from twin.robots._davinci import DVRK, to_insertion
from twin.robots._davinci_classic import LINKAGE, PINS, linkage, linkage_angles, linkage_pins

PAPER = "paper on the affordable console"
_POINTS = (*PINS, *instrument.ENDS)


def standard(a, alpha, d, theta):
    """Return Rz(theta) Tz(d) Tx(a) Rx(alpha), (4, 4): one row of a standard Denavit-Hartenberg table.

    The order differs from that of `row`, of a modified table: there alpha, d (along x), theta, r (along z).
    """
    R = symbolic.rotation_z(theta)
    return symbolic.pose(R @ symbolic.rotation_x(alpha), R @ vertcat(a, 0, d))


equation = Equations("DERIVED from the table of dVRK", variant="derived")


@equation(
    "forward",
    "joints -> pose",
    gives="T_base_tool",
    source=f"{PAPER}, Table 1",
    variant="modified",
    why=f"Modified Denavit-Hartenberg form with offsets and lengths of {DVRK}: then the shaft passes through the RCM.",
)
def table1(q1, q2, q3, q4, q5, q6, a5, origin, shaft_long):
    """Return the pose of the tool: rows 1 to 6 of dVRK's modified DH table, then a rotation of z to the jaws' axis."""
    T_03 = to_insertion(q1, q2, q3, origin)
    T_36 = row(0, 0, q4, shaft_long) @ row(-pi / 2, 0, q5 - pi / 2, 0) @ row(-pi / 2, a5, q6 - pi / 2, 0)
    T_base_tool = T_03 @ T_36 @ row(-pi / 2, 0, pi / 2, 0)
    return T_base_tool


@equation.variant(
    "corrected",
    of=table1,
    why="Table 1 in standard form as in the paper, with the missing offsets of q2, q3, q5, and of base and tool.",
)
def table1_corrected(q1, q2, q3, q4, q5, q6, a5, origin, shaft_long):
    """Return the pose of the tool from Table 1 with offsets, with base and tool frames as in dVRK."""
    T_03 = (
        standard(0, -pi / 2, 0, q1) @ standard(0, -pi / 2, 0, q2 + pi / 2) @ standard(0, 0, q3 + shaft_long - origin, 0)
    )
    T_36 = standard(0, pi / 2, 0, q4) @ standard(a5, -pi / 2, 0, q5 + pi / 2) @ standard(0, -pi / 2, 0, q6)
    T_base_tool = row(pi / 2, 0, pi / 2, 0) @ T_03 @ T_36 @ row(0, 0, pi / 2, 0) @ row(pi / 2, 0, 0, 0)
    return T_03, T_36, T_base_tool


@equation.variant(
    "printed",
    of=table1,
    why="As printed: standard form without joint offsets and fixed rotations. a5 has no value; dVRK's value is used.",
)
def table1_printed(q1, q2, q3, q4, q5, q6, a5):
    """Return the pose of the tool from Table 1 as printed."""
    T_03 = standard(0, -pi / 2, 0, q1) @ standard(0, -pi / 2, 0, q2) @ standard(0, 0, q3, 0)
    T_36 = standard(0, pi / 2, 0, q4) @ standard(a5, -pi / 2, 0, q5) @ standard(0, -pi / 2, 0, q6)
    T_base_tool = T_03 @ T_36
    return T_03, T_36, T_base_tool


equation("inverse", "pose -> point P_w of the shaft on the pitch axis", gives="P_w")(instrument.wrist)
equation("inverse", "P_w -> q1, q2, q3", gives="q1 q2 q3")(instrument.arm)
equation("inverse", "rotation relative to the shaft -> q4, q5, q6", gives="q4 q5 q6")(instrument.wrist_angles)


@equation("helper", "points in base", gives=place_names(_POINTS))
def places(
    T_base_tool, q1, q2, q3, origin, shaft_long, reach, setback, rise, second_y, second_z, apart_y, apart_z, tip
):
    """Return the pins of the linkage, the RCM, the wrist's pitch and yaw axes, and the tip in base, each (3,)."""
    pins = linkage_pins(q1, q2, reach, setback, rise, second_y, second_z, apart_y, apart_z)
    return *pins, *instrument.ends(T_base_tool, q1, q2, q3, origin, shaft_long, tip)


@equation("helper", "pitch -> passive pins", gives=LINKAGE)
def pins(q2):
    """Return the angles of the pins of both parallelograms."""
    return linkage_angles(q2)


equation("helper", "distance from singularities", gives="depth straight")(instrument.margins)

FORMULA = Formula(
    name="davinci_psm",
    title="da Vinci Classic instrument arm (PSM) with a needle driver",
    source=f"{PAPER}, Table 1; offsets and lengths: {DVRK}",
    parameters=(
        *instrument.parameters(origin=431.8, shaft_long=416.2, tool="400006"),
        *linkage(
            reach=516.0,
            crank=(-40.09, 144.54),
            second=(-96.0, 0.0),
            apart=(0.0, -38.08),
            provenance="CITED",
            source="WPI-AIM/dvrk_dynamics_identification",
        ),
    ),
    joints=instrument.JOINTS,
    coordinates=ZYX,
    equations=tuple(equation),
    characteristic_length=lambda crank: crank,
    points=dict(zip(_POINTS, place_names(_POINTS), strict=True)),
    passive=LINKAGE,
    measures=instrument.MEASURES,
    aspects=instrument.ASPECTS,
    seeds=instrument.SEEDS,
)
