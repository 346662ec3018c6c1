"""Parts of the hexapod, each body drawn in its own frame.

Body frames (mm):
    base       the world frame
    crossN     origin in the centre of universal joint N, x along its pin in the base, z along the leg
    cylinderN  as crossN
    rodN       origin in the ball centre, axes as crossN
    platform   origin in its top face, z up

Every function returns a list of ``(part name, solid, material)``.
"""

import numpy as np
from build123d import Axis, Plane, Solid
from shapes import X, Y, Z, bolts, box, cone, cyl, hull

MATERIALS = {  # sRGB, density in kg/m3
    "steel": ((0.66, 0.69, 0.72), 7850),
    "dark_steel": ((0.26, 0.28, 0.31), 7850),
    "aluminium": ((0.80, 0.82, 0.84), 2700),
    "blue_aluminium": ((0.17, 0.36, 0.55), 2700),
    "bronze": ((0.78, 0.57, 0.27), 8800),
    "plastic": ((0.13, 0.14, 0.16), 1200),
    "ruby": ((0.72, 0.07, 0.16), 3980),
}


def ring(at, axis, inner, outer, h):
    """Return a tube with inner and outer radius that starts at `at` and has length h along `axis`."""
    return cyl(at, axis, outer, h) - cyl(at, axis, inner, h)


def rims(solid, size):
    """Chamfer the outer rims at both ends of a disc."""
    groups = solid.edges().group_by(Axis.Z)
    return solid.chamfer(size, None, [max(groups[0], key=lambda e: e.length), max(groups[-1], key=lambda e: e.length)])


# ---- base -------------------------------------------------------------------
def base(d, legs):
    """Draw the base: ring plate on the table, and six brackets for the universal joints."""
    t = d.base_thickness
    plate = rims(cyl((0, 0, -t), Z, d.base_radius, t), d.base_chamfer) - cyl((0, 0, -t - 1), Z, d.base_bore, t + 2)
    plate -= box(d.base_flat, d.base_radius + 1, -d.base_radius, d.base_radius, -t - 1, 1)
    for k in range(3):
        w = np.radians(60 + 120 * k)
        at = 0.5 * (d.base_radius + d.base_bore) * np.array([np.cos(w), np.sin(w)])
        plate -= cyl((*at, -t - 1), Z, d.foot_hole, t + 2) + cyl((*at, -d.foot_hole * 2), Z, d.foot_sink, t)
    out = [("plate", plate, "dark_steel")]
    for n, leg in enumerate(legs, 1):
        x = leg[:3, 0]
        out += bracket(d, n, Plane(origin=tuple(leg[:3, 3]), x_dir=tuple(x), z_dir=Z))
    return out


def bracket(d, n, plane):
    """Draw a bracket: foot with two ears around the pin along x, and its screws."""
    low, foot, far = -d.h_a, 8.0, d.hub + d.ear
    body = box(-far - 10, far + 10, -13, 13, low, low + foot, 4)
    ears = []
    for x in (-far, d.hub):
        side = Plane(origin=(x, 0, 0), x_dir=Y, z_dir=X)
        ears.append(hull([(0, 0, d.ear_radius), (0, low + foot, 12.9)], side, d.ear))
    body = body + ears[0] + ears[1]
    body -= box(-60, 60, -60, 60, low - 40, low)
    body -= cyl((-far - 1, 0, 0), X, d.hole, 2 * far + 2)
    move = plane.location
    out = [(f"bracket{n}", body.moved(move), "aluminium")]
    for k, (x, y) in enumerate((x, y) for x in (-far - 5, far + 5) for y in (-8, 8)):
        screw = cyl((x, y, low + foot), Z, 3.5, 4) - cyl((x, y, low + foot + 2), Z, 1.7, 3)
        out.append((f"screw{n}{'abcd'[k]}", screw.moved(move), "steel"))
    return out


# ---- legs -------------------------------------------------------------------
def cross(d):
    """Draw the cross: a block with a pin along x and a pin along y; its shoulders touch the ears."""
    far, h = d.hub + d.ear, d.hub
    block = box(-h, h, -h, h, -8, 8)
    block = block.chamfer(2, None, block.edges().filter_by(Axis.Z))
    block -= cyl((0, 0, -9), Z, 3.4, 18)  # grease
    pins = cyl((-far - 1.5, 0, 0), X, d.pin, 2 * far + 3) + cyl((0, -far - 1.5, 0), Y, d.pin, 2 * far + 3)
    out = [("block", block + (pins - cyl((0, 0, -9), Z, 3.4, 18)), "steel")]
    for k, axis in enumerate(((1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0))):
        at = tuple(far * np.array(axis, float))
        out.append((f"clip{k + 1}", ring(at, axis, d.pin, d.pin + 2, 1.0), "dark_steel"))
    return out


def cylinder(d):
    """Draw the cylinder: fork, motor with gear, cylinder tube and head."""
    far, r = d.hub + d.ear, d.ear_radius
    fork = cyl((0, 0, d.motor_start - 6), Z, d.motor_radius, 6)
    for y in (d.hub, -far):
        fork += cyl((0, y, 0), Y, r, d.ear) + box(-r, r, y, y + d.ear, 0, d.motor_start - 6)
    fork -= cyl((0, -far - 1, 0), Y, d.hole, 2 * far + 2)
    motor = cyl((0, 0, d.motor_start), Z, d.motor_radius, d.motor_end - d.motor_start)
    for k in range(5):
        motor -= ring((0, 0, d.motor_start + 10 + 6 * k), Z, d.motor_radius - 1.2, d.motor_radius + 1, 2.5)
    plug = box(-5, 5, d.motor_radius - 4, d.motor_radius + 8, d.motor_end - 14, d.motor_end - 2, 2)
    socket = cyl((0, d.motor_radius + 2, d.motor_end - 8), Y, 3.6, 12)
    motor -= plug
    gear = rims(cyl((0, 0, d.motor_end), Z, d.motor_radius + 1, 8), 1.0)
    start = d.motor_end + 8
    tube = cyl((0, 0, start), Z, d.tube_radius, d.tube_end - start)
    head = rims(cyl((0, 0, d.tube_end), Z, d.gland_radius, d.gland_end - d.tube_end), 1.0)
    drill = cyl((0, 0, d.bore_start), Z, d.bore, d.gland_end)
    wiper = ring((0, 0, d.gland_end), Z, d.bore, d.bore + 3, 2)
    for k in range(4):
        w = np.radians(45 + 90 * k)
        head -= cyl((11.6 * np.cos(w), 11.6 * np.sin(w), d.gland_end - 3), Z, 1.6, 4)
    return [
        ("fork", fork, "aluminium"),
        ("motor", motor, "plastic"),
        ("plug", plug + socket, "dark_steel"),
        ("gear", gear - drill, "blue_aluminium"),
        ("tube", tube - drill, "aluminium"),
        ("head", head - drill, "blue_aluminium"),
        ("wiper", wiper, "bronze"),
    ]


def rod(d):
    """Draw the rod with spanner flats, and the ball on its neck."""
    foot = -d.rod_length
    shaft = cyl((0, 0, foot), Z, d.rod, d.rod_length - 26)
    shaft = shaft.chamfer(1.0, None, [shaft.edges().group_by(Axis.Z)[0][0]])
    for low, high in ((d.rod_flat, d.rod + 1), (-d.rod - 1, -d.rod_flat)):
        shaft -= box(-20, 20, low, high, -46, -34)
    end = cone((0, 0, -26), Z, d.rod, d.neck, 8) + cyl((0, 0, -18), Z, d.neck, 18)
    return [
        ("shaft", shaft, "steel"),
        ("ball", end + Solid.make_sphere(d.ball, Plane.XY), "steel"),
    ]


# ---- platform ---------------------------------------------------------------
def platform(d, balls, legs):
    """Draw the platform: a plate with a hole pattern, six sockets, and a stylus."""
    t = d.plate_thickness
    plate = rims(cyl((0, 0, -t), Z, d.plate_radius, t), 1.5) - cyl((0, 0, -t - 1), Z, d.plate_bore, t + 2)
    plate -= box(d.plate_flat, d.plate_radius + 1, -d.plate_radius, d.plate_radius, -t - 1, 1)
    for k in range(3):
        w = np.radians(120 * k)
        plate -= cyl((d.window_at * np.cos(w), d.window_at * np.sin(w), -t - 1), Z, d.window, t + 2)
        for r, turn in ((45, 60), (75, 60), (75, 42), (75, 78), (104, 30), (104, 90)):
            w = np.radians(120 * k + turn)
            plate -= cyl((r * np.cos(w), r * np.sin(w), -t - 1), Z, 2.5, t + 2)
    out = []
    for n, (b, leg) in enumerate(zip(balls, legs, strict=True), 1):
        down = -leg[:3, 2]
        post = cyl((b[0], b[1], b[2]), Z, 9, -t - b[2])
        socket = Solid.make_sphere(d.cup_outer, Plane(origin=tuple(b))) + post
        rim = b + d.cup_rim * down
        socket -= cyl(tuple(rim), tuple(down), 2 * d.cup_outer, 2 * d.cup_outer)
        out.append((f"socket{n}", socket - Solid.make_sphere(d.cup, Plane(origin=tuple(b))), "bronze"))
    holder = (
        rims(cyl((0, 0, 0), Z, 30, 7), 1.0) + cone((0, 0, 7), Z, 16, 7, 24) + cyl((0, 0, -9), Z, d.plate_bore - 0.02, 9)
    )
    holder -= cyl((0, 0, 12), Z, d.stylus, 30)
    shaft = cyl((0, 0, 12), Z, d.stylus, d.stylus_tip - 24) + cone((0, 0, d.stylus_tip - 12), Z, d.stylus, 1.4, 12)
    ruby = Solid.make_sphere(d.stylus_ball, Plane(origin=(0, 0, d.stylus_tip)))
    out += [("holder", holder, "blue_aluminium"), ("stylus", shaft - ruby, "steel"), ("ruby", ruby, "ruby")]
    heads = bolts((0, 0, 7), Z, 23, 4, 3, 3)
    return [("plate", plate, "aluminium"), *out, *((f"bolt{k + 1}", b, "dark_steel") for k, b in enumerate(heads))]
