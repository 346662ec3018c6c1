"""Parts of the operating theatre, all in the world frame: floor at z = 0, y towards the head of the patient.

Every function that draws a body returns a list of ``(part name, solid, material)``.
"""

from math import sqrt

from build123d import Axis, Location, Matrix, Plane, Solid
from shapes import Z, box, cyl

MATERIALS = {  # sRGB, density in kg/m3
    "steel": ((0.72, 0.75, 0.78), 7850),
    "white_steel": ((0.90, 0.91, 0.92), 7850),
    "mattress": ((0.20, 0.24, 0.29), 60),
    "skin": ((0.88, 0.68, 0.56), 1050),
    "drape": ((0.36, 0.60, 0.62), 300),
}


def on_belly(d, port):
    """Return the height of the outer face of the abdomen above the floor at a port, in mm."""
    x, y, _ = port
    return d.mattress_high + d.belly_z * sqrt(1 - (x / d.belly_x) ** 2 - (y / d.belly_y) ** 2)


def dome(d, less=0.0):
    """Return the upper half of the ellipsoid of the abdomen, with semi-axes shorter by `less` in mm."""
    ball = Solid.make_sphere(1.0, Plane.XY)
    ax, ay, az = d.belly_x - less, d.belly_y - less, d.belly_z - less
    scaled = Matrix([[ax, 0, 0, 0], [0, ay, 0, 0], [0, 0, az, 0], [0, 0, 0, 1]])
    whole = ball.transform_geometry(scaled).moved(Location((0, 0, d.mattress_high)))
    return whole & box(-400, 400, -400, 400, d.mattress_high, d.mattress_high + 400)


def table(d):
    """Draw the table: foot, column, top, mattress and side rails."""
    w, a, b = d.table_half, d.table_foot, d.table_head
    foot = box(-d.foot_half_x, d.foot_half_x, -d.foot_half_y, d.foot_half_y, 0, d.foot_high, 60)
    foot = foot.chamfer(20, None, foot.edges().group_by(Axis.Z)[-1])
    column = box(-d.column_half_x, d.column_half_x, -d.column_half_y, d.column_half_y, d.foot_high, d.table_low, 40)
    top = box(-w, w, a, b, d.table_low, d.table_high, 25)
    mattress = box(-w + 8, w - 8, a + 8, b - 8, d.table_high, d.mattress_high, 30)
    mattress = mattress.fillet(8, mattress.edges().group_by(Axis.Z)[-1])
    rails = [box(x, x + 14, a + 60, b - 60, d.table_low + 8, d.table_high - 8, 4, Axis.Y) for x in (w, -w - 14)]
    return [
        ("foot", foot, "white_steel"),
        ("column", column, "steel"),
        ("top", top, "white_steel"),
        ("mattress", mattress, "mattress"),
        *((f"rail{i}", r, "steel") for i, r in enumerate(rails, 1)),
    ]


def patient(d):
    """Draw the patient: the abdomen as a shell with three ports, the chest and the legs under drapes."""
    wall = dome(d) - dome(d, d.belly_wall)
    for port in (d.port_left, d.port_right, d.port_camera):
        wall -= cyl((port[0], port[1], d.mattress_high + 20), Z, d.port_radius, 400)
    inner = d.belly_y - 30
    c, h = d.chest_half, d.mattress_high
    chest = box(-c, c, inner, d.chest_head, h, h + d.chest_high, 70, Axis.Y)
    chest = chest.fillet(35, chest.edges().group_by(Axis.Y)[-1])
    chest -= dome(d)
    legs = []
    for s in (-1, 1):
        x = s * d.leg_apart
        leg = cyl((x, -inner, h + d.leg_radius), (0, -1, 0), d.leg_radius, -inner - d.table_foot - 20)
        leg = leg.fillet(30, leg.edges().group_by(Axis.Y)[0])
        legs.append(leg - dome(d))
    return [
        ("abdomen", wall, "skin"),
        ("chest", chest, "drape"),
        ("leg1", legs[0], "drape"),
        ("leg2", legs[1], "drape"),
    ]


def pedestal(d, at):
    """Draw the stand of a robot: foot, column and top plate, whose upper face is at `at`."""
    x, y, top = at
    foot = cyl((x, y, 0), Z, d.pedestal_foot, d.pedestal_foot_high)
    foot = foot.chamfer(15, None, foot.edges().group_by(Axis.Z)[-1])
    cap_low = top - d.pedestal_cap_high
    cap = cyl((x, y, cap_low), Z, d.pedestal_cap, d.pedestal_cap_high)
    cap = cap.chamfer(3, None, cap.edges().group_by(Axis.Z)[-1])
    column = cyl((x, y, d.pedestal_foot_high), Z, d.pedestal_radius, cap_low - d.pedestal_foot_high)
    return [("foot", foot, "white_steel"), ("column", column, "steel"), ("cap", cap, "white_steel")]
