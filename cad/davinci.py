"""Parts that all arms of the da Vinci share (cart, locked set-up joints, pins, sledge), and the assembly of an arm.

All body frames (mm) have the axes of the world: origin at the RCM, x across the linkage, z up, and the arm at negative
y. The arm is drawn with yaw and pitch at zero, so the frame of a body is only a translation.
"""

import sys

import drawing as cad
import numpy as np
from build123d import Axis, Plane
from shapes import X, Y, Z, box, cap, cyl, flange, hull, seat, soft

MATERIALS = {  # sRGB, density in kg/m3
    "cover": ((0.87, 0.88, 0.89), 1200),
    "grey": ((0.52, 0.56, 0.61), 1600),
    "dark": ((0.17, 0.18, 0.21), 2700),
    "steel": ((0.70, 0.72, 0.75), 7850),
    "accent": ((0.10, 0.42, 0.62), 1200),
    "instrument": ((0.34, 0.39, 0.47), 1200),
    "glass": ((0.35, 0.62, 0.78), 2500),
}
LEFT, DOWN = (-1, 0, 0), (0, 0, -1)
SLED = 8.5  # half of the sledge's width


# ---- an arm ---------------------------------------------------------------------
def assembly(path, drawn, places, errors):
    """Draw an arm with the values of a dimension file; return ({body: [(name, shape, rgb)]}, mass in kg).

    Args:
        path: dimension file.
        drawn: modules with a function named after each body; the first one that has it draws the body.
        places: dimensions -> {body: origin in the world in mm}, in the order of the file, without the set-up joints.
        errors: the manufacturing errors that can be set for a body, {body: {key}}; its function takes them as `err`.
    """
    d = cad.Dimensions(path, errors)
    at = dict.fromkeys(("base", "setup1", "setup2", "mount"), (0, 0, 0)) | places(d)
    draw = {body: next(getattr(m, body) for m in (*drawn, sys.modules[__name__]) if hasattr(m, body)) for body in at}
    solids = {body: f(d, d.error(body)) if body in errors else f(d) for body, f in draw.items()}
    return cad.build(list(at), solids, {body: cad.pose4(p, *np.eye(3)) for body, p in at.items()}, MATERIALS)


# ---- cart and set-up joints -------------------------------------------------
def base(d):
    """Draw the cart: a foot on castors, and a column with the carriage of the first set-up joint."""
    x, y, z = d.setup1
    floor = -d.floor
    foot = soft(box(-270, 270, y - 330, y + 250, floor + 60, floor + 150, 90), Axis.Z, 18)
    nose = soft(box(-130, 130, y - 230, y - 30, floor + 150, floor + 330, 50), Axis.Z, 25)
    castors = [cyl((s * 200 - 16, y + v, floor + 36), X, 36, 32) for s in (1, -1) for v in (-260, 180)]
    back = y - 70
    column = soft(box(-75, 75, back - 140, back, floor + 150, d.column_top, 40), Axis.Z, 20)
    strip = box(-45, 45, back, back + 6, floor + 340, d.column_top - 60)
    band = box(-76, 76, back - 141, back + 1, d.column_top - 130, d.column_top - 112, 40)
    block = box(-58, 58, back + 6, y + 30, z - 110, z - d.seat, 12)
    block += cyl((x, y, z - 110), Z, d.r1, 110 - d.seat)
    block -= cyl((x, y, z - d.deep - 12), Z, d.j1 + 1, d.deep)
    return [
        ("foot", foot, "cover"),
        ("nose", nose, "cover"),
        *((f"castor{i}", c, "dark") for i, c in enumerate(castors, 1)),
        ("column", column, "cover"),
        ("band", band - column, "accent"),
        ("strip", strip, "dark"),
        ("carriage", block, "grey"),
        ("seat1", seat(d.setup1, Z, d.r1, d.j1, d.seat), "dark"),
    ]


def setup1(d):
    """Draw the upper arm from the carriage of the cart to the elbow; it lies above the carriage."""
    (x, y, z), (x2, y2, z2) = d.setup1, d.setup2
    low = z + d.seat
    arm = hull([(x, y, d.r1), (x2, y2, d.r2)], Plane(origin=(0, 0, low)), z2 + 52 - low, 8)
    arm -= cyl((x2, y2, z2 + d.seat - 1), Z, d.j2 + 1, d.deep)
    return [
        ("flange1", flange(d.setup1, Z, d.r1, d.j1, d.seat, d.deep), "dark"),
        ("arm", arm, "cover"),
        ("cap1", cap((x, y, z2 + 52), Z, d.r1 - 12, 20), "grey"),
        ("cap2", cap((x2, y2, z2 + 52), Z, d.r2 - 10, 14), "grey"),
        ("seat2", seat(d.setup2, DOWN, d.r2, d.j2, d.seat), "dark"),
    ]


def setup2(d):
    """Draw the forearm from the elbow down to the mount."""
    (x, y, z), (x2, y2, z2) = d.setup2, d.setup3
    top = z - d.seat
    arm = hull([(x, y, d.r2), (x2, y2, d.r3)], Plane(origin=(0, 0, z2 + d.seat)), top - z2 - d.seat, 7)
    arm -= cyl((x2, y2, z2 + d.seat - 1), Z, d.j3 + 1, d.deep)
    return [
        ("flange2", flange(d.setup2, DOWN, d.r2, d.j2, d.seat, d.deep), "dark"),
        ("arm", arm, "cover"),
        ("cap3", cap((x2, y2, top), Z, d.r3 - 10, 12), "grey"),
        ("seat3", seat(d.setup3, DOWN, d.r3, d.j3, d.seat), "dark"),
    ]


def mount(d):
    """Draw the mount: the post below the forearm, and the housing of the yaw drive about the yaw axis."""
    x, y, z = d.setup3
    post = cyl((x, y, 0), Z, d.r3 - 4, z - d.seat)
    start = y - d.r3 - 20
    house = soft(cyl((0, start, 0), Y, d.yaw_r, d.yaw_face - d.seat - start), Axis.Y, 14, 0)
    house -= cyl((0, d.yaw_face - d.seat - d.deep, 0), Y, d.yaw_j + 1, d.deep + 1)
    return [
        ("flange3", flange(d.setup3, DOWN, d.r3, d.j3, d.seat, d.deep), "dark"),
        ("post", post - cyl((0, start, 0), Y, d.yaw_r, d.yaw_face - start), "grey"),
        ("housing", house, "cover"),
        ("brake", cap((0, start, 0), (0, -1, 0), d.yaw_r - 14, 26), "dark"),
        ("seat_yaw", seat((0, d.yaw_face, 0), Y, d.yaw_r, d.yaw_j, d.seat), "dark"),
    ]


# ---- links and their pins ---------------------------------------------------------
def hole(p, x0, x1, r):
    """Return a cylinder of radius r along x from x0 to x1, to be subtracted for a hole at p (y, z)."""
    return cyl((x0, *p), X, r, x1 - x0)


def plane_x(x):
    """Return the plane at x across the linkage, with y and z as its axes."""
    return Plane(origin=(x, 0, 0), x_dir=Y, z_dir=X)


def scaled(v, length):
    """Return v (y, z) scaled to a length in mm, for a link with a length error; v itself if length is None."""
    norm = (v[0] ** 2 + v[1] ** 2) ** 0.5
    return v if length is None else (v[0] * length / norm, v[1] * length / norm)


# ---- sledge ----------------------------------------------------------------------
def sledge(d):
    """Draw the block on both rods with its index; its origin is the origin of the insertion."""
    block = box(-SLED, SLED, d.rail_front + 1.5, d.plate - 4, -46, 56)
    for s in (1, -1):
        block -= cyl((s * d.rod_x, d.rod_y, -60), Z, d.rod + 0.02, 130)
    index = box(SLED, 16, d.plate - 7, d.plate - 4, -6, 0)  # its upper face is the origin
    plate = box(-25, 25, d.plate - 4, d.plate, -46, 60, 6, Axis.Y)
    return [("block", block, "dark"), ("index", index, "accent"), ("plate", plate, "cover")]
