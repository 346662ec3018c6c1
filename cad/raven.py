"""The drawing of both arms of the Raven-II: base, two arcs about the remote centre (RCM), carriage and instrument.

World (mm): the origin is at the RCM, z is up. Body frames have their origin at the RCM:
    base        the world
    link1       z towards the shoulder; y towards the elbow, in the plane of the arc
    link2       z along the tool, away from the patient; y towards the elbow, in the plane of the arc
    carriage    as link2, with its origin at the origin of frame 3 of the table
Shaft, clevis (the wrist), hand and jaws are drawn by `davinci_instrument`, in the axes of the carriage. The bodies of
both arms have the same shapes, symmetric about x = 0 of the body except for the instrument and the flats of shoulder
and elbow; the frames of one arm are mirrored. Roll, wrist and jaws are drawn at zero.
"""

from math import asin, cos, degrees, radians, sin

import davinci_instrument as instrument
import drawing as cad
import numpy as np
from build123d import Axis, Face, Plane, Solid
from drawing import row
from shapes import Y, Z, box, cone, cyl, flange, pipe, seat, soft

DOWN, BACK = (0, 0, -1), (0, -1, 0)
PAINT = {"left": (0.80, 0.62, 0.20), "right": (0.24, 0.55, 0.36)}  # the arms are called gold and green
MATERIALS = {  # sRGB, density in kg/m3
    "cover": ((0.87, 0.88, 0.89), 1200),
    "grey": ((0.52, 0.56, 0.61), 2700),
    "dark": ((0.17, 0.18, 0.21), 2700),
    "steel": ((0.70, 0.72, 0.75), 7850),
    "accent": ((0.10, 0.42, 0.62), 1200),
    "instrument": ((0.34, 0.39, 0.47), 1200),
}
TABLE = {  # rows 1 to 3: alpha and theta at joint zero in degrees, and the turn of the base about z
    "left": ((0, 205), (75, 180), (128, 90), 180),
    "right": ((180, 25), (75, 0), (52, -90), 0),
}


# ---- places -------------------------------------------------------------------------
def axes(d, side):
    """Return R_base_frame (3, 3) of frames 1 to 3 of the table in the drawn posture."""
    (a1, t1), (a2, t2), (a3, t3), turn = TABLE[side]
    R1 = _turn(Z, turn) @ _turn(Y, -90) @ row(a1, 0, t1 + d.shoulder, 0)[:3, :3]
    R2 = R1 @ row(a2, 0, t2 + d.elbow, 0)[:3, :3]
    return R1, R2, R2 @ row(a3, 0, t3, 0)[:3, :3]


def _turn(axis, angle):
    """Return the rotation (3, 3) about an axis by an angle in degrees."""
    k, w = np.asarray(axis, float), radians(angle)
    K = np.array([[0, -k[2], k[1]], [k[2], 0, -k[0]], [-k[1], k[0], 0]])
    return np.eye(3) + sin(w) * K + (1 - cos(w)) * K @ K


def places(d, side):
    """Return the pose (4, 4) in mm of each body in the world."""
    R1, R2, R3 = axes(d, side)
    way = 1 if R2[:, 2] @ R3[:, 2] > 0 else -1  # the elbow is where its axis makes an acute angle with the tool
    shoulder, elbow, tool = way * R1[:, 2], way * R2[:, 2], R3[:, 2]
    link1, link2 = _frame(shoulder, elbow), _frame(tool, elbow)
    out = {"base": np.eye(4), "link1": link1, "link2": link2}
    wrist = d.insertion - d.shaft_long
    yaw = wrist - d.wrist
    for body, far in {
        "carriage": d.insertion,
        "shaft": d.insertion,
        "clevis": wrist,
        "hand": yaw,
        "jaw_left": yaw,
        "jaw_right": yaw,
    }.items():
        out[body] = cad.pose4(far * tool, *link2[:3, :3].T)
    return out


def _frame(z, towards):
    """Return the pose (4, 4) at the RCM with axis z, and y in the plane of z and a second direction."""
    y = cad.unit(towards - (towards @ z) * z)
    return cad.pose4((0, 0, 0), np.cross(y, z), y, z)


def keys(d, side):
    """Return the normals of the flats of shoulder and elbow, {(body, joint): vector in the frame of the body}."""
    R1, R2, _ = axes(d, side)
    at = places(d, side)
    link1, link2 = at["link1"][:3, :3], at["link2"][:3, :3]
    along1, along2 = np.array(Y, float), np.array([0, cos(radians(d.arc2)), -sin(radians(d.arc2))])
    return {
        ("link1", 1): along1,
        ("base", 1): _turn(R1[:, 2], -d.shoulder) @ link1 @ along1,
        ("link2", 2): along2,
        ("link1", 2): link1.T @ _turn(R2[:, 2], -d.elbow) @ link2 @ along2,
    }


# ---- shapes ---------------------------------------------------------------------------
def out_at(angle, far=1.0):
    """Return the point at a distance from the RCM, in the plane x = 0, at an angle (deg) from z towards y."""
    return np.array([0, far * sin(radians(angle)), far * cos(radians(angle))])


def arc(far, thick, wide, start, end, radius):
    """Return an arc about the RCM in the plane x = 0: a rounded bar between two angles (deg) from z towards y."""
    at = out_at(start)
    section = Plane(origin=tuple(far * at), x_dir=tuple(at), z_dir=tuple(out_at(start + 90)))
    face = Face.make_rect(thick, wide)
    face = face.fillet_2d(radius, face.vertices()) if radius else face
    return Solid.revolve(section.from_local_coords(face), end - start, Axis((0, 0, 0), (-1, 0, 0)))


def cable(far, x, start, end):
    """Return a cable about the RCM, beside the plane of an arc."""
    at = out_at(start)
    plane = Plane(origin=tuple(far * at + np.array([x, 0, 0])), x_dir=tuple(at), z_dir=tuple(out_at(start + 90)))
    return Solid.revolve(Face.make_rect(1.6, 1.6, plane), end - start, Axis((0, 0, 0), (-1, 0, 0)))


def sheaves(name, at, axis, r, count, pitch):
    """Return a stack of cable pulleys on an axis, each with a groove."""
    out = []
    for k in range(count):
        start = tuple(np.add(at, np.multiply(axis, k * pitch + 0.8)))
        groove = tuple(np.add(start, np.multiply(axis, 0.3 * pitch)))
        wheel = cyl(start, axis, r - 3 * k, pitch - 0.8) - pipe(groove, axis, r - 3 * k - 2, r + 1, 0.35 * pitch)
        out.append((f"{name}{k + 1}", wheel, "steel"))
    return out


# ---- bodies -----------------------------------------------------------------------------
def base(d, key):
    """Draw the base beside the patient: post with clamp, gear housing, seven motors, seat of the shoulder."""
    s = d.side
    at, inward = (s * d.shoulder_far, 0, 0), (-s, 0, 0)
    front, back = d.shoulder_far + d.seat, d.shoulder_far + d.seat + d.house_deep

    def block(x0, x1, *rest, **more):
        return box(*sorted((s * x0, s * x1)), *rest, **more)

    house = block(front + 24, back, -92, 92, -118, 84, radius=26, axis=Axis.X)
    neck = cyl((s * front, 0, 0), (s, 0, 0), d.r1 - 2, 30)
    house = house + neck - cyl((s * (front - 1), 0, 0), (s, 0, 0), d.j1 + 1, d.deep + 2)
    plate = block(back, back + 10, -96, 96, -122, 88, radius=28, axis=Axis.X)
    motors = []
    for k, (y, z, r, long) in enumerate(
        [(-56, 44, 20, 71), (0, 44, 20, 71), (56, 44, 20, 71)]
        + [(y, z, 15, 68) for y, z in ((-44, -18), (44, -18), (-44, -72), (44, -72))],
        1,
    ):
        can = cyl((s * (back + 10), y, z), (s, 0, 0), r, long)
        end = cyl((s * (back + 10 + long), y, z), (s, 0, 0), 0.72 * r, 16)
        motors += [(f"motor{k}", can, "steel"), (f"encoder{k}", end, "dark")]
    post = cyl((s * (front + 90), 0, -d.post_long), Z, 32, d.post_long - 110)
    clamp = block(front + 40, front + 140, -70, 70, -d.post_long - 50, -d.post_long, radius=10, axis=Axis.Z)
    clamp -= block(front + 20, front + 120, -80, 80, -d.post_long - 34, -d.post_long - 16)
    strip = block(front + 60, back - 20, -40, 40, 84, 86)
    return [
        ("housing", house, "cover"),
        ("plate", plate, "dark"),
        ("strip", strip, "paint"),
        *motors,
        ("post", post, "grey"),
        ("clamp", clamp, "dark"),
        ("seat1", seat(at, inward, d.r1, d.j1, d.seat, key=key[1]), "dark"),
    ]


def link1(d, key):
    """Draw the first arc, from the shoulder to the elbow; both hubs, pulleys and cables are on it."""
    high = d.shoulder_far - d.seat
    low = d.elbow_far + d.seat
    far = (high + low) / 2
    elbow = out_at(d.arc1)
    body = arc(far, high - low - 4, d.wide1, 0, d.arc1, 9)
    body += cyl((0, 0, low), Z, d.r1, high - low) + cyl(tuple(low * elbow), tuple(elbow), d.r2 + 3, high - low)
    body -= cyl(tuple((low - 1) * elbow), tuple(elbow), d.j2 + 1, d.deep + 1)
    body -= cyl((0, 0, high - 6), Z, d.j1 - 6, 7)
    off = degrees(asin(d.r1 / far))
    cables = [cable(high + 1, x, off - 3, d.arc1 - off + 3) for x in (-16, -8, 8, 16)]
    return [
        ("flange1", flange((0, 0, d.shoulder_far), DOWN, d.r1, d.j1, d.seat, d.deep, key=key[1]), "dark"),
        ("arc", body, "paint"),
        *((f"cable{k}", c, "steel") for k, c in enumerate(cables, 1)),
        ("cap1", cyl((0, 0, low - 8), Z, d.r1 - 10, 8), "dark"),
        *sheaves("pulley", high * elbow, elbow, d.r2 - 4, 3, 7),
        ("seat2", seat(tuple(d.elbow_far * elbow), tuple(-elbow), d.r2, d.j2, d.seat, key=key[2]), "dark"),
    ]


def link2(d, key):
    """Draw the second arc, from the elbow to the tool, with the rail of the carriage at its end."""
    high = d.elbow_far - d.seat
    low = high - d.thick2
    far = (high + low) / 2
    elbow = out_at(d.arc2)
    end = degrees(asin((d.rail_back - 6) / far))
    body = arc(far, d.thick2 - 4, d.wide2, end, d.arc2, 8)
    body += cyl(tuple(low * elbow), tuple(elbow), d.r2, high - low)
    plate = box(-d.rail_half, d.rail_half, d.rail_back - 12, d.rail_back, d.rail_low, d.rail_high, 6, Axis.Y)
    for z in (d.rail_low + 70, d.rail_high - 210, d.rail_high - 120):
        plate -= box(-11, 11, d.rail_back - 20, d.rail_back + 20, z, z + 60, 8, Axis.Y)
    rib = box(-6, 6, d.rail_back, d.rail_back + 12, d.rail_low + 50, d.rail_low + 190, 4, Axis.X)
    body += plate + rib
    ends = []
    for k, z in enumerate((d.rail_low, d.rail_high - 14), 1):
        block = box(-d.rail_half, d.rail_half, d.rod_y - 9, d.rail_back - 12, z, z + 14, 3, Axis.Z)
        for s in (1, -1):
            block -= cyl((s * d.rod_x, d.rod_y, z - 1), Z, d.rod, 16)
        ends.append((f"end{k}", block, "dark"))
    rods = [
        (f"rod{k}", cyl((s * d.rod_x, d.rod_y, d.rail_low), Z, d.rod, d.rail_high - d.rail_low), "steel")
        for k, s in enumerate((1, -1), 1)
    ]
    off = degrees(asin(d.r2 / far))
    cables = [cable(high + 1, x, end + 9, d.arc2 - off + 2) for x in (-14, -7, 7, 14)]
    top = (0, d.rail_back - 6, d.rail_high)
    return [
        ("flange2", flange(tuple(d.elbow_far * elbow), tuple(-elbow), d.r2, d.j2, d.seat, d.deep, key=key[2]), "dark"),
        ("arc", body, "paint"),
        ("cap2", cyl(tuple((low - 7) * elbow), tuple(elbow), d.r2 - 9, 7), "dark"),
        *ends,
        *rods,
        *((f"cable{k}", c, "steel") for k, c in enumerate(cables, 1)),
        *sheaves("pulley", top, Z, 15, 2, 6),
    ]


def carriage(d):
    """Draw the carriage on both rods with the holder of the instrument, its four spindles, and the instrument's box."""
    block = box(-d.rail_half, d.rail_half, d.rod_y - 10, d.rail_back - 16, 0, 70, 4, Axis.Z)
    for s in (1, -1):
        block -= cyl((s * d.rod_x, d.rod_y, -1), Z, d.rod + 0.02, 80)
    holder = box(-32, 32, 24, d.rod_y - 10, -24, 76, 8, Axis.Y)
    spindles = [cyl((x, 20, z), Y, 8, 4) for z in (6, 38) for x in (-13, 13)]
    house = soft(box(-25, 25, -20, 20, -30, 58, 8), Axis.Z, 6)
    house -= cyl((0, 0, -d.roll_face), Z, d.roll_j + 1, 50)
    nose = cone((0, 0, -30), DOWN, 15, d.roll_r, d.roll_face - 30 - d.roll_seat)
    nose -= cyl((0, 0, -d.roll_face), Z, d.roll_j + 1, 40)
    grip = [box(s * 25 - 2, s * 25 + 2, -10, 8, 14, 44, 1.5, Axis.X) for s in (1, -1)]
    return [
        ("block", block, "grey"),
        ("holder", holder, "dark"),
        *((f"spindle{k}", q, "steel") for k, q in enumerate(spindles, 1)),
        ("housing", house, "cover"),
        *((f"button{k}", g, "paint") for k, g in enumerate(grip, 1)),
        ("nose", nose, "dark"),
        ("seat4", seat((0, 0, -d.roll_face), DOWN, d.roll_r, d.roll_j, d.roll_seat), "dark"),
    ]


def assembly(path, side):
    """Draw an arm with the values of a dimension file; return ({body: [(name, shape, rgb)]}, mass in kg)."""
    d = cad.Dimensions(path, {})
    d.side = -1 if side == "left" else 1
    where = places(d, side)
    key = {}
    for (body, joint), normal in keys(d, side).items():
        key.setdefault(body, {})[joint] = tuple(normal)
    solids = {
        "base": base(d, key["base"]),
        "link1": link1(d, key["link1"]),
        "link2": link2(d, key["link2"]),
        "carriage": carriage(d),
        "shaft": instrument.shaft(d),
        "clevis": instrument.wrist(d),
        **{b: getattr(instrument, b)(d) for b in ("hand", "jaw_left", "jaw_right")},
    }
    return cad.build(list(where), solids, where, MATERIALS | {"paint": (PAINT[side], 2700)})
