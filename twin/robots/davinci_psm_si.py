"""Instrument arm (PSM) of the da Vinci Si: yaw and pitch about the RCM, insertion, roll, and a two-axis wrist.

The table is dVRK's for the Si, in modified Denavit-Hartenberg form: the table of the Classic arm with a longer shaft.
The mechanism differs from the Classic: bands keep one crank and one coupler parallel, and each of two telescopes does
half of the insertion. The lengths are taken from dVRK's table of the whole linkage (PSM_Si_physical).

Frame {tool} is at the control point of dVRK, on the wrist's yaw axis; its z is along the closed jaws.
"""

from __future__ import annotations

from math import hypot

from casadi import pi, vertcat

from twin.formula.contract import Formula
from twin.formula.equations import Equations
from twin.robots import _davinci_instrument as instrument
from twin.robots._authoring import ZYX, mm, place_names, row
from twin.robots._davinci import DVRK, in_base, on_yaw_link, to_insertion

PHYSICAL = f"{DVRK}, PSM_Si_physical"
_PASSIVE = ("pin_a", "pin_c", "slide1", "slide2")
_POINTS = ("pin_b", "pin_c", "slide", *instrument.ENDS)

equation = Equations("DERIVED from the table of dVRK", variant="derived")


@equation("forward", "joints -> pose", gives="T_base_tool", source=f"{DVRK}, psm-si", variant="modified")
def table(q1, q2, q3, q4, q5, q6, a5, origin, shaft_long):
    """Return the pose of the tool: rows 1 to 6 of the modified table, then the fixed rotation of z to the jaws."""
    T_03 = to_insertion(q1, q2, q3, origin)
    T_36 = row(0, 0, q4, shaft_long) @ row(-pi / 2, 0, q5 - pi / 2, 0) @ row(-pi / 2, a5, q6 - pi / 2, 0)
    T_base_tool = T_03 @ T_36 @ row(-pi / 2, 0, pi / 2, 0)
    return T_base_tool


equation("inverse", "pose -> point P_w of the shaft on the pitch axis", gives="P_w")(instrument.wrist)
equation("inverse", "P_w -> q1, q2, q3", gives="q1 q2 q3")(instrument.arm)
equation("inverse", "rotation relative to the shaft -> q4, q5, q6", gives="q4 q5 q6")(instrument.wrist_angles)


@equation("helper", "points in base", gives=place_names(_POINTS))
def places(T_base_tool, q1, q2, q3, origin, shaft_long, reach, drop, setback, rise, slide_back, slide_origin, tip):
    """Return points in base: pivots B and C, origin of the first telescope, RCM, wrist's pitch and yaw axes, tip."""
    on_yaw = on_yaw_link(q1, vertcat(0, -reach, -drop))
    on_rail = in_base(q1, q2, vertcat(0, -setback, rise), vertcat(0, -slide_back, slide_origin - q3 / 2))
    return *on_yaw, *on_rail, *instrument.ends(T_base_tool, q1, q2, q3, origin, shaft_long, tip)


@equation("helper", "pitch, insertion -> passive joints", gives=_PASSIVE)
def bands(q2, q3):
    """Return the angles of pivots A (-pitch) and C (+pitch) and the lengths of both telescopes (insertion / 2 each)."""
    return -q2, q2, q3 / 2, q3 / 2


equation("helper", "distance from singularities", gives="depth straight")(instrument.margins)

FORMULA = Formula(
    name="davinci_psm_si",
    title="da Vinci Si instrument arm (PSM) with a needle driver",
    source=f"{DVRK}, psm-si and PSM_Si_physical; {instrument.TOOL}, 420006",
    parameters=(
        *instrument.parameters(
            origin=482.6, shaft_long=467.0, tool="420006", note=", estimated there; PSM_Si_physical adds up to 482.5"
        ),
        mm("reach", 338.72, "CITED", f"{PHYSICAL}: distance from pivot B to the RCM, along the yaw axis"),
        mm("drop", 71.2, "CITED", f"{PHYSICAL}: distance of pivot B below the yaw axis"),
        mm("coupler", hypot(338.72, 71.2), "DERIVED", "length of the coupler, from reach and drop"),
        mm("setback", 92.2, "CITED", f"{PHYSICAL}: distance of pivot C behind the shaft"),
        mm("rise", 181.0, "CITED", f"{PHYSICAL}: height of pivot C above the RCM"),
        mm("crank", hypot(92.2, 181.0), "DERIVED", "length of the crank, from setback and rise"),
        mm(
            "slide_origin",
            361.0,
            "CITED",
            f"{PHYSICAL}: height of the first telescope's origin above the RCM, 180 mm above pivot C",
        ),
        mm(
            "slide_back",
            56.0,
            "ASSUMED",
            "distance of the first telescope's rods behind the shaft, chosen so that the rods fit",
        ),
        mm(
            "slide_up",
            121.6,
            "DERIVED",
            "height of the second telescope's origin above the first telescope's origin: origin - slide_origin",
        ),
    ),
    joints=instrument.JOINTS,
    coordinates=ZYX,
    equations=tuple(equation),
    characteristic_length=lambda crank: crank,
    points=dict(zip(_POINTS, place_names(_POINTS), strict=True)),
    passive=_PASSIVE,
    measures=instrument.MEASURES,
    aspects=instrument.ASPECTS,
    seeds=instrument.SEEDS,
)
