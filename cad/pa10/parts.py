"""Parts of the PA-10, each body drawn in the world frame (frame 0) with all joints at zero: the arm points straight up.

The seats of roll joints (1, 3, 5, 7) are perpendicular to the axis of the arm. At a pitch joint (2, 4, 6), a drum of
the next link is between the two cheeks of a fork of the previous link; the cheek on the side of -y locates the drum.

Every function returns a list of ``(part name, solid, material)``.
"""

from build123d import Axis, Plane, Solid
from shapes import X, Y, Z, bolts, cone, cyl, flange, flat, hull, polar, seat, soft

BACK = (0, -1, 0)
MATERIALS = {  # sRGB, density in kg/m3
    "cast": ((0.88, 0.88, 0.85), 1700),
    "grey": ((0.66, 0.68, 0.69), 1700),
    "cap": ((0.20, 0.22, 0.25), 1700),
    "steel": ((0.70, 0.72, 0.75), 7850),
    "flange": ((0.11, 0.12, 0.13), 7850),
    "trim": ((0.16, 0.36, 0.62), 3300),
}


# ---- shapes -----------------------------------------------------------------
def slot(half, low, high, long, radius):
    """Return the gap of a fork, to be subtracted: `half` width along y, z from low to high, lower edges rounded."""
    block = Solid.make_box(2 * long, 2 * half, high - low, Plane(origin=(-long, -half, low)))
    return block.fillet(radius, block.edges().filter_by(Axis.X).group_by(Axis.Z)[0])


def fork(d, n, z, foot, r_foot, height, deep):
    """Return the fork of joint n at height z, which continues a round stem; it has a bore and a recess for the seat.

    `foot` and `r_foot` are the height and the radius of the stem's end, `height` is the height of the seat, and `deep`
    is the length of the journal in its bore.
    """
    half, thick, r = getattr(d, f"gap{n}"), getattr(d, f"cheek{n}"), getattr(d, f"fork{n}")
    waist, low = getattr(d, f"waist{n}"), z - getattr(d, f"crotch{n}")
    wide = half + thick
    block = hull([(0, 0, r), (0, z - foot, waist)], Plane(origin=(0, -wide, z), x_dir=X, z_dir=Y), 2 * wide)
    for end in (0, -1):
        block = soft(block, Axis.Y, thick / 4, end)
    grown, rise = 1.45 * wide, 0.8 * (low - foot) + 0.35 * thick
    block &= cone((0, 0, foot), Z, r_foot, grown, rise) + cyl((0, 0, foot + rise), Z, grown, z + r + 1 - foot - rise)
    block -= slot(half, low, z + r + 1, wide + r, thick / 2)
    journal = getattr(d, f"j{n}")
    block -= cyl((0, -half - height, z), Y, getattr(d, f"r{n}"), height + 1)
    block -= cyl((0, -half - deep - 0.5, z), Y, journal + 0.5, deep)
    return block - cyl((0, half - 1, z), Y, journal + 0.5, deep + 1.5)


def drum(d, n, z, tube, height, deep, err):
    """Return (disc with journal, drum joined to the `tube`, opposite disc) of joint n at height z.

    Where the tube is wider than the drum, it is cut out around the discs so that they can rotate.
    """
    half, r, journal = getattr(d, f"gap{n}"), getattr(d, f"r{n}"), getattr(d, f"j{n}")
    foot = flange((0, -half, z), Y, r, journal, height, deep, err(f"journal{n}_offset_mm", (0, 0)))
    end = half - d.gap
    body = cyl((0, height - half, z), Y, getattr(d, f"drum{n}"), end - 2 * height + half)
    body = body.chamfer(2, None, [*body.edges().group_by(Axis.Y)[0], *body.edges().group_by(Axis.Y)[-1]])
    for at, way in ((height - half, BACK), (end - height, Y)):
        tube -= cyl((0, at, z), way, r + d.gap, 2 * height)
    disc = cyl((0, end - height, z), Y, r, height) + cyl((0, end - 1, z), Y, journal, deep)
    return foot, body + tube, disc


def cover(name, at, axis, r, h):
    """Draw the motor cover of a joint on the outside of a cheek: a disc with a dome, and six bolts."""
    disc = cyl(at, axis, r, 0.3 * h)
    dome = soft(cyl(at, axis, 0.78 * r, h), Axis.Y, 0.55 * h, -1 if axis == Y else 0)
    top = [at[i] + 0.3 * h * axis[i] for i in range(3)]
    heads = bolts(top, axis, 0.89 * r, 6, 0.055 * r, 0.05 * r)
    return [(name, disc + dome, "cap"), *((f"{name}_bolt{k}", b, "steel") for k, b in enumerate(heads, 1))]


def covers(d, n, z, h):
    """Draw the covers of both cheeks of a fork."""
    wide, r = getattr(d, f"gap{n}") + getattr(d, f"cheek{n}"), 0.86 * getattr(d, f"fork{n}")
    return [*cover(f"cover{n}_left", (0, wide, z), Y, r, h), *cover(f"cover{n}_right", (0, -wide, z), BACK, r, h)]


def stem(low, high, r0, r1, collar):
    """Return the tube on the flange of a roll joint; it begins with a cone from radius `collar` to r0."""
    rise = 1.2 * (collar - r0)
    return cone((0, 0, low), Z, collar, r0, rise) + cone((0, 0, low + rise), Z, r0, r1, high - low - rise)


def roll_seat(d, n, height, err):
    """Return the seat of roll joint n on the axis of the arm."""
    at = (0, 0, getattr(d, f"hub{n}"))
    return seat(at, Z, getattr(d, f"r{n}"), getattr(d, f"j{n}"), height, err(f"bore{n}_offset_mm", (0, 0)))


def pitch_seat(d, n, z, height, err):
    """Return the seat of pitch joint n in its cheek."""
    at = (0, -getattr(d, f"gap{n}"), z)
    return seat(at, Y, getattr(d, f"r{n}"), getattr(d, f"j{n}"), height, err(f"bore{n}_offset_mm", (0, 0)))


def roll_flange(d, n, height, deep, err):
    """Return the flange and the journal of roll joint n."""
    at = (0, 0, getattr(d, f"hub{n}"))
    return flange(at, Z, getattr(d, f"r{n}"), getattr(d, f"j{n}"), height, deep, err(f"journal{n}_offset_mm", (0, 0)))


# ---- bodies -----------------------------------------------------------------
def base(d, err):
    """Draw the base: mounting plate with bolts, conical column with a cable socket, and seat of joint 1."""
    low, high = -d.shoulder_high, d.hub1
    plate = soft(cyl((0, 0, low), Z, d.base_radius, d.plate), Axis.Z, 4)
    foot, collar = low + d.plate, high - d.seat - d.rib
    body = cone((0, 0, foot), Z, d.column, d.r1 - 4, collar - foot) + cyl((0, 0, collar), Z, d.r1 - 4, d.rib)
    z = foot + d.plug_high
    body += cyl((0, 0, z), (-1, 0, 0), d.plug + 5, d.column + 4)
    body -= cyl((0, 0, high - d.seat - d.deep), Z, d.j1 + 1, d.deep + 2)
    plug = soft(cyl((-d.column - 4, 0, z), (-1, 0, 0), d.plug, 12), Axis.X, 3, 0)
    heads = bolts((0, 0, foot), Z, (d.column + d.base_radius) / 2 - 1, 8, 5, 5)
    return [
        ("plate", plate, "grey"),
        ("column", body, "cast"),
        ("seat1", roll_seat(d, 1, d.seat, err), "cap"),
        ("plug", plug, "cap"),
        *((f"bolt{k}", b, "steel") for k, b in enumerate(heads, 1)),
    ]


def link1(d, err):
    """Draw the shoulder: the flange of joint 1 and the fork of joint 2."""
    body = fork(d, 2, 0.0, d.hub1 + d.seat, d.r1 - 3, d.seat, d.deep)
    return [
        ("flange1", roll_flange(d, 1, d.seat, d.deep, err), "grey"),
        ("shoulder", body, "cast"),
        ("seat2", pitch_seat(d, 2, 0.0, d.seat, err), "cap"),
        *covers(d, 2, 0.0, 22),
    ]


def lower(d, err, n, name, z, tube, height, deep):
    """Draw the link of pitch joint n at height z: its drum, and a tube up to the seat of the next roll joint."""
    foot, body, disc = drum(d, n, z, tube, height, deep, err)
    hole = getattr(d, f"hub{n + 1}") - height - deep
    body -= cyl((0, 0, hole), Z, getattr(d, f"j{n + 1}") + 1, deep + 1)
    return [
        (f"flange{n}", foot, "cap"),
        (name, body, "cast"),
        (f"disc{n}", disc, "cap"),
        (f"seat{n + 1}", roll_seat(d, n + 1, height, err), "cap"),
    ]


def upper(d, err, n, name, z, height, deep, cap):
    """Draw the link of roll joint n: its flange, a tube, and the fork of the next pitch joint at height z."""
    low, waist = z - getattr(d, f"foot{n + 1}"), getattr(d, f"waist{n + 1}") - 1
    body = fork(d, n + 1, z, low, waist, height, deep)
    body += stem(getattr(d, f"hub{n}") + d.seat, low, getattr(d, f"tube{n}"), waist, getattr(d, f"r{n}") - 2)
    return [
        (f"flange{n}", roll_flange(d, n, d.seat, d.deep, err), "grey"),
        (name, body, "cast"),
        (f"seat{n + 1}", pitch_seat(d, n + 1, z, height, err), "cap"),
        *covers(d, n + 1, z, cap),
    ]


def link2(d, err):
    """Draw the lower half of the upper arm."""
    tube = cone((0, 0, 0), Z, d.tube2, d.tube2 - 3, d.hub3 - d.seat)
    return lower(d, err, 2, "arm", 0.0, tube, d.seat, d.deep)


def link3(d, err):
    """Draw the upper half of the upper arm."""
    return upper(d, err, 3, "upper_arm", d.elbow, d.seat, d.deep, 18)


def link4(d, err):
    """Draw the lower half of the forearm."""
    tube = cyl((0, 0, d.elbow), Z, d.tube4, d.hub5 - d.seat - d.elbow)
    return lower(d, err, 4, "arm", d.elbow, tube, d.seat, d.deep)


def link5(d, err):
    """Draw the upper half of the forearm."""
    return upper(d, err, 5, "forearm", d.wrist, d.seat6, d.deep6, 9)


def link6(d, err):
    """Draw the wrist: the drum of joint 6 with the neck of joint 7."""
    tube = cyl((0, 0, d.wrist), Z, d.r7 - 3, d.hub7 - d.seat6 - d.wrist)
    return lower(d, err, 6, "wrist", d.wrist, tube, d.seat6, d.deep6)


def link7(d, err):
    """Draw the last link: journal, disc with a flat, neck, and tool flange with a centring pin."""
    disc = roll_flange(d, 7, d.seat6, d.deep6, err)
    top = d.flange_high - d.flange_height
    disc += cyl((0, 0, d.hub7 + d.seat6), Z, d.groove7, top - d.hub7 - d.seat6)
    disc += cyl((0, 0, top), Z, d.r7, d.flange_height) + cyl((0, 0, top), Z, d.pin, d.flange_height + d.pin_high)
    return [("flange7", disc, "flange")]


def instrument(d, err):
    """Draw the instrument: adapter, jaw drive, rotation ring, nose, shaft, and a grasper along the last axis."""
    z, tip = d.flange_high, d.flange_high + d.tool_length + err("tip_mm", 0.0)
    adapter = soft(cyl((0, 0, z), Z, d.adapter_radius, d.adapter), Axis.Z, 3)
    adapter -= cyl((0, 0, z - 1), Z, d.pin + 0.02, d.pin_high + 3)
    adapter = flat(adapter, (0, 0, z), Z, d.adapter_radius, d.adapter)
    foot = z + d.adapter
    heads = bolts((0, 0, foot), Z, (d.adapter_radius + d.housing) / 2 - 1, 6, 2.2, 2.2)
    ring = foot + d.housing_long
    housing = soft(cyl((0, 0, foot), Z, d.housing, d.housing_long), Axis.Z, 2, 0)
    knob = cyl((0, 0, ring), Z, d.knob, d.knob_long)
    knob = knob.chamfer(2, None, [*knob.edges().group_by(Axis.Z)[0], *knob.edges().group_by(Axis.Z)[-1]])
    for k in range(12):
        knob -= cyl(polar(d.knob + 1.5, 30 * k, ring - 1), Z, 3, d.knob_long + 2)
    nose = ring + d.knob_long
    cap = cone((0, 0, nose), Z, d.housing - 3, 2.2 * d.shaft, d.nose)
    start, hinge = nose + d.nose, tip - d.jaw - d.clevis
    shaft = cyl((0, 0, start), Z, d.shaft, hinge - start)
    clevis = soft(cyl((0, 0, hinge), Z, d.shaft, d.clevis), Axis.Z, 0.4, 0)
    both = cone((0, 0, tip - d.jaw), Z, d.shaft - 0.2, d.jaw_end, d.jaw)
    jaws = [
        both & Solid.make_box(10, 5, 2 * d.jaw, Plane(origin=(-5, side, tip - 1.5 * d.jaw)))
        for side in (d.jaw_gap / 2, -d.jaw_gap / 2 - 5)
    ]
    return [
        ("adapter", adapter, "flange"),
        *((f"bolt{k}", b, "steel") for k, b in enumerate(heads, 1)),
        ("housing", housing, "cast"),
        ("knob", knob, "cap"),
        ("nose", cap, "trim"),
        ("shaft", shaft, "steel"),
        ("clevis", clevis, "steel"),
        ("jaw_upper", jaws[0], "steel"),
        ("jaw_lower", jaws[1], "steel"),
    ]
