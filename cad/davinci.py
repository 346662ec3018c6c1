"""What the arms of the da Vinci Classic share: cart, locked set-up joints, and the double parallelogram of the pitch.

World axes in every body (mm): the RCM at the origin, x across the linkage, z up, the arm behind it at negative y. So
the arm stands with yaw and pitch at zero, and a body's frame is only moved: `places` says to where.

    yaw        turns about y through the RCM; its fork holds the pivots B and B2
    crank1     from B to A, with a second pin A2 beside A;  crank2 from B2 to A3, as long and parallel
    coupler1   from A3 over A to C: stays parallel to B2-B;  coupler2 from A2 to C2: keeps the rail parallel to crank1
    rail       hangs on C and C2; the instrument slides on it along the line x = y = 0

Nothing turns at the RCM: C - A = RCM - B, so that the rail turns about it with the cranks.
Every function returns a list of ``(part name, solid, material)``.
"""

from build123d import Axis, Plane
from shapes import X, Y, Z, box, cap, cyl, flange, hull, pipe, seat, soft

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
IN, OUT = 9.0, 13.0  # cranks and rail lie within |x| < IN, couplers and fork beyond OUT; seats and flanges between


def pivots(d):
    """Pins in the pitch plane as drawn, {name: (y, z)}."""
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
    """Origin of each body of the arm in the world."""
    p = pivots(d)
    at = {"crank1": "B", "crank2": "B2", "coupler1": "A", "coupler2": "A2", "rail": "C"}
    return {
        **dict.fromkeys(("base", "setup1", "setup2", "mount", "yaw"), (0, 0, 0)),
        **{k: (0, *p[v]) for k, v in at.items()},
    }


# ---- cart and set-up joints -------------------------------------------------
def base(d):
    """Cart: foot on castors, column with the carriage of the first set-up joint."""
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
    """Upper arm from the cart's carriage to the elbow, above it."""
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
    """Forearm from the elbow down to the mount."""
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
    """Post below the forearm, housing of the yaw drive about the yaw axis."""
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


# ---- pins of the linkage: seat on the parent, flange on the child --------------
def holder(p, side, r, j, h):
    """Seat on a body that lies within IN: its face at OUT looks to `side`."""
    return seat((side * OUT, *p), (side, 0, 0), r, j, h, key=Z)


def pin(d, p, side, r, j):
    """Flange at OUT of a body on the `side` of the face, with its pin the other way."""
    return flange((side * OUT, *p), (side, 0, 0), r, j, d.pin_seat, d.pin_deep, key=Z)


def inner(d, p, side, r, j):
    """Flange at OUT of a body within IN whose pin leads outwards to `side`."""
    return flange((side * OUT, *p), (-side, 0, 0), r, j, d.pin_seat, d.pin_deep, key=Z)


def hole(p, x0, x1, r):
    """Cylinder along x to cut."""
    return cyl((x0, *p), X, r, x1 - x0)


def plane_x(x):
    """Plane across the linkage at x, with y and z as its axes."""
    return Plane(origin=(x, 0, 0), x_dir=Y, z_dir=X)


# ---- the arm ------------------------------------------------------------------
def yaw(d, err):
    """Neck on the yaw bearing, motors under it, fork with the seats of both cranks."""
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
    """Flat link within IN between two pins."""
    return hull([(*a, ra), (*b, rb)], plane_x(-IN), 2 * IN, 2.5)


def _scaled(v, length):
    """Vector of the same direction with a length; the drawn pin of a link that came out long."""
    norm = (v[0] ** 2 + v[1] ** 2) ** 0.5
    return v if length is None else (v[0] * length / norm, v[1] * length / norm)


def crank1(d, err):
    """Driven crank: pin B, seats of both couplers."""
    a = _scaled(tuple(d.crank[1:]), err("length_mm", None))
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
    """Second crank: pin B2, seat of the first coupler."""
    a = _scaled(tuple(d.crank[1:]), err("length_mm", None))
    plate = _plate(d, (0, 0), a, d.pin_r + 1, d.pin_r - 1)
    plate -= hole(a, IN - d.pin_deep + d.pin_seat - 1, IN + 1, d.pin_j + 1)
    return [
        ("flange_b2", inner(d, (0, 0), 1, d.pin_r, d.pin_j), "dark"),
        ("plate", plate, "cover"),
        ("seat_a3", holder(a, 1, d.pin_r - 1, d.pin_j, d.pin_seat), "dark"),
    ]


def coupler1(d, err):
    """Long coupler: pins A3 and A, seat of the rail at C."""
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
    """Thin coupler: pin A2, seat of the rail at C2."""
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
    """Web with the pins C and C2, tower with two rods, cannula holder; origin C."""
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


def sledge(d):
    """Block on both rods and its index at the origin of the insertion; origin there, on the instrument's axis."""
    block = box(-IN + 0.5, IN - 0.5, d.rail_front + 1.5, d.plate - 4, -46, 56)
    for s in (1, -1):
        block -= cyl((s * d.rod_x, d.rod_y, -60), Z, d.rod + 0.02, 130)
    index = box(IN - 0.5, 16, d.plate - 7, d.plate - 4, -6, 0)  # its upper face is the origin
    plate = box(-25, 25, d.plate - 4, d.plate, -46, 60, 6, Axis.Y)
    return [("block", block, "dark"), ("index", index, "accent"), ("plate", plate, "cover")]
