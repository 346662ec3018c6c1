"""Functions for the da Vinci instrument arms: roll and a two-axis wrist after the insertion, as in dVRK.

Frame {tool} is at the control point of dVRK, on the wrist's yaw axis; its z is along the closed jaws. The tip is at
distance `tip` (m) along z. The jaw does not move the tool and is in no equation. Robots register these functions as
their equations.
"""

from __future__ import annotations

from casadi import atan2, cos, dot, if_else, norm_2, pi, sqrt, vertcat

from twin.core.provenance import Parameter
from twin.core.units import DEG
from twin.formula import symbolic
from twin.formula.contract import Aspect, Measure
from twin.robots._authoring import active_joints, mm
from twin.robots._davinci import DVRK, about_rcm, shaft_frame

TOOL = "jhu-dvrk/sawIntuitiveResearchKit, share/tool"


def wrist(T_base_tool, a5):
    """Return P_w, the point of the wrist's pitch axis at distance a5 from the wrist's yaw axis, behind the jaws.

    P_w is in the plane that is perpendicular to the yaw axis and contains the RCM. Two points are possible; at the
    point behind the jaws, the wrist yaw is within ±90 deg.
    """
    R = T_base_tool[0:3, 0:3]
    p = T_base_tool[0:3, 3]
    back = -R.T @ p  # from the control point to the RCM, in {tool}
    n = vertcat(0, back[1], back[2])
    side = if_else(back[2] <= 0, 1, -1)  # -1: the jaws point towards the RCM, because the wrist is above it
    return p + side * a5 * (R @ (n / norm_2(n)))


def arm(P_w, T_base_tool, origin, shaft_long):
    """Return yaw, pitch and insertion at which the shaft points from P_w to the side of the jaws.

    At the smallest insertions, the wrist is above the RCM: the shaft then points from P_w to the RCM.
    """
    side = if_else(dot(T_base_tool[0:3, 3] - P_w, P_w) >= 0, 1, -1)
    q1, q2, beyond = about_rcm(side * P_w)
    return q1, q2, side * beyond + origin - shaft_long


def wrist_angles(T_base_tool, q1, q2):
    """Return roll, wrist pitch (within ±90 deg) and wrist yaw."""
    along = symbolic.rotation_x(-pi / 2) @ symbolic.rotation_z(pi / 2)  # last frame of the table -> {tool}
    X = shaft_frame(q1, q2).T @ T_base_tool[0:3, 0:3] @ along.T
    q4 = atan2(X[1, 2], X[0, 2])
    q5 = atan2(-X[2, 2], sqrt(X[0, 2] ** 2 + X[1, 2] ** 2))
    down = symbolic.rotation_x(-pi / 2)
    R_yaw = (symbolic.rotation_z(q4) @ down @ symbolic.rotation_z(q5 - pi / 2) @ down).T @ X  # what q6 has to do
    return q4, q5, atan2(R_yaw[0, 0], -R_yaw[1, 0])


def ends(T_base_tool, q1, q2, q3, origin, shaft_long, tip):
    """Return points (3,) in base: RCM, pitch axis of the wrist, yaw axis of the wrist (fulcrum), tip of the jaws."""
    p = T_base_tool[0:3, 3]
    at_wrist = (q3 + shaft_long - origin) * shaft_frame(q1, q2)[0:3, 2]
    return vertcat(0, 0, 0), at_wrist, p, p + tip * T_base_tool[0:3, 2]


def margins(q3, q5, origin, shaft_long, crank):
    """Return the wrist's distance beyond the RCM divided by the crank's length, and the cosine of the wrist pitch."""
    return (q3 + shaft_long - origin) / crank, cos(q5)


def parameters(origin: float, shaft_long: float, tool: str, note: str = "") -> tuple[Parameter, ...]:
    """Return the lengths of shaft and wrist (given in mm) as parameters; `tool` and `note` appear in the notes."""
    return (
        mm("origin", origin, "CITED", f"{DVRK}: height of the insertion origin above the RCM at q3 = 0{note}"),
        mm(
            "shaft_long",
            shaft_long,
            "CITED",
            f"{TOOL}, {tool}: distance from the insertion origin to the wrist's pitch axis",
        ),
        mm("a5", 9.1, "CITED", f"{TOOL}, {tool}: distance from pitch axis to yaw axis"),
        mm("tip", 10.2, "CITED", "jhu-dvrk/dvrk_model, tool 400006: distance from yaw axis to the tip of the jaws"),
    )


ENDS = ("rcm", "wrist", "fulcrum", "tip")
"""Names of the points that `ends` returns."""

JOINTS = active_joints("q1 q2 q3 q4 q5 q6", slides="q3")

_ALARM = "alarm ASSUMED: no published threshold"

MEASURES = (
    Measure("depth", "depth", "type1", 0.1, f"the wrist is at the RCM: yaw and pitch do not move it; {_ALARM}"),
    Measure(
        "wrist", "straight", "type1", 0.1, f"the wrist is bent by 90 deg: its roll and yaw axes are parallel; {_ALARM}"
    ),
)

ASPECTS = (
    Aspect("depth", 1, "the wrist is beyond the RCM, on the patient's side"),
    Aspect("straight", 1, "the wrist is bent by less than 90 deg"),
)

SEEDS = (
    (0.0, 0.0, -0.1135, 90 * DEG, 0.0, 180 * DEG),
    (0.04, 0.03, -0.12, 70 * DEG, 10 * DEG, 170 * DEG),
    (-0.05, 0.02, -0.15, 100 * DEG, -10 * DEG, 190 * DEG),
)
