"""Parts of the SILS robot, each body drawn in its own frame.

Body frames (mm):
    frame      the world frame
    limbN      x = r (radial), y = t (tangential), z = a (axis of the rail); origin at the axial zero of rail N
    carriageK  axes of its limb; origin on the axis of the rail, at the height of the pivot
    strutN     x from the carriage pivot to the apex, z = t
    barN       x from the carriage pivot to the ball, z = t
    platform   origin E, instruments along -z
"""

from math import cos, radians, sin, sqrt

import numpy as np
from build123d import Axis, Location, Plane, Solid
from shapes import METAL_AND_PLASTIC, X, Y, Z, box, cyl, hull, joint, pipe, prism

MATERIALS = METAL_AND_PLASTIC


# ---- shapes -----------------------------------------------------------------
def hexagon(at, axis, r, h):
    """Return a hexagonal prism; r is half of the width across corners."""
    corners = [(r * cos(radians(60 * k)), r * sin(radians(60 * k))) for k in range(6)]
    return prism(corners, h, Plane(origin=at, z_dir=axis))


def screw(d, at, axis):
    """Return the head of a cap screw, with a round socket."""
    head = cyl(at, axis, d.bolt_radius, d.bolt_height)
    top = np.array(at, float) + np.array(axis) * (d.bolt_height - d.bolt_socket)
    return head - cyl(tuple(top), axis, d.bolt_socket, d.bolt_socket)


# ---- frame ------------------------------------------------------------------
def profile(d, side, length, hollow):
    """Return an extruded profile along z, centred in x and y, with a slot in each side."""
    h, w = side / 2, d.profile_slot / 2
    solid = box(-h, h, -h, h, 0, length, d.profile_corner)
    for k in range(4):
        slot = box(h - d.profile_slot_depth, h + 1, -w, w, -1, length + 1)
        solid -= slot.moved(Location((0, 0, 0), (0, 0, 90 * k)))
    return solid - box(-hollow / 2, hollow / 2, -hollow / 2, hollow / 2, -1, length + 1)


def gusset(d, plane, leg):
    """Return a triangular plate with blunt corners and its legs along x and y of the plane."""
    t, n = d.gusset_thickness, d.gusset_nose
    solid = prism([(0, 0), (leg, 0), (leg, n), (n, leg), (0, leg)], t)
    at = 0.3 * leg
    return (solid - cyl((at, at, -1), Z, d.gusset_hole, t + 2)).moved(Location(plane))


def pillow(d, start, length, thrust, radius):
    """Return (pillow block, bush) around z, for a column on the side of -x."""
    lower = start if thrust is None else thrust - d.bearing_flange_height - length
    back, web = d.portal_front, d.block_web
    body = cyl((0, 0, lower), Z, radius, length)
    body += box(back, 0, -web, web, lower, lower + length)
    front, half = back + d.block_base_height, d.block_base
    body += box(back, front, -half, half, lower, lower + length, d.base_corner, Axis.X)
    for side in (-1, 1):
        body += screw(d, (front, side * d.bolt_spread, lower + length / 2), X)
    body -= cyl((0, 0, lower - 1), Z, d.bearing_outer, length + 2)
    bush = pipe((0, 0, lower), Z, d.bearing_bore, d.bearing_outer, length)
    if thrust is not None:
        bush += pipe((0, 0, lower + length), Z, d.bearing_bore, d.bearing_flange, d.bearing_flange_height)
    return body, bush


def frame(d):
    """Draw the frame: portal with feet, pillow blocks, datum plate and drive cabinets."""
    out = []
    half, front = d.profile / 2, d.portal_front
    mid = front - half
    floor = d.column_foot - d.profile
    beam_low = d.LV - half  # the beam lies behind rail 2
    column = profile(d, d.profile, beam_low - d.column_foot, d.profile_bore)
    for n, y in ((1, 0.0), (3, d.LH)):
        out.append((f"column{n}", column.moved(Location((mid, y, d.column_foot))), "aluminium"))
        foot = profile(d, d.profile, d.foot_front - d.foot_back, d.profile_bore)
        lying = Location(Plane(origin=(d.foot_back, y, floor + half), x_dir=Y, z_dir=X))
        out.append((f"foot{n}", foot.moved(lying), "aluminium"))
        for m, (x, way) in enumerate(((d.foot_front, 1), (d.foot_back, -1))):
            low, high = sorted((x, x + way * d.cap_thickness))
            cap = box(low, high, y - half, y + half, floor, floor + d.profile, d.profile_corner, Axis.X)
            out.append((f"foot{n}_cap{m}", cap, "plastic"))
            at = x - way * d.pad_inset
            stem = cyl((at, y, floor - d.pad_height), Z, d.pad_radius, d.pad_height * 0.45)
            stem += cyl((at, y, floor - d.pad_height), Z, d.stem_radius, d.pad_height)
            out.append((f"foot{n}_pad{m}", stem, "dark_steel"))
        t = d.gusset_thickness
        ahead = Plane(origin=(front, y + t / 2, d.column_foot), x_dir=X, z_dir=(0, -1, 0))
        behind = Plane(origin=(front - d.profile, y - t / 2, d.column_foot), x_dir=(-1, 0, 0), z_dir=Y)
        inward = 1 if y == 0 else -1
        corner = (mid + inward * t / 2, y + inward * half, beam_low)
        under = Plane(origin=corner, x_dir=(0, inward, 0), z_dir=(-inward, 0, 0))
        out.append((f"gusset{n}_front", gusset(d, ahead, d.gusset), "blue_aluminium"))
        out.append((f"gusset{n}_back", gusset(d, behind, d.gusset), "blue_aluminium"))
        out.append((f"gusset{n}_beam", gusset(d, under, d.gusset), "blue_aluminium"))
        back = front - d.profile
        low, width = d.cabinet_low, d.cabinet_width / 2
        rear, high = back - d.cabinet_depth, low + d.cabinet_height
        case = box(rear, back, y - width, y + width, low, high, d.cabinet_corner, Axis.X)
        out.append((f"cabinet{n}", case, "white_plastic"))
        for k in range(3):
            at = (back - d.cabinet_depth / 2, y + (k - 1) * width / 2, low - d.cabinet_gland_length)
            gland = cyl(at, Z, d.cabinet_gland, d.cabinet_gland_length)
            out.append((f"cabinet{n}_gland{k + 1}", gland, "plastic"))
        m, face = d.door_margin, rear - d.door_thickness
        door = box(face, rear, y - width + m, y + width - m, low + m, high - m, d.cabinet_corner, Axis.X)
        knob = (face - d.knob_height, y + inward * (width - 2 * m), low + d.cabinet_height / 2)
        out.append((f"cabinet{n}_door", door, "blue_aluminium"))
        out.append((f"cabinet{n}_knob", cyl(knob, X, d.knob_radius, d.knob_height), "plastic"))
    beam = profile(d, d.profile, d.LH + 2 * d.beam_overhang, d.profile_bore)
    lying = Location(Plane(origin=(mid, -d.beam_overhang, d.LV), x_dir=X, z_dir=Y))
    out.append(("beam", beam.moved(lying), "aluminium"))
    for n, y in ((1, -d.beam_overhang - d.cap_thickness), (3, d.LH + d.beam_overhang)):
        ends = (y, y + d.cap_thickness)
        cap = box(front - d.profile, front, *ends, d.LV - half, d.LV + half, d.profile_corner, Axis.Y)
        out.append((f"beam_cap{n}", cap, "plastic"))
    tie = profile(d, d.tie_profile, d.LH - d.profile, d.tie_profile / 2)
    lying = Location(Plane(origin=(mid, half, d.tie_low), x_dir=X, z_dir=Y))
    out.append(("tie", tie.moved(lying), "aluminium"))

    y, w, h = d.LH / 2, d.datum_width / 2, d.datum_height / 2
    plate = box(front, d.datum_front, y - w, y + w, d.LV - h, d.LV + h, d.datum_corner, Axis.X)
    for dy in (-1, 1):
        for dz in (-1, 1):
            at = (front - 1, y + dy * (w - d.datum_inset), d.LV + dz * (h - d.datum_inset))
            plate -= cyl(at, X, d.datum_hole, 50)
    out.append(("datum", plate, "steel"))

    rail2 = Location(Plane(origin=(0, 0, d.LV), x_dir=X, z_dir=Y))
    for n, where in ((1, Location((0, 0, 0))), (2, rail2), (3, Location((0, d.LH, 0)))):
        r = d.block_radius
        if n == 2:  # the horizontal rail
            low = pillow(d, None, d.h_block_low, d.h_thrust, r + 2)
            high = pillow(d, d.h_block_high_start, d.h_block_high, None, r + 2)
        else:
            low = pillow(d, None, d.v_block_low, d.v_thrust, r + 2)
            high = pillow(d, d.v_block_high_start, d.v_block_high, None, r)
        for end, (body, bush) in (("low", low), ("high", high)):
            out.append((f"rail{n}_block_{end}", body.moved(where), "grey_aluminium"))
            out.append((f"rail{n}_bush_{end}", bush.moved(where), "bronze"))
    return out


# ---- limbs ------------------------------------------------------------------
def limb(d, n):
    """Draw the limb: a rail with flat, thrust collar, lock nut and end stop."""
    flat = n == 2
    thrust, shoulder = (d.h_thrust, d.h_shoulder) if flat else (d.v_thrust, d.v_shoulder)
    bottom, top = (d.h_bottom, d.h_top) if flat else (d.v_bottom, d.v_top)
    start, end = thrust + d.collar_height, shoulder - d.stop_gap - d.stop_height
    shaft = cyl((0, 0, thrust), Z, d.rail_radius, shoulder - thrust)
    if flat:
        shaft -= pipe((0, 0, d.h_zero), Z, d.groove_radius, d.rail_radius + 1, d.groove_width)
    r = d.rail_radius
    shaft -= box(d.rail_flat, r + 2, -r, r, start + d.flat_margin * 0.3, end - d.flat_margin)
    low = cyl((0, 0, bottom), Z, d.journal_radius, thrust - bottom)
    high = cyl((0, 0, shoulder), Z, d.journal_radius, top - shoulder)
    low = low.chamfer(d.rail_chamfer, None, [low.edges().group_by(Axis.Z)[0][0]])
    high = high.chamfer(d.rail_chamfer, None, [high.edges().group_by(Axis.Z)[-1][0]])
    shaft = shaft + low + high
    collar = pipe((0, 0, thrust), Z, d.rail_radius, d.collar_radius, d.collar_height)
    block = d.h_block_low if flat else d.v_block_low
    under = thrust - d.bearing_flange_height - block - d.nut_height
    nut = hexagon((0, 0, under), Z, d.nut_radius, d.nut_height) - cyl((0, 0, under), Z, d.journal_radius, d.nut_height)
    stop = pipe((0, 0, end), Z, d.rail_radius, d.stop_radius, d.stop_height)
    return [
        ("shaft", shaft, "steel"),
        ("collar", collar, "dark_steel"),
        ("nut", nut, "dark_steel"),
        ("stop", stop, "orange_plastic"),
    ]


# ---- carriages --------------------------------------------------------------
def pin(d, sign, back, front, where):
    """Return (pin, retaining ring): head at `back`, ring beyond `front`, both measured along sign * z."""
    lo = back - d.pin_head_height
    hi = front + d.clip_gap
    axis = (0, 0, sign)
    body = cyl((0, 0, sign * lo), axis, d.pin_head, d.pin_head_height)
    body += cyl((0, 0, sign * lo), axis, d.pin_radius, hi + d.clip_height + d.pin_end - lo)
    clip = pipe((0, 0, sign * hi), axis, d.pin_radius, d.clip_radius, d.clip_height)
    return body.moved(where), clip.moved(where)


def carriage(d, n, err):
    """Draw a carriage: hub (tubular motor), arm, and pivot pin with thrust washer and retaining ring."""
    even = n % 2 == 0
    hh, cap = d.hub_half, d.hub_cap
    eye, reach = d.eye_half, d.eye_half + d.washer
    out_, along = err("pin_offset_mm", (0, 0))
    where = joint((err("l0_mm", d.l0), 0, 0), Y, X, (out_, -along), _swap(err("pin_tilt_deg", 0.0)))
    if even:  # arm beyond the washer on the -t side
        y1, sign, back, front = -reach, 1, reach + d.arm, eye
    else:  # arm in the plane of the bar, washer towards the strut
        y1, sign, back, front = eye, -1, eye, reach + d.plate
    washer = pipe((0, 0, -reach), Z, d.pin_radius, d.washer_radius, d.washer)
    body, clip = pin(d, sign, -back, front, where)

    hub = cyl((0, 0, -hh + cap), Z, d.hub_radius, 2 * (hh - cap))
    for k in (-1.5, -0.5, 0.5, 1.5):
        z = k * d.fin_pitch - d.fin_width / 2
        hub -= pipe((0, 0, z), Z, d.hub_radius - d.fin_depth, d.hub_radius + 1, d.fin_width)
    plane = Plane(origin=(0, y1, 0), x_dir=X, z_dir=(0, -1, 0))
    arm = hull([(d.arm_start, 0, d.arm_root), (d.l0, 0, d.arm_eye)], plane, d.arm, d.arm_chamfer)
    w = d.arm_window
    arm -= hull(
        [(d.window_start, 0, w), (d.window_end, 0, d.window_tip)],
        Plane(origin=(0, y1 + 1, 0), x_dir=X, z_dir=(0, -1, 0)),
        d.arm + 2,
    )
    gland = cyl((0, 0, 0), (-1, 0, 0), d.gland_radius, d.gland_reach)
    block = hub + arm + gland
    block -= cyl((0, 0, -hh), Z, d.hub_liner, 2 * hh)
    block -= cyl((0, 0, -50), Z, d.pin_radius, 100).moved(where)
    axis = joint((0, 0, 0), Z, X, err("bore_offset_mm", (0, 0)), err("bore_tilt_deg", 0.0))
    hole = cyl((0, 0, -50), Z, d.hub_bore, 100) - box(d.hub_flat, 20, -20, 20, -60, 60)
    liner = cyl((0, 0, -hh), Z, d.hub_liner, 2 * hh) - hole.moved(axis)
    out = [("block", block, "blue_aluminium" if even else "grey_aluminium"), ("liner", liner, "bronze")]
    for name, z in (("cap_low", -hh), ("cap_high", hh - cap)):
        lid = pipe((0, 0, z), Z, d.hub_liner, d.hub_cap_radius, cap)
        face = z if z < 0 else z + cap / 2
        for k in range(4):
            a = radians(45 + 90 * k)
            lid -= cyl((d.hub_screw_circle * cos(a), d.hub_screw_circle * sin(a), face), Z, d.hub_screw, cap / 2)
        out.append((name, lid, "plastic"))
    return [
        *out,
        ("pin", body, "steel"),
        ("washer", washer.moved(where), "bronze"),
        ("clip", clip, "dark_steel"),
    ]


def _swap(tilt):
    """Return a tilt [about r, about a] as angles about x = r and y = -a of the joint frame."""
    return [tilt[0], -tilt[1]] if isinstance(tilt, (list, tuple)) else tilt


# ---- struts and bars --------------------------------------------------------
def strut(d, err):
    """Draw the strut, a link beside the bar (on the side of negative t), with a pressed-in apex pin."""
    top = -d.eye_half - d.washer
    low, length = top - d.plate, err("l1_mm", d.l1)
    e, s = d.strut_eye, d.strut_slot
    web = box(0, length, -d.strut_waist, d.strut_waist, low, top)
    body = web + cyl((0, 0, low), Z, e, d.plate) + cyl((length, 0, low), Z, e, d.plate)
    inset = d.strut_slot_inset
    slot = hull([(inset, 0, s), (length - inset, 0, s)], Plane(origin=(0, 0, low - 1)), d.plate + 2)
    pivot = joint((0, 0, 0), Z, X, err("pivot_bore_offset_mm", (0, 0)), err("pivot_bore_tilt_deg", 0.0))
    apex = joint((length, 0, 0), Z, X, err("apex_pin_offset_mm", (0, 0)), err("apex_pin_tilt_deg", 0.0))
    body = body - slot - cyl((0, 0, low - 1), Z, d.bush_radius, d.plate + 2)
    body -= cyl((0, 0, -50), Z, d.pin_radius, 100).moved(apex)
    bush = cyl((0, 0, low), Z, d.bush_radius, d.plate) - cyl((0, 0, -50), Z, d.pin_bore, 100).moved(pivot)
    shaft, clip = pin(d, 1, low, d.eye_half, apex)
    washer = pipe((0, 0, top), Z, d.pin_radius, d.washer_radius, d.washer).moved(apex)
    return [
        ("link", body, "grey_aluminium"),
        ("bush", bush, "bronze"),
        ("apex_pin", shaft, "steel"),
        ("apex_washer", washer, "bronze"),
        ("apex_clip", clip, "dark_steel"),
    ]


def bar(d, err):
    """Draw the bar: a rod with pivot eye, apex eye, ferrule and ball stud."""
    apex_at = err("l1_mm", d.l1)
    ball_at = apex_at + err("l2_mm", d.l2)
    off = err("ball_offset_mm", (0, 0, 0))
    h, end = d.eye_half, ball_at - d.stud_start
    rod = cyl((0, 0, 0), X, d.bar_radius, end - d.ferrule_length)
    rod += cyl((0, 0, -h), Z, d.bar_eye, 2 * h)
    rod += cyl((apex_at, 0, -h), Z, d.bar_apex, 2 * h)
    for at in (0, apex_at):
        for lo, hi in ((h, 20), (-20, -h)):
            rod -= box(at - d.bar_flat, at + d.bar_flat, -20, 20, lo, hi)
    out = []
    for name, at in (("pivot", 0), ("apex", apex_at)):
        where = joint((at, 0, 0), Z, X, err(f"{name}_bore_offset_mm", (0, 0)), err(f"{name}_bore_tilt_deg", 0.0))
        rod -= cyl((at, 0, -20), Z, d.bush_radius, 40)
        bush = cyl((at, 0, -h), Z, d.bush_radius, 2 * h) - cyl((0, 0, -50), Z, d.pin_bore, 100).moved(where)
        out.append((f"{name}_bush", bush, "bronze"))
    ferrule = cyl((end - d.ferrule_length, 0, 0), X, d.ferrule_radius, d.ferrule_length)
    ferrule = ferrule.chamfer(d.ferrule_chamfer, None, ferrule.edges().group_by(Axis.X)[0])
    stud = hexagon((end, 0, 0), X, d.stud_hex, d.stud_hex_height)
    stud += cyl((end, 0, 0), X, d.neck_radius, d.stud_start)
    ball = Solid.make_sphere(d.ball_radius, Plane(origin=(ball_at + off[0], off[1], off[2]), z_dir=X))
    return [
        ("rod", rod, "aluminium"),
        *out,
        ("ferrule", ferrule, "dark_steel"),
        ("ball", stud + ball, "steel"),
    ]


# ---- platform ---------------------------------------------------------------
def bare_platform(d, err):
    """Return the plate, and the parts (ball cups, laparoscope with camera head) of a platform without instruments."""
    third = d.lp / sqrt(3)
    nominal = [(third / 2, -d.lp / 2), (-third, 0.0), (third / 2, d.lp / 2)]
    top, low = d.plate_top, d.plate_top - d.plate_thickness
    order = (0, 2, 1)  # counter-clockwise
    plate = hull(
        [(*nominal[k], d.plate_corner) for k in order], Plane(origin=(0, 0, low)), d.plate_thickness, d.plate_chamfer
    )
    plate -= cyl((0, 0, low - 1), Z, d.scope_radius, d.plate_thickness + 2)
    plate -= cyl((d.plate_window_at, 0, low - 1), Z, d.plate_window, d.plate_thickness + 2)
    out = []
    for n in (1, 2, 3):
        x, y = nominal[n - 1]
        off = err(f"s{n}_offset_mm", (0, 0, 0))
        at = (x + off[0], y + off[1], off[2])
        p, a, o = radians(d.cup_polar[n - 1]), radians(d.cup_azimuth[n - 1]), d.cup_outer
        axis = (sin(p) * cos(a), sin(p) * sin(a), cos(p))
        cup = Solid.make_sphere(o, Plane(origin=(x, y, 0))) + cyl((x, y, top), Z, d.cup_post, -top)
        depth = o / 3
        cut = Solid.make_cone(0, depth * np.tan(radians(d.cup_opening)), depth, Plane(origin=at, z_dir=axis))
        rim = np.array(at) + depth * np.array(axis)
        cup -= cut + cyl(tuple(rim), axis, 2 * o, 2 * o)
        out.append((f"cup{n}", cup - Solid.make_sphere(d.cup_radius, Plane(origin=at)), "steel"))

    tip = err("scope_tip_mm", d.scope_tip)
    scope = cyl((0, 0, tip), Z, d.scope_radius, d.scope_top - tip)
    scope -= cyl((0, 0, tip), Z, d.lens_radius, d.lens_recess + d.lens_depth)
    lens = cyl((0, 0, tip + d.lens_recess), Z, d.lens_radius, d.lens_depth)
    clamp = pipe((0, 0, top), Z, d.scope_radius, d.clamp_radius, d.clamp_height)
    lug = d.clamp_radius + d.clamp_lug
    clamp += box(d.scope_radius + 2, lug, -d.clamp_lug_half, d.clamp_lug_half, top, top + d.clamp_height)
    clamp -= box(0, 40, -d.clamp_slit / 2, d.clamp_slit / 2, top - 1, top + d.clamp_height + 1)
    clamp -= cyl((lug - d.clamp_lug / 2, -20, top + d.clamp_height / 2), Y, d.clamp_screw, 40)
    clamp -= cyl((0, 0, top - 1), Z, d.scope_radius, 60)
    s, n = d.scope_top, d.camera_neck
    focus = cyl((0, 0, s), Z, n, n)
    light = cyl((n - 2, 0, s + n / 2), X, d.light_radius, d.light_reach - n + 2)
    head = cyl((0, 0, s + n), Z, d.camera_radius, d.camera_length)
    head = head.fillet(d.camera_fillet, head.edges().group_by(Axis.Z)[-1])
    panel = d.camera_radius - d.panel_depth
    middle = s + n + d.panel_at
    head -= box(panel, 30, -30, 30, middle - d.panel_half, middle + d.panel_half)
    cable = cyl((0, 0, s + n + d.camera_length), Z, d.cable_radius, d.cable_length)
    keys = [cyl((panel, 0, middle + k * d.key_pitch), X, d.key_radius, d.key_height) for k in (-1, 0, 1)]
    out += [
        ("scope", scope, "steel"),
        ("lens", lens, "glass"),
        ("clamp", clamp, "grey_aluminium"),
        ("focus", focus + light, "dark_steel"),
        ("camera", head, "white_plastic"),
        ("cable", cable, "plastic"),
    ]
    out += [(f"key{k + 1}", key, "orange_plastic") for k, key in enumerate(keys)]
    return plate, out


def platform(d, err):
    """Draw the platform: a plate, three ball cups, a laparoscope with camera head, and two rigid instrument modules."""
    plate, out = bare_platform(d, err)
    top = d.plate_top
    tilt = radians(d.tool_tilt)
    for n, a in ((1, radians(d.tool_azimuth)), (2, -radians(d.tool_azimuth))):
        out_, side = np.array([cos(a), sin(a), 0.0]), np.array([-sin(a), cos(a), 0.0])
        base = -d.tool_rcm * np.tan(tilt) * out_ + d.tool_offset * side
        up = sin(tilt) * out_ + cos(tilt) * np.array([0, 0, 1.0])
        where = Location(Plane(origin=tuple(base), x_dir=tuple(side), z_dir=tuple(up)))
        hole = cyl((0, 0, -80), Z, d.tool_hole, 160).moved(where)
        plate -= hole
        seat = cyl((base[0], base[1], top), Z, d.seat_radius, d.seat_top - top)
        seat = seat - cyl((0, 0, 0), Z, d.module_radius, 60).moved(where) - hole
        r, length = d.module_radius, d.module_length
        body = cyl((0, 0, 0), Z, r, length)
        g = d.module_groove
        for z in (d.module_groove_low, d.module_groove_high):
            body -= pipe((0, 0, z), Z, r - g / 2, r + 1, g)
        body -= box(-r, r, r - g, r + 1, d.module_groove_low + 2 * g, d.module_groove_high - g)
        motors = cyl((0, 0, length), Z, r, d.motor_plate)
        for k in range(3):
            b = radians(90 + 120 * k)
            at = (d.motor_circle * cos(b), d.motor_circle * sin(b), length)
            motors += cyl(at, Z, d.motor_radius, d.motor_plate + d.motor_length)
        shaft = cyl((0, 0, -d.tool_length), Z, d.tool_radius, d.tool_length)
        jaws = []
        for way in (1, -1):
            w = d.jaw_width / 2
            jaw = prism(
                [(d.jaw_gap, w), (d.jaw_gap, 0), (d.jaw_length, 0), (d.jaw_length, w / 2)],
                d.jaw_width,
                Plane(origin=(0, -w, -d.tool_length), x_dir=(0, 0, -1), z_dir=Y),
            )
            jaw = jaw.moved(Location((0, 0, 0), (0, 0, 0 if way > 0 else 180)))
            hinge = (
                Location((0, 0, -d.tool_length))
                * Location((0, 0, 0), (0, way * d.jaw_open, 0))
                * Location((0, 0, d.tool_length))
            )
            jaws.append(jaw.moved(hinge))
        out += [
            (f"tool{n}_seat", seat, "grey_aluminium"),
            (f"tool{n}_module", body.moved(where), "white_plastic"),
            (f"tool{n}_motors", motors.moved(where), "dark_steel"),
            (f"tool{n}_shaft", shaft.moved(where), "steel"),
        ]
        out += [(f"tool{n}_jaw{k + 1}", jaw.moved(where), "steel") for k, jaw in enumerate(jaws)]
    return [("plate", plate, "blue_aluminium"), *out]
