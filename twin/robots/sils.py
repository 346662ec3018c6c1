# ruff: noqa: E501 - each published row is one line, so that it can be read, and edited by tools, as printed
"""SILS: 6-DOF parallel robot for single-incision laparoscopic surgery, three limbs R-PRR-PRS.

The equations are (1) platform points, (2) inverse model and (3) lengths of the paper: Ro. J. Techn. Sci. - Appl. Mech.
68(1), 3-18, 2023, DOI 10.59277/RJTS-AM.2023.1.01. In the base frame O-XYZ, O is on rail 1, Z points up along this rail,
Y towards rail 3, and X out of the portal towards the patient. The tool frame is at the centroid of the three ball
centres, z_p points up from the platform, and the rotation is R = Rz(psi) Ry(theta) Rx(phi).

Every printed row is one assignment with the symbols of the paper. In eq. (2), q1 is on both sides of its row and depends
on q2, and q2 depends on q1; likewise q3 and q4, q5 and q6. The compiler solves these pairs.

Limb i is rotated about its rail (direction e_a) by alpha_i; e_r points from the rail to the ball; t = e_a x e_r.
The bar points from its carriage along sin(beta) e_r - sigma cos(beta) e_a, the strut from its carriage along
sin(beta) e_r + sigma cos(beta) e_a. Here sigma is +1, -1, +1 for limbs 1, 2, 3.
"""

from __future__ import annotations

from casadi import atan2, cos, cross, dot, fabs, pi, sin, sqrt, vertcat

from twin.core.units import DEG, MM
from twin.formula import symbolic
from twin.formula.contract import (
    ActiveJoint,
    Aspect,
    Coordinates,
    Formula,
    Measure,
)
from twin.formula.equations import Equations
from twin.robots._authoring import mm
from twin.robots._sils_assembly import branches

_PAPER = "RJTS-AM 68(1), 2023"
_EQ3 = f"{_PAPER}, eq. (3)"

equation = Equations()

# ------------------------------------------------------------------- eq. (1): pose -> ball centres

_BALLS = ("X_S1", "Y_S1", "Z_S1", "X_S2", "Y_S2", "Z_S2", "X_S3", "Y_S3", "Z_S3")


@equation(
    "inverse",
    "pose coordinates -> ball centres S1, S2, S3",
    gives=_BALLS,
    source=f"{_PAPER}, eq. (1)",
    name="eq1",
    why="In X and Y of S1 and S3, the last factor c_theta is now c_phi. Only then is S_i = E + R a_i with constant a_i, and all "
    "three sides are l_p at every pose.",
)
def eq1_corrected(X_E, Y_E, Z_E, psi, theta, phi, l_p):
    """Return the ball centres of a rigid equilateral platform: c_theta is replaced by c_phi at the end of four rows."""
    c_psi, c_theta, c_phi = cos(psi), cos(theta), cos(phi)
    s_psi, s_theta, s_phi = sin(psi), sin(theta), sin(phi)
    X_S1 = X_E + sqrt(3) / 6 * l_p * c_psi * c_theta - l_p / 2 * c_psi * s_theta * s_phi + l_p / 2 * s_psi * c_phi  # fmt: skip  # (1)
    Y_S1 = Y_E + sqrt(3) / 6 * l_p * s_psi * c_theta - l_p / 2 * s_psi * s_theta * s_phi - l_p / 2 * c_psi * c_phi  # fmt: skip  # (1)
    Z_S1 = Z_E - sqrt(3) / 6 * l_p * s_theta - l_p / 2 * s_phi * c_theta  # (1)
    X_S2 = X_E - sqrt(3) / 3 * l_p * c_psi * c_theta  # (1)
    Y_S2 = Y_E - sqrt(3) / 3 * l_p * s_psi * c_theta  # (1)
    Z_S2 = Z_E + sqrt(3) / 3 * l_p * s_theta  # (1)
    X_S3 = X_E + sqrt(3) / 6 * l_p * c_psi * c_theta + l_p / 2 * c_psi * s_theta * s_phi - l_p / 2 * s_psi * c_phi  # fmt: skip  # (1)
    Y_S3 = Y_E + sqrt(3) / 6 * l_p * s_psi * c_theta + l_p / 2 * s_psi * s_theta * s_phi + l_p / 2 * c_psi * c_phi  # fmt: skip  # (1)
    Z_S3 = Z_E - sqrt(3) / 6 * l_p * s_theta + l_p / 2 * s_phi * c_theta  # (1)
    return X_S1, Y_S1, Z_S1, X_S2, Y_S2, Z_S2, X_S3, Y_S3, Z_S3


@equation.variant(
    "printed",
    of=eq1_corrected,
    why="As printed. The platform is then not rigid: the side S1 S3 is l_p only if |theta| = |phi|.",
)
def eq1_printed(X_E, Y_E, l_p, c_psi, c_theta, s_psi, s_theta, s_phi):
    """Return the ball centres as printed: the last factor of X and Y of S1 and S3 is c_theta."""
    X_S1 = X_E + sqrt(3) / 6 * l_p * c_psi * c_theta - l_p / 2 * c_psi * s_theta * s_phi + l_p / 2 * s_psi * c_theta  # fmt: skip  # (1)
    Y_S1 = Y_E + sqrt(3) / 6 * l_p * s_psi * c_theta - l_p / 2 * s_psi * s_theta * s_phi - l_p / 2 * c_psi * c_theta  # fmt: skip  # (1)
    X_S3 = X_E + sqrt(3) / 6 * l_p * c_psi * c_theta + l_p / 2 * c_psi * s_theta * s_phi - l_p / 2 * s_psi * c_theta  # fmt: skip  # (1)
    Y_S3 = Y_E + sqrt(3) / 6 * l_p * s_psi * c_theta + l_p / 2 * s_psi * s_theta * s_phi + l_p / 2 * c_psi * c_theta  # fmt: skip  # (1)
    return X_S1, Y_S1, X_S3, Y_S3


# ------------------------------------------------------------------- eq. (2): ball centres -> joints


@equation(
    "inverse",
    "ball centres -> carriages q1..q6",
    gives="q1 q2 q3 q4 q5 q6",
    source=f"{_PAPER}, eq. (2)",
    name="eq2",
    why="The radicals are corrected. In the odd rows, (l_1 + l_2) is now (l_2 - l_1); this is equivalent to a misprint of "
    "q_odd for q_even on the left. Only then does the strut have the length l_1 at every pose, and the carriages of "
    "Table 2 are within the frame. From the order in R-PRR-PRS it is inferred, not published, that odd carriages carry "
    "the strut and even carriages the bar.",
)
def eq2_corrected(X_S1, Y_S1, Z_S1, X_S2, Y_S2, Z_S2, X_S3, Y_S3, Z_S3, q1, q2, q3, q4, q5, q6, l_0, l_1, l_2, L_H, L_V):  # fmt: skip
    """Return the carriages for struts of length l_1: the rows of q1, q3, q5 have (l_2 - l_1) instead of (l_1 + l_2)."""
    q1 = 1 / (2 * l_1) * (l_2 - l_1) * (q2 - q1) + Z_S1  # (2)
    q2 = 1 / (l_1 + l_2) * ((l_1 + l_2) * q1 + 2 * l_1 * sqrt(-X_S1**2 - Y_S1**2 - l_0**2 + (l_1 + l_2)**2 + 2 * l_0 * sqrt(X_S1**2 + Y_S1**2)))  # fmt: skip  # (2)
    q3 = 1 / (2 * l_1) * (l_2 - l_1) * (q4 - q3) + Y_S2  # (2)
    q4 = 1 / (l_1 + l_2) * ((l_1 + l_2) * q3 - 2 * l_1 * sqrt(-X_S2**2 - l_0**2 + (l_1 + l_2)**2 - (L_V - Z_S2)**2 + 2 * l_0 * sqrt((L_V - Z_S2)**2 + X_S2**2)))  # fmt: skip  # (2)
    q5 = 1 / (2 * l_1) * (l_2 - l_1) * (q6 - q5) + Z_S3  # (2)
    q6 = 1 / (l_1 + l_2) * ((l_1 + l_2) * q5 + 2 * l_1 * sqrt(-X_S3**2 - l_0**2 + (l_1 + l_2)**2 - (L_H - Y_S3)**2 + 2 * l_0 * sqrt((L_H - Y_S3)**2 + X_S3**2)))  # fmt: skip  # (2)
    return q1, q2, q3, q4, q5, q6


@equation.variant(
    "printed",
    of=eq2_corrected,
    why="The radicals are corrected: all terms are under the root. Their sum, (l_1+l_2)^2 - (rho-l_0)^2, is negative if "
    "the bar does not reach. The odd rows are as printed: each odd carriage is at the place of its even carriage, and the "
    "struts have lengths of 244 to 396 mm instead of l_1.",
)
def eq2_printed(Z_S1, Y_S2, Z_S3, q1, q2, q3, q4, q5, q6, l_1, l_2):
    """Return the carriages with all terms under the radical, and the rows of q1, q3 and q5 as printed."""
    q1 = 1 / (2 * l_1) * (l_1 + l_2) * (q2 - q1) + Z_S1  # (2)
    q3 = 1 / (2 * l_1) * (l_1 + l_2) * (q4 - q3) + Y_S2  # (2)
    q5 = 1 / (2 * l_1) * (l_1 + l_2) * (q6 - q5) + Z_S3  # (2)
    return q1, q3, q5


@equation.variant(
    "literal",
    of=eq2_printed,
    why="The radicals are exactly as in our transcription of the paper: the root ends before 2 l_0 sqrt(...) (q2, q4, q6) and before "
    "-(L_V - Z_S2)^2, -(L_H - Y_S3)^2 (q4, q6). Carriage gaps are then wrong by up to 0.55 m. This may be an error "
    "of the transcription; therefore this is a separate variant.",
)
def eq2_literal(X_S1, Y_S1, X_S2, Z_S2, X_S3, Y_S3, q1, q3, q5, l_0, l_1, l_2, L_H, L_V):
    """Return the carriages with the radicals as in our transcription of the paper: roots cover too few terms."""
    q2 = 1 / (l_1 + l_2) * ((l_1 + l_2) * q1 + 2 * l_1 * sqrt(-X_S1**2 - Y_S1**2 - l_0**2 + (l_1 + l_2)**2) + 2 * l_0 * sqrt(X_S1**2 + Y_S1**2))  # fmt: skip  # (2)
    q4 = 1 / (l_1 + l_2) * ((l_1 + l_2) * q3 - 2 * l_1 * sqrt(-X_S2**2 - l_0**2 + (l_1 + l_2)**2) - (L_V - Z_S2)**2 + 2 * l_0 * sqrt((L_V - Z_S2)**2 + X_S2**2))  # fmt: skip  # (2)
    q6 = 1 / (l_1 + l_2) * ((l_1 + l_2) * q5 + 2 * l_1 * sqrt(-X_S3**2 - l_0**2 + (l_1 + l_2)**2) - (L_H - Y_S3)**2 + 2 * l_0 * sqrt((L_H - Y_S3)**2 + X_S3**2))  # fmt: skip  # (2)
    return q2, q4, q6


# ------------------------------------------------------------------- quantities without a printed equation

_LIMB = ("rho", "h", "alpha", "beta", "reach", "cos_beta", "sin_beta", "radius")


@equation(
    "helper",
    "ball centres -> limb angles, margins",
    gives=[f"{name}{i}" for i in (1, 2, 3) for name in _LIMB],
)
def limbs(X_S1, Y_S1, Z_S1, X_S2, Y_S2, Z_S2, X_S3, Y_S3, Z_S3, l_0, l_1, l_2, L_H, L_V):
    """Return angles and margins of each limb, computed from its ball centre alone.

    rho is the distance from ball to rail axis; h is the distance from ball to bar pivot along the rail. alpha and beta
    are the angles of limb and bar. No value depends on the variant of eq. (2), which only computes the carriages.
    """
    L = l_1 + l_2
    values = []
    for radial_x, radial_y in ((X_S1, Y_S1), (X_S2, L_V - Z_S2), (X_S3, L_H - Y_S3)):
        rho = symbolic.sqrt(radial_x**2 + radial_y**2)
        h = sqrt(L**2 - (rho - l_0) ** 2)
        reach = L - fabs(rho - l_0)
        values += [
            rho,
            h,
            atan2(radial_y, radial_x),
            atan2(rho - l_0, h),
            reach,
            h / L,
            (rho - l_0) / L,
            rho / L,
        ]
    return tuple(values)


_PASSIVE = (
    "rf1", "rf2", "rf3",
    "r11", "r12", "r13",
    "r21", "r22", "r23",
    "r31", "r32", "r33",
)  # fmt: skip


@equation(
    "helper", "limb angles -> passive joints", gives=_PASSIVE, source="DERIVED; numbering ASSUMED", name="passive"
)
def passive_joints(alpha1, alpha2, alpha3, beta1, beta2, beta3):
    """Return the passive joint angles; the angles of bar and strut are about t, measured from e_r.

    With y = t x e_r = -e_a, the angle of the bar is atan2(sigma cos(beta), sin(beta)); the angle of the strut is
    the negative.
    """
    angles = [alpha1, alpha2, alpha3]
    for sigma, beta in ((1, beta1), (-1, beta2), (1, beta3)):
        angles += [-sigma * (pi / 2 - beta), sigma * (pi / 2 - beta), sigma * (pi - 2 * beta)]
    return tuple(angles)


@equation("helper", "ball centres -> apex joints", gives="A1 A2 A3")
def apexes(X_S1, Y_S1, Z_S1, X_S2, Y_S2, Z_S2, X_S3, Y_S3, Z_S3, alpha1, alpha2, alpha3, beta1, beta2, beta3, l_2):  # fmt: skip
    """Return the apex joints on the bars, at distance l_2 from the ball centres and l_1 from the bar pivots."""
    balls = (vertcat(X_S1, Y_S1, Z_S1), vertcat(X_S2, Y_S2, Z_S2), vertcat(X_S3, Y_S3, Z_S3))
    joints = []
    for S, sigma, beta, (e_a, e_r) in zip(
        balls, (1, -1, 1), (beta1, beta2, beta3), _axes(alpha1, alpha2, alpha3), strict=True
    ):
        joints.append(S - l_2 * (sin(beta) * e_r - sigma * cos(beta) * e_a))
    return tuple(joints)


@equation("helper", "type II singularity measure", gives="D z_up")
def type2(X_S1, Y_S1, Z_S1, X_S2, Y_S2, Z_S2, X_S3, Y_S3, Z_S3, alpha1, alpha2, alpha3, theta, phi, l_p):
    """Return D and the z component of z_p; D is 0 if the platform can move while all carriages are at rest."""
    S1 = vertcat(X_S1, Y_S1, Z_S1)
    S2 = vertcat(X_S2, Y_S2, Z_S2)
    S3 = vertcat(X_S3, Y_S3, Z_S3)
    t1, t2, t3 = [cross(e_a, e_r) for e_a, e_r in _axes(alpha1, alpha2, alpha3)]
    u12 = (S1 - S2) / l_p
    u23 = (S2 - S3) / l_p
    u13 = (S1 - S3) / l_p
    D = dot(u12, t2) * dot(u23, t3) * dot(u13, t1) - dot(u12, t1) * dot(u23, t2) * dot(u13, t3)
    return D, cos(theta) * cos(phi)


def _axes(alpha1, alpha2, alpha3):
    """Return (e_a, e_r) of each limb; alpha is a rotation about +Z, +Y and -Z (limbs 1, 2, 3)."""
    return (
        (vertcat(0, 0, 1), vertcat(cos(alpha1), sin(alpha1), 0)),
        (vertcat(0, 1, 0), vertcat(cos(alpha2), 0, -sin(alpha2))),
        (vertcat(0, 0, 1), vertcat(cos(alpha3), -sin(alpha3), 0)),
    )


# ------------------------------------------------------------------- the formula


_TABLE2 = (
    (380.0, 280.0, 185.0, 0.0, 0.0, 0.0),
    (407.9, 306.0, 211.4, 10.0, 15.0, 10.0),
    (380.0, 280.0, 145.0, 0.0, 0.0, 0.0),
    (400.0, 310.0, 135.0, 15.0, 20.0, 10.0),
)
"""Poses B, C, I, T of Table 2 in mm and deg."""

_ALARM = "alarm ASSUMED: no published threshold"


def _limb_measures(name, symbol, note):
    """Return a measure of singularity for each of the three limbs."""
    return [Measure(f"{name}_{limb}", f"{symbol}{limb}", "type1", 0.1, f"{note}; {_ALARM}") for limb in (1, 2, 3)]


FORMULA = Formula(
    name="sils",
    title="SILS 6-DOF parallel robot, three limbs R-PRR-PRS",
    source="Ro. J. Techn. Sci. - Appl. Mech. 68(1), 3-18, 2023, DOI 10.59277/RJTS-AM.2023.1.01",
    parameters=(
        mm(
            "l_0", 50.0, "PUBLISHED", f"{_EQ3}, printed l_o: distance from rail axis to strut and bar pivots, along e_r"
        ),
        mm("l_1", 182.0, "PUBLISHED", f"{_EQ3}: length of the strut, and distance from bar pivot to apex joint"),
        mm(
            "l_2",
            392.0,
            "PUBLISHED",
            f"{_EQ3}: distance from apex joint to ball centre; the bar has the length l_1 + l_2",
        ),
        mm("l_p", 135.0, "PUBLISHED", f"{_EQ3}: side of the equilateral triangle S1 S2 S3"),
        mm("L_V", 657.0, "PUBLISHED", f"{_EQ3}: height of the horizontal rail 2"),
        mm(
            "L_H",
            612.0,
            "ASSUMED",
            f"{_EQ3} gives L_B = 612 mm; eq. (2) uses L_H, which has no value. Both are taken as the distance between "
            "rail 1 and rail 3",
        ),
    ),
    joints=tuple(ActiveJoint(f"q{i}", "prismatic") for i in range(1, 7)),
    coordinates=Coordinates(
        names=("X_E", "Y_E", "Z_E", "psi", "theta", "phi"),
        units=("m", "m", "m", "rad", "rad", "rad"),
        to_pose=lambda X_E, Y_E, Z_E, psi, theta, phi: symbolic.pose(
            symbolic.rotation_zyx(psi, theta, phi), vertcat(X_E, Y_E, Z_E)
        ),
        from_pose=lambda T: (T[0, 3], T[1, 3], T[2, 3], *symbolic.angles_zyx(T)),
    ),
    equations=tuple(equation),
    characteristic_length=lambda l_p: l_p / 3**0.5,
    points={
        **{f"s{i}": (f"X_S{i}", f"Y_S{i}", f"Z_S{i}") for i in (1, 2, 3)},
        **{f"apex{i}": f"A{i}" for i in (1, 2, 3)},
    },
    passive=_PASSIVE,
    reach={f"limb {i}": f"reach{i}" for i in (1, 2, 3)},
    measures=(
        Measure("type2", "D", "type2", 0.15, f"the platform can move while all carriages are at rest; {_ALARM}"),
        *_limb_measures(
            "bar_across", "cos_beta", "h = 0: the bar is perpendicular to its rail, and the carriages coincide"
        ),
        *_limb_measures("bar_along", "sin_beta", "rho = l_0: the bar is parallel to its rail"),
        *_limb_measures(
            "ball_on_rail", "radius", "rho = 0: the ball is on the rail axis, and the limb angle is undefined"
        ),
    ),
    aspects=(
        Aspect("X_E", 1, "the platform is in front of the portal"),
        Aspect("z_up", 1, "z_p points up, and the instrument points down"),
        Aspect("D", -1, "D has the sign that it has at all poses of Table 2"),
    ),
    branches=branches,
    seeds=tuple((x * MM, y * MM, z * MM, a * DEG, b * DEG, c * DEG) for x, y, z, a, b, c in _TABLE2),
)
