"""The double parallelogram of the arms of the da Vinci Classic, which keeps the remote centre of motion (RCM) fixed.

    yaw        rotates about y through the RCM; its fork has the pivots B and B2
    crank1     from B to A, with a second pin A2 next to A
    crank2     from B2 to A3, of the same length as crank1 and parallel to it
    coupler1   from A3 through A to C; it stays parallel to B2-B
    coupler2   from A2 to C2; it keeps the rail parallel to crank1
    rail       is carried by C and C2; the instrument slides on it along the line x = y = 0

There is no joint at the RCM: because C - A = RCM - B, the rail rotates about the RCM with the cranks. `places` returns
the origins of the body frames.
"""

from build123d import Axis
from davinci import LEFT, hole, plane_x, scaled
from shapes import X, Y, Z, box, cap, cyl, flange, hull, pipe, seat, soft

IN, OUT = 9.0, 13.0  # cranks and rail lie within |x| < IN, couplers and fork beyond OUT; seats and flanges between
ERRORS = {  # the manufacturing errors that can be set for each body
    "yaw": {"pivot1_offset_mm", "pivot2_offset_mm"},
    **{body: {"length_mm"} for body in ("crank1", "crank2", "coupler1", "coupler2")},
    "rail": {"pin_c_offset_mm"},
}


def pivots(d):
    """Return the nominal positions of the pins in the pitch plane in mm, {name: (y, z)}."""
    b = (-d.reach, 0.0)
    add = lambda p, *v: (p[0] + sum(w[0] for w in v), p[1] + sum(w[1] for w in v))  # noqa: E731
    crank, second, apart = tuple(d.crank[1:]), tuple(d.second[1:]), tuple(d.apart[1:])
    a = add(b, crank)
    return {
        "B": b,
        "A": a,
        "A2": add(a, apart),
        "B2": add(b, second),
        "A3": add(a, second),
        "C": crank,
        "C2": add(crank, apart),
    }


def places(d):
    """Return the origin of each body of the linkage in the world in mm."""
    p = pivots(d)
    at = {"crank1": "B", "crank2": "B2", "coupler1": "A", "coupler2": "A2", "rail": "C"}
    return {"yaw": (0, 0, 0), **{k: (0, *p[v]) for k, v in at.items()}}


# ---- pins: seat on the parent, flange on the child ---------------------------------
def holder(p, side, r, j, h):
    """Return the seat of a pin on a body within |x| < IN; its face is at OUT, with its normal to `side` (+1 or -1)."""
    return seat((side * OUT, *p), (side, 0, 0), r, j, h, key=Z)


def pin(d, p, side, r, j):
    """Return the flange at OUT of a body on the outer `side` (+1 or -1), with its pin pointing inwards."""
    return flange((side * OUT, *p), (side, 0, 0), r, j, d.pin_seat, d.pin_deep, key=Z)


def inner(d, p, side, r, j):
    """Return the flange at OUT of a body within |x| < IN, with its pin pointing outwards to `side` (+1 or -1)."""
    return flange((side * OUT, *p), (-side, 0, 0), r, j, d.pin_seat, d.pin_deep, key=Z)


# ---- the bodies -------------------------------------------------------------------
def yaw(d, err):
    """Draw the yaw link: neck on the yaw bearing, motors below it, and fork with the seats of both cranks."""
    p = pivots(d)
    (yb, zb), (y2, z2) = p["B"], p["B2"]
    start = d.yaw_face + d.seat
    neck = soft(cyl((0, start, 0), Y, d.neck, d.neck_long), Axis.Y, 5, -1)
    low = min(zb, z2) - d.fork_drop
    wide = OUT + d.cheek
    bridge = box(-wide, wide, start, yb + 30, low - 26, low, 9, Axis.Y)
    bridge += box(-wide + 6, wide - 6, start, start + d.neck_long, low - 10, 0)
    cheeks = []
    for side in (1, -1):
        x0 = OUT + d.pin_seat if side > 0 else -OUT - d.cheek
        w = d.cheek - d.pin_seat
        plate = hull([(y2, z2, d.pin_r + 2), (yb, zb, d.pin_r + 2)], plane_x(x0), w, 2)
        plate += box(x0, x0 + w, y2 - 14, yb + 14, low, min(zb, z2))
        for q in ((yb, zb), (y2, z2)):
            plate -= hole(q, x0 - 1, x0 + d.pin_deep, d.pin_j + 1)
        cheeks.append(plate)
    motors = [soft(cyl((s * 30, start + 6, low - 16), Y, 19, y2 - start), Axis.Y, 5, -1) for s in (1, -1)]
    lids = [cyl((OUT + d.cheek, *q), X, d.pin_r - 3, 3) for q in ((yb, zb), (y2, z2))]
    bushes = []
    for k, q in ((1, (yb, zb)), (2, (y2, z2))):
        o = err(f"pivot{k}_offset_mm", (0, 0))
        bushes.append(seat((OUT, *q), LEFT, d.pin_r, d.pin_j, d.pin_seat, o, key=Z))
    return [
        ("flange_yaw", flange((0, d.yaw_face, 0), Y, d.yaw_r - 8, d.yaw_j, d.seat, d.deep), "dark"),
        ("neck", neck, "cover"),
        *((f"motor{i}", m, "dark") for i, m in enumerate(motors, 1)),
        ("bridge", bridge, "grey"),
        *((f"cheek{i}", c, "cover") for i, c in enumerate(cheeks, 1)),
        *((f"lid{i}", c, "cover") for i, c in enumerate(lids, 1)),
        *((f"seat_b{k}", s, "dark") for k, s in zip(("", "2"), bushes, strict=True)),
    ]


def _plate(d, a, b, ra, rb):
    """Return a flat link within |x| < IN between the pins a and b, with the end radii ra and rb."""
    return hull([(*a, ra), (*b, rb)], plane_x(-IN), 2 * IN, 2.5)


def crank1(d, err):
    """Draw the driven crank: pin B and the seats of both couplers."""
    a = scaled(tuple(d.crank[1:]), err("length_mm", None))
    a2 = (a[0] + d.apart[1], a[1] + d.apart[2])
    plate = _plate(d, (0, 0), a, d.pin_r + 1, d.pin_r - 1)
    plate += hull([(*a, d.pin_r - 1), (*a2, d.small_r + 1)], plane_x(-IN), 2 * IN)
    plate -= hole(a, IN - d.pin_deep + d.pin_seat - 1, IN + 1, d.pin_j + 1)
    plate -= hole(a2, -IN - 1, -IN + d.pin_deep - d.pin_seat + 1, d.small_j + 1)
    return [
        ("flange_b", inner(d, (0, 0), 1, d.pin_r, d.pin_j), "dark"),
        ("plate", plate, "cover"),
        ("seat_a", holder(a, 1, d.pin_r - 1, d.pin_j, d.pin_seat), "dark"),
        ("seat_a2", holder(a2, -1, d.small_r, d.small_j, d.pin_seat), "dark"),
    ]


def crank2(d, err):
    """Draw the second crank: pin B2 and the seat of the first coupler."""
    a = scaled(tuple(d.crank[1:]), err("length_mm", None))
    plate = _plate(d, (0, 0), a, d.pin_r + 1, d.pin_r - 1)
    plate -= hole(a, IN - d.pin_deep + d.pin_seat - 1, IN + 1, d.pin_j + 1)
    return [
        ("flange_b2", inner(d, (0, 0), 1, d.pin_r, d.pin_j), "dark"),
        ("plate", plate, "cover"),
        ("seat_a3", holder(a, 1, d.pin_r - 1, d.pin_j, d.pin_seat), "dark"),
    ]


def coupler1(d, err):
    """Draw the long coupler: the pins A3 and A, and the seat of the rail at C."""
    c, a3 = (err("length_mm", d.reach), 0.0), tuple(d.second[1:])
    x0 = OUT + d.pin_seat
    beam = hull([(*c, d.beam), (0, 0, d.beam)], plane_x(x0), d.beam_wide, 3)
    beam += hull([(*a3, d.beam), (0, 0, d.beam)], plane_x(x0), d.beam_wide, 3)
    beam -= hole(c, x0 - 1, x0 + d.pin_deep - d.pin_seat + 1, d.pin_j + 1)
    cover = hull([(c[0] - 50, 0, d.beam - 6), (50, 0, d.beam - 6)], plane_x(x0 + d.beam_wide), 4, 1.5)
    return [
        ("pin_a3", pin(d, a3, 1, d.pin_r - 1, d.pin_j), "dark"),
        ("pin_a", pin(d, (0, 0), 1, d.pin_r - 1, d.pin_j), "dark"),
        ("beam", beam, "cover"),
        ("cover", cover, "grey"),
        ("seat_c", seat((OUT, *c), LEFT, d.pin_r - 1, d.pin_j, d.pin_seat, key=Z), "dark"),
    ]


def coupler2(d, err):
    """Draw the thin coupler: pin A2 and the seat of the rail at C2."""
    c = (err("length_mm", d.reach), 0.0)
    x0 = -OUT - d.pin_seat - d.beam_wide
    beam = hull([(*c, d.small_r), (0, 0, d.small_r)], plane_x(x0), d.beam_wide, 2)
    beam -= hole(c, x0 + d.beam_wide - d.pin_deep + d.pin_seat - 1, x0 + d.beam_wide + 1, d.small_j + 1)
    return [
        ("pin_a2", pin(d, (0, 0), -1, d.small_r, d.small_j), "dark"),
        ("beam", beam, "grey"),
        ("seat_c2", seat((-OUT, *c), X, d.small_r, d.small_j, d.pin_seat, key=Z), "dark"),
    ]


def rail(d, err):
    """Draw the rail: a web with the pins C and C2, a tower with two rods, and the cannula holder; the origin is C."""
    yc, zc = pivots(d)["C"]
    c2 = tuple(d.apart[1:])
    o = err("pin_c_offset_mm", (0, 0))
    front = d.rail_front - yc
    low, high = d.rail_low - zc, d.rail_high - zc
    web_top = max(0.0, c2[1]) + d.web
    web = box(-IN, IN, front - 24, front, low, web_top)
    web += hull([(0, 0, d.pin_r), (front - 14, 0, d.pin_r)], plane_x(-IN), 2 * IN)
    web += hull([(*c2, d.small_r + 3), (front - 14, c2[1], d.small_r + 3)], plane_x(-IN), 2 * IN)
    tower = box(-26, 26, front - 30, front, web_top, high, 8)
    spine = soft(box(-20, 20, front - 46, front - 30, web_top + 20, high - 20, 7), Axis.Z, 6)
    plates = [box(-IN, IN, front, d.rod_y + 6 - yc, z, z + 8) for z in (low, high - 8)]
    rods = [cyl((s * d.rod_x, d.rod_y - yc, low + 8), Z, d.rod, high - low - 16) for s in (1, -1)]
    zero = box(20, 26, front, front + 3, d.origin - zc - 5, d.origin - zc)
    motor = cap((0, front - 15, high), Z, 14, 40)
    arm = box(-IN, IN, front - 14, -4 - yc, low - d.holder, low, 0)
    arm = arm.fillet(4, arm.edges().filter_by(Axis.X))
    clamp = pipe((0, -yc, low - d.holder), Z, d.bore, d.bore + 8, d.holder - 4)
    hollow = cyl((0, -yc, low - d.holder - 1), Z, d.bore + 8, d.holder + 2)
    end = low - d.holder
    tube = pipe((0, -yc, -zc - d.below), Z, d.bore, d.bore + 1.6, end + zc + d.below)
    mark = pipe((0, -yc, -zc - 4), Z, d.bore + 1.6, d.bore + 1.9, 4)  # its upper face is at the RCM
    return [
        ("pin_c", flange((OUT, 0, 0), LEFT, d.pin_r - 1, d.pin_j, d.pin_seat, d.pin_deep, o, key=Z), "dark"),
        ("pin_c2", inner(d, c2, -1, d.small_r, d.small_j), "dark"),
        ("web", web, "cover"),
        ("tower", tower, "cover"),
        ("spine", spine, "grey"),
        *((f"end{i}", q, "dark") for i, q in enumerate(plates, 1)),
        *((f"rod{i}", q, "steel") for i, q in enumerate(rods, 1)),
        ("zero", zero, "accent"),
        ("motor", motor, "dark"),
        ("arm", arm - hollow, "grey"),
        ("clamp", clamp, "dark"),
        ("cannula", tube, "steel"),
        ("mark", mark, "dark"),
    ]
