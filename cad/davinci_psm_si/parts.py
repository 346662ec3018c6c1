"""Linkage of the instrument arm of the da Vinci Si: one crank, one coupler, two bands, and a two-stage telescope.

    yaw        rotates about y through the RCM; it has the pivot B on one side, and a pulley fixed to it
    crank      from B to A; its band connects the pulleys of yaw link and coupler: the coupler keeps its direction
    coupler    from A to C; its band connects the pulleys of crank and rail: the rail stays parallel to the crank
    rail       is carried by C and holds the cannula
    slide      slides on the rods of the rail; the instrument's sledge slides on the rods of the slide

There is no joint at the RCM: because C - A = RCM - B, the rail rotates about the RCM with the crank. A double
parallelogram would be singular at a pitch of -74.9 deg, where its links are in line. Bands have no such singularity;
the pitch limit is 2.4 deg from this angle.

All body frames (mm) have the axes of the world. Their origins: `yaw` and `rail` at the RCM, `crank` at B, `coupler` at
A, `slide` at the origin of its telescope. In the order of x: yaw link, then crank and rail, then coupler.
"""

from build123d import Axis
from davinci import LEFT, hole, plane_x, scaled
from shapes import X, Y, Z, box, cap, cyl, flange, hull, pipe, seat, soft

ERRORS = {  # the manufacturing errors that can be set for each body; band_mm: excess length of its band
    "yaw": {"pivot_offset_mm"},
    "crank": {"length_mm", "band_mm"},
    "coupler": {"length_mm", "band_mm"},
    "rail": {"pin_c_offset_mm", "rod_offset_mm"},
}


def pivots(d):
    """Return the nominal pivots B, A and C, each (y, z) in mm."""
    base, crank = d.base_link[1:], d.crank[1:]
    return (-base[0], -base[1]), (crank[0] - base[0], crank[1] - base[1]), tuple(crank)


def places(d):
    """Return the origin in the world in mm of each body from the yaw link to the slide."""
    b, a, _ = pivots(d)
    slide = (0, 0, d.slide_origin - d.insertion / 2)
    return {"yaw": (0, 0, 0), "crank": (0, *b), "coupler": (0, *a), "rail": (0, 0, 0), "slide": slide}


# ---- bands --------------------------------------------------------------------
def _middle(d):
    """Return the x coordinate of the middle of the coupler; the middle of the crank is at 0."""
    return d.half + 2 * d.gap + d.coupler_wide / 2


def _band(d, end, x, longer):
    """Draw a taut closed band about the pulleys at the origin and at `end`; `longer` (mm) is its error of length."""
    length = (end[0] ** 2 + end[1] ** 2) ** 0.5
    far = scaled(end, length + longer / 2)
    loop = [
        hull([(0, 0, r), (*far, r)], plane_x(x - d.band_wide / 2), d.band_wide) for r in (d.pulley + d.band, d.pulley)
    ]
    return loop[0] - loop[1]


def _housing(d, end, ra, rb, x, half, windows):
    """Draw a hollow link from the origin to `end`, with room for the band, and `windows` (from, to) along the link."""
    shell = hull([(0, 0, ra), (*end, rb)], plane_x(x - half), 2 * half, 4)
    room = d.pulley + 4
    shell -= hull([(0, 0, room), (*end, room)], plane_x(x - d.band_wide / 2 - 1), d.band_wide + 2)
    for window in windows:
        shell -= hull([(*scaled(end, s), d.pulley + 3) for s in window], plane_x(x - half - 1), 2 * half + 2)
    return shell


def _pulley(d, p, x):
    """Draw a pulley with two rims."""
    w = d.band_wide / 2
    wheel = cyl((x - w, *p), X, d.pulley, 2 * w)
    for s in (-1, 1):
        wheel += cyl((x + s * (w - 0.5) - 0.5, *p), X, d.pulley + 1.6, 0.9)
    return wheel


# ---- the bodies ---------------------------------------------------------------
def yaw(d, err):
    """Draw the yaw link: neck on the yaw bearing, hollow arm to B with the pitch motor, axle with the fixed pulley."""
    b, _, _ = pivots(d)
    start = d.yaw_face + d.seat
    inside = -d.half - 2 * d.gap
    neck = soft(cyl((0, start, 0), Y, d.neck, d.neck_long - d.seat), Axis.Y, 5, -1)
    ring = pipe((0, start + 8, 0), Y, d.neck - 1, d.neck + 0.6, 5)
    back = (d.yaw_face + 84, -14.0)
    arm = hull([(*back, 58), (*b, d.hub_b + 4)], plane_x(inside - d.yaw_wide), d.yaw_wide, 6)
    arm -= hole(b, inside - d.pin_deep, inside + 1, d.pin_j + 1)
    panel = hull(
        [(back[0] + 26, back[1] - 6, 34), (b[0] - 74, b[1] + 14, 30)], plane_x(inside - d.yaw_wide - 3), 4, 1.5
    )
    motor = soft(cyl((inside - d.yaw_wide - 52, *b), X, 39, 53), Axis.X, 10, 0)
    grip = pipe((inside - d.yaw_wide - 22, *b), X, 38, 39.6, 5)
    axle = cyl((inside - d.pin_deep - 2, *b), X, d.axle, d.pin_deep + 2 - inside)
    ring_b = seat((-d.half - d.gap, *b), X, d.pin_r, d.pin_j, d.gap, err("pivot_offset_mm", (0, 0)), key=Z)
    return [
        ("flange_yaw", flange((0, d.yaw_face, 0), Y, d.yaw_r - 8, d.yaw_j, d.seat, d.deep), "dark"),
        ("neck", neck, "cover"),
        ("ring", ring, "accent"),
        ("arm", arm, "cover"),
        ("panel", panel, "grey"),
        ("motor", motor, "dark"),
        ("grip", grip, "accent"),
        ("seat_b", ring_b, "dark"),
        ("pulley", axle + _pulley(d, b, 0), "steel"),
    ]


def crank(d, err):
    """Draw the driven crank: hollow pin B, seat of the coupler at A, first band, axle of the second band's pulley."""
    a = scaled(tuple(d.crank[1:]), err("length_mm", None))
    nominal = tuple(d.crank[1:])
    body = _housing(d, nominal, d.hub_b, d.hub_a, 0, d.half, [(78, 126)])
    body -= hole((0, 0), -d.half - 1, 0, d.axle + 1)
    body -= hole(nominal, 0, d.half + 1, d.pin_j + 1)
    foot = flange((-d.half - d.gap, 0, 0), X, d.pin_r, d.pin_j, d.gap, d.pin_deep, key=Z)
    x = _middle(d)
    shaft = cyl((-d.half + 4, *nominal), X, d.axle - 3, d.half - 4 + x) + _pulley(d, nominal, x)
    return [
        ("flange_b", foot - hole((0, 0), -99, 99, d.axle + 1), "dark"),
        ("housing", body, "cover"),
        ("band", _band(d, nominal, 0, err("band_mm", 0.0)), "accent"),
        ("pulley", shaft, "steel"),
        ("seat_a", seat((d.half + d.gap, *a), X, d.pin_r, d.pin_j, d.gap, key=Z), "dark"),
    ]


def coupler(d, err):
    """Draw the coupler: hollow pin A with the pulley of the first band, second band, and seat of the rail at C."""
    nominal = tuple(d.base_link[1:])
    c = scaled(nominal, err("length_mm", None))
    face, x = d.half + d.gap, _middle(d)
    body = _housing(d, nominal, d.hub_a, d.hub_c, x, d.coupler_wide / 2, [(84, 144), (206, 262)])
    body -= hole((0, 0), face, x, d.axle - 1)
    body -= hole(nominal, face, x, d.pin_j + 1)
    wheel = cyl((-d.band_wide / 2, 0, 0), X, d.axle, face - d.pin_deep + 2 + d.band_wide / 2) + _pulley(d, (0, 0), 0)
    lids = [cyl((x + d.coupler_wide / 2, *p), X, r - 8, 4) for p, r in (((0, 0), d.hub_a), (nominal, d.hub_c))]
    pin = flange((face, 0, 0), X, d.pin_r, d.pin_j, d.gap, d.pin_deep, key=Z)
    through = hole((0, 0), -99, 99, d.axle - 2)
    return [
        ("pin_a", pin - through, "dark"),
        ("pulley", wheel - through, "steel"),
        ("housing", body, "cover"),
        *((f"lid{i}", soft(q, Axis.X, 2), "grey") for i, q in enumerate(lids, 1)),
        ("band", _band(d, nominal, x, err("band_mm", 0.0)), "accent"),
        ("seat_c", seat((face, *c), LEFT, d.pin_r, d.pin_j, d.gap, key=Z), "dark"),
    ]


def rail(d, err):
    """Draw the rail: hub on the pin C with the pulley of the second band, column with three rods, cannula holder."""
    _, _, c = pivots(d)
    face, x, w = d.half + d.gap, _middle(d), d.half - 2
    back, front, low, high = d.rail_back, d.rail_face, d.rail_low, d.slide_origin
    pin = flange((face, *c), LEFT, d.pin_r, d.pin_j, d.gap, d.pin_deep, err("pin_c_offset_mm", (0, 0)), key=Z)
    column = box(-w, w, back, front, low, high, 7)
    hub = soft(soft(hole(c, -d.half, d.half, d.pin_r - 1), Axis.X, 3), Axis.X, 3, 0)
    gusset = hull([(c[0] - 4, c[1], 30), (front - 17, low + 19, 17)], plane_x(-w + 2), 2 * w - 4, 3)
    top = soft(box(-w + 2, w - 2, back + 3, front - 3, high, high + 34, 6), Axis.Z, 8)
    strips = [box(v, v + 0.6, back + 8, back + 14, low + 40, high - 30) for v in (-w - 0.6, w)]
    ends = [box(-17, 17, front, d.guide_y + 5.2, z, z + 8) for z in (low, high - 8)]
    off = err("rod_offset_mm", (0, 0))
    rods = [
        cyl((v + off[0], d.guide_y + off[1], low + 8), Z, r, high - low - 16)
        for v, r in ((0, d.guide), (-11, d.guide - 1.5), (11, d.guide - 1.5))
    ]
    zero = box(w - 4, w + 4, front - 9, front - 1, high - 6, high)  # its upper face is the origin of the slide
    arm = box(-9, 9, back + 12, -4, low - d.holder, low)
    arm = arm.fillet(4, arm.edges().filter_by(Axis.X))
    hollow = cyl((0, 0, low - d.holder - 1), Z, d.bore + 8, d.holder + 2)
    end = low - d.holder
    return [
        ("pin_c", pin, "dark"),
        ("pulley", cyl((face + d.pin_deep - 1, *c), X, d.axle, x - face - d.pin_deep + 1) + _pulley(d, c, x), "steel"),
        ("hub", hub, "cover"),
        ("column", column, "cover"),
        ("gusset", gusset, "cover"),
        ("top", top, "grey"),
        *((f"strip{i}", q, "accent") for i, q in enumerate(strips, 1)),
        *((f"end{i}", q, "dark") for i, q in enumerate(ends, 1)),
        *((f"rod{i}", q, "steel") for i, q in enumerate(rods, 1)),
        ("zero", zero, "accent"),
        ("arm", arm - hollow, "grey"),
        ("clamp", pipe((0, 0, end), Z, d.bore, d.bore + 8, d.holder - 4), "dark"),
        ("cannula", pipe((0, 0, -d.below), Z, d.bore, d.bore + 1.6, end + d.below), "steel"),
        ("mark", pipe((0, 0, -4), Z, d.bore + 1.6, d.bore + 1.9, 4), "dark"),  # its upper face is at the RCM
    ]


def slide(d):
    """Draw the slide: block on the rail's rods, beam with the rods of the sledge, and band that doubles the travel."""
    low, high, front = -d.slide_low, d.slide_high, d.rail_front
    block = box(-15, 15, d.guide_y - 4.8, d.guide_y + 6.2, low, low + 105, 3)
    for v, r in ((0, d.guide), (-11, d.guide - 1.5), (11, d.guide - 1.5)):
        block -= cyl((v, d.guide_y, low - 1), Z, r + 0.02, 107)
    back = d.guide_y + 6.2
    slot = box(-4.5, 4.5, back - 1, front + 1, low + 18, high - 20, 4, Axis.X)
    beam = soft(box(-19, 19, back, front, low, high, 6), Axis.Z, 4, -1) - slot
    middle, r = (back + front) / 2, (front - back) / 2 + 0.6
    ends = [low + 34.0, high - 36.0]
    wheels = [cyl((-4, middle, z), X, r - 0.5, 8) for z in ends]
    loop = [hull([(middle, ends[0], v), (middle, ends[1], v)], plane_x(-3), 6) for v in (r, r - 0.5)]
    head, foot = d.origin - d.slide_origin + 60, -81.0  # room for the sledge over its whole travel
    plates = [box(-12, 12, front, d.rod_y + 5.4, z, z + 6) for z in (foot, head)]
    rods = [cyl((s * d.rod_x, d.rod_y, foot + 6), Z, d.rod, head - foot - 6) for s in (1, -1)]
    stop = d.origin - d.slide_origin
    zero = box(15, 21, front, front + 3, stop - 5, stop)  # its upper face is the origin of the sledge
    index = box(14, 21, back, back + 6, -6, 0)  # its upper face is the slide's own origin
    return [
        ("block", block, "dark"),
        ("beam", beam, "cover"),
        *((f"wheel{i}", q, "steel") for i, q in enumerate(wheels, 1)),
        ("band", loop[0] - loop[1], "accent"),
        *((f"end{i}", q, "dark") for i, q in enumerate(plates, 1)),
        *((f"rod{i}", q, "steel") for i, q in enumerate(rods, 1)),
        ("zero", zero, "accent"),
        ("index", index - beam, "accent"),
        ("cap", cap((0, (back + front) / 2, high - 0.5), Z, 8, 8), "grey"),
    ]
