"""Functions for both arms of the Raven-II: one modified Denavit-Hartenberg table, and its inverse in closed form.

Frame 0 is at the remote centre of motion (RCM), where the axes of shoulder, elbow and tool meet; its x points up. Frame
{base} is at the same point with z up. Frame {tool} is frame 6 of the table: on the axis of the jaws, with x along the
closed jaws. The two arms differ in five angles of the table, which are parameters; each arm is the mirror image of the
other. The tilt of the real base (25 deg) is in the offsets of the joints, not in {base}.

The inverse has eight candidates: the wrist is on either side of the jaw axis and on either side of the RCM, and the
elbow has either of two angles. The inverse returns the candidate within the ranges of the joints, or the candidate
nearest to these ranges. The jaw does not move the tool and is in no equation.
"""

from __future__ import annotations

from itertools import product

from casadi import atan2, cos, fabs, fmax, fmin, if_else, norm_2, pi, sin, vertcat

from twin.core.provenance import Parameter
from twin.core.units import DEG
from twin.formula import symbolic
from twin.formula.contract import ActiveJoint, Aspect, Formula, Measure
from twin.formula.equations import Equations
from twin.robots._authoring import ZYX, mm, place_names, row
from twin.robots._raven_motion import MOTION

SOURCE = "uw-biorobotics/raven2 (kinematics after UWEETR-2012-0006)"
NAMES = ("shoulder", "elbow", "insertion", "roll", "wrist", "yaw")
_POINTS = ("elbow", "wrist", "fulcrum", "tip")
_RANGES = (  # rad and m, CITED: uw-biorobotics/raven2; they only choose one of the candidates
    (0.0, 90 * DEG),
    (45 * DEG, 135 * DEG),
    (0.23, 0.56),
    (-182 * DEG, 182 * DEG),
    (-70 * DEG, 70 * DEG),
    (-105 * DEG, 105 * DEG),
)

equation = Equations("DERIVED from the table", variant="derived")


def from_zero(base_turn):
    """Return R_base_0 (3, 3): x of frame 0 is z of base."""
    return symbolic.rotation_z(base_turn) @ symbolic.rotation_y(-pi / 2)


def to_carriage(shoulder, elbow, insertion, alpha1, alpha2, alpha3, offset1, offset2, theta3):
    """Return T_0_3 (4, 4): z of frame 3 is along the shaft, away from the patient; its origin is on the carriage."""
    T = row(alpha1, 0, shoulder + offset1, 0) @ row(alpha2, 0, elbow + offset2, 0)
    return T @ row(alpha3, 0, theta3, insertion)


def to_tool(roll, wrist, yaw, L_w, shaft_long):
    """Return T_3_6 (4, 4): from the carriage along the shaft to the wrist and to the axis of the jaws."""
    return row(0, 0, roll, -shaft_long) @ row(pi / 2, 0, wrist - pi / 2, 0) @ row(pi / 2, L_w, yaw, 0)


@equation(
    "forward",
    "joints -> pose",
    gives="T_base_tool",
    source=SOURCE,
    variant="raven",
    why="The distance between wrist and jaw axis is taken from the Raven's own instruments.",
)
def table(
    shoulder,
    elbow,
    insertion,
    roll,
    wrist,
    yaw,
    alpha1,
    alpha2,
    alpha3,
    offset1,
    offset2,
    theta3,
    base_turn,
    L_w,
    shaft_long,
):
    """Return the pose of the tool: the product of rows 1 to 6 of the modified Denavit-Hartenberg table."""
    T_03 = to_carriage(shoulder, elbow, insertion, alpha1, alpha2, alpha3, offset1, offset2, theta3)
    T_36 = to_tool(roll, wrist, yaw, L_w, shaft_long)
    T_base_tool = symbolic.pose(from_zero(base_turn), vertcat(0, 0, 0)) @ T_03 @ T_36
    return T_base_tool


@equation.variant("davinci_tool", of=table, why="The instrument is of da Vinci type, with a shorter wrist.")
def table_davinci(roll, wrist, yaw, L_w_davinci, shaft_long):
    """Return T_3_6 (4, 4), from the carriage to the axis of the jaws, for the instrument with the shorter wrist."""
    T_36 = to_tool(roll, wrist, yaw, L_w_davinci, shaft_long)
    return T_36


def candidates(T_base_tool, alpha1, alpha2, alpha3, offset1, offset2, theta3, base_turn, L_w, shaft_long):
    """Return the eight candidates [(joints (6,), excess)] of the inverse.

    `excess` is 0 for a candidate that exists; for others, it is |cos(elbow angle)| - 1 > 0. Each angle is within half a
    turn of the middle of the range of its joint.
    """
    T = symbolic.pose(from_zero(base_turn).T, vertcat(0, 0, 0)) @ T_base_tool
    R = T[0:3, 0:3]
    p = T[0:3, 3]
    back = -R.T @ p  # the RCM in {tool}; its projection normal to the jaw axis is the direction of the wrist
    u = vertcat(back[0], back[1], 0)
    u = u / norm_2(u)
    c1, s1 = cos(alpha1), sin(alpha1)
    c2, s2 = cos(alpha2), sin(alpha2)
    c3, s3 = cos(alpha3), sin(alpha3)
    solutions = []
    for side, beyond, bend in product((1, -1), (1, -1), (1, -1)):
        p_w = p + side * L_w * (R @ u)
        d = -beyond * norm_2(p_w)
        # The unit vector along the shaft, z of frame 3, in frame 1 before the rotation of the shoulder.
        w = vertcat(p_w[0], c1 * p_w[1] + s1 * p_w[2], -s1 * p_w[1] + c1 * p_w[2]) / d
        c = (c2 * c3 - w[2]) / (s2 * s3)
        excess = fmax(fabs(c) - 1, 0)
        th2 = atan2(bend * symbolic.sqrt(1 - c * c), fmin(fmax(c, -1), 1))
        across = vertcat(sin(th2) * s3, -(c2 * cos(th2) * s3 + s2 * c3))
        th1 = atan2(w[1], w[0]) - atan2(across[1], across[0])
        shoulder = th1 - offset1
        elbow = th2 - offset2
        insertion = d + shaft_long
        T_03 = to_carriage(shoulder, elbow, insertion, alpha1, alpha2, alpha3, offset1, offset2, theta3)
        R36 = T_03[0:3, 0:3].T @ R
        along = (T_03[0:3, 0:3].T @ (p - p_w)) / L_w  # from the wrist to the jaw axis, in frame 3
        bent = if_else(along[2] < 0, -1, 1)  # sine of the angle of row 5, as a sign
        roll = atan2(R36[1, 2] * bent, R36[0, 2] * bent)
        wrist = atan2(along[2], -R36[2, 2]) + pi / 2
        yaw = atan2(-R36[2, 1] * bent, R36[2, 0] * bent)
        joints = []
        for number, value in enumerate((shoulder, elbow, insertion, roll, wrist, yaw)):
            joints.append(_near(value, number))
        solutions.append((vertcat(*joints), excess))
    return solutions


def _near(value, number):
    """Return joint i (from 0) within half a turn of the middle of its range; the insertion is returned unchanged."""
    if number == 2:
        return value
    middle = sum(_RANGES[number]) / 2
    return middle + atan2(sin(value - middle), cos(value - middle))


def outside(joints):
    """Return the sum over joints (6,) of (distance of the joint from its range) / (half the width of this range)."""
    total = 0
    for number, (low, high) in enumerate(_RANGES):
        middle = (low + high) / 2
        half_width = (high - low) / 2
        total += fmax(fabs(joints[number] - middle) / half_width - 1, 0)
    return total


@equation("inverse", "pose -> joints", gives=NAMES, variant="raven", why="The table, solved for the joints.")
def inverse(T_base_tool, alpha1, alpha2, alpha3, offset1, offset2, theta3, base_turn, L_w, shaft_long):
    """Return the candidate that is within the ranges of the joints, or the candidate nearest to these ranges."""
    solutions = candidates(T_base_tool, alpha1, alpha2, alpha3, offset1, offset2, theta3, base_turn, L_w, shaft_long)
    shoulder, elbow, insertion, roll, wrist, yaw = _best(solutions)
    return shoulder, elbow, insertion, roll, wrist, yaw


@equation.variant("davinci_tool", of=inverse, why="The instrument is of da Vinci type, with a shorter wrist.")
def inverse_davinci(T_base_tool, alpha1, alpha2, alpha3, offset1, offset2, theta3, base_turn, L_w_davinci, shaft_long):
    """Return the candidates of the inverse for the instrument with the shorter wrist."""
    angles = (alpha1, alpha2, alpha3, offset1, offset2, theta3, base_turn)
    solutions = candidates(T_base_tool, *angles, L_w_davinci, shaft_long)
    return solutions


def _best(solutions):
    """Return the six joint values of the candidate that exceeds the joint ranges least."""
    ranked = [(joints, outside(joints) + 100 * excess) for joints, excess in solutions]
    best, least_distance = ranked[0]
    for joints, distance in ranked[1:]:
        is_nearer = distance < least_distance
        best = if_else(is_nearer, joints, best)
        least_distance = if_else(is_nearer, distance, least_distance)
    return tuple(best[number] for number in range(6))


@equation("helper", "points in base", gives=place_names(_POINTS))
def places(
    T_base_tool,
    shoulder,
    elbow,
    insertion,
    alpha1,
    alpha2,
    alpha3,
    offset1,
    offset2,
    theta3,
    base_turn,
    shaft_long,
    elbow_far,
    tip,
):
    """Return points (3,) in base: elbow bearing, wrist, jaw axis (fulcrum) and tip of the jaws."""
    R = from_zero(base_turn)
    T_02 = row(alpha1, 0, shoulder + offset1, 0) @ row(alpha2, 0, elbow + offset2, 0)
    T_03 = to_carriage(shoulder, elbow, insertion, alpha1, alpha2, alpha3, offset1, offset2, theta3)
    p = T_base_tool[0:3, 3]
    at_wrist = R @ (T_03[0:3, 3] - shaft_long * T_03[0:3, 2])
    sign = if_else(cos(alpha3) < 0, -1, 1)  # the elbow is where its axis makes an acute angle with the tool
    return sign * elbow_far * (R @ T_02[0:3, 2]), at_wrist, p, p + tip * T_base_tool[0:3, 0]


@equation("helper", "distance from singularities", gives="depth straight open_elbow")
def margins(insertion, elbow, wrist, shaft_long):
    """Return the fraction of the shaft beyond the RCM, cosine of the wrist angle, and sine of the elbow angle."""
    return (shaft_long - insertion) / shaft_long, cos(wrist), sin(elbow)


def _angle(name: str, value: float, note: str, where: str = SOURCE) -> Parameter:
    return Parameter(name, value * DEG, "deg", value, "CITED", f"{where}: {note}")


_ALARM = "alarm ASSUMED: no published threshold"


def formula(name: str, title: str, left: bool) -> Formula:
    """Return the equations of the left or the right arm."""
    offset1 = 205.0 if left else 25.0
    offset2 = 180.0 if left else 0.0
    return Formula(
        name=name,
        title=title,
        source=SOURCE,
        parameters=(
            _angle("alpha2", 75.0, "row 2: arc of link 1"),
            _angle("alpha1", 0.0 if left else 180.0, "row 1"),
            _angle("alpha3", 128.0 if left else 52.0, "row 3: arc of link 2, 52 deg"),
            _angle("offset1", offset1, "angle of row 1 at shoulder zero; it contains the tilt of the base, 25 deg"),
            _angle("offset2", offset2, "angle of row 2 at elbow zero"),
            _angle("theta3", 90.0 if left else -90.0, "row 3"),
            _angle(
                "base_turn",
                180.0 if left else 0.0,
                "rotation of frame 0 in {base} about the vertical",
                "WPI-AIM/ambf, Raven-II",
            ),
            mm("L_w", 13.0, "CITED", f"{SOURCE}: distance from wrist axis to jaw axis"),
            mm("L_w_davinci", 9.0, "CITED", f"{SOURCE}: distance from wrist axis to jaw axis, da Vinci type"),
            mm(
                "shaft_long",
                470.0,
                "CITED",
                f"{SOURCE}: distance from carriage to wrist axis; a comment gives 482 for instruments of da Vinci type",
            ),
            mm("elbow_far", 274.0, "ASSUMED", "distance of the elbow bearing from the RCM; not published"),
            mm("tip", 10.0, "ASSUMED", "distance from jaw axis to the tip of the jaws; not published"),
        ),
        joints=tuple(ActiveJoint(n, "prismatic" if n == "insertion" else "revolute") for n in NAMES),
        coordinates=ZYX,
        equations=tuple(equation),
        characteristic_length=lambda shaft_long: shaft_long,
        points=dict(zip(_POINTS, place_names(_POINTS), strict=True)),
        measures=(
            Measure(
                "depth", "depth", "type1", 0.05, f"the wrist is at the RCM: shoulder and elbow do not move it; {_ALARM}"
            ),
            Measure(
                "wrist",
                "straight",
                "type1",
                0.1,
                f"the wrist is bent by 90 deg: roll and jaw axes are parallel; {_ALARM}",
            ),
            Measure(
                "elbow",
                "open_elbow",
                "type1",
                0.1,
                f"both arcs are in one plane: the arm is stretched or folded; {_ALARM}",
            ),
        ),
        aspects=(
            Aspect("depth", 1, "the wrist is beyond the RCM, on the patient's side"),
            Aspect("straight", 1, "the wrist is bent by less than 90 deg"),
            Aspect("open_elbow", 1, "the elbow is on the same side as in the CAD"),
        ),
        seeds=_SEEDS[left],
        motion=MOTION,
    )


_SEEDS = {  # coordinates at three joint values, the first of which are home
    True: (
        (0.0132, 0.0253, -0.0779, 1.0886, 1.2201, -0.6650),
        (0.0066, 0.0602, -0.1063, 0.7763, 0.9007, -1.5479),
        (0.0394, 0.0199, -0.0919, 1.4162, 0.7587, 0.2620),
    ),
    False: (
        (-0.0132, 0.0253, -0.0779, 2.0530, 1.2201, 0.6650),
        (-0.0024, 0.0591, -0.1071, 0.6793, 1.1784, -1.0703),
        (-0.0328, 0.0200, -0.0944, 2.0672, 0.6207, 1.2171),
    ),
}
