"""Parts of the PA-10, each body drawn where it stands with all joints at zero: arm straight up, world = frame 0.

The seat of a joint lies on its axis, away from the joint's origin where links must pass each other.

Every function returns a list of ``(part name, solid, material)``.
"""

from build123d import Axis, Plane
from shapes import X, Y, Z, bolts, cap, cone, cyl, flange, flat, hull, seat, soft

MATERIALS = {  # sRGB, density in kg/m3
    "cast": ((0.88, 0.88, 0.85), 1500),
    "cap": ((0.20, 0.22, 0.25), 1300),
    "trim": ((0.16, 0.36, 0.62), 1300),
    "steel": ((0.70, 0.72, 0.75), 7850),
    "flange": ((0.13, 0.14, 0.16), 2700),
}


# ---- bodies -----------------------------------------------------------------
def base(d, err):
    """Mounting plate, conical column, seat of joint 1."""
    low, high = -d.shoulder_high, -d.hub1
    plate = cyl((0, 0, low), Z, d.base_radius, d.plate)
    plate = plate.chamfer(4, None, plate.edges().group_by(Axis.Z)[-1])
    body = cone((0, 0, low + d.plate), Z, d.base_radius - 14, d.r1 + 8, high - low - d.plate - d.seat)
    ring = seat((0, 0, high), Z, d.r1, d.j1, d.seat, err("bore1_offset_mm", (0, 0)))
    body -= cyl((0, 0, high - d.seat - d.deep), Z, d.j1 + 1, d.deep + 2)
    heads = bolts((0, 0, low + d.plate), Z, d.base_radius - 8, 8, 5, 5)
    return [
        ("plate", plate, "cast"),
        ("column", body, "cast"),
        ("seat1", ring, "cap"),
        *((f"bolt{k}", b, "steel") for k, b in enumerate(heads, 1)),
    ]


def link1(d, err):
    """Shoulder: flange on joint 1, neck, housing of joint 2 across it."""
    foot = flange((0, 0, -d.hub1), Z, d.r1, d.j1, d.seat, d.deep, err("journal1_offset_mm", (0, 0)))
    neck = cyl((0, 0, -d.hub1 + d.seat), Z, d.r1 - 4, d.hub1 - d.seat)
    house = cyl((0, -d.back2, 0), Y, d.r2, d.back2 + d.hub2 - d.seat)
    ring = seat((0, d.hub2, 0), Y, d.r2, d.j2, d.seat, err("bore2_offset_mm", (0, 0)))
    house -= cyl((0, d.hub2 - d.seat - d.deep, 0), Y, d.j2 + 1, d.deep + 1)
    cover = cap((0, -d.back2, 0), (0, -1, 0), d.r2 - 6, 22)
    return [
        ("flange1", foot, "cap"),
        ("housing2", house + neck, "cast"),
        ("seat2", ring, "cap"),
        ("cover2", cover, "trim"),
    ]


def _side(d, z, hub, r, journal, thick, reach, tip, near, far, centre, errors):
    """Flange on a pitch joint at height z, side plate, bracket back to the middle line.

    hub: y of the face. reach: length of the side plate, tip: its radius there. near..far: the bracket along z, with
    radius `centre` about the middle line.
    """
    foot = flange((0, hub, z), Y, r, journal, d.seat, d.deep, errors)
    inner = hub + d.seat
    plane = Plane(origin=(0, inner, z), x_dir=X, z_dir=Y)  # its y is -z of the world
    plate = hull([(0, 0, r - 3), (0, -reach, tip)], plane, thick, 6)
    middle = hub + d.seat + thick / 2
    bracket = hull([(0, middle, thick / 2 - 1), (0, 0, centre)], Plane(origin=(0, 0, z + near)), far - near, 3)
    cover = cap((0, inner + thick, z), Y, r - 12, 16)
    return foot, plate + bracket, cover


def link2(d, err):
    """Upper arm, lower half."""
    foot, arm, cover = _side(
        d, 0, d.hub2, d.r2, d.j2, d.thick2, d.reach2, d.tip2, d.near2, d.far2, d.r3, err("journal2_offset_mm", (0, 0))
    )
    ring = seat((0, 0, d.hub3), Z, d.r3, d.j3, d.seat, err("bore3_offset_mm", (0, 0)))
    arm -= cyl((0, 0, d.hub3 - d.seat - d.deep), Z, d.j3 + 1, d.deep + 1)
    return [("flange2", foot, "cap"), ("arm", arm, "cast"), ("cover2", cover, "trim"), ("seat3", ring, "cap")]


def link3(d, err):
    """Upper arm, upper half, with the elbow housing."""
    foot = flange((0, 0, d.hub3), Z, d.r3, d.j3, d.seat, d.deep, err("journal3_offset_mm", (0, 0)))
    z = d.elbow
    tube = cone((0, 0, d.hub3 + d.seat), Z, d.r3 - 4, d.tube3, z - d.hub3 - d.seat)
    house = cyl((0, -d.back4, z), Y, d.r4, d.back4 + d.hub4 - d.seat)
    ring = seat((0, d.hub4, z), Y, d.r4, d.j4, d.seat, err("bore4_offset_mm", (0, 0)))
    house -= cyl((0, d.hub4 - d.seat - d.deep, z), Y, d.j4 + 1, d.deep + 1)
    cover = cap((0, -d.back4, z), (0, -1, 0), d.r4 - 6, 18)
    return [
        ("flange3", foot, "cap"),
        ("upper_arm", house + tube, "cast"),
        ("seat4", ring, "cap"),
        ("cover4", cover, "trim"),
    ]


def link4(d, err):
    """Forearm, lower half."""
    foot, arm, cover = _side(
        d,
        d.elbow,
        d.hub4,
        d.r4,
        d.j4,
        d.thick4,
        d.reach4,
        d.tip4,
        d.near4,
        d.far4,
        d.r5,
        err("journal4_offset_mm", (0, 0)),
    )
    ring = seat((0, 0, d.hub5), Z, d.r5, d.j5, d.seat, err("bore5_offset_mm", (0, 0)))
    arm -= cyl((0, 0, d.hub5 - d.seat - d.deep), Z, d.j5 + 1, d.deep + 1)
    return [("flange4", foot, "cap"), ("arm", arm, "cast"), ("cover4", cover, "trim"), ("seat5", ring, "cap")]


def link5(d, err):
    """Forearm, upper half, with the wrist housing."""
    foot = flange((0, 0, d.hub5), Z, d.r5, d.j5, d.seat, d.deep, err("journal5_offset_mm", (0, 0)))
    z = d.wrist
    tube = cone((0, 0, d.hub5 + d.seat), Z, d.r5 - 4, d.tube5, z - d.hub5 - d.seat)
    house = cyl((0, -d.back6, z), Y, d.r6, d.back6 + d.hub6 - d.seat6)
    ring = seat((0, d.hub6, z), Y, d.r6, d.j6, d.seat6, err("bore6_offset_mm", (0, 0)))
    house -= cyl((0, d.hub6 - d.seat6 - d.deep6, z), Y, d.j6 + 1, d.deep6 + 1)
    cover = cap((0, -d.back6, z), (0, -1, 0), d.r6 - 5, 10)
    return [
        ("flange5", foot, "cap"),
        ("forearm", house + tube, "cast"),
        ("seat6", ring, "cap"),
        ("cover6", cover, "trim"),
    ]


def link6(d, err):
    """Wrist: side plate and bracket to joint 7."""
    z, inner = d.wrist, d.hub6 + d.seat6
    foot = flange((0, d.hub6, z), Y, d.r6, d.j6, d.seat6, d.deep6, err("journal6_offset_mm", (0, 0)))
    plane = Plane(origin=(0, inner, z), x_dir=X, z_dir=Y)
    plate = hull([(0, 0, d.r6 - 3), (0, -d.near6 - 4, d.tip6)], plane, d.thick6, 2)
    middle = inner + d.thick6 / 2
    bracket = hull(
        [(0, middle, d.thick6 / 2 - 1), (0, 0, d.r7)],
        Plane(origin=(0, 0, z + d.near6)),
        d.hub7 - z - d.near6 - d.seat6,
        0,
    )
    ring = seat((0, 0, d.hub7), Z, d.r7, d.j7, d.seat6, err("bore7_offset_mm", (0, 0)))
    bracket -= cyl((0, 0, d.hub7 - d.seat6 - d.deep6), Z, d.j7 + 1, d.deep6 + 1)
    cover = cap((0, inner + d.thick6, z), Y, d.r6 - 10, 8)
    return [
        ("flange6", foot, "cap"),
        ("wrist", plate + bracket, "cast"),
        ("cover6", cover, "trim"),
        ("seat7", ring, "cap"),
    ]


def link7(d, err):
    """Tool flange: journal, disc, centring pin and face for the instrument."""
    disc = flange((0, 0, d.hub7), Z, d.r7, d.j7, d.flange_high - d.hub7, d.deep6, err("journal7_offset_mm", (0, 0)))
    pin = cyl((0, 0, d.flange_high - 1), Z, d.pin, d.pin_high + 1)
    return [("flange7", disc + pin, "flange")]


def instrument(d, err):
    """Adapter, handle, shaft and a closed grasper along the last axis."""
    z, tip = d.flange_high, d.flange_high + d.tool_length + err("tip_mm", 0.0)
    adapter = cyl((0, 0, z), Z, d.r7, d.adapter)
    adapter -= cyl((0, 0, z - 1), Z, d.pin + 0.02, d.pin_high + 3)
    adapter = flat(adapter, (0, 0, z), Z, d.r7, d.adapter)
    handle = cone((0, 0, z + d.adapter), Z, d.r7 - 4, 9, d.handle)
    handle = soft(handle, Axis.Z, 3)
    start = z + d.adapter + d.handle
    shaft = cyl((0, 0, start), Z, d.shaft, tip - d.jaw - start)
    jaw = cone((0, 0, tip - d.jaw), Z, d.shaft, d.jaw_end, d.jaw)
    return [
        ("adapter", adapter, "flange"),
        ("handle", handle, "trim"),
        ("shaft", shaft, "steel"),
        ("jaw", jaw, "steel"),
    ]
