"""SHER 3.0, the Steady-Hand Eye Robot: delta stage (q1 to q3), roll (q4 = psi), four-bar tilt with stroke q5 = s.

The paper (eqs (1)-(3)) prints the chain T_t^b = T_p^b T_r^p T_a^r T_t^a, but no lengths. Lengths and the two linkages
are taken from the published derivation, github.com/zhaob5/sher3-kinematics (MIT), called [A] below; its equations are
written here in closed form.

Frame {b} is the base: z is up along the slides, and the origin is the centre of the base joint circle at q = 0. Frame
{p} is at the centre of the platform joint circle and never rotates. Frame {r} is on the roll axis, with x along this
axis. Frame {a} is at pin A, with the linkage in its x-y plane. Frame {t} is the tool frame: it is at P, the intended
RCM, and y points along the tool towards its handle, so the tool points along -y. Five joints control five degrees of
freedom: the position of P and the direction of the tool. These determine the rotation about the tool axis.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from casadi import acos, atan2, cos, cross, dot, norm_2, pi, sin, sqrt, vertcat

from twin.core.provenance import Parameter
from twin.core.spatial import Array
from twin.core.units import DEG, MM
from twin.formula import symbolic
from twin.formula.contract import ActiveJoint, Aspect, Coordinates, Formula, Measure
from twin.formula.equations import Equations

_A = "sher3-kinematics (MIT, JHU LCSR 2025)"
_PAPER = "paper on the SHER 3.0 simulation"
_LEGS = (
    "u1a1", "u1a2", "u1b1", "u1b2",
    "u2a1", "u2a2", "u2b1", "u2b2",
    "u3a1", "u3a2", "u3b1", "u3b2",
)  # fmt: skip
_PINS = ("pin_r", "e_a", "e_b", "e_d", "e_c", "pin_q")
_DRAWN = "R moves 10 mm above A, as in the drawing of [A]. At s = 0, P is then at (160.1, -45.9) mm in {a}."
_BELOW = "R moves 10 mm below A (y_AR = -10). Only then is P at (145.2, -45.4) mm at s = 0, as published in [A]."

equation = Equations()


def hypot(a, b):
    """Return the length of the vector (a, b)."""
    return sqrt(a**2 + b**2)


_AZIMUTHS = (60 * DEG, 180 * DEG, 300 * DEG)


def _legs(r_x, r_y, r_z, r_b, r_p, heights):
    """Return the leg vectors l_i = r - c_i, from lower to upper joint centre; a leg is midway between its two rods."""
    rho = r_b - r_p
    r = vertcat(r_x, r_y, r_z)
    legs = []
    for a, height in zip(_AZIMUTHS, heights, strict=True):
        legs.append(r - vertcat(rho * cos(a), rho * sin(a), height))
    return legs


# ------------------------------------------------------------------- forward: joints -> pose


@equation(
    "forward",
    "slides -> platform centre, upper solution",
    gives="r_x r_y r_z",
    source=f"DERIVED from the geometry of {_A}: its elimination divides by differences that can vanish",
)
def delta_forward(q1, q2, q3, r_b, r_p, l):  # noqa: E741 - the symbol of the source
    """Return the platform centre from the slides: the upper of the two points at distance l from three centres."""
    rho = r_b - r_p
    c1, c2, c3 = (vertcat(rho * cos(a), rho * sin(a), q) for a, q in zip(_AZIMUTHS, (q1, q2, q3), strict=True))
    d = norm_2(c2 - c1)
    e_x = (c2 - c1) / d
    i = dot(e_x, c3 - c1)
    e_y = (c3 - c1 - i * e_x) / norm_2(c3 - c1 - i * e_x)
    j = dot(e_y, c3 - c1)
    X = d / 2
    Y = (i**2 + j**2 - 2 * i * X) / (2 * j)
    H = sqrt(l**2 - X**2 - Y**2)
    r = c1 + X * e_x + Y * e_y + H * cross(e_x, e_y)
    return r[0], r[1], r[2]


def _crank(x_AR, y_AR, AQ, QR):
    """Return the angle al from the negative x axis to A->Q; th1, the angle from x to A->D, follows from al."""
    L_AR = hypot(x_AR, y_AR)
    return acos((L_AR**2 + AQ**2 - QR**2) / (2 * L_AR * AQ)) + atan2(y_AR, x_AR)


@equation(
    "forward",
    "stroke -> tilt angle, P in {a}",
    gives="th P_x P_y",
    source=f"{_A}, forward of the tilt linkage",
    why=_BELOW,
)
def tilt_forward(q5, AB, BC, CD, DA, DP, AQ, QR, phi1, phi2, phi3, phi4, x_max, y_AR):
    """Return tilt angle and P in {a} from the stroke, by the slider-crank R-Q-A, then the four-bar A-B-C-D."""
    al = _crank(x_max - q5, y_AR, AQ, QR)
    th1 = pi - phi2 - al
    BD = sqrt(AB**2 + DA**2 - 2 * AB * DA * cos(phi1 - th1))
    b1 = acos((AB**2 + BD**2 - DA**2) / (2 * AB * BD))
    de = acos((CD**2 + BD**2 - BC**2) / (2 * CD * BD))
    th2 = phi1 + b1 - de
    P_x = DA * cos(th1) + DP * cos(th2 - phi3)
    P_y = DA * sin(th1) + DP * sin(th2 - phi3)
    return pi / 2 - phi4 - phi3 + th2, P_x, P_y


@equation.variant("drawn", of=tilt_forward, why=_DRAWN)
def tilt_forward_drawn(y_AR):
    """Return y_AR as in the drawing of [A], in which the rail of R is above A."""
    y_AR = -y_AR
    return y_AR


@equation("forward", "T_p^b", gives="T_b_p", source=f"{_PAPER}, eq. (1)")
def eq1(r_x, r_y, r_z):
    """Return T_p^b; the platform never rotates."""
    return symbolic.pose(symbolic.rotation_x(0), vertcat(r_x, r_y, r_z))


@equation("forward", "T_r^p", gives="T_p_r", source=f"{_PAPER}, eq. (2)")
def eq2(q4, d1):
    """Return T_r^p = Trans(z, d1) Rot(x, psi)."""
    return symbolic.pose(symbolic.rotation_x(q4), vertcat(0, 0, d1))


@equation(
    "forward",
    "T_a^r",
    gives="T_r_a",
    source=f"{_PAPER}, eq. (3)",
    name="eq3",
    why="Rot(x, 90 deg) is added at the end, as in [A]; only then is the linkage upright at psi = 0 (all figures).",
)
def eq3_corrected(d2, d3):
    """Return T_a^r = Trans(x, d2) Trans(z, d3) Rot(x, 90 deg)."""
    T_r_a = symbolic.pose(symbolic.rotation_x(pi / 2), vertcat(d2, 0, d3))
    return T_r_a


@equation.variant(
    "printed",
    of=eq3_corrected,
    why="As printed: no rotation, although the paper's frame {a} implies one. The linkage is then in the x-y plane.",
)
def eq3_printed(d2, d3):
    """Return T_a^r = Trans(x, d2) Trans(z, d3), as printed."""
    T_r_a = symbolic.pose(symbolic.rotation_x(0), vertcat(d2, 0, d3))
    return T_r_a


@equation("forward", "T_t^b", gives="T_base_tool", source=f"{_PAPER}, eq. (1)")
def chain(T_b_p, T_p_r, T_r_a, th, P_x, P_y):
    """Return T_t^b = T_p^b T_r^p T_a^r T_t^a with T_t^a = Trans(P) Rot(z, th)."""
    return T_b_p @ T_p_r @ T_r_a @ symbolic.pose(symbolic.rotation_z(th), vertcat(P_x, P_y, 0))


# ------------------------------------------------------------------- inverse: pose -> joints


@equation(
    "inverse",
    "tilt angle -> stroke q5, P in {a}",
    gives="q5 P_x P_y",
    source=f"{_A}, inverse of the tilt linkage",
    why=_BELOW,
)
def tilt_inverse(theta, AB, BC, CD, DA, DP, AQ, QR, phi1, phi2, phi3, phi4, x_max, y_AR):
    """Return stroke and P in {a} from the tilt angle, by the inverse of the four-bar, then of the slider-crank."""
    th2 = theta - pi / 2 + phi4 + phi3
    a = CD * cos(th2) - AB * cos(phi1)
    b = AB * sin(phi1) - CD * sin(th2)
    L = hypot(a, b)
    th1 = pi / 2 - acos((DA**2 + L**2 - BC**2) / (2 * DA * L)) + atan2(a, b)
    al = pi - th1 - phi2
    x_AR = AQ * cos(al) + sqrt(QR**2 - (AQ * sin(al) - y_AR) ** 2)
    P_x = DA * cos(th1) + DP * cos(th2 - phi3)
    P_y = DA * sin(th1) + DP * sin(th2 - phi3)
    return x_max - x_AR, P_x, P_y


@equation.variant("drawn", of=tilt_inverse, why=_DRAWN)
def tilt_inverse_drawn(y_AR):
    """Return y_AR as in the drawing of [A], in which the rail of R is above A."""
    y_AR = -y_AR
    return y_AR


@equation(
    "inverse", "pose -> roll q4, platform centre r", gives="q4 r_x r_y r_z", source=f"{_PAPER}, eqs (1)-(3) inverted"
)
def roll_inverse(x, y, z, psi, P_x, P_y, d1, d2, d3):
    """Return roll and platform centre from the coordinates of the tool."""
    return psi, x - P_x - d2, y + sin(psi) * (P_y + d3), z - cos(psi) * (P_y + d3) - d1


@equation("inverse", "platform centre -> slides q1..q3", gives="q1 q2 q3", source=f"{_A}, geometry of the delta stage")
def delta_inverse(r_x, r_y, r_z, r_b, r_p, l):  # noqa: E741
    """Return the slides from the platform centre, with the platform above the carriages."""
    rho = r_b - r_p
    return tuple(r_z - sqrt(l**2 - (r_x - rho * cos(a)) ** 2 - (r_y - rho * sin(a)) ** 2) for a in _AZIMUTHS)


# ------------------------------------------------------------------- quantities without a printed equation


@equation("helper", "tilt angle -> angles of the links", gives="th1 th2 al")
def tilt_angles(theta, AB, CD, DA, DP, AQ, phi2, phi3, phi4, phi1, BC):
    """Return the link angles th1, th2, al from the tilt angle; points, passive joints and margins use them."""
    th2 = theta - pi / 2 + phi4 + phi3
    a = CD * cos(th2) - AB * cos(phi1)
    b = AB * sin(phi1) - CD * sin(th2)
    L = hypot(a, b)
    th1 = pi / 2 - acos((DA**2 + L**2 - BC**2) / (2 * DA * L)) + atan2(a, b)
    return th1, th2, pi - th1 - phi2


def _in_plane(th1, th2, al, AB, CD, DA, AQ, QR, phi1, y_AR):
    """Return B, C, D, Q, R in {a}, each (x, y)."""
    D = (DA * cos(th1), DA * sin(th1))
    Q = (-AQ * cos(al), AQ * sin(al))
    return {
        "b": (AB * cos(phi1), AB * sin(phi1)),
        "c": (D[0] + CD * cos(th2), D[1] + CD * sin(th2)),
        "d": D,
        "q": Q,
        "r": (Q[0] - sqrt(QR**2 - (Q[1] - y_AR) ** 2), y_AR),
    }


@equation(
    "helper",
    "pins, P and platform centre in base",
    gives="at_p at_platform at_a at_b at_c at_d at_q at_r",
)
def points(T_base_tool, psi, r_x, r_y, r_z, th1, th2, al, AB, CD, DA, AQ, QR, phi1, y_AR, d1, d2, d3):
    """Return P, the platform centre, and the pins in {b}; pins are given in the plane of the tool."""
    T_b_a = eq1(r_x, r_y, r_z) @ eq2(psi, d1) @ eq3_corrected(d2, d3)
    pins = {"a": (0, 0), **_in_plane(th1, th2, al, AB, CD, DA, AQ, QR, phi1, y_AR)}
    placed = []
    for x, y in pins.values():
        placed.append((T_b_a @ vertcat(x, y, 0, 1))[0:3])
    return T_base_tool[0:3, 3], vertcat(r_x, r_y, r_z), *placed


@equation("helper", "angles of rods and pins", gives=(*_LEGS, *_PINS), name="passive")
def passive_joints(r_x, r_y, r_z, q1, q2, q3, r_b, r_p, th1, th2, al, AB, CD, DA, AQ, QR, phi1, y_AR):
    """Return the angles of cross and rod for both rods of each leg, then of the pins of the tilt linkage."""
    angles = []
    for a, leg in zip(_AZIMUTHS, _legs(r_x, r_y, r_z, r_b, r_p, (q1, q2, q3)), strict=True):
        outwards = cos(a) * leg[0] + sin(a) * leg[1]
        along = -sin(a) * leg[0] + cos(a) * leg[1]
        # both rods of a leg are parallel
        angles += 2 * [atan2(outwards, leg[2]), atan2(-along, hypot(outwards, leg[2]))]
    p = _in_plane(th1, th2, al, AB, CD, DA, AQ, QR, phi1, y_AR)
    bc = atan2(p["c"][1] - p["b"][1], p["c"][0] - p["b"][0])
    rq = atan2(p["q"][1] - p["r"][1], p["q"][0] - p["r"][0])
    qa = atan2(-p["q"][1], -p["q"][0])
    turn = qa - rq - pi
    return *angles, rq, th1, bc, th2 - th1, th2 - bc, atan2(sin(turn), cos(turn))


@equation("helper", "reach and singularity", gives="leg1 leg2 leg3 toggle slide volume sin_c cos_r up1 up2 up3")
def margins(r_x, r_y, r_z, q1, q2, q3, r_b, r_p, l, th1, al, AB, BC, CD, DA, AQ, QR, phi1, y_AR):  # noqa: E741
    """Return margins of reach in m of rods, four-bar, slider-crank (below 0: no solution), singularity measures."""
    rho = r_b - r_p
    lateral = []
    for a in _AZIMUTHS:
        lateral.append(l - hypot(r_x - rho * cos(a), r_y - rho * sin(a)))
    legs = _legs(r_x, r_y, r_z, r_b, r_p, (q1, q2, q3))
    volume = dot(legs[0], cross(legs[1], legs[2])) / l**3
    BD = sqrt(AB**2 + DA**2 - 2 * AB * DA * cos(phi1 - th1))
    across = AQ * sin(al) - y_AR
    # Angle between BC and CD: if they are in line, the coupler can rotate although the crank is locked.
    cosine = (BC**2 + CD**2 - BD**2) / (2 * BC * CD)
    # Angle between QR and its rail: if it is a right angle, the slider is at rest while the crank rotates.
    return (
        *lateral,
        BC + CD - BD,
        QR - across,
        volume,
        sqrt(1 - cosine**2),
        sqrt(QR**2 - across**2) / QR,
        *(leg[2] / l for leg in legs),
    )


# ------------------------------------------------------------------- the formula


def _mm(name: str, mm: float, note: str) -> Parameter:
    return Parameter(name, mm * MM, "mm", mm, "CITED", f"{_A}: {note}")


def _deg(name: str, deg: float, note: str) -> Parameter:
    return Parameter(name, deg * DEG, "deg", deg, "CITED", f"{_A}: {note}")


_ALARM = "alarm ASSUMED: no published threshold"
_ROD_LEVEL = f"the rod is horizontal: its slide has no effect; {_ALARM}"

_U = np.column_stack([np.cos(_AZIMUTHS), np.sin(_AZIMUTHS)])
"""Directions (3, 2) from the axis of the robot to the slides."""


def platforms(q: Array, p: Mapping[str, float]) -> list[Array]:
    """Return the platform centres (3,) in m at slides q (3,): upper, then lower solution; empty if there is none.

    Both solutions are at distance l from three centres, one on each side of the plane through these centres.
    """
    c = np.column_stack([(p["r_b"] - p["r_p"]) * _U, q])
    d = np.linalg.norm(c[1] - c[0])
    e_x = (c[1] - c[0]) / d
    i = e_x @ (c[2] - c[0])
    e_y = c[2] - c[0] - i * e_x
    e_y /= np.linalg.norm(e_y)
    j = e_y @ (c[2] - c[0])
    X = d / 2
    Y = (i**2 + j**2 - 2 * i * X) / (2 * j)
    H2 = p["l"] ** 2 - X**2 - Y**2
    if H2 < 0:
        return []
    foot = c[0] + X * e_x + Y * e_y
    up = np.sqrt(H2) * np.cross(e_x, e_y)
    return sorted((foot + up, foot - up), key=lambda r: -r[2])


def branches(q: Array, p: Mapping[str, float], variants: Mapping[str, str]) -> list[Array]:
    """Return T_base_tool (4, 4) of both assemblies at q (5,), the upper one first."""
    from twin.kinematics import compile_formula

    centres = platforms(q[:3], p)
    if not centres:
        return []
    T = compile_formula(FORMULA, dict(variants), p).forward(q)
    poses = []
    for r in centres:  # the links after the platform move with it by the same translation
        T_moved = T.copy()
        T_moved[:3, 3] += r - centres[0]
        poses.append(T_moved)
    return poses


FORMULA = Formula(
    name="sher",
    title="SHER 3.0, Steady-Hand Eye Robot: delta stage, roll, four-bar tilt",
    source=f"{_PAPER}, eqs (1)-(7); lengths and linkages: {_A}, github.com/zhaob5/sher3-kinematics",
    parameters=(
        _mm("r_b", 60.6927, "radius of the base joint circle; only r_b - r_p has an effect"),
        _mm("r_p", 34.4773, "radius of the platform joint circle"),
        _mm("l", 68.0, "length of a rod between its joint centres"),
        _mm("d1", 56.01, "distance from {p} to {r} along z, l1 in the paper"),
        _mm("d2", 192.7, "distance from {r} to {a} along x"),
        _mm("d3", 25.5, "distance from {r} to {a} along z"),
        _mm("AB", 28.0, "ground link of the four-bar"),
        _mm("BC", 78.5, "link B to C"),
        _mm("CD", 15.0, "coupler, which carries the tool holder"),
        _mm("DA", 73.5, "input link; DA and AQ form one bell crank"),
        _mm("DP", 94.49, "distance from D to P; DP is rigidly fixed to CD"),
        _mm("AQ", 32.5, "arm of the bell crank towards the slider"),
        _mm("QR", 42.0, "link from the slider"),
        _mm("x_max", 60.48, "distance of R behind A at s = 0"),
        _mm("y_AR", -10.0, "height of R above A; in the drawing the sign is opposite, see tilt_forward"),
        _deg("phi1", 90.0, "angle of the direction A->B, measured from x_a"),
        _deg("phi2", 138.0, "angle between AD and AQ"),
        _deg("phi3", 103.93, "angle at D, from P to C"),
        _deg("phi4", 31.06, "angle at P, between tool axis and PD"),
    ),
    joints=(
        *(ActiveJoint(f"q{i}", "prismatic") for i in (1, 2, 3)),
        ActiveJoint("q4", "revolute"),
        ActiveJoint("q5", "prismatic"),
    ),
    coordinates=Coordinates(
        names=("x", "y", "z", "psi", "theta"),
        units=("m", "m", "m", "rad", "rad"),
        to_pose=lambda x, y, z, psi, theta: symbolic.pose(
            symbolic.rotation_x(psi + pi / 2) @ symbolic.rotation_z(theta), vertcat(x, y, z)
        ),
        from_pose=lambda T: (T[0, 3], T[1, 3], T[2, 3], atan2(-T[2, 2], -T[1, 2]), atan2(-T[0, 1], T[0, 0])),
    ),
    equations=tuple(equation),
    characteristic_length=lambda DP: DP,
    points={
        **{"p": "at_p", "platform": "at_platform", "pin_a": "at_a", "pin_b": "at_b"},
        **{"pin_c": "at_c", "pin_d": "at_d", "pin_q": "at_q", "pin_r": "at_r"},
    },
    passive=(*_LEGS, *_PINS),
    reach={"rod 1": "leg1", "rod 2": "leg2", "rod 3": "leg3", "four-bar": "toggle", "slider-crank": "slide"},
    measures=(
        Measure(
            "delta_flat",
            "volume",
            "type2",
            0.1,
            f"the rods are in one plane: they do not hold the platform; {_ALARM}",
        ),
        Measure(
            "four_bar_toggle",
            "sin_c",
            "type2",
            0.15,
            f"BC and CD are in line: the tool can rotate while the crank is locked; {_ALARM}",
        ),
        Measure(
            "slider_across",
            "cos_r",
            "type1",
            0.05,
            f"QR is perpendicular to its rail: the slider has no effect; {_ALARM}",
        ),
        Measure("rod_level_1", "up1", "type1", 0.3, _ROD_LEVEL),
        Measure("rod_level_2", "up2", "type1", 0.3, _ROD_LEVEL),
        Measure("rod_level_3", "up3", "type1", 0.3, _ROD_LEVEL),
    ),
    aspects=(Aspect("volume", 1, "upper solution: the platform is above its carriages"),),
    branches=branches,
    seeds=(
        (353.965 * MM, 0.0, 148.288 * MM, 0.0, 40.0 * DEG),
        (349.913 * MM, 9.999 * MM, 151.434 * MM, 30.0 * DEG, 31.334 * DEG),
        (351.212 * MM, -7.269 * MM, 156.164 * MM, -30.0 * DEG, 56.458 * DEG),
    ),
)
