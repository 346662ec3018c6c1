"""Draw the SILS parallel robot and write it as a STEP assembly.

    python cad/sils/model.py [--dimensions FILE] [--out sils.step]

The robot is drawn in the posture given in the dimension file.  Each rigid body
is one sub-assembly (frame, limb1..3, carriage1..6, strut1..3, bar1..3,
platform); its parts are named <body>_<part>.  All shapes are written in world
coordinates: no instance has a placement.
"""

import sys
from pathlib import Path

import numpy as np

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent))
import drawing as cad
from drawing import pose4

ERRORS = {  # the manufacturing errors that can be set for each kind of body
    "carriage": {"l0_mm", "pin_offset_mm", "pin_tilt_deg", "bore_offset_mm", "bore_tilt_deg"},
    "strut": {
        "l1_mm",
        "pivot_bore_offset_mm",
        "pivot_bore_tilt_deg",
        "apex_pin_offset_mm",
        "apex_pin_tilt_deg",
    },
    "bar": {
        "l1_mm",
        "l2_mm",
        "pivot_bore_offset_mm",
        "pivot_bore_tilt_deg",
        "apex_bore_offset_mm",
        "apex_bore_tilt_deg",
        "ball_offset_mm",
    },
    "platform": {"s1_offset_mm", "s2_offset_mm", "s3_offset_mm", "scope_tip_mm"},
}
BODIES = [
    "frame",
    "limb1",
    "limb2",
    "limb3",
    *(f"carriage{k}" for k in range(1, 7)),
    *(f"strut{n}" for n in (1, 2, 3)),
    *(f"bar{n}" for n in (1, 2, 3)),
    "platform",
]


def dimensions(path):
    """Read a dimension file of the SILS robot."""
    errors = {body: ERRORS[kind] for body in BODIES if (kind := body.rstrip("0123456789")) in ERRORS}
    return cad.Dimensions(path, errors, {"ball_offset_mm", *(("platform", key) for key in ERRORS["platform"])})


# ---- placement, by construction ---------------------------------------------
def rotation(psi, theta, phi):
    """Return the rotation Rz(psi) Ry(theta) Rx(phi); angles in degrees."""
    (a, b, c), (u, v, w) = np.cos(np.radians([psi, theta, phi])), np.sin(np.radians([psi, theta, phi]))
    rz = np.array([[a, -u, 0], [u, a, 0], [0, 0, 1]])
    ry = np.array([[b, 0, v], [0, 1, 0], [-v, 0, b]])
    return rz @ ry @ np.array([[1, 0, 0], [0, c, -w], [0, w, c]])


def line_sphere(start, direction, centre, radius):
    """Return both intersections of a line with a sphere, in the order of `direction`; None if there are none."""
    middle = direction @ (centre - start)
    gap = radius**2 - np.sum((start + middle * direction - centre) ** 2)
    if gap < 0:
        return None
    return [start + (middle + s * np.sqrt(gap)) * direction for s in (-1, 1)]


def placements(d, position, angles):
    """Return the pose (4, 4) in mm of each body in the world at a platform pose; None if out of reach.

    Each limb is constructed geometrically. The rail and the ball centre define the plane of the limb; the pivots are
    on a line in this plane, parallel to the rail. The bar pivot is where this line intersects a sphere around the ball
    centre, and the strut pivot is where it intersects a sphere around the apex.
    """
    turn, e = rotation(*angles), np.array(position, float)
    out = {"frame": np.eye(4), "platform": pose4(e, *turn.T)}
    third = d.lp / np.sqrt(3)
    balls = [(third / 2, -d.lp / 2, 0), (-third, 0, 0), (third / 2, d.lp / 2, 0)]
    up, along = np.array([0.0, 0, 1]), np.array([0.0, 1, 0])
    rails = [((0, 0, 0), up, 1), ((0, 0, d.LV), along, 0), ((0, d.LH, 0), up, 1)]
    for n, (origin, axis, which) in enumerate(rails, 1):
        origin, s = np.array(origin, float), e + turn @ balls[n - 1]
        radial = (s - origin) - axis * (axis @ (s - origin))
        radial /= np.linalg.norm(radial)
        t = np.cross(axis, radial)
        start = origin + d.l0 * radial
        cuts = line_sphere(start, axis, s, d.l1 + d.l2)
        if cuts is None:
            return None
        pivot = cuts[which]
        u = (s - pivot) / np.linalg.norm(s - pivot)
        apex = pivot + d.l1 * u
        foot = line_sphere(start, axis, apex, d.l1)[1 - which]
        v = (apex - foot) / np.linalg.norm(apex - foot)
        out[f"limb{n}"] = pose4(origin, radial, t, axis)
        for k, point in ((2 * n - 1, foot), (2 * n, pivot)):
            out[f"carriage{k}"] = pose4(point - d.l0 * radial, radial, t, axis)
        out[f"strut{n}"] = pose4(foot, v, np.cross(t, v), t)
        out[f"bar{n}"] = pose4(pivot, u, np.cross(t, u), t)
    return out


# ---- drawing ----------------------------------------------------------------
def draw(d):
    """Draw all bodies in their body frames; return {body: [(part, solid, material)]}."""
    parts, numbers = cad.parts(HERE), range(1, 4)
    return {
        "frame": parts.frame(d),
        **{f"limb{n}": parts.limb(d, n) for n in numbers},
        **{f"carriage{k}": parts.carriage(d, k, d.error(f"carriage{k}")) for k in range(1, 7)},
        **{f"strut{n}": parts.strut(d, d.error(f"strut{n}")) for n in numbers},
        **{f"bar{n}": parts.bar(d, d.error(f"bar{n}")) for n in numbers},
        "platform": parts.platform(d, d.error("platform")),
    }


def assembly(path):
    """Draw the robot with the values of a dimension file; return ({body: [(name, shape, rgb)]}, mass in kg)."""
    d = dimensions(path)
    where = placements(d, d.pose_position, d.pose_angles)
    if where is None:
        raise ValueError("the posture in the CAD cannot be reached with these lengths")
    return cad.build(BODIES, draw(d), where, cad.parts(HERE).MATERIALS)


if __name__ == "__main__":
    cad.command("sils", HERE, assembly)
