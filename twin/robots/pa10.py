"""Mitsubishi PA10-7C with an instrument along its last axis: an S-R-S arm in modified Denavit-Hartenberg form.

Table 1 of the paper on the virtual surgery robot gives the chain in Khalil and Kleinfinger's form, T = Rx(alpha) Tx(d)
Rz(theta) Tz(r), but no lengths. Lengths are taken from the INRIA model of the arm. Frame 0 is at the shoulder, with z
up; if all joints are zero, the arm points straight up. Frame {tool} is frame 8, at the tip; its z points forward along
the shaft.

Seven joints control six degrees of freedom, so the elbow can swivel about the line from shoulder to wrist. The swivel
angle is a parameter of the inverse (0: elbow up, in the vertical plane through this line). The inverse returns one of
eight solutions.

The paper finds elbow P_c and wrist P_m by Levenberg-Marquardt instead, from the lengths of the arm and from the
condition that wrist, trocar P_tr and tip P_d are on one line. It prints neither rows, weights nor starting values; the
rows here are DERIVED, see `POINTS`.
"""

from __future__ import annotations

from casadi import atan2, cos, cross, dot, fmin, if_else, norm_2, pi, sin, sqrt, vertcat

from twin.core.provenance import Parameter
from twin.core.units import DEG
from twin.formula import symbolic
from twin.formula.contract import Aspect, Formula, Measure, PointSearch
from twin.formula.equations import Equations
from twin.robots._authoring import PAPER, ZYX, active_joints, mm, place_names, row

_INRIA = "siconos HuMAns_pa10 (INRIA)"
_POINTS = ("shoulder", "elbow", "wrist", "flange", "tip")

equation = Equations("DERIVED from Table 1", variant="derived")


@equation("forward", "joints -> pose", gives="T_base_tool", source=f"{PAPER}, Table 1", variant="published")
def table1(q1, q2, q3, q4, q5, q6, q7, RL3, RL5, RL7, RL8):
    """Return the pose of the tool: the product of rows 1 to 8 of the modified Denavit-Hartenberg table."""
    T = row(0, 0, q1, 0) @ row(-pi / 2, 0, q2, 0) @ row(pi / 2, 0, q3, RL3) @ row(-pi / 2, 0, q4, 0)
    return T @ row(pi / 2, 0, q5, RL5) @ row(-pi / 2, 0, q6, 0) @ row(pi / 2, 0, q7, RL7) @ row(0, 0, 0, RL8)


@equation("inverse", "pose -> wrist P_m", gives="P_m", source=f"{PAPER}, trocar model", variant="published")
def wrist(T_base_tool, RL7, RL8):
    """Return the wrist P_m, which is on the shaft axis behind the tip."""
    return T_base_tool[0:3, 3] - (RL7 + RL8) * T_base_tool[0:3, 2]


@equation("inverse", "wrist and swivel -> elbow P_c", gives="P_c", source="DERIVED: |P_c| = RL3, |P_m - P_c| = RL5")
def elbow(P_m, RL3, RL5, swivel):
    """Return the elbow P_c on its circle about the line from shoulder to wrist; swivel 0 is the highest point."""
    D = norm_2(P_m)
    n = P_m / D
    a = (RL3**2 - RL5**2 + D**2) / (2 * D)
    up = vertcat(0, 0, 1)
    e1 = up - dot(up, n) * n
    e1 = e1 / norm_2(e1)
    return a * n + sqrt(RL3**2 - a**2) * (cos(swivel) * e1 + sin(swivel) * cross(n, e1))


@equation("inverse", "elbow and wrist -> q1..q4", gives="q1 q2 q3 q4")
def arm_angles(P_c, P_m, RL3, RL5):
    """Return q1 to q4 from elbow and wrist, with q1 towards the wrist and q4 >= 0."""
    side = if_else(P_c[0] * P_m[0] + P_c[1] * P_m[1] < 0, -1, 1)
    q1 = atan2(side * P_c[1], side * P_c[0])
    q2 = atan2(side * sqrt(P_c[0] ** 2 + P_c[1] ** 2), P_c[2])
    w = (symbolic.rotation_z(q1) @ symbolic.rotation_y(q2)).T @ (P_m - P_c) / RL5
    return q1, q2, atan2(w[1], w[0]), atan2(sqrt(w[0] ** 2 + w[1] ** 2), w[2])


@equation("inverse", "shaft -> q5..q7", gives="q5 q6 q7")
def wrist_angles(T_base_tool, q1, q2, q3, q4):
    """Return q5 to q7 from the direction of the shaft and the rotation about the shaft, with q6 >= 0."""
    R04 = symbolic.rotation_z(q1) @ symbolic.rotation_y(q2) @ symbolic.rotation_z(q3) @ symbolic.rotation_y(q4)
    R = R04.T @ T_base_tool[0:3, 0:3]  # = Rz(q5) Ry(q6) Rz(q7)
    q5 = atan2(R[1, 2], R[0, 2])
    q6 = atan2(sqrt(R[0, 2] ** 2 + R[1, 2] ** 2), R[2, 2])
    R_yaw = (symbolic.rotation_z(q5) @ symbolic.rotation_y(q6)).T @ R
    return q5, q6, atan2(R_yaw[1, 0], R_yaw[0, 0])


@equation("helper", "points of the arm in base", gives=place_names(_POINTS), source="DERIVED")
def places(T_base_tool, P_c, P_m, RL8):
    """Return shoulder, elbow, wrist, flange and tip in base, each (3,)."""
    tip = T_base_tool[0:3, 3]
    return vertcat(0, 0, 0), P_c, P_m, tip - RL8 * T_base_tool[0:3, 2], tip


@equation("helper", "reach and singularity", gives="stretch fold s2 s4 s6 aside", source="DERIVED")
def margins(q2, q4, q6, P_m, RL3, RL5):
    """Return margins of reach in m (arm stretched, folded), then sin(q2), sin(q4), sin(q6), and `aside`; 0: singular.

    `aside` is the distance of the wrist from the axis of joint 1, divided by the length RL3 + RL5 of the arm.
    """
    D = norm_2(P_m)
    aside = sqrt(P_m[0] ** 2 + P_m[1] ** 2)
    return RL3 + RL5 - D, D - sqrt((RL3 - RL5) ** 2), sin(q2), sin(q4), sin(q6), aside / (RL3 + RL5)


def collinear(P_c, P_m, P_d, P_tr, RL3, RL5, RL7, RL8):
    """Return six rows in m: lengths of upper arm, forearm and instrument; distance of the wrist from line P_d P_tr."""
    u = (P_tr - P_d) / norm_2(P_tr - P_d)
    upper_arm = (dot(P_c, P_c) - RL3**2) / RL3
    forearm = (dot(P_m - P_c, P_m - P_c) - RL5**2) / RL5
    instrument = norm_2(P_m - P_d) - (RL7 + RL8)
    return vertcat(upper_arm, forearm, instrument, cross(u, P_m - P_tr))


def between(P_m, P_d, P_tr):
    """Return the smaller distance of the trocar from tip and wrist along the shaft; negative if it is not between."""
    w = (P_m - P_d) / norm_2(P_m - P_d)
    from_tip = dot(P_tr - P_d, w)
    from_wrist = dot(P_m - P_tr, w)
    return fmin(from_tip, from_wrist)


def at_swivel(P_c, P_m, swivel):
    """Return the distance of the elbow from the half-plane of the swivel angle, and its sign; see `elbow`."""
    n = P_m / norm_2(P_m)
    up = vertcat(0, 0, 1)
    e1 = up - dot(up, n) * n
    e1 = e1 / norm_2(e1)
    e2 = cross(n, e1)
    across = dot(P_c, cos(swivel) * e2 - sin(swivel) * e1)
    along = dot(P_c, cos(swivel) * e1 + sin(swivel) * e2)
    return across, along


def elbow_and_wrist(q1, q2, q3, q4, RL3, RL5):
    """Return P_c and P_m at joint values: the origins of frames 3 and 5 of Table 1."""
    upper_arm = row(0, 0, q1, 0) @ row(-pi / 2, 0, q2, 0) @ row(pi / 2, 0, q3, RL3)
    forearm = upper_arm @ row(-pi / 2, 0, q4, 0) @ row(pi / 2, 0, 0, RL5)
    return upper_arm[0:3, 3], forearm[0:3, 3]


POINTS = PointSearch(
    source=f"{PAPER}, trocar model; rows and weights DERIVED: the paper prints none",
    unknowns=("P_c", "P_m"),
    tip="P_d",
    trocar="P_tr",
    axis=(0.0, 0.0, 1.0),
    residual=collinear,
    between=between,
    redundant=at_swivel,
    places=elbow_and_wrist,
)

_ALARM = "alarm ASSUMED: no published threshold"

FORMULA = Formula(
    name="pa10",
    title="Mitsubishi PA10-7C with an instrument through a trocar",
    source=f"{PAPER}, Table 1; lengths: {_INRIA}",
    parameters=(
        mm("RL3", 450.0, "CITED", f"{_INRIA}: distance from shoulder to elbow"),
        mm("RL5", 480.0, "CITED", f"{_INRIA}: distance from elbow to wrist, PA10-7C; the older PA-10 has 500"),
        mm(
            "RL7",
            70.0,
            "CITED",
            "OpenBionics modelMitsubishiPA10: distance from wrist to flange, PA10-7C; the PA-10 has 80",
        ),
        mm("RL8", 330.0, "ASSUMED", "length of the instrument beyond the flange; it has no value in the paper's table"),
        Parameter(
            "swivel",
            0.0,
            "deg",
            0.0,
            "ASSUMED",
            "0: the elbow is in the vertical plane through shoulder and wrist, above them; the paper gives no value",
        ),
    ),
    joints=active_joints("q1 q2 q3 q4 q5 q6 q7"),
    coordinates=ZYX,
    equations=tuple(equation),
    characteristic_length=lambda RL5: RL5,
    points=dict(zip(_POINTS, place_names(_POINTS), strict=True)),
    reach={"arm": "stretch", "arm, folded": "fold"},
    measures=(
        Measure(
            "shoulder", "s2", "type1", 0.03, f"the upper arm is vertical: the axes of q1 and q3 are in line; {_ALARM}"
        ),
        Measure("elbow", "s4", "type1", 0.1, f"the arm is stretched; {_ALARM}"),
        Measure("wrist", "s6", "type1", 0.1, f"the axes of q5 and q7 are in line; {_ALARM}"),
        Measure(
            "swivel_zero", "aside", "type1", 0.05, f"the wrist is above the shoulder: swivel 0 is undefined; {_ALARM}"
        ),
    ),
    aspects=(
        Aspect("s4", 1, "q4 is positive: the elbow is as in the CAD"),
        Aspect("s6", 1, "q6 is positive: the wrist is as in the CAD"),
    ),
    seeds=(
        (0.55, 0.40, 0.0, 0.0, 175 * DEG, 0.0),
        (0.75, 0.10, 0.15, 0.0, 150 * DEG, 0.0),
        (0.75, -0.45, 0.20, -35 * DEG, 130 * DEG, 0.0),
    ),
    point_search=POINTS,
)
