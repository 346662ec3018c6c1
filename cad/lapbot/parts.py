"""Parts of Lapbot, each body drawn in its own frame (mm).

Body frames are those of the table in Khalil and Kleinfinger's form: `lift` has frame 1, `upper_arm` 2, `forearm` 3,
`bracket` 4, `yoke` 5, `carrier` 6, `wrist` 8, `jaw` 9, and `shaft` has frame 7 moved back to the outer point. The joint
between a body and its parent rotates about z of this frame; the flat of its flange has the normal x. `base` has the
world frame; `cannula` has its ball at the origin and its bore along z.

Every function returns a list of ``(part name, solid, material)``.
"""

from build123d import Axis, Plane, Solid
from shapes import X, Y, Z, box, cannula, cap, cone, cyl, flange, hull, seat

__all__ = ["cannula"]  # drawn as in shapes.py
DOWN = (0, 0, -1)
MATERIALS = {  # sRGB, density in kg/m3
    "cast": ((0.86, 0.88, 0.90), 2000),
    "cover": ((0.18, 0.45, 0.50), 1300),
    "dark": ((0.20, 0.22, 0.25), 2700),
    "steel": ((0.70, 0.72, 0.75), 7850),
    "belt": ((0.12, 0.12, 0.13), 1300),
    "plastic": ((0.80, 0.83, 0.86), 1200),
}


def base(d):
    """Draw the base: foot with castors, column at the back, two rails, and the motor of the lift on top."""
    foot = box(-d.back - 60, 130, -150, 150, 30, 70, 40)
    foot = foot.chamfer(12, None, foot.edges().group_by(Axis.Z)[-1])
    castors = [cyl((x, y - 12, 15), Y, 15, 24) for x in (-d.back - 25, 95) for y in (-105, 105)]
    column = box(-d.back - 45, -d.back, -60, 60, 70, d.column_high - 20, 18)
    rails = [cyl((-d.back + d.rail_gap, s * d.rail_apart, 70), Z, d.rail, d.column_high - 90) for s in (1, -1)]
    head = box(-d.back - 45, -d.back + 40, -60, 60, d.column_high - 20, d.column_high, 14)
    motor = cap((-d.back - 15, 0, d.column_high), Z, 26, 60)
    datum = box(-d.back, -d.back + 6, -40, 40, 76, d.column_high - 24)
    return [
        ("foot", foot, "cast"),
        *((f"castor{i}", c, "dark") for i, c in enumerate(castors, 1)),
        ("column", column, "cast"),
        ("rail1", rails[0], "steel"),
        ("rail2", rails[1], "steel"),
        ("head", head, "cover"),
        ("motor", motor, "dark"),
        ("strip", datum, "dark"),
        ("pad", cyl((20, 0, 0), Z, 22, 30), "dark"),
    ]


def lift(d, seat2):
    """Draw the lift: carriage on both rails, and boss with the seat of joint 2."""
    x = -d.back + d.rail_gap
    block = box(x - 14, x + 24, -62, 62, -45, 25, 10)
    for s in (1, -1):
        block -= cyl((x, s * d.rail_apart, -60), Z, d.rail + 0.02, 120)
    neck = hull([(x + 20, 0, 34), (0, 0, d.r2)], Plane(origin=(0, 0, -30)), d.o2 - d.seat + 30, 4)
    ring = seat((0, 0, d.o2), Z, d.r2, d.j2, d.seat)
    neck -= cyl((0, 0, d.o2 - d.seat - d.deep), Z, d.j2 + 1, d.deep + 1)
    mark = box(x + 24, x + 28, -56, -40, -8, 0)  # its upper face is the height of the outer point
    return [
        ("mark", mark, "cover"),
        ("block", block, "dark"),
        ("boss", neck - box(x - 14, x + 24, -62, 62, -45, 25), "cast"),
        ("seat2", ring, "dark"),
    ]


def upper_arm(d, seat3):
    """Draw the upper arm: flange, tapered arm, cover, belt to the elbow, and seat of joint 3."""
    foot = flange((0, 0, d.o2), Z, d.r2, d.j2, d.seat, d.deep)
    low = d.o2 + d.seat
    arm = hull([(0, 0, d.r2), (d.arm, 0, d.r3)], Plane(origin=(0, 0, low)), d.thick2, 5)
    arm -= cyl((d.arm, 0, low + d.thick2 - d.deep + d.seat), Z, d.j3 + 1, d.deep)
    ring = seat((d.arm, 0, d.o3), Z, d.r3, d.j3, d.seat)
    cover = hull([(70, 0, 24), (d.arm - 80, 0, 18)], Plane(origin=(0, 0, low + d.thick2)), 6, 2)
    runs = [
        hull([(d.r2 + 18, s * 16, 1.5), (d.arm - d.r3 - 18, s * 12, 1.5)], Plane(origin=(0, 0, low - 9)), 9)
        for s in (1, -1)
    ]
    return [
        ("flange2", foot, "dark"),
        ("arm", arm, "cast"),
        ("cover", cover, "cover"),
        ("belt1", runs[0], "belt"),
        ("belt2", runs[1], "belt"),
        ("seat3", ring, "dark"),
    ]


def forearm(d, seat4):
    """Draw the forearm: flange, tapered arm, cover, belt to the bracket, and seat of joint 4 below its end."""
    foot = flange((0, 0, d.o3), Z, d.r3, d.j3, d.seat, d.deep)
    low = d.o3 + d.seat
    arm = hull([(0, 0, d.r3), (d.arm, 0, d.r4)], Plane(origin=(0, 0, low)), d.thick3, 5)
    arm -= cyl((d.arm, 0, low - 1), Z, d.j4 + 1, d.deep - d.seat + 2)
    ring = seat((d.arm, 0, low - d.seat), DOWN, d.r4, d.j4, d.seat)
    cover = hull([(60, 0, 20), (d.arm - 60, 0, 15)], Plane(origin=(0, 0, low + d.thick3)), 6, 2)
    runs = [
        hull([(d.r3 + 16, s * 12, 1.5), (d.arm - d.r4 - 16, s * 10, 1.5)], Plane(origin=(0, 0, low - 9)), 9)
        for s in (1, -1)
    ]
    return [
        ("flange3", foot, "dark"),
        ("arm", arm, "cast"),
        ("cover", cover, "cover"),
        ("belt1", runs[0], "belt"),
        ("belt2", runs[1], "belt"),
        ("seat4", ring, "dark"),
    ]


def bracket(d, seat5):
    """Draw the bracket: flange under the forearm, arm down to the outer point, and seat of joint 5 next to it."""
    top = d.o3
    foot = flange((0, 0, top), DOWN, d.r4, d.j4, d.seat, d.deep)
    y = -d.o5
    lid = hull([(0, 0, d.r4), (0, y + 9, 11)], Plane(origin=(0, 0, top - d.seat - 12)), 12, 2)
    arm = hull(
        [(0, 0, d.r5), (0, -(top - d.seat - 20), 14)], Plane(origin=(0, y + d.seat5, 0), x_dir=X, z_dir=Y), 14, 2
    )
    ring = seat((0, 0, d.o5), Z, d.r5, d.j5, d.seat5).moved(seat5)
    arm -= cyl((0, y + d.seat5 - 1, 0), Y, d.j5 + 1, d.deep5 - d.seat5 + 2)
    return [("flange4", foot, "dark"), ("arm", lid + arm, "cast"), ("seat5", ring, "dark")]


def yoke(d, seat6):
    """Draw the yoke: an angle bracket between the two passive axes."""
    foot = flange((0, 0, d.o5), Z, d.r5, d.j5, d.seat5, d.deep5)
    low = d.o5 + d.seat5
    reach = -d.o6 + d.seat5
    plate = hull([(0, 0, d.r5), (0, reach + 4, 12)], Plane(origin=(0, 0, low)), 8, 1.5)
    side = box(-12, 12, reach, reach + 10, low, 12, 0)
    side = side.fillet(4, side.edges().filter_by(Axis.Y))
    ring = seat((0, 0, d.o6), Z, d.r6, d.j6, d.seat5).moved(seat6)
    side -= Solid.make_cylinder(d.j6 + 1, 30, Plane(origin=(0, reach - 1, 0), z_dir=Y))
    return [("flange5", foot, "dark"), ("angle", plate + side, "cast"), ("seat6", ring, "dark")]


def carrier(d, seat7):
    """Draw the carrier: housing of the roll motor around the outer point, and seat of joint 7."""
    foot = flange((0, 0, d.o6), Z, d.r6, d.j6, d.seat5, d.deep5)
    stub = cyl((0, 0, d.o6 + d.seat5), Z, d.r6 - 2, -d.o6 - d.seat5)
    house = cyl((0, d.house_top, 0), (0, -1, 0), d.house, d.o7 - d.seat5 + d.house_top)
    ring = seat((0, 0, d.o7), Z, d.r7, d.j7, d.seat5).moved(seat7)
    house -= Solid.make_cylinder(d.j7 + 1, 20, Plane(origin=(0, -d.o7 + d.seat5 - 1 + 12, 0), z_dir=(0, -1, 0)))
    return [("flange6", foot, "dark"), ("housing", house + stub, "cover"), ("seat7", ring, "dark")]


def shaft(d, seat8):
    """Draw the shaft: roll flange, straight tube, and tongue with the seat of joint 8."""
    foot = flange((0, 0, d.o7), Z, d.r7, d.j7, d.seat5, d.deep5)
    hub = cone((0, 0, d.o7 + d.seat5), Z, d.r7 - 1, 7, 26)
    start = d.o7 + d.seat5 + 26
    tube = cyl((0, 0, start), Z, d.tube, d.length - 18 - start)
    collar = cyl((0, 0, d.length - 18), Z, d.tube + 1.5, 5)
    tongue = hull([(0, 0, d.r8), (-16, 0, d.r8 - 0.5)], Plane(origin=(0, 0, d.o8 - d.seat8)), d.seat8)
    tongue -= cyl((0, 0, d.o8 - 2 * d.seat8), Z, d.j8 + 1, 3 * d.seat8)
    ring = seat((0, 0, d.o8), Z, d.r8, d.j8, d.seat8)
    bridge = box(-13, -8, -3, 3, d.o8 - d.seat8, 3)
    return [
        ("flange7", foot, "dark"),
        ("hub", hub, "cover"),
        ("tube", tube, "steel"),
        ("collar", collar, "steel"),
        ("fork", (bridge - cyl((0, 0, -20), Z, d.r8, 40)).moved(seat8), "steel"),
        ("seat8", ring.moved(seat8), "steel"),
    ]


def wrist(d, seat9):
    """Draw the wrist: an angle bracket between its two axes."""
    foot = flange((0, 0, d.o8), Z, d.r8, d.j8, d.seat8, d.deep8)
    low = d.o8 + d.seat8
    y = -d.o9
    corner = box(-2.6, 2.6, 3, y + d.seat8, d.o8 + 0.2, low) - cyl((0, 0, -20), Z, d.r8, 40)
    side = box(-2.6, 2.6, y + 0.2, y + d.seat8, d.o8 + 0.2, 0)
    ring = seat((0, 0, d.o9), Z, d.r8, d.j8, d.seat8).moved(seat9)
    hole = Solid.make_cylinder(d.r8, 30, Plane(origin=(0, -1, 0), z_dir=Y))
    return [("flange8", foot, "steel"), ("angle", corner + side - hole, "steel"), ("seat9", ring, "steel")]


def jaw(d):
    """Draw the jaw: a flange, and a closed grasper perpendicular to the last axis."""
    foot = flange((0, 0, d.o9), Z, d.r8, d.j8, d.seat8, d.deep8)
    low = d.o9 + d.seat8
    arm = hull([(0, 0, d.r8 - 0.2), (0, -9, 2.4)], Plane(origin=(0, 0, low)), 2, 0)
    root = box(-2.2, 2.2, -11.4, -6.6, low, 2.2)
    tip = cone((0, -11.4, 0), (0, -1, 0), 2.2, 0.5, d.tool - 11.4)
    return [("flange9", foot, "steel"), ("arm", arm + root, "steel"), ("grasper", tip, "steel")]
