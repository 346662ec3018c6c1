"""Parts of the endoscope arm that slide on the rail.

Both body frames (mm) have the axes of the world. The origin of `stage` and `scope` is the origin of the
insertion, on the endoscope's axis. The endoscope points down along -z.
"""

from build123d import Axis
from davinci import DOWN, sledge
from shapes import X, Y, Z, box, cone, cyl, flange, seat, soft


def places(d):
    """Return the origin of both bodies in the world in mm, at the insertion of the dimension file."""
    return dict.fromkeys(("stage", "scope"), (0, 0, d.origin - d.insertion))


def stage(d):
    """Draw the sledge with the bearing of the roll axis and, next to it, the roll motor."""
    low = -d.roll_face
    ring = cyl((0, 0, low + d.roll_seat), Z, d.roll_r + 3, 30) - cyl((0, 0, low), Z, d.roll_j + 1, 60)
    bridge = box(-17, 17, d.plate, -4, low + d.roll_seat, low + 34)
    bridge -= cyl((0, 0, low), Z, d.roll_r + 3, 60)
    motor = soft(cyl((29, -1, low + 8), Z, 12, 60), Axis.Z, 3)
    return [
        *sledge(d),
        ("ring", ring, "grey"),
        ("bridge", bridge, "grey"),
        ("motor", motor, "dark"),
        ("seat4", seat((0, 0, low), DOWN, d.roll_r, d.roll_j, d.roll_seat), "dark"),
    ]


def scope(d):
    """Draw the endoscope: camera head with two cables above the bearing, light post, tube, and window at its tip."""
    low = -d.roll_face
    foot = flange((0, 0, low), DOWN, d.roll_r, d.roll_j, d.roll_seat, 20)
    neck = cyl((0, 0, low + 2), Z, d.roll_j - 2, 48)
    head = box(-24, 24, -19, 19, low + 50, low + 150, 10)
    head = soft(head, Axis.Z, 6)
    cables = [cyl((s * 9, 0, low + 148), Z, 5, 34) for s in (1, -1)]
    light = cyl((0, 17, low + 66), Y, 6, 16)
    keys = [cyl((s * 23, 0, low + 100), X if s > 0 else (-1, 0, 0), 6, 3) for s in (1, -1)]
    hub = cone((0, 0, low - d.roll_seat), DOWN, d.roll_r - 2, d.tube + 2, 22)
    tube = cyl((0, 0, -d.shaft_long), Z, d.tube, d.shaft_long + low - d.roll_seat - 22)
    tube -= cyl((0, 0, -d.shaft_long - 1), Z, d.tube - 1, 2)
    window = cyl((0, 0, -d.shaft_long), Z, d.tube - 1, 1)
    lenses = [cyl((s * 2.5, 0, -d.shaft_long), Z, 1.8, 0.3) for s in (1, -1)]
    for lens in lenses:
        window -= lens
    return [
        ("flange4", foot, "dark"),
        ("neck", neck, "steel"),
        ("head", head, "cover"),
        *((f"cable{i}", c, "dark") for i, c in enumerate(cables, 1)),
        ("light", light, "dark"),
        *((f"key{i}", k, "accent") for i, k in enumerate(keys, 1)),
        ("hub", hub, "dark"),
        ("tube", tube, "steel"),
        ("window", window, "glass"),
        *((f"lens{i}", q, "dark") for i, q in enumerate(lenses, 1)),
    ]
