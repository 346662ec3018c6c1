"""The surgeon's cart of the console: two haptic pens, two pedals, a visor on an arm, and a seat.

Frame (mm): the origin is on the floor below the middle of the front edge of the arm support, x points to the surgeon's
right and y away from the surgeon. Every function except `_rod` returns a list of ``(part name, solid, material)``.
"""

import numpy as np
from build123d import Axis, Plane, Solid
from shapes import X, Y, Z, box, cone, cyl, soft

MATERIALS = {  # sRGB, density in kg/m3
    "profile": ((0.76, 0.78, 0.80), 1100),
    "shelf": ((0.93, 0.94, 0.95), 700),
    "pad": ((0.16, 0.17, 0.19), 400),
    "rubber": ((0.10, 0.10, 0.11), 1200),
    "device": ((0.22, 0.24, 0.27), 1100),
    "link": ((0.55, 0.58, 0.62), 1300),
    "pen": ((0.13, 0.42, 0.78), 1200),
    "visor": ((0.09, 0.10, 0.12), 700),
    "lens": ((0.30, 0.52, 0.70), 1200),
    "clutch": ((0.95, 0.62, 0.15), 1200),
    "camera": ((0.20, 0.58, 0.42), 1200),
}


def cart(d):
    """Draw all parts of the cart."""
    return [*_frame(d), *_pen(d, "right", 1), *_pen(d, "left", -1), *_visor(d), *_pedals(d), *_seat(d)]


def _rod(a, b, r):
    """Return a round bar of radius r from a to b."""
    way = np.subtract(b, a)
    return cyl(tuple(map(float, a)), tuple(way / np.linalg.norm(way)), r, float(np.linalg.norm(way)))


def _frame(d):
    """Draw the trolley with castors and two shelves, and the arm support on two bars in front of it."""
    w, near, far, p = d.cart_half, d.cart_near, d.cart_far, d.profile / 2
    out = []
    corners = [(sx * (w - p), y) for y in (near + p, far - p) for sx in (-1, 1)]
    for k, (x, y) in enumerate(corners, 1):
        post = box(x - p, x + p, y - p, y + p, d.castor_high, d.shelf_high - d.board, 5)
        wheels = [cyl((x + s * 8 - 5, y, d.castor / 2), X, d.castor / 2, 10) for s in (-1, 1)]
        fork = box(x - 12, x + 12, y - 12, y + 12, d.castor / 2, d.castor_high, 4) - wheels[0] - wheels[1]
        out += [(f"post{k}", post, "profile"), (f"fork{k}", fork, "profile")]
        out += [(f"wheel{k}{s}", wheel, "rubber") for s, wheel in zip("ab", wheels, strict=True)]
    inner = d.computer_low
    low = box(-w + 2 * p, w - 2 * p, near, far, inner - d.board, inner, 4)
    top = box(-w, w, near, far, d.shelf_high - d.board, d.shelf_high, 30)
    out += [("shelf1", low, "shelf"), ("shelf2", top, "shelf")]
    tower = box(-90, 90, near + 60, far - 60, inner, inner + 360, 12)
    out.append(("computer", tower, "device"))
    # The support is in front of the shelf and higher, so that the wrists can move freely behind it.
    high, deep = d.support_high, d.support_deep
    plate = box(-w, w, 0, deep, high - 28, high - 12, 25)
    pad = box(-w + 6, w - 6, 4, deep - 4, high - 12, high, 24)
    out += [("support", plate, "shelf"), ("pad", soft(pad, Axis.Z, 5), "pad")]
    for k, s in enumerate((-1, 1), 1):
        x = s * (w - p)
        bar = box(x - p, x + p, deep - 2 * p, deep, d.shelf_high - 60, high - 28, 5)
        arm = box(x - p, x + p, deep, near, d.shelf_high - 60, d.shelf_high - 60 + 2 * p, 5, Axis.Y)
        out += [(f"bar{k}", bar, "profile"), (f"arm{k}", arm, "profile")]
    return out


def _pen(d, name, side):
    """Draw a haptic pen (foot, rotating head, two links, stylus with gripper); the stylus is at the hand's position."""
    x = side * d.pen_apart / 2
    shelf, hand = d.shelf_high, np.array([x, d.support_deep + d.hand_from_support, d.hand_high])
    y = hand[1] + d.pen_reach
    foot = box(x - d.pen_half, x + d.pen_half, y - d.pen_near, y + d.pen_far, shelf, shelf + 34, 40)
    foot = foot.chamfer(8, None, foot.edges().group_by(Axis.Z)[-1])
    neck = cone((x, y, shelf + 34), Z, 52, 40, 40)
    shoulder = np.array([x, y, shelf + 34 + 40 + 26])
    head = Solid.make_sphere(42, Plane(origin=tuple(map(float, shoulder)))) - box(
        x - 60, x + 60, y - 60, y + 60, shelf, shelf + 74
    )
    lean = np.radians(d.pen_lean)
    tail = hand + d.pen_long * np.array([0, np.sin(lean), np.cos(lean)])  # the wrist of the device, at the pen's end
    reach = tail - shoulder
    span, bend = np.linalg.norm(reach), np.array([0.0, 0.35, 1.0])
    bend -= bend @ reach / span**2 * reach
    bend /= np.linalg.norm(bend)
    elbow = shoulder + reach / 2 + bend * np.sqrt(d.pen_link**2 - span**2 / 4)
    hub = cyl((x - 16, *map(float, elbow[1:])), X, 17, 32)
    joint = Solid.make_sphere(15, Plane(origin=tuple(map(float, tail))))
    upper = _rod(shoulder + (elbow - shoulder) * 0.29, elbow, 13) - hub
    lower = _rod(elbow, tail, 9) - hub - joint
    way = (hand - tail) / np.linalg.norm(hand - tail)
    grip = tail + way * 0.45 * d.pen_long
    end = tail + way * d.pen_long
    stylus = _rod(tail, end, 8) - joint
    stylus = stylus - _rod(grip, end, 20)
    handle = _rod(grip, end, 11)
    jaws = [
        ("jaw" + n, _rod(end + np.array([s * 4, 0, 0]), end + way * 30 + np.array([s * 20, 0, 0]), 4) - handle, "link")
        for n, s in (("a", -1), ("b", 1))
    ]
    parts = [
        ("foot", foot, "device"),
        ("neck", neck, "link"),
        ("head", head, "device"),
        ("upper", upper - head, "link"),
        ("hub", hub, "device"),
        ("lower", lower, "link"),
        ("joint", joint, "device"),
        ("stylus", stylus, "device"),
        ("handle", handle, "pen"),
        *jaws,
    ]
    return [(f"{name}_{part}", solid, material) for part, solid, material in parts]


def _visor(d):
    """Draw the mast behind the shelf, its two arms, and the visor in front of the surgeon's eyes."""
    far, eyes = d.cart_far, np.array([0, d.eyes_from_support, d.eyes_high])
    mast_y, top = far + 22, d.eyes_high + 150
    mast = cyl((0, mast_y, d.shelf_high - 160), Z, 20, top - d.shelf_high + 160)
    clamp = box(-30, 30, far, mast_y + 26, d.shelf_high - 90, d.shelf_high - d.board, 8)
    clamp -= cyl((0, mast_y, 0), Z, 20, 3000)
    back = eyes[1] + d.visor_deep
    knee = (150.0, 0.5 * (mast_y + back), top - 25)
    first = _rod((0, mast_y, top - 25), knee, 13)
    first -= cyl((0, mast_y, 0), Z, 20, 3000)
    pin = cyl((knee[0], knee[1], knee[2] - 60), Z, 17, 85)
    hook = (0.0, back + 40, top - 75)
    second = _rod((knee[0], knee[1], top - 75), hook, 11) - pin
    bow = _rod((0, back + 40, top - 60), (0, back + 40, eyes[2]), 9) - second
    stem = _rod((0, back + 40, eyes[2] + 6), (0, back - 6, eyes[2] + 6), 8) - bow
    w, h = d.visor_half, d.visor_half_high
    shell = box(-w, w, eyes[1], back, eyes[2] - h, eyes[2] + h, 34, Axis.Y)
    shell = shell.fillet(16, shell.edges().group_by(Axis.Y)[-1])
    hollow = box(-w + 14, w - 14, eyes[1] - 10, eyes[1] + 45, eyes[2] - h + 12, eyes[2] + h - 12, 22, Axis.Y)
    lenses = [cyl((s * 32, eyes[1] + 37, eyes[2]), Y, 22, 8) for s in (-1, 1)]
    return [
        ("mast", mast, "profile"),
        ("clamp", clamp, "device"),
        ("boom1", first - pin, "profile"),
        ("boom2", second, "profile"),
        ("pin", pin, "device"),
        ("bow", bow, "profile"),
        ("stem", stem - shell, "profile"),
        ("visor", shell - hollow, "visor"),
        ("lens1", lenses[0], "lens"),
        ("lens2", lenses[1], "lens"),
    ]


def _pedals(d):
    """Draw the pedals: clutch on the left, camera on the right; each is a plate inclined on its foot."""
    out = []
    y, w, deep = d.pedal_from_support, d.pedal_half, d.pedal_deep
    for name, s in (("clutch", -1), ("camera", 1)):
        x = s * d.pedal_apart / 2
        foot = box(x - w, x + w, y, y + deep, 0, 22, 18)
        plate = box(x - w + 8, x + w - 8, y + 8, y + deep - 16, 0, 14, 12)
        lean = Plane(origin=(0, y, 30), x_dir=X, z_dir=(0, -np.sin(0.24), np.cos(0.24)))
        flat = Plane(origin=(0, y, 0))
        plate = plate.moved(flat.location.inverse()).moved(lean.location)
        hinge = box(x - 14, x + 14, y + deep - 34, y + deep - 10, 22, 60, 4) - plate
        out += [(f"{name}_foot", foot, "device"), (f"{name}_plate", plate, name), (f"{name}_hinge", hinge, "device")]
    return out


def _seat(d):
    """Draw the stool: five feet with castors, a column and a seat."""
    y, high = -d.seat_from_support, d.seat_high
    out = []
    for k in range(5):
        a = 2 * np.pi * (k + 0.5) / 5
        u = np.array([np.cos(a), np.sin(a), 0.0])
        end = np.array([0, y, 72.0]) + u * d.seat_foot
        leg = _rod(np.array([0, y, 85.0]) + u * 30, end, 14)
        ball = Solid.make_sphere(26, Plane(origin=(float(end[0]), float(end[1]), 26.0)))
        stem = cyl((float(end[0]), float(end[1]), 26.0), Z, 8, 40) - ball - leg
        out += [(f"stool_leg{k + 1}", leg, "profile"), (f"stool_wheel{k + 1}", ball, "rubber")]
        out.append((f"stool_stem{k + 1}", stem, "profile"))
    hub = cyl((0, y, 60), Z, 34, 60)
    column = cyl((0, y, 120), Z, 25, high - 190)
    cushion = cyl((0, y, high - 70), Z, d.seat_radius, 70)
    cushion = cushion.fillet(22, cushion.edges())
    legs = [p for p in out if "leg" in p[0]]
    for _, leg, _ in legs:
        hub = hub - leg
    return [*out, ("stool_hub", hub, "profile"), ("stool_column", column, "profile"), ("stool_seat", cushion, "pad")]
