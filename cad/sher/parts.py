"""Parts of SHER 3.0, each body drawn in its own frame.

Body frames (mm):
    base, eye_phantom, microscope   the world frame
    carriageN        x = u (radial), y = t (tangential), z up; origin on the axis of the first pins, between the rods
    crossNk, rodNk   origin at the centre of the cross; z along the second pin; rod: x up along the rod
    platform         origin at the centre of the ball sockets, axes of the world
    arm              frame of the tilt linkage: origin at pin A, x along the roll axis, z perpendicular to the linkage
    tilt_slider      axes of the arm, origin at pin R
    l2, l3, l4, l5   origin at pin B, D, A, R; x to pin C, C, D, Q; z perpendicular to the linkage

Every function returns a list of ``(part name, solid, material)``.
"""

from math import cos, radians, sin

import numpy as np
from build123d import Axis, Location, Plane, Solid
from shapes import METAL_AND_PLASTIC, X, Y, Z, box, cyl, hull, joint, pipe, polar

MATERIALS = METAL_AND_PLASTIC


# ---- shapes -----------------------------------------------------------------
def turned(degrees):
    """Return a rotation about z as a location."""
    return Location((0, 0, 0), (0, 0, degrees))


def clip(d, at, z, sign):
    """Return the retaining ring on a pin at `at` (x, y), in front of the face at z on the side `sign` (+1 or -1)."""
    start = z + sign * d.clip_gap
    return pipe((*at, start), (0, 0, sign), d.pin_radius, d.clip_radius, d.clip_height)


def pin(d, where, z0, z1):
    """Return a pin along z of a joint location, from z0 to z1."""
    return cyl((0, 0, z0), Z, d.pin_radius, z1 - z0).moved(where)


# ---- base -------------------------------------------------------------------
def base(d, eye_at):
    """Draw bench, ring, pillar with the datum, three columns with rail, screw and motor, and the pads of the props."""
    high, low = d.ring_high, d.ring_low
    plate = pipe((0, 0, low), Z, d.ring_inner, d.ring_radius, high - low)
    plate = plate.chamfer(1.5, None, plate.edges().group_by(Axis.Z)[-1])
    pillar = cyl((0, 0, low), Z, d.datum_radius, -low) - cyl((0, 0, low - 1), Z, d.datum_bore, 2 - low)
    pillar -= box(d.datum_flat, 40, -40, 40, -12, 1)
    out = []
    for k, azimuth in enumerate(d.leg_azimuth, 1):
        way = turned(azimuth)
        spoke = box(d.datum_bore + 3, d.ring_inner + 4, -7, 7, low, high).moved(turned(azimuth + 60))
        plate += spoke
        plate -= cyl(polar(d.foot_at, azimuth + 60, low - 1), Z, 2.5, 50)
        plate -= cyl(polar(d.screw_at, azimuth, low - 1), Z, d.screw_radius + 1, 50)
        foot = cyl(polar(d.foot_at, azimuth + 60, d.bench_high), Z, d.foot_radius, low - d.bench_high)
        h, t = d.column_half, d.column_thickness
        wall = box(d.column_at, d.column_at + t, -h, h, high, d.column_top)
        wall = wall.fillet(8, [e for e in wall.edges().filter_by(Axis.X) if e.center().Z > 0])
        slot = Plane(origin=(d.column_at - 1, 0, 0), x_dir=Y, z_dir=X)
        wall -= hull([(0, 15, 9), (0, 90, 9)], slot, t + 2)
        under = d.column_top - d.bracket_height
        bracket = box(d.bracket_front, d.column_at, -d.bracket_half, d.bracket_half, under, d.column_top, 3)
        for at, r in ((d.rail_at, d.rail_radius), (d.screw_at, d.screw_radius)):
            bracket -= cyl((at, 0, under - 1), Z, r, 40)
        rail = cyl((d.rail_at, 0, high), Z, d.rail_radius, d.column_top - high)
        screw = cyl((d.screw_at, 0, low), Z, d.screw_radius, d.column_top - low - 1)
        motor = cyl((d.screw_at, 0, low - d.motor_length), Z, d.motor_radius, d.motor_length)
        motor = motor.chamfer(1.5, None, motor.edges().group_by(Axis.Z)[0])
        encoder = cyl((d.screw_at, 0, low - d.motor_length - 8), Z, d.motor_radius - 3, 8)
        out += [
            (f"foot{k}", foot, "grey_aluminium"),
            (f"column{k}", wall.moved(way), "grey_aluminium"),
            (f"bracket{k}", bracket.moved(way), "aluminium"),
            (f"rail{k}", rail.moved(way), "steel"),
            (f"screw{k}", screw.moved(way), "dark_steel"),
            (f"motor{k}", motor.moved(way), "dark_steel"),
            (f"encoder{k}", encoder.moved(way), "plastic"),
        ]
    plate -= cyl((0, 0, low - 1), Z, d.datum_radius, 100)
    bench_low = d.bench_high - d.bench_thickness
    bench = box(d.bench_start, d.bench_end, -d.bench_half, d.bench_half, bench_low, d.bench_high, 12)
    for name, x in (("eye_mount", eye_at), ("scope_mount", d.scope_x)):
        pad = cyl((x, 0, d.bench_high), Z, d.mount_radius, d.mount_height)
        pad -= box(x + d.mount_flat, x + 40, -40, 40, d.bench_high - 1, d.bench_high + 20)
        pad += cyl((x, 0, d.bench_high), Z, d.mount_pin, d.mount_height + d.mount_pin_height)
        out.append((name, pad, "steel"))
    return [("ring", plate, "blue_aluminium"), ("pillar", pillar, "aluminium"), ("bench", bench, "white_plastic"), *out]


# ---- legs -------------------------------------------------------------------
def carriage(d, err):
    """Draw the carriage: bearing block on rail and screw, with a fork that holds two crosses."""
    r, rail, screw = d.base_radius, d.rail_at, d.screw_at
    h, w = d.carriage_half, d.rod_spread
    block = box(d.carriage_front - r, d.carriage_back - r, -h, h, d.carriage_low, d.carriage_high, 3)
    off = err("rail_bore_offset_mm", (0, 0))
    block -= cyl((rail - r + off[0], off[1], -60), Z, d.rail_radius + d.play, 120)
    block -= cyl((screw - r, 0, -60), Z, d.screw_radius + 0.4, 120)
    fork = box(d.fork_front - r, d.carriage_front - r, -w - 8, w + 8, d.fork_low, d.fork_high)
    start, end = w + d.ear_gap, w + d.ear_gap + d.ear_thickness
    inner = w - d.ear_gap - d.side_gap
    for y0, y1 in ((-end, -start), (-inner, -inner + d.ear_thickness), (inner - d.ear_thickness, inner), (start, end)):
        plane = Plane(origin=(0, y0, 0), x_dir=Z, z_dir=Y)
        fork += hull([(d.fork_low + 4, 0, d.ear_radius), (0, 0, d.ear_radius)], plane, y1 - y0)
    # the outer ears locate the crosses; there is a gap at the inner ears
    bushes = []
    for side, name in ((w, "a"), (-w, "b")):
        o = err(f"bore_{name}_offset_mm", (0, 0))
        y = start if side > 0 else -end
        at, r1 = (o[0], side - 9, o[1]), d.cross_pin1 + d.play
        fork -= cyl(at, Y, r1, 18) + cyl((0, y - 1, 0), Y, d.bush_radius, d.ear_thickness + 2)
        bush = cyl((0, y, 0), Y, d.bush_radius, d.ear_thickness) - cyl(at, Y, r1, 18)
        bushes.append((f"bush_{name}", bush, "bronze"))
    wiper = cyl((rail - r, 0, d.carriage_low - 2), Z, 9, 2) - cyl((rail - r, 0, -60), Z, d.rail_radius + 0.3, 120)
    out = [("block", block, "grey_aluminium"), ("fork", fork, "blue_aluminium"), *bushes]
    return [*out, ("wiper", wiper, "orange_plastic")]


def cross(d, err):
    """Draw a cross with two pins: the first along y, the second along z."""
    c, s = d.cross_half, d.cross_shoulder
    body = box(-c, c, -c, c, -c, c, 0.4, Axis.X)
    g, t = d.ear_gap, d.ear_thickness
    body += cyl((0, -g, 0), Y, s, 2 * g) + cyl((0, 0, -d.pin2_shoulder), Z, s, 2 * d.pin2_shoulder)
    end = g + t
    body += cyl((0, -end, 0), Y, d.cross_pin1, 2 * end)
    o = err("pin2_offset_mm", (0, 0))
    end = d.pin2_shoulder + d.side_gap + d.cheek_thickness
    body += cyl((o[0], o[1], -end), Z, d.cross_pin2, 2 * end)
    return [("spider", body, "steel")]


def rod(d, err):
    """Draw a rod with fork, ferrule and ball."""
    length, s = err("length_mm", d.rod_length), d.pin2_shoulder
    top = d.bridge_start + d.bridge_height
    out, r, w, t = None, d.cheek_radius, d.cheek_waist, d.cheek_thickness
    for z in (s, -s - d.side_gap - t):
        cheek = cyl((0, 0, z), Z, r, t) + box(0, top, -w, w, z, z + t)
        out = cheek if out is None else out + cheek
    out += box(d.bridge_start, top, -w, w, -s - d.side_gap - t, s + t)
    o = err("bore_offset_mm", (0, 0))
    out -= cyl((o[0], o[1], -20), Z, d.cross_pin2 + d.play, 40)
    end = length - d.rod_end
    bar = cyl((top, 0, 0), X, d.rod_radius, end - top)
    bar = bar.chamfer(0.6, None, bar.edges().group_by(Axis.X)[-1])
    off = err("ball_offset_mm", (0, 0, 0))
    ball = Solid.make_sphere(d.ball_radius, Plane(origin=(length + off[0], off[1], off[2]), z_dir=X))
    ball += cyl((end, 0, 0), X, d.neck_radius, d.rod_end - 1)
    return [("fork", out, "grey_aluminium"), ("bar", bar, "aluminium"), ("ball", ball, "steel")]


# ---- platform ---------------------------------------------------------------
def platform(d, err):
    """Draw the platform: a disc with six ball sockets, roll housing and roll motor."""
    low, high, r = d.disc_low, d.disc_high, d.disc_radius
    disc = cyl((0, 0, low), Z, r, high - low)
    disc = disc.chamfer(1.5, None, disc.edges().group_by(Axis.Z)[-1])
    disc -= cyl((0, 0, 0), Z, d.disc_bore, 50)
    for azimuth in d.leg_azimuth:
        disc -= cyl(polar(r - 12, azimuth + 60, 0), Z, 7, 50)
    out = []
    for n, azimuth in enumerate(d.leg_azimuth, 1):
        for k, side in (("a", d.rod_spread), ("b", -d.rod_spread)):
            at, o = (d.platform_radius, side, 0), d.cup_outer
            off = err(f"s{n}{k}_offset_mm", (0, 0, 0))
            lean = radians(d.cup_lean)
            axis = (sin(lean), 0, -cos(lean))
            cup = Solid.make_sphere(o, Plane(origin=at)) + cyl(at, Z, o, low)
            depth = o / 3
            wide = depth * np.tan(radians(d.cup_opening))
            rim = np.array(at) + depth * np.array(axis)
            cup -= Solid.make_cone(0, wide, depth, Plane(origin=at, z_dir=axis)) + cyl(tuple(rim), axis, 2 * o, 2 * o)
            here = (at[0] + off[0], at[1] + off[1], off[2])
            cup -= Solid.make_sphere(d.ball_radius + d.play, Plane(origin=here))
            out.append((f"cup{n}{k}", cup.moved(turned(azimuth)), "steel"))
    h, b, z = d.housing_half, d.housing_radius, d.d1
    stand = box(-h, h, -b, b, high, z) - cyl((-h - 1, 0, z), X, b - 1, 2 * h + 2)
    stand -= box(-h - 1, h + 1, -10, 10, high + 4, z)  # hollow under the housing
    tube = pipe((-h, 0, z), X, d.bearing_radius + 4, b, 2 * h)
    tube = tube.chamfer(1, None, tube.edges().group_by(Axis.X)[0])
    for k in range(6):
        y, q, _ = polar(b - 5, 30 + 60 * k)
        tube -= cyl((h - 3, y, z + q), X, 1.5, 10)
    off = err("roll_offset_mm", (0, 0))
    bush = cyl((-h, 0, z), X, d.bearing_radius + 4, 2 * h)
    bush -= cyl((-h - 1, off[0], z + off[1]), X, d.bearing_radius + d.play, 2 * h + 2)
    motor = cyl((-h - 3 - d.roll_motor_length, 0, z), X, d.roll_motor, d.roll_motor_length)
    motor = motor.chamfer(2, None, motor.edges().group_by(Axis.X)[0])
    lid = pipe((-h - 3, 0, z), X, d.bearing_radius + 1, b, 3)
    return [
        ("disc", disc, "blue_aluminium"),
        *out,
        ("stand", stand, "blue_aluminium"),
        ("housing", tube, "grey_aluminium"),
        ("roll_bush", bush, "bronze"),
        ("lid", lid, "aluminium"),
        ("roll_motor", motor, "dark_steel"),
    ]


# ---- arm --------------------------------------------------------------------
def arm(d, err):
    """Draw the arm L1: roll shaft and flange, main beam, side beam with the tilt rail, end plate with pins A and B."""
    axis, face = -d.d3, d.housing_half - d.d2
    shaft = cyl((face - 2 * d.housing_half, axis, 0), X, d.bearing_radius, 2 * d.housing_half)
    flange = cyl((face, axis, 0), X, d.hub_radius, d.hub_thickness)
    flange = flange.chamfer(1, None, flange.edges().group_by(Axis.X)[-1])
    start, w = face + d.hub_thickness, d.beam_half
    beam = box(start, d.beam_end, d.beam_low, d.beam_high, -w, w, 3, Axis.X)
    for x in (start + 24, start + 50):
        beam -= box(x - 8, x + 8, -33, -17, -20, 20)
    link = box(d.side_start, d.beam_end, d.side_bottom, d.side_top, w, d.side_high)
    side = box(d.beam_end, d.end_back, d.side_bottom, d.side_top, d.side_low, d.side_high)
    for x in (-64, -44, -24):
        side -= cyl((x, -9, 0), Z, 6.5, 50)
    low, far = d.end_low, d.end_front
    end = box(d.end_back, far, d.side_bottom, d.end_top, low, d.side_high)
    end = end.fillet(4, [e for e in end.edges().filter_by(Axis.Z) if e.center().Y > 0 and e.center().X > 0])
    post = box(d.side_start + 10, d.beam_end, d.side_bottom, d.side_top, low, w)
    rail_at = (d.y_AR, d.tilt_rail_layer)
    rail = cyl((d.beam_end, *rail_at), X, d.tilt_rail_radius, far - d.beam_end - 2)
    end -= cyl((d.end_back - 1, *rail_at), X, d.tilt_rail_radius, 200)
    out = []
    pins = {"a": ((0, 0), d.stem_a, d.link_half, -d.link_half), "b": ((0, d.AB), d.stem_b, 0, d.layer_BC - d.link_half)}
    for name, (at, r, seat, last) in pins.items():
        where = joint((*at, 0), Z, X, err(f"pin_{name}_offset_mm", (0, 0)), err(f"pin_{name}_tilt_deg", 0.0))
        stem = pipe((*at, seat), Z, d.pin_radius, r, low - seat)
        end -= cyl((0, 0, low - 1), Z, d.pin_radius, 8).moved(where)
        tail = last - d.clip_gap - d.clip_height - 0.5
        out.append((f"stem_{name}", stem, "bronze"))
        out.append((f"pin_{name}", pin(d, where, tail, low + 5), "steel"))
        out.append((f"clip_{name}", clip(d, at, last, -1), "dark_steel"))
    scale = box(-d.x_max, 0, d.side_top, d.side_top + d.scale_height, d.side_low + 2, d.side_high)
    motor = cyl((start + 8, d.beam_high + d.tilt_motor, 0), X, d.tilt_motor, d.tilt_motor_length)
    motor = motor.chamfer(1.5, None, motor.edges().group_by(Axis.X)[0])
    return [
        ("roll_shaft", shaft, "steel"),
        ("flange", flange, "aluminium"),
        ("beam", beam, "blue_aluminium"),
        ("link", link + post, "blue_aluminium"),
        ("side_beam", side, "blue_aluminium"),
        ("end_plate", end, "aluminium"),
        ("tilt_rail", rail, "steel"),
        ("scale", scale, "white_plastic"),
        ("tilt_motor", motor, "dark_steel"),
        *out,
    ]


def tilt_slider(d, err):
    """Draw the block on the tilt rail with pin R, and a lug with its end face in the plane of the linkage."""
    h, rail = d.slider_half, d.tilt_rail_layer
    block = box(-h, h, -h, h, d.slider_front, d.slider_back)
    block += box(-h, h, d.lug_low, d.lug_high, 0, d.slider_back - 4) + box(-h, h, d.lug_high, 0, d.slider_front, 16)
    off = err("rail_bore_offset_mm", (0, 0))
    block -= cyl((-h - 1, off[0], rail + off[1]), X, d.tilt_rail_radius + d.play, 2 * h + 2)
    where = joint((0, 0, 0), Z, X, err("pin_r_offset_mm", (0, 0)), err("pin_r_tilt_deg", 0.0))
    block -= cyl((0, 0, d.slider_front - 1), Z, d.pin_radius, 2.5).moved(where)
    last = d.layer_QR - d.link_half
    shaft = pin(d, where, last - d.clip_gap - d.clip_height - 0.5, d.slider_front + 1.5)
    return [
        ("block", block, "orange_plastic"),
        ("pin_r", shaft, "steel"),
        ("clip_r", clip(d, (0, 0), last, -1), "dark_steel"),
    ]


# ---- tilt links -------------------------------------------------------------
def link(d, length, layer, r0, r1):
    """Draw a flat link with a boss at each end."""
    low, t = layer - d.link_half, 2 * d.link_half
    body = hull([(0, 0, d.waist), (length, 0, d.waist)], Plane(origin=(0, 0, low)), t)
    return body + cyl((0, 0, low), Z, r0, t) + cyl((length, 0, low), Z, r1, t)


def bore(d, err, name, at):
    """Return a cylinder for a bore through all layers at `at` (x, y)."""
    where = joint((*at, 0), Z, X, err(f"bore_{name}_offset_mm", (0, 0)), err(f"bore_{name}_tilt_deg", 0.0))
    return cyl((0, 0, -50), Z, d.pin_radius + d.play, 100).moved(where)


def l5(d, err):
    """Draw the link from the tilt slider (R) to the bell crank (Q)."""
    length = err("length_mm", d.QR)
    body = link(d, length, d.layer_QR, d.boss, d.boss)
    low, top = d.layer_QR - d.link_half, d.link_half
    body += cyl((length, 0, top), Z, d.spacer, low - top)
    return [("link", body - bore(d, err, "r", (0, 0)) - bore(d, err, "q", (length, 0)), "aluminium")]


def l4(d, err):
    """Draw the bell crank Q-A-D with the pins Q and D."""
    h, r, length = d.link_half, d.boss, err("DA_mm", d.DA)
    q = polar(err("AQ_mm", d.AQ), err("phi2_deg", d.phi2))[:2]
    low = Plane(origin=(0, 0, -h))
    body = hull([(0, 0, r), (length, 0, r)], low, 2 * h)
    arm = hull([(0, 0, d.crank_waist), (q[0], q[1], d.crank_waist)], low, 2 * h)
    body = body + arm + cyl((*q, -h), Z, r, 2 * h)
    body -= box(length + d.flat_over, length + 20, -20, 20, -20, 20)
    p = d.pocket_half
    body -= hull([(14, 0, p), (length - 14, 0, p)], Plane(origin=(0, 0, 0)), h + 1)
    out = []
    pins = {
        "q": (q, -h, d.layer_QR + d.link_half, 1),
        "d": ((length, 0), h, d.layer_CD - d.link_half, -1),
    }
    body -= bore(d, err, "a", (0, 0))
    for name, (at, back, last, sign) in pins.items():
        where = joint((*at, 0), Z, X, err(f"pin_{name}_offset_mm", (0, 0)), err(f"pin_{name}_tilt_deg", 0.0))
        tail = last + sign * (d.clip_gap + d.clip_height + 0.5)
        shaft = pin(d, where, min(back, tail), max(back, tail))
        body -= cyl((0, 0, -h - 1), Z, d.pin_radius, 2 * h + 2).moved(where)
        out += [(f"pin_{name}", shaft, "steel"), (f"clip_{name}", clip(d, at, last, sign), "dark_steel")]
    face = d.layer_CD + d.link_half
    spacer = pipe((length, 0, face), Z, d.pin_radius, d.spacer, -h - face)
    return [("crank", body, "orange_plastic"), ("spacer_d", spacer, "bronze"), *out]


def l2(d, err):
    """Draw the link B-C with the pin C."""
    length = err("length_mm", d.BC)
    body = link(d, length, d.layer_BC, d.boss, d.boss)
    low, high = d.layer_BC - d.link_half, d.layer_BC + d.link_half
    body += cyl((0, 0, high), Z, d.stem_b, -high)
    where = joint((length, 0, 0), Z, X, err("pin_c_offset_mm", (0, 0)), err("pin_c_tilt_deg", 0.0))
    body = body - bore(d, err, "b", (0, 0)) - cyl((0, 0, low - 1), Z, d.pin_radius, 20).moved(where)
    last, face = d.layer_CD - d.link_half, d.layer_CD + d.link_half
    shaft = pin(d, where, last - d.clip_gap - d.clip_height - 0.5, high)
    spacer = pipe((length, 0, face), Z, d.pin_radius, d.spacer, low - face)
    return [
        ("link", body, "aluminium"),
        ("pin_c", shaft, "steel"),
        ("clip_c", clip(d, (length, 0), last, -1), "dark_steel"),
        ("spacer_c", spacer, "bronze"),
    ]


def l3(d, err, p, along):
    """Draw the coupler C-D with holder, handle and instrument; point P is at p, `along` is the handle's direction."""
    reach = err("tool_reach_mm", d.tool_reach)
    tool = Location(Plane(origin=(*p, 0), x_dir=Z, z_dir=(*along, 0)))
    p, along = np.array(p), np.array(along)
    foot = p - along * (p @ along)
    low, t = d.layer_CD - d.link_half, 2 * d.link_half
    plane = Plane(origin=(0, 0, low))
    plate = hull([(0, 0, d.boss + 1), (*foot, d.clamp_half), (d.CD, 0, d.boss + 1)], plane, t)
    at = -(p @ along)
    half, r = d.clamp_half, d.clamp_outer
    clamp = cyl((0, 0, at - half), Z, r, 2 * half).moved(tool)
    block = Solid.make_box(2 * half, 2 * half, -low, Plane(origin=(*(foot), low), x_dir=(*along, 0), z_dir=Z))
    side = np.array([-along[1], along[0]])
    block = block.moved(Location((*(-half * along - half * side), 0)))
    grip = cyl((0, 0, d.handle_start), Z, d.handle_radius, d.handle_length).moved(tool)
    body = plate + clamp + block - cyl((0, 0, at - 30), Z, d.handle_radius, 60).moved(tool)
    body = body - bore(d, err, "d", (0, 0)) - bore(d, err, "c", (d.CD, 0))
    start, end = d.handle_start, d.handle_start + d.handle_length
    for z in (start + 8, start + 12, start + 16, end - 20, end - 12):
        grip -= pipe((0, 0, z), Z, d.handle_radius - 0.6, d.handle_radius + 1, 1.6).moved(tool)
    collet = Solid.make_cone(1.0, d.ferrule_radius, start - d.ferrule_start, Plane(origin=(0, 0, d.ferrule_start)))
    shaft = cyl((0, 0, -reach), Z, d.shaft_radius, reach) + cyl((0, 0, 0), Z, d.shaft_thick, d.ferrule_start)
    return [
        ("holder", body, "aluminium"),
        ("handle", grip, "white_plastic"),
        ("collet", collet.moved(tool), "dark_steel"),
        ("shaft", shaft.moved(tool), "steel"),
    ]


# ---- props ------------------------------------------------------------------
def foot(d, x, radius):
    """Return the foot plate of a prop, on its pad."""
    z = d.bench_high + d.mount_height
    plate = cyl((x, 0, z), Z, radius, d.plate_height) - box(x + d.mount_flat, x + 40, -40, 40, z - 1, z + 20)
    return plate - cyl((x, 0, z - 1), Z, d.mount_pin + d.play, d.plate_height + 2)


def eye_phantom(d, centre, pole, err):
    """Draw the eye phantom on a post: a hemisphere with five holes and copper foil inside; its axis is `pole`."""
    r, wall = d.eye_radius, d.eye_wall
    off = err("centre_offset_mm", (0, 0, 0))
    at = tuple(np.array(centre) + off)
    tilted = Location(Plane(origin=at, x_dir=(pole[2], 0, -pole[0]), z_dir=tuple(pole)))
    half = box(-40, 40, -40, 40, 0, 40)

    def shell(outer, inner):
        return (Solid.make_sphere(outer) - Solid.make_sphere(inner)).intersect(half)

    dome, foil = only_solid(shell(r, r - wall)), only_solid(shell(r - wall, r - wall - d.copper_wall))
    out = []
    for k in range(5):
        a, b = radians(d.hole_polar if k else 0.0), radians(90 * (k - 1))
        axis = (sin(a) * cos(b), sin(a) * sin(b), cos(a))
        start = tuple((r - d.grommet_height) * np.array(axis))
        dome -= cyl((0, 0, 0), axis, d.grommet, 30)
        foil -= cyl((0, 0, 0), axis, d.grommet + 0.2, 30)
        seal = pipe(start, axis, d.hole_radius, d.grommet, d.grommet_height)
        out.append((f"seal{k + 1}", seal.moved(tilted), "orange_plastic"))
    rim = pipe((0, 0, -d.holder_depth), Z, r - wall, r + d.holder_wall, d.holder_depth)
    floor = cyl((0, 0, -d.holder_depth - 3), Z, r + d.holder_wall, 3)
    x, z = at[0], d.bench_high + d.mount_height
    neck = cyl((x, 0, z + d.plate_height), Z, d.post_radius, at[2] - z - d.plate_height - d.holder_depth)
    neck = neck - cyl((0, 0, -d.holder_depth - 0.5), Z, 40, 80).moved(tilted)
    return [
        ("shell", dome.moved(tilted), "white_plastic"),
        ("foil", foil.moved(tilted), "copper"),
        *out,
        ("holder", (rim + floor).moved(tilted), "grey_aluminium"),
        ("post", only_solid(neck), "grey_aluminium"),
        ("foot", foot(d, x, d.plate_radius), "dark_steel"),
    ]


def microscope(d, eye_x):
    """Draw the microscope: a column, an arm, and a tube that points down at the eye."""
    x, z = d.scope_x, d.bench_high + d.mount_height + d.plate_height
    column = cyl((x, 0, z), Z, d.scope_column, d.scope_top - z)
    column = column.fillet(3, column.edges().group_by(Axis.Z)[-1])
    mid = d.scope_top - 30
    h, t = d.scope_arm, d.scope_tube
    beam = box(eye_x, x + 18, -h, h, mid - h, mid + h) - cyl((eye_x, 0, 0), Z, t, 600)
    beam -= cyl((x, 0, 0), Z, d.scope_column, 600)
    tube = cyl((eye_x, 0, d.scope_low), Z, t, d.scope_top - d.scope_low)
    tube = tube.fillet(4, tube.edges().group_by(Axis.Z)[-1])
    tube -= cyl((eye_x, 0, d.scope_low), Z, d.scope_lens, 4)
    lens = cyl((eye_x, 0, d.scope_low + 1), Z, d.scope_lens, 3)
    out = []
    for k, side in ((1, 10.5), (2, -10.5)):
        plane = Plane(origin=(eye_x - 6, side, d.scope_top), z_dir=(-sin(0.6), 0, cos(0.6)))
        eyepiece = Solid.make_cylinder(8, 46, plane) - box(-1000, 1000, -200, 200, 0, d.scope_top - 0)
        out.append((f"eyepiece{k}", only_solid(eyepiece), "plastic"))
    knob = cyl((x, h, mid), Y, 9, 14)
    return [
        ("column", column, "grey_aluminium"),
        ("foot", foot(d, x, d.scope_plate), "dark_steel"),
        ("arm", only_solid(beam), "white_plastic"),
        ("tube", tube, "white_plastic"),
        ("lens", lens, "glass"),
        *out,
        ("knob", knob, "plastic"),
    ]


def only_solid(shape):
    """Return the only solid of a shape that is the result of a cut."""
    return shape if isinstance(shape, Solid) else shape.solids()[0]
