"""Parts of Hibou, each body drawn in its own frame (mm).

Body frames are given by the table in Khalil and Kleinfinger's form: `turret` has frame 1, `upper_arm` 2, `forearm` 3,
`bracket` 4, `yoke` 5, `camera` 7, and `scope` has frame 6 moved back to the outer point. The joint between a body and
its parent rotates about z of this frame; the flat of its flange has the normal x. `base` has the world frame; `cannula`
has its ball at the origin.
"""

from build123d import Axis, Plane, Solid
from shapes import X, Y, Z, bolts, box, cannula, cap, cone, cyl, flange, hull, seat

__all__ = ["cannula"]  # drawn as in shapes.py
DOWN = (0, 0, -1)
MATERIALS = {  # sRGB, density in kg/m3
    "cast": ((0.89, 0.87, 0.83), 2000),
    "cover": ((0.47, 0.28, 0.52), 1300),
    "dark": ((0.20, 0.21, 0.24), 2700),
    "steel": ((0.70, 0.72, 0.75), 7850),
    "plastic": ((0.82, 0.84, 0.87), 1200),
    "glass": ((0.30, 0.55, 0.75), 2500),
}


def base(d, seat1):
    """Draw the base: round foot with bolts, conical column, and seat of joint 1."""
    foot = cyl((0, 0, 0), Z, d.foot, 20)
    foot = foot.chamfer(5, None, foot.edges().group_by(Axis.Z)[-1])
    top = d.h + d.o1
    column = cone((0, 0, 20), Z, d.foot - 26, d.r1 + 4, top - d.seat - 20)
    column -= cyl((0, 0, top - d.seat - d.deep), Z, d.j1 + 1, d.deep + 1)
    ring = seat((0, 0, d.o1), Z, d.r1, d.j1, d.seat).moved(seat1)
    heads = bolts((0, 0, 20), Z, d.foot - 13, 6, 5, 5)
    return [
        ("foot", foot, "cast"),
        ("column", column, "cast"),
        ("seat1", ring, "dark"),
        *((f"bolt{k}", b, "steel") for k, b in enumerate(heads, 1)),
    ]


def turret(d, seat2):
    """Draw the turret: flange, neck, housing of the shoulder motor, and seat of joint 2."""
    foot = flange((0, 0, d.o1), Z, d.r1, d.j1, d.seat, d.deep)
    neck = cyl((0, 0, d.o1 + d.seat), Z, d.r1 - 4, -d.o1 - d.seat) - box(-90, 90, d.o2 - d.seat, 120, -200, 100)
    house = Solid.make_cylinder(d.r2, d.o2 - d.seat + d.back2, Plane(origin=(0, -d.back2, 0), z_dir=Y))
    house = neck + house - cyl((0, d.o2 - d.seat - d.deep, 0), Y, d.j2 + 1, d.deep + 1)
    ring = seat((0, 0, d.o2), Z, d.r2, d.j2, d.seat).moved(seat2)
    cover = cap((0, -d.back2, 0), (0, -1, 0), d.r2 - 5, 20)
    return [
        ("flange1", foot, "dark"),
        ("housing", house, "cast"),
        ("seat2", ring, "dark"),
        ("cover", cover, "cover"),
    ]


def upper_arm(d, seat3):
    """Draw the upper arm: flange, tapered side plate, and seat of joint 3."""
    foot = flange((0, 0, d.o2), Z, d.r2, d.j2, d.seat, d.deep)
    low = d.o2 + d.seat
    arm = hull([(0, 0, d.r2), (d.arm, 0, d.r3)], Plane(origin=(0, 0, low)), d.thick, 5)
    arm -= cyl((d.arm, 0, low + d.thick - d.deep + d.seat), Z, d.j3 + 1, d.deep)
    cover = cap((0, 0, low + d.thick), Z, d.r2 - 12, 12)
    ring = seat((0, 0, d.o3), Z, d.r3, d.j3, d.seat).moved(seat3)
    return [("flange2", foot, "dark"), ("arm", arm, "cast"), ("cover", cover, "cover"), ("seat3", ring, "dark")]


def forearm(d, seat4):
    """Draw the forearm: flange, tapered side plate, and seat of joint 4 on its inner side."""
    foot = flange((0, 0, d.o3), Z, d.r3, d.j3, d.seat, d.deep)
    low = d.o3 + d.seat
    arm = hull([(0, 0, d.r3), (d.arm, 0, d.r4)], Plane(origin=(0, 0, low)), d.thick, 5)
    arm -= cyl((d.arm, 0, low - 1), Z, d.j4 + 1, d.deep - d.seat + 2)
    cover = cap((0, 0, low + d.thick), Z, d.r3 - 10, 10)
    ring = seat((0, 0, d.o3), DOWN, d.r4, d.j4, d.seat).moved(seat4)
    return [("flange3", foot, "dark"), ("arm", arm, "cast"), ("cover", cover, "cover"), ("seat4", ring, "dark")]


def bracket(d, seat5):
    """Draw the bracket: flange at the forearm, and angle bracket to the seat of joint 5 next to the outer point."""
    foot = flange((0, 0, d.o3), DOWN, d.r4, d.j4, d.seat, d.deep)
    y, low = -d.o5 + d.seat5, d.o3 - d.seat - 12
    lid = hull([(0, 0, d.r4), (0, y + 3, 12)], Plane(origin=(0, 0, low)), 12, 2)
    arm = hull([(0, 0, d.r5), (0, -low - 4, 14)], Plane(origin=(0, y, 0), x_dir=X, z_dir=Y), 12, 2)
    arm -= cyl((0, y - 1, 0), Y, d.j5 + 1, d.deep5 - d.seat5 + 2)
    ring = seat((0, 0, d.o5), Z, d.r5, d.j5, d.seat5).moved(seat5)
    return [("flange4", foot, "dark"), ("angle", lid + arm, "cast"), ("seat5", ring, "dark")]


def yoke(d, seat6):
    """Draw the yoke: flange, housing of the roll motor around the outer point, and seat of joint 6."""
    foot = flange((0, 0, d.o5), Z, d.r5, d.j5, d.seat5, d.deep5)
    stub = cyl((0, 0, d.o5 + d.seat5), Z, d.r5 - 3, -d.o5 - d.seat5)
    back = d.house_back
    house = Solid.make_cylinder(d.house, d.o6 - d.seat5 + back, Plane(origin=(0, back, 0), z_dir=(0, -1, 0)))
    house -= Solid.make_cylinder(d.j6 + 1, d.deep5 + 2, Plane(origin=(0, -d.o6 + d.deep5 + 1, 0), z_dir=(0, -1, 0)))
    ring = seat((0, 0, d.o6), Z, d.r6, d.j6, d.seat5).moved(seat6)
    return [("flange5", foot, "dark"), ("housing", stub + house, "cover"), ("seat6", ring, "dark")]


def scope(d, seat7):
    """Draw the scope: roll flange, light connector, straight tube, and tongue with the seat of joint 7."""
    foot = flange((0, 0, d.o6), Z, d.r6, d.j6, d.seat5, d.deep5)
    start = d.o6 + d.seat5
    head = cyl((0, 0, start), Z, d.r6 - 1, 22)
    light = cyl((d.r6 - 3, 0, start + 11), X, 4.5, 22)
    neck = cone((0, 0, start + 22), Z, d.r6 - 1, d.tube + 2, 14)
    tube = cyl((0, 0, start + 36), Z, d.tube, d.length - 18 - start - 36)
    collar = cyl((0, 0, d.length - 18), Z, d.tube + 1, 5)
    bridge = box(-3, 3, 8, 13, d.o7 - d.seat7, 4) - cyl((0, 0, -20), Z, d.r7, 40)
    tongue = box(-3, 3, 0, 16 + d.r7, d.o7 - 2 * d.seat7, d.o7 - d.seat7) - cyl((0, 0, -20), Z, d.j7 + 1, 40)
    ring = seat((0, 0, d.o7), Z, d.r7, d.j7, d.seat7)
    return [
        ("flange6", foot, "dark"),
        ("head", head + light, "cover"),
        ("neck", neck, "dark"),
        ("tube", tube, "steel"),
        ("collar", collar, "steel"),
        ("fork", (bridge + tongue).moved(seat7), "steel"),
        ("seat7", ring.moved(seat7), "steel"),
    ]


def camera(d):
    """Draw the tilting tip: flange, arm, and barrel with its lens."""
    foot = flange((0, 0, d.o7), Z, d.r7, d.j7, d.seat7, d.deep7)
    low = d.o7 + d.seat7
    arm = hull([(0, 0, d.r7 - 0.2), (0, -9, 4)], Plane(origin=(0, 0, low)), 2, 0)
    barrel = cyl((0, -7, 0), (0, -1, 0), d.tube, d.tip - 8)
    lens = cyl((0, -d.tip + 1, 0), (0, -1, 0), d.tube - 1, 1)
    return [("flange7", foot, "steel"), ("barrel", arm + barrel, "steel"), ("lens", lens, "glass")]
