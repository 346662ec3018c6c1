"""The needle driver of an instrument arm, from its sledge to its jaws.

All body frames (mm) have the axes of the world. Their origins:
    stage         origin of the insertion, on the instrument's axis
    shaft         the same point; the tube extends along -z down to the wrist
    wrist         on the pitch axis, which is along x
    hand, jaw_left, jaw_right    on the yaw axis, which is along y

The hand is the pin of the yaw axis with an idler. Its angle is the mean of both jaw angles, and it carries the tool
frame.
"""

from build123d import Axis, Plane
from davinci import DOWN, LEFT, sledge
from shapes import X, Y, Z, box, cone, cyl, flange, hull, pipe, seat, soft

BACK = (0, -1, 0)


def places(d):
    """Return the origin of each body of the instrument in the world in mm, at the insertion of the dimension file."""
    high = d.origin - d.insertion
    yaw = high - d.shaft_long - d.wrist
    return {
        **dict.fromkeys(("stage", "shaft"), (0, 0, high)),
        "wrist": (0, 0, high - d.shaft_long),
        **dict.fromkeys(("hand", "jaw_left", "jaw_right"), (0, 0, yaw)),
    }


def stage(d):
    """Draw the sledge with the sterile adapter, and the housing of the instrument with its four drive discs."""
    y = d.plate
    house = box(-22, 22, y + 3, y + 36, -d.house_low, 62, 7)
    house = soft(house, Axis.Z, 5)
    grip = [box(s * 22 - 2.5, s * 22 + 2.5, y + 10, y + 24, 8, 44, 1.5, Axis.X) for s in (1, -1)]
    discs = [cyl((s * 10, y, v), Y, 7.5, 3) for v in (36, 12) for s in (1, -1)]
    nose = cone((0, 0, -d.house_low), DOWN, 15, d.roll_r, d.roll_face - d.house_low - d.roll_seat)
    nose -= cyl((0, 0, -d.roll_face), Z, d.roll_j + 1, 12)
    label = box(-14, 14, y + 36, y + 36.6, 4, 30, 2, Axis.Y)
    return [
        *sledge(d),
        ("housing", house - cyl((0, 0, -d.roll_face), Z, d.roll_j + 1, 30), "instrument"),
        *((f"button{i}", g, "accent") for i, g in enumerate(grip, 1)),
        *((f"disc{i}", q, "steel") for i, q in enumerate(discs, 1)),
        ("nose", nose, "dark"),
        ("label", label, "accent"),
        ("seat4", seat((0, 0, -d.roll_face), DOWN, d.roll_r, d.roll_j, d.roll_seat), "dark"),
    ]


def shaft(d):
    """Draw the shaft: the roll flange, the tube, and the clevis of the wrist."""
    foot = flange((0, 0, -d.roll_face), DOWN, d.roll_r, d.roll_j, d.roll_seat, 14)
    low = -d.shaft_long
    top = -d.roll_face - d.roll_seat
    tube = cyl((0, 0, low + 11), Z, d.tube, top - low - 11)
    collar = cyl((0, 0, low + 7), Z, d.tube, 4) + cyl((0, 0, low + 8), Z, d.tube + 0.1, 1.2)
    core = cyl((0, 0, low - d.wrist_r), Z, d.tube, 7 + d.wrist_r)
    clevis = []
    for s in (1, -1):
        x0 = d.wrist_in if s > 0 else -d.tube
        cheek = box(x0, x0 + d.tube - d.wrist_in, -d.wrist_r, d.wrist_r, low, low + 7)
        cheek += cyl((x0, 0, low), X, d.wrist_r, d.tube - d.wrist_in)
        clevis.append(core & cheek)
    clevis[0] -= cyl((d.wrist_in - 1, 0, low), X, d.wrist_r + 0.01, d.wrist_seat + 1)
    seat5 = seat((d.wrist_in, 0, low), LEFT, d.wrist_r, d.wrist_j, d.wrist_seat, key=DOWN)
    return [
        ("flange4", foot, "dark"),
        ("tube", tube, "dark"),
        ("collar", collar, "steel"),
        ("cheek1", clevis[0], "steel"),
        ("cheek2", clevis[1], "steel"),
        ("seat5", seat5, "steel"),
    ]


def wrist(d):
    """Draw the wrist: the pin and the pulleys of the pitch axis, the neck, and the clevis of the yaw axis."""
    foot = flange((d.wrist_in, 0, 0), LEFT, d.wrist_r, d.wrist_j, d.wrist_seat, 2.0, key=DOWN)
    inside = d.wrist_in - d.wrist_seat
    pin = cyl((-d.wrist_in - 1.4, 0, 0), X, d.wrist_j, d.wrist_in + 1.4 + inside)
    pulleys = [
        pipe((x, 0, 0), X, d.wrist_j, d.wrist_r - 0.3, 0.55) - pipe((x + 0.15, 0, 0), X, d.wrist_r - 0.6, 3, 0.25)
        for x in (0.35, -0.35 - 0.55, -1.25 - 0.55)
    ]
    neck = cyl((0, 0, -d.wrist), Z, d.tube, d.wrist - d.wrist_r - 0.2)
    gap = box(-5, 5, -d.hand_in, d.hand_in, -d.wrist - 5, -d.wrist + d.wrist_r + 0.6)
    cut = cyl((-5, 0, 0), X, d.wrist_r + 0.15, 10)
    neck += cyl((0, -5, -d.wrist), Y, d.wrist_r, 10) & cyl((0, 0, -d.wrist - 5), Z, d.tube, 10)
    neck = neck - gap - cut + (cyl((0, 0, -d.wrist_r - 1.4), Z, 1.3, d.wrist_r + 1.2))
    neck -= cyl((0, d.hand_in - 1, -d.wrist), Y, d.wrist_r + 0.01, d.hand_seat + 1)
    ring = seat((0, d.hand_in, -d.wrist), BACK, d.wrist_r, d.hand_j, d.hand_seat, key=DOWN)
    return [
        ("flange5", foot, "steel"),
        ("pin5", pin, "steel"),
        *((f"pulley{i}", p, "steel") for i, p in enumerate(pulleys, 1)),
        ("neck", neck, "steel"),
        ("seat6", ring, "steel"),
    ]


def hand(d):
    """Draw the pin of the yaw axis with its idler; the step of the pin in the middle marks the control point."""
    foot = flange((0, d.hand_in, 0), BACK, d.wrist_r, d.hand_j, d.hand_in - d.hub, 1.6, key=DOWN)
    pin = cyl((0, 0, 0), Y, d.hand_j - 0.1, d.hub) + cyl((0, -d.hand_in - 1.2, 0), Y, d.hand_j - 0.2, d.hand_in + 1.2)
    idler = pipe((0, -d.hand_in + 0.1, 0), Y, d.hand_j - 0.2, d.wrist_r - 0.3, d.hand_in - d.hub - 0.2)
    return [("flange6", foot, "steel"), ("pin6", pin, "steel"), ("idler", idler, "steel")]


def _jaw(d, side):
    """Draw a jaw: a hub on the pin, and a blade on one side (+1 or -1) of x = 0 with a serrated inner face."""
    y0, bore = (0 if side > 0 else -d.hub), d.hand_j - 0.08
    hub = cyl((0, y0, 0), Y, d.wrist_r - 0.1, d.hub)
    root = box(0.03, 2.2, y0, y0 + d.hub, -4.2, 0) if side > 0 else box(-2.2, -0.03, y0, y0 + d.hub, -4.2, 0)
    shape = hull([(0, -4.0, 2.3), (0, -d.tip + 0.5, 1.1)], Plane(origin=(0, -1.7, 0), x_dir=X, z_dir=BACK), -3.4)
    half = box(0.03, 4, -2.2, 2.2, -d.tip, -3.4) if side > 0 else box(-4, -0.03, -2.2, 2.2, -d.tip, -3.4)
    blade = shape & half
    for k in range(6):
        z = -5.2 - 0.75 * k
        blade -= box(-0.2, 0.2, -3, 3, z - 0.18, z)
    hole = cyl((0, -5, 0), Y, bore, 10)
    return [("hub", hub + (root - cyl((0, -5, 0), Y, 1.5, 10)) - hole, "steel"), ("blade", blade, "steel")]


def jaw_left(d):
    """Draw the jaw on the side of +x."""
    return _jaw(d, 1)


def jaw_right(d):
    """Draw the jaw on the side of -x; a bush guides it on the thinner end of the pin."""
    bush = pipe((0, -d.hub, 0), Y, d.hand_j - 0.18, d.hand_j - 0.08, d.hub - 0.1)
    return [*_jaw(d, -1), ("bush", bush, "steel")]
