"""Draw the SHER 3.0 robot in the posture given in the dimension file."""

import sys
from pathlib import Path

import numpy as np

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent))
import drawing as cad
from drawing import pose4, unit

LEGS = [f"{i}{k}" for i in (1, 2, 3) for k in "ab"]
ERRORS = {  # the manufacturing errors that can be set for each body
    **{f"carriage{i}": {"rail_bore_offset_mm", "bore_a_offset_mm", "bore_b_offset_mm"} for i in (1, 2, 3)},
    **{f"cross{n}": {"pin2_offset_mm"} for n in LEGS},
    **{f"rod{n}": {"length_mm", "bore_offset_mm", "ball_offset_mm"} for n in LEGS},
    "platform": {"roll_offset_mm", *(f"s{n}_offset_mm" for n in LEGS)},
    "arm": {"pin_a_offset_mm", "pin_a_tilt_deg", "pin_b_offset_mm", "pin_b_tilt_deg"},
    "tilt_slider": {"rail_bore_offset_mm", "pin_r_offset_mm", "pin_r_tilt_deg"},
    "l5": {"length_mm", "bore_r_offset_mm", "bore_r_tilt_deg", "bore_q_offset_mm", "bore_q_tilt_deg"},
    "l4": {
        "DA_mm",
        "AQ_mm",
        "phi2_deg",
        "bore_a_offset_mm",
        "bore_a_tilt_deg",
        "pin_q_offset_mm",
        "pin_q_tilt_deg",
        "pin_d_offset_mm",
        "pin_d_tilt_deg",
    },
    "l3": {"tool_reach_mm", "bore_c_offset_mm", "bore_c_tilt_deg", "bore_d_offset_mm", "bore_d_tilt_deg"},
    "l2": {"length_mm", "bore_b_offset_mm", "bore_b_tilt_deg", "pin_c_offset_mm", "pin_c_tilt_deg"},
    "eye_phantom": {"centre_offset_mm"},
}
VECTORS = {"ball_offset_mm", "centre_offset_mm", *(f"s{n}_offset_mm" for n in LEGS)}  # three numbers, not two
BODIES = [
    "base",
    *(f"carriage{i}" for i in (1, 2, 3)),
    *(f"cross{n}" for n in LEGS),
    *(f"rod{n}" for n in LEGS),
    "platform",
    "arm",
    "tilt_slider",
    "l5",
    "l4",
    "l3",
    "l2",
    "eye_phantom",
    "microscope",
]


def dimensions(path):
    """Read a dimension file of the SHER."""
    return cad.Dimensions(path, ERRORS, VECTORS)


# ---- placement, by construction ---------------------------------------------
def spheres(centres, radius):
    """Return the upper of the two points at distance `radius` from three points; None if there is none."""
    a, b, c = centres
    n = np.cross(b - a, c - a)
    # circumcentre: on the bisector planes of a, b and of a, c, and in the plane of the three points
    rows = np.array([b - a, c - a, n])
    centre = np.linalg.solve(rows, [(b @ b - a @ a) / 2, (c @ c - a @ a) / 2, n @ a])
    rest = radius**2 - np.sum((centre - a) ** 2)
    return None if rest < 0 else centre + np.sqrt(rest) * unit(n) * np.sign(n[2])


def circles(a, ra, b, rb, side):
    """Return the point at distances ra from a and rb from b, left (+1) or right (-1) of the line a-b; None if none."""
    gap = np.linalg.norm(b - a)
    along = (gap**2 + ra**2 - rb**2) / (2 * gap)
    rest = ra**2 - along**2
    if rest < 0:
        return None
    u = (b - a) / gap
    return a + along * u + side * np.sqrt(rest) * np.array([-u[1], u[0]])


def direction(degrees):
    """Return the unit vector in the plane at an angle from x."""
    return np.array([np.cos(np.radians(degrees)), np.sin(np.radians(degrees))])


def turn(v, degrees):
    """Return a vector in the plane, rotated counter-clockwise."""
    c, s = direction(degrees)
    return np.array([c * v[0] - s * v[1], s * v[0] + c * v[1]])


def linkage(d, tilt):
    """Return the pins of the tilt mechanism in frame {a} at a tool angle from the vertical; None if unreachable.

    The construction goes from the tool to the drive. The tool's direction gives the direction of the coupler C-D; D is
    at distance DA from A, and C at distance BC from B. The bell crank gives Q, and Q gives R on the line of the slider.
    """
    A, B = np.zeros(2), np.array([0.0, d.AB])
    handle = direction(tilt + 90)
    to_p = -turn(handle, d.phi4)  # D to P: the tool makes phi4 with P to D
    to_c = turn(to_p, d.phi3)
    D = circles(A, d.DA, B - d.CD * to_c, d.BC, -1)  # C on its circle about B, moved by D - C
    if D is None:
        return None
    Q = d.AQ * turn(unit(D), d.phi2)
    rise = d.y_AR - Q[1]
    if abs(rise) > d.QR:
        return None
    R = np.array([Q[0] - np.sqrt(d.QR**2 - rise**2), d.y_AR])
    return {"A": A, "B": B, "C": D + d.CD * to_c, "D": D, "P": D + d.DP * to_p, "Q": Q, "R": R, "handle": handle}


def placements(d, q, roll, tilt):
    """Return the pose (4, 4) in mm of each body in the world; None if out of reach."""
    u = [np.array([*direction(w), 0.0]) for w in d.leg_azimuth]
    z = np.array([0.0, 0, 1])
    centre = spheres([(d.base_radius - d.platform_radius) * r + h * z for r, h in zip(u, q, strict=True)], d.rod_length)
    pins = linkage(d, tilt)
    if centre is None or pins is None:
        return None
    out = {"base": np.eye(4), "platform": pose4(centre, *np.eye(3)), "eye_phantom": np.eye(4), "microscope": np.eye(4)}
    for i, (radial, height) in enumerate(zip(u, q, strict=True), 1):
        t = np.cross(z, radial)
        foot = d.base_radius * radial + height * z
        way = unit(centre + d.platform_radius * radial - foot)
        e = unit(way - (way @ t) * t)
        f = np.cross(t, e)
        out[f"carriage{i}"] = pose4(foot, radial, t, z)
        for k, side in (("a", 1), ("b", -1)):
            at = foot + side * d.rod_spread * t
            out[f"cross{i}{k}"] = pose4(at, e, -t, f)
            out[f"rod{i}{k}"] = pose4(at, way, np.cross(f, way), f)
    x, (c, s) = np.array([1.0, 0, 0]), direction(roll)
    ya, za = np.array([0.0, -s, c]), np.array([0.0, -c, -s])
    pin_a = centre + d.d1 * z + d.d2 * x + d.d3 * ya

    def in_plane(origin, towards):
        v = unit(towards)
        along, across = v[0] * x + v[1] * ya, -v[1] * x + v[0] * ya
        return pose4(pin_a + origin[0] * x + origin[1] * ya, along, across, za)

    p = pins
    out["arm"] = in_plane(p["A"], (1, 0))
    out["tilt_slider"] = in_plane(p["R"], (1, 0))
    for body, start, end in (("l5", "R", "Q"), ("l4", "A", "D"), ("l3", "D", "C"), ("l2", "B", "C")):
        out[body] = in_plane(p[start], p[end] - p[start])
    return out


def drawn(d):
    """Return the placements in the drawn posture."""
    return placements(d, d.pose_q, d.pose_roll, d.pose_tilt)


def tool(d):
    """Return the point P and the direction of the handle, both in frame l3."""
    p = d.DP * direction(-d.phi3)
    return p, turn(unit(-p), -d.phi4)


# ---- drawing ----------------------------------------------------------------
def draw(d):
    """Draw all bodies in their body frames; return {body: [(part, solid, material)]}."""
    return {body: draw_body(d, body, d.error(body)) for body in BODIES}


def draw_body(d, body, err):
    """Draw one body; return [(part, solid, material)]."""
    parts = cad.parts(HERE)
    p, handle = tool(d)
    if body in ("base", "eye_phantom", "microscope"):  # where the tool points in the drawn posture
        T = drawn(d)["l3"]
        point = T[:3, :3] @ [*p, 0] + T[:3, 3]
        back = T[:3, :3] @ [*handle, 0]
        centre = point - (d.tool_reach + d.eye_gap + d.eye_radius) * back
    if body == "base":
        return parts.base(d, float(centre[0]))
    if body == "eye_phantom":
        return parts.eye_phantom(d, centre, back, err)
    if body == "microscope":
        return parts.microscope(d, float(centre[0]))
    if body == "l3":
        return parts.l3(d, err, tuple(map(float, p)), tuple(map(float, handle)))
    kind = body.rstrip("ab").rstrip("123") if body[0] in "cr" else body
    return getattr(parts, kind)(d, err)


def assembly(path):
    """Draw the robot with the values of a dimension file; return ({body: [(name, shape, rgb)]}, mass in kg)."""
    d = dimensions(path)
    where = drawn(d)
    if where is None:
        raise ValueError("the posture in the CAD cannot be reached with these lengths")
    return cad.build(BODIES, draw(d), where, cad.parts(HERE).MATERIALS)


if __name__ == "__main__":
    cad.command("sher", HERE, assembly)
