"""Lapbot: a lift, a horizontal two-link arm, three passive joints, and an instrument with a two-axis wrist.

The paper gives the structure (9 joints: the first is prismatic; 6 are driven and 3 passive; the trocar is between
joints 7 and 8), but no dimensions. Everything else is ASSUMED, including the rows below in Khalil and Kleinfinger's
form, and a belt that keeps the azimuth of the passive joints constant: q2 + q3 + q4 = 0. Without the belt, one degree
of freedom would be undetermined.

The trocar P_tr determines the shaft: u is the direction from the inner wrist P_in to the trocar. The outer point W is
at distance r7 from P_in along u.
"""

from __future__ import annotations

from casadi import acos, asin, atan2, cos, if_else, norm_2, pi, sin, sqrt, vertcat

from twin.core.units import DEG
from twin.formula.contract import ActiveJoint, Aspect, Formula, Measure
from twin.formula.equations import Equations
from twin.robots._authoring import ASSUMED, DERIVED, PAPER, ZYX, mm, place_names, row, trocar

_POINTS = ("outer", "inner", "tip", "trocar")

equation = Equations(DERIVED, variant="derived")


@equation("inverse", "pose and trocar -> inner wrist, shaft, outer point W", gives="P_in u W")
def shaft(T_base_tool, r7, r10, trocar_x, trocar_y, trocar_z):
    """Return inner wrist P_in, direction from P_in to the trocar, and outer point W; NaN if the shaft is too short."""
    P_in = T_base_tool[0:3, 3] - r10 * T_base_tool[0:3, 2]
    to = vertcat(trocar_x, trocar_y, trocar_z) - P_in
    length = norm_2(to)
    u = to / if_else(length < r7, length, float("nan"))
    return P_in, u, P_in + r7 * u


@equation("inverse", "W -> q1, q2, q3", gives="q1 q2 q3")
def arm(W, a, b):
    """Return the lift q1 and the angles q2 and q3 of the horizontal arm for the wrist W and the link lengths a and b.

    Seen from above, the elbow is to the right of the line from the axis of joint 2 to W (q3 > 0).
    """
    q3 = acos((W[0] ** 2 + W[1] ** 2 - a**2 - b**2) / (2 * a * b))
    return W[2], atan2(W[1], W[0]) - atan2(b * sin(q3), a + b * cos(q3)), q3


@equation("inverse", "shaft -> passive q4, q5, q6", gives="q4 q5 q6")
def gimbal(u, q2, q3):
    """Return the passive joints: the belt determines q4, the trocar determines q5 and q6."""
    return -(q2 + q3), atan2(-u[0], u[2]), asin(-u[1])


def _to_shaft(q1, q2, q3, q4, q5, q6, q7, a, b, r7):
    """Return the pose (4, 4) of frame 7: its origin is at the inner wrist, and z is along the shaft."""
    T = row(0, 0, 0, q1) @ row(0, 0, q2, 0) @ row(0, a, q3, 0) @ row(0, b, q4, 0)
    return T @ row(pi / 2, 0, pi / 2 + q5, 0) @ row(pi / 2, 0, -pi / 2 + q6, 0) @ row(pi / 2, 0, q7, r7)


@equation("inverse", "rotation relative to the shaft -> q7, q8, q9", gives="q7 q8 q9")
def instrument(T_base_tool, q1, q2, q3, q4, q5, q6, a, b, r7):
    """Return the roll and both wrist angles, from the rotation of the tool relative to the shaft."""
    M = _to_shaft(q1, q2, q3, q4, q5, q6, 0, a, b, r7)[0:3, 0:3].T @ T_base_tool[0:3, 0:3]
    return atan2(M[1, 1], M[0, 1]), asin(M[2, 1]), atan2(-M[2, 0], M[2, 2])


@equation("forward", "driven arm and trocar -> shaft", gives="u_out")
def outer(q1, q2, q3, a, b, r7, trocar_x, trocar_y, trocar_z):
    """Return the direction from the trocar to the outer point W of the driven arm; NaN if the shaft is too short."""
    W = vertcat(a * cos(q2) + b * cos(q2 + q3), a * sin(q2) + b * sin(q2 + q3), q1)
    u = W - vertcat(trocar_x, trocar_y, trocar_z)
    length = norm_2(u)
    return u / if_else(length < r7, length, float("nan"))


@equation("forward", "joints -> pose", gives="T_base_tool")
def chain(q1, q2, q3, q7, q8, q9, u_out, a, b, r7, r10):
    """Return the tool pose: the product of all Denavit-Hartenberg rows; q4 to q6 follow from belt and trocar."""
    T = _to_shaft(q1, q2, q3, *gimbal(u_out, q2, q3), q7, a, b, r7)
    return T @ row(pi / 2, 0, pi / 2 + q8, 0) @ row(pi / 2, 0, pi / 2 + q9, 0) @ row(pi / 2, 0, 0, r10)


@equation("helper", "points in base", gives=place_names(_POINTS))
def places(T_base_tool, P_in, W, trocar_x, trocar_y, trocar_z):
    """Return W (outer point), P_in (inner wrist), the tip and the trocar in base, each (3,)."""
    return W, P_in, T_base_tool[0:3, 3], vertcat(trocar_x, trocar_y, trocar_z)


@equation("helper", "reach and singularity", gives="stretch fold rest s3 c6 c8")
def margins(W, P_in, q3, q6, q8, a, b, r7, trocar_x, trocar_y, trocar_z):
    """Return margins of reach in m: arm stretched, arm folded, shaft; then three singularity measures (0: singular)."""
    D = sqrt(W[0] ** 2 + W[1] ** 2)
    rest = r7 - norm_2(vertcat(trocar_x, trocar_y, trocar_z) - P_in)
    return a + b - D, D - sqrt((a - b) ** 2), rest, sin(q3), cos(q6), cos(q8)


_ALARM = f"alarm {ASSUMED}"

FORMULA = Formula(
    name="lapbot",
    title="Lapbot: six driven and three passive joints, instrument through a trocar",
    source=f"{PAPER}, figure 1: structure; dimensions {ASSUMED}",
    parameters=(
        mm("a", 300, "ASSUMED", "length of the upper arm; the arm reaches over half of the table"),
        mm("b", 300, "ASSUMED", "length of the forearm, equal to the upper arm"),
        mm("r7", 350, "ASSUMED", "length of the shaft from outer point to inner wrist, as in common instruments"),
        mm("r10", 20, "ASSUMED", "distance from inner wrist to tip"),
        *trocar(400, 0, 300),
    ),
    joints=(
        ActiveJoint("q1", "prismatic"),
        *(ActiveJoint(f"q{i}", "revolute") for i in (2, 3, 7, 8, 9)),
    ),
    coordinates=ZYX,
    equations=tuple(equation),
    characteristic_length=lambda r7: r7,
    points=dict(zip(_POINTS, place_names(_POINTS), strict=True)),
    passive=("q4", "q5", "q6"),
    reach={"arm": "stretch", "arm, folded": "fold", "shaft": "rest"},
    measures=(
        Measure("elbow", "s3", "type1", 0.1, f"the arm is stretched or folded; {_ALARM}"),
        Measure("gimbal", "c6", "type2", 0.2, f"two passive axes are in line; {_ALARM}"),
        Measure("wrist", "c8", "type1", 0.1, f"the axes of q7 and q9 are in line; {_ALARM}"),
    ),
    aspects=(Aspect("s3", 1, "the elbow is as in the CAD"), Aspect("c8", 1, "the wrist is bent by less than 90 deg")),
    seeds=(
        (0.40, 0.0, 0.13, 0.0, 180 * DEG, 0.0),
        (0.44, 0.03, 0.16, 10 * DEG, 165 * DEG, 5 * DEG),
        (0.36, -0.04, 0.12, -10 * DEG, 195 * DEG, -10 * DEG),
    ),
)
