"""Hibou: a turret, a two-link arm in a vertical plane, two passive joints, and an endoscope with a tilting tip.

The paper gives the structure (7 revolute joints, 5 driven and 2 passive, and the trocar between joints 5 and 6), but no
dimensions. Everything else is ASSUMED, including the table below in Khalil and Kleinfinger's form.

The five driven joints determine the position P_7 of the shaft's end, the roll of the image and the tilt of the tip. The
direction of the shaft follows from P_7 and the trocar; a pose with another shaft direction has no solution.
"""

from __future__ import annotations

from casadi import acos, asin, atan2, cos, fabs, if_else, norm_2, pi, sin, sqrt, vertcat

from twin.core.units import DEG
from twin.formula import symbolic
from twin.formula.contract import Aspect, Formula, Measure
from twin.formula.equations import Equations
from twin.robots._authoring import ASSUMED, DERIVED, PAPER, ZYX, active_joints, mm, place_names, row, trocar

_OFF = 1e-6
"""Maximum error of an entry of the rotation matrix at which a pose counts as within the five degrees of freedom."""
_POINTS = ("outer", "inner", "tip", "trocar")

equation = Equations(DERIVED, variant="derived")


@equation("inverse", "pose and trocar -> end of the shaft, its direction, outer point W", gives="P_7 u W")
def shaft(T_base_tool, r6, r8, trocar_x, trocar_y, trocar_z):
    """Return shaft end P_7, direction from P_7 to the trocar, and outer point W; NaN if the shaft is too short."""
    P_7 = T_base_tool[0:3, 3] - r8 * T_base_tool[0:3, 2]
    to = vertcat(trocar_x, trocar_y, trocar_z) - P_7
    length = norm_2(to)
    u = to / if_else(length < r6, length, float("nan"))
    return P_7, u, P_7 + r6 * u


@equation("inverse", "W -> q1, q2, q3", gives="q1 q2 q3")
def arm(W, a, b, h):
    """Return the angles of turret, shoulder and elbow, with the elbow up (q3 positive)."""
    rr = sqrt(W[0] ** 2 + W[1] ** 2)
    zz = W[2] - h
    q3 = acos((rr**2 + zz**2 - a**2 - b**2) / (2 * a * b))
    return atan2(W[1], W[0]), atan2(-zz, rr) - atan2(b * sin(q3), a + b * cos(q3)), q3


def _to_elbow(q1, q2, q3, a, h):
    return row(0, 0, q1, h) @ row(-pi / 2, 0, q2, 0) @ row(0, a, q3, 0)


@equation("inverse", "shaft -> passive q4, q5", gives="q4 q5")
def gimbal(u, q1, q2, q3, a, h):
    """Return the passive joint angles at which the shaft passes through the trocar."""
    s = _to_elbow(q1, q2, q3, a, h)[0:3, 0:3].T @ -u
    return atan2(s[1], s[0]), asin(s[2])


def _to_outer(q1, q2, q3, q4, q5, a, b, h):
    return _to_elbow(q1, q2, q3, a, h) @ row(0, b, q4, 0) @ row(pi / 2, 0, pi / 2 + q5, 0)


@equation("inverse", "rotation relative to the shaft -> q6, q7", gives="q6 q7 within")
def scope(T_base_tool, q1, q2, q3, q4, q5, a, b, h):
    """Return roll, tilt, margin; tilt is NaN and margin negative if the pose needs a rotation about a third axis."""
    R = _to_outer(q1, q2, q3, q4, q5, a, b, h)[0:3, 0:3] @ symbolic.rotation_x(pi / 2)
    N = R.T @ T_base_tool[0:3, 0:3]  # = Rz(q6) Ry(q7)
    q7 = atan2(-N[2, 0], N[2, 2])
    return atan2(-N[0, 1], N[1, 1]), if_else(fabs(N[2, 1]) < _OFF, q7, float("nan")), _OFF - fabs(N[2, 1])


@equation("forward", "driven arm and trocar -> shaft", gives="u_out")
def outer(q1, q2, q3, a, b, h, r6, trocar_x, trocar_y, trocar_z):
    """Return the direction from the trocar to the outer point W of the driven arm; NaN if the shaft is too short."""
    W = (_to_elbow(q1, q2, q3, a, h) @ vertcat(b, 0, 0, 1))[0:3]
    u = W - vertcat(trocar_x, trocar_y, trocar_z)
    length = norm_2(u)
    return u / if_else(length < r6, length, float("nan"))


@equation("forward", "joints -> pose", gives="T_base_tool")
def chain(q1, q2, q3, q6, q7, u_out, a, b, h, r6, r8):
    """Return the tool pose: the product of all Denavit-Hartenberg rows; q4 and q5 follow from the trocar."""
    T = _to_outer(q1, q2, q3, *gimbal(u_out, q1, q2, q3, a, h), a, b, h)
    return T @ row(pi / 2, 0, q6, r6) @ row(-pi / 2, 0, q7, 0) @ row(pi / 2, 0, 0, r8)


@equation("helper", "points in base", gives=place_names(_POINTS))
def places(T_base_tool, P_7, W, trocar_x, trocar_y, trocar_z):
    """Return W (outer point), P_7 (end of the shaft), the tip and the trocar in base, each (3,)."""
    return W, P_7, T_base_tool[0:3, 3], vertcat(trocar_x, trocar_y, trocar_z)


@equation("helper", "reach and singularity", gives="stretch fold rest s3 c5 aside")
def margins(W, P_7, q3, q5, a, b, h, r6, trocar_x, trocar_y, trocar_z):
    """Return margins of reach in m: arm stretched, arm folded, shaft; then three singularity measures (0: singular)."""
    D = norm_2(W - vertcat(0, 0, h))
    rest = r6 - norm_2(vertcat(trocar_x, trocar_y, trocar_z) - P_7)
    aside = sqrt(W[0] ** 2 + W[1] ** 2) / (a + b)
    return a + b - D, D - sqrt((a - b) ** 2), rest, sin(q3), cos(q5), aside


_ALARM = f"alarm {ASSUMED}"

FORMULA = Formula(
    name="hibou",
    title="Hibou: five driven and two passive joints, endoscope through a trocar",
    source=f"{PAPER}, figure 2: structure; dimensions {ASSUMED}",
    parameters=(
        mm("h", 350, "ASSUMED", "height of the shoulder above the base"),
        mm("a", 300, "ASSUMED", "length of the upper arm; the arm reaches over half of the table"),
        mm("b", 300, "ASSUMED", "length of the forearm, equal to the upper arm"),
        mm("r6", 300, "ASSUMED", "length of the shaft from outer point to tip joint, as in common laparoscopes"),
        mm("r8", 30, "ASSUMED", "distance from tip joint to camera"),
        *trocar(400, 0, 300),
    ),
    joints=active_joints("q1 q2 q3 q6 q7"),
    coordinates=ZYX,
    equations=tuple(equation),
    characteristic_length=lambda r6: r6,
    points=dict(zip(_POINTS, place_names(_POINTS), strict=True)),
    passive=("q4", "q5"),
    reach={"arm": "stretch", "arm, folded": "fold", "shaft": "rest", "five joints": "within"},
    measures=(
        Measure("elbow", "s3", "type1", 0.1, f"the arm is stretched or folded; {_ALARM}"),
        Measure("gimbal", "c5", "type2", 0.2, f"two passive axes are in line; {_ALARM}"),
        Measure("turret", "aside", "type1", 0.05, f"the outer point is above the turret; {_ALARM}"),
    ),
    aspects=(Aspect("s3", 1, "the elbow is up"),),
    seeds=((0.40, 0.0, 0.13, 90 * DEG, 0.0, 180 * DEG),),
)
