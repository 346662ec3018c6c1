"""Instrument arm (PSM) of the da Vinci Classic: yaw, pitch, insertion about the RCM, then roll and a two-axis wrist.

The paper's Table 1 is a standard Denavit-Hartenberg table without offsets, and its a5 has no value. dVRK writes the
same arm in modified form, with every number; that reading is the default. Table 1 becomes equal to it with 90 deg added
to q2 and q5, q3 moved by shaft_long - origin, a5 of dVRK, and fixed turns of base and tool.

{tool} is the control point of dVRK: on the wrist's yaw axis, z along the closed jaws. The tip lies `tip` further along
z. The jaw does not move the tool and is in no equation.
"""

from __future__ import annotations

from casadi import atan2, cos, norm_2, pi, sqrt, vertcat

from twin.core.units import DEG
from twin.formula import symbolic
from twin.formula.contract import ActiveJoint, Aspect, Formula, Measure
from twin.formula.equations import Equations
from twin.robots._authoring import ZYX, mm, row
from twin.robots._davinci import (
    DVRK,
    LINKAGE,
    PAPER,
    PINS,
    about_rcm,
    linkage,
    linkage_angles,
    linkage_pins,
    shaft_frame,
    standard,
    to_insertion,
)

_POINTS = (*PINS, "rcm", "wrist", "fulcrum", "tip")

equation = Equations("DERIVED from the table of dVRK", variant="derived")


@equation(
    "forward",
    "joints -> pose",
    gives="T_base_tool",
    source=f"{PAPER}, Table 1",
    variant="modified",
    why=f"Modified Denavit-Hartenberg form with the offsets and lengths of {DVRK}: so the shaft passes the RCM.",
)
def table1(q1, q2, q3, q4, q5, q6, a5, origin, shaft_long):
    """Chain of the modified table of dVRK, rows 1 to 6, and its turn of the last frame along the jaws."""
    T_03 = to_insertion(q1, q2, q3, origin)
    T_36 = row(0, 0, q4, shaft_long) @ row(-pi / 2, 0, q5 - pi / 2, 0) @ row(-pi / 2, a5, q6 - pi / 2, 0)
    T_base_tool = T_03 @ T_36 @ row(-pi / 2, 0, pi / 2, 0)
    return T_base_tool


@equation.variant(
    "corrected",
    of=table1,
    why="Table 1 in its own standard form, with the missing offsets of q2, q3, q5 and rotations of base and tool.",
)
def table1_corrected(q1, q2, q3, q4, q5, q6, a5, origin, shaft_long):
    """Rows of Table 1 with offsets, between the axes of dVRK's base and tool."""
    T_03 = (
        standard(0, -pi / 2, 0, q1) @ standard(0, -pi / 2, 0, q2 + pi / 2) @ standard(0, 0, q3 + shaft_long - origin, 0)
    )
    T_36 = standard(0, pi / 2, 0, q4) @ standard(a5, -pi / 2, 0, q5 + pi / 2) @ standard(0, -pi / 2, 0, q6)
    T_base_tool = row(pi / 2, 0, pi / 2, 0) @ T_03 @ T_36 @ row(0, 0, pi / 2, 0) @ row(pi / 2, 0, 0, 0)
    return T_03, T_36, T_base_tool


@equation.variant(
    "printed",
    of=table1,
    why="As printed: standard form, no offset at any joint, no fixed rotations. a5 has no value: dVRK's is used.",
)
def table1_printed(q1, q2, q3, q4, q5, q6, a5):
    """Rows of Table 1 as printed."""
    T_03 = standard(0, -pi / 2, 0, q1) @ standard(0, -pi / 2, 0, q2) @ standard(0, 0, q3, 0)
    T_36 = standard(0, pi / 2, 0, q4) @ standard(a5, -pi / 2, 0, q5) @ standard(0, -pi / 2, 0, q6)
    T_base_tool = T_03 @ T_36
    return T_03, T_36, T_base_tool


@equation("inverse", "pose -> point P_w of the shaft on the pitch axis", gives="P_w")
def wrist(T_base_tool, a5):
    """P_w: at distance a5 from the yaw axis, perpendicular to it, on the side of the RCM."""
    R, p = T_base_tool[0:3, 0:3], T_base_tool[0:3, 3]
    back = -R.T @ p
    n = vertcat(0, back[1], back[2])
    return p + a5 * (R @ (n / norm_2(n)))


@equation("inverse", "P_w -> q1, q2, q3", gives="q1 q2 q3")
def arm(P_w, origin, shaft_long):
    """Yaw, pitch and insertion; the wrist is below the RCM."""
    q1, q2, depth = about_rcm(P_w)
    return q1, q2, depth + origin - shaft_long


@equation("inverse", "rotation relative to the shaft -> q4, q5, q6", gives="q4 q5 q6")
def wrist_angles(T_base_tool, q1, q2):
    """Roll, wrist pitch within a quarter turn, wrist yaw."""
    along = symbolic.rotation_x(-pi / 2) @ symbolic.rotation_z(pi / 2)  # last frame of the table -> {tool}
    X = shaft_frame(q1, q2).T @ T_base_tool[0:3, 0:3] @ along.T
    q4 = atan2(X[1, 2], X[0, 2])
    q5 = atan2(-X[2, 2], sqrt(X[0, 2] ** 2 + X[1, 2] ** 2))
    down = symbolic.rotation_x(-pi / 2)
    left = (symbolic.rotation_z(q4) @ down @ symbolic.rotation_z(q5 - pi / 2) @ down).T @ X
    return q4, q5, atan2(left[0, 0], -left[1, 0])


@equation("helper", "points in base", gives=[f"at_{n}" for n in _POINTS])
def places(
    T_base_tool, q1, q2, q3, origin, shaft_long, reach, setback, rise, second_y, second_z, apart_y, apart_z, tip
):
    """Pins of the linkage, the RCM, wrist, fulcrum and tip."""
    pins = linkage_pins(q1, q2, reach, setback, rise, second_y, second_z, apart_y, apart_z)
    p = T_base_tool[0:3, 3]
    at_wrist = (q3 + shaft_long - origin) * shaft_frame(q1, q2)[0:3, 2]
    return *pins, vertcat(0, 0, 0), at_wrist, p, p + tip * T_base_tool[0:3, 2]


@equation("helper", "pitch -> passive pins", gives=LINKAGE)
def pins(q2):
    """Angles of the pins of both parallelograms."""
    return linkage_angles(q2)


@equation("helper", "distance from singularities", gives="depth straight")
def margins(q3, q5, origin, shaft_long, crank):
    """Distance of the wrist beyond the RCM divided by the crank's length; cosine of the wrist's pitch."""
    return (q3 + shaft_long - origin) / crank, cos(q5)


_ALARM = "alarm ASSUMED: no published threshold"

FORMULA = Formula(
    name="davinci_psm",
    title="da Vinci Classic instrument arm (PSM) with a needle driver",
    source=f"{PAPER}, Table 1; offsets and lengths: {DVRK}",
    parameters=(
        mm("origin", 431.8, "CITED", f"{DVRK}: origin of the insertion above the RCM at q3 = 0"),
        mm("shaft_long", 416.2, "CITED", f"{DVRK}, tool 400006: origin of the insertion to the wrist's pitch axis"),
        mm("a5", 9.1, "CITED", f"{DVRK}, tool 400006: pitch axis to yaw axis; in Table 1 without a value"),
        mm("tip", 10.2, "CITED", "jhu-dvrk/dvrk_model: yaw axis to the tip of the jaws"),
        *linkage(516.0, (-40.09, 144.54), (-96.0, 0.0), (0.0, -38.08), "CITED", "WPI-AIM/dvrk_dynamics_identification"),
    ),
    joints=tuple(ActiveJoint(f"q{i}", "prismatic" if i == 3 else "revolute") for i in range(1, 7)),
    coordinates=ZYX,
    equations=tuple(equation),
    characteristic_length=lambda crank: crank,
    points={n: f"at_{n}" for n in _POINTS},
    passive=LINKAGE,
    measures=(
        Measure("depth", "depth", "type1", 0.1, f"wrist at the RCM: yaw and pitch do not move it; {_ALARM}"),
        Measure("wrist", "straight", "type1", 0.1, f"wrist bent by a quarter turn: roll and yaw in line; {_ALARM}"),
    ),
    aspects=(
        Aspect("depth", 1, "wrist beyond the RCM, on the patient's side"),
        Aspect("straight", 1, "wrist bent by less than a quarter turn"),
    ),
    seeds=(
        (0.0, 0.0, -0.1135, 90 * DEG, 0.0, 180 * DEG),
        (0.04, 0.03, -0.12, 70 * DEG, 10 * DEG, 170 * DEG),
        (-0.05, 0.02, -0.15, 100 * DEG, -10 * DEG, 190 * DEG),
    ),
)
