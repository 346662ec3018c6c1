"""Shapes used by the drawings of several robots, and the seats of their revolute joints.

At a joint, the parent has a bore, a shoulder face perpendicular to it, and a flat whose normal is the key direction.
The child has a journal, a flange face, and a flat.
"""

from math import cos, hypot, radians, sin, sqrt

import numpy as np
from build123d import Axis, Edge, Face, Location, Plane, Solid, Vector, Wire

X, Y, Z = (1, 0, 0), (0, 1, 0), (0, 0, 1)

METAL_AND_PLASTIC = {  # sRGB, density in kg/m3
    "steel": ((0.66, 0.69, 0.72), 7850),
    "dark_steel": ((0.26, 0.28, 0.31), 7850),
    "aluminium": ((0.80, 0.82, 0.84), 2700),
    "blue_aluminium": ((0.17, 0.36, 0.55), 2700),
    "grey_aluminium": ((0.45, 0.49, 0.54), 2700),
    "bronze": ((0.78, 0.57, 0.27), 8800),
    "copper": ((0.80, 0.45, 0.28), 8960),
    "plastic": ((0.13, 0.14, 0.16), 1200),
    "white_plastic": ((0.91, 0.91, 0.89), 1200),
    "orange_plastic": ((0.89, 0.42, 0.12), 1200),
    "glass": ((0.35, 0.62, 0.78), 2500),
}


def cyl(at, axis, r, h):
    """Return a cylinder of radius r that starts at `at` and has length h along `axis`."""
    return Solid.make_cylinder(r, h, Plane(origin=at, z_dir=axis))


def cone(at, axis, r0, r1, h):
    """Return a truncated cone of length h along `axis`, with radius r0 at `at` and r1 at its end."""
    return Solid.make_cone(r0, r1, h, Plane(origin=at, z_dir=axis))


def pipe(at, axis, inner, outer, h):
    """Return a tube with inner and outer radius that starts at `at` and has length h along `axis`."""
    return cyl(at, axis, outer, h) - cyl(at, axis, inner, h)


def pin(start, end, radius):
    """Return a pin with two round ends; the rounding at `start` is inside the body that carries the pin."""
    way = [b - a for a, b in zip(start, end, strict=True)]
    length = sum(w * w for w in way) ** 0.5
    tip = [b - radius * w / length for b, w in zip(end, way, strict=True)]
    solid = Solid.make_cylinder(radius, length - radius, Plane(origin=start, z_dir=way))
    for middle in (start, tip):
        solid += Solid.make_sphere(radius, Plane(origin=middle, z_dir=way), -90, 90, 360)
    return solid


def box(x0, x1, y0, y1, z0, z1, radius=0.0, axis=Axis.Z):
    """Return a box between two corners; its edges parallel to `axis` are rounded by a radius."""
    solid = Solid.make_box(x1 - x0, y1 - y0, z1 - z0, Plane(origin=(x0, y0, z0)))
    return rounded(solid, radius, axis) if radius else solid


def rounded(solid, radius, axis):
    """Round all edges parallel to an axis."""
    return solid.fillet(radius, solid.edges().filter_by(axis))


def prism(points, height, plane=Plane.XY):
    """Return a polygon extruded along the normal of its plane."""
    points = [Vector(*p, 0) for p in points]
    edges = [Edge.make_line(p, q) for p, q in zip(points, [*points[1:], points[0]], strict=True)]
    return Solid.extrude(Face(Wire(edges)), Vector(0, 0, height)).moved(Location(plane))


def hull(circles, plane, height, chamfer=0.0):
    """Return the convex hull of circles (x, y, r) in a plane, extruded along its normal.

    Each circle touches the hull; their order is counter-clockwise.
    """
    normals, following = [], [*circles[1:], circles[0]]
    for (xa, ya, ra), (xb, yb, rb) in zip(circles, following, strict=True):
        dx, dy = xb - xa, yb - ya
        d = hypot(dx, dy)
        u, s = (dx / d, dy / d), (ra - rb) / d
        c = sqrt(1 - s * s)
        normals.append((u[0] * s + u[1] * c, u[1] * s - u[0] * c))
    edges = []
    for k, ((x, y, r), (x2, y2, r2)) in enumerate(zip(circles, following, strict=True)):
        before, after = normals[k - 1], normals[k]
        a = np.arctan2(before[1], before[0])
        b = a + (np.arctan2(after[1], after[0]) - a) % (2 * np.pi)
        arc = [Vector(x + r * cos(w), y + r * sin(w), 0) for w in (a, (a + b) / 2, b)]
        foot = Vector(x2 + r2 * after[0], y2 + r2 * after[1], 0)
        edges += [Edge.make_three_point_arc(*arc), Edge.make_line(arc[2], foot)]
    solid = Solid.extrude(Face(Wire(edges)), Vector(0, 0, height))
    if chamfer:
        rims = solid.edges().group_by(Axis.Z)
        solid = solid.chamfer(chamfer, None, list(rims[0]) + list(rims[-1]))
    return solid.moved(Location(plane))


def soft(solid, axis, radius, end=-1):
    """Round the rim at one end of a solid; the ends are those along an axis."""
    return solid.fillet(radius, solid.edges().group_by(axis)[end])


def flat(solid, at, axis, r, h, key=X):
    """Cut the flat of a flange of radius r: a face perpendicular to `key` at 0.9 r, over the height h of the flange."""
    along, k = Vector(*axis), Vector(*key)
    corner = Vector(*at) + k * 0.9 * r - along.cross(k) * r - along * 0.5
    tool = Solid.make_box(0.2 * r, 2 * r, h + 1, Plane(origin=corner, x_dir=k, z_dir=along))
    return solid - tool


def seat(at, axis, r, journal, h, error=(0.0, 0.0), key=X):
    """Return the parent's ring below the shoulder face at `at`; the face's normal is `axis`, the flat's is `key`.

    `error` is an offset of the bore in mm along `key` and along axis x key.
    """
    low = Vector(*at) - Vector(*axis) * h
    ring = cyl(low, axis, r, h)
    shift = Vector(*key) * error[0] + Vector(*axis).cross(Vector(*key)) * error[1]
    ring -= cyl(low - Vector(*axis) + shift, axis, journal + 0.02, h + 2)
    return flat(ring, low, axis, r, h, key)


def flange(at, axis, r, journal, h, deep, error=(0.0, 0.0), key=X):
    """Return the child's flange above the face at `at`, with the journal below it and a flat with normal `key`.

    `error` is an offset of the journal in mm along `key` and along axis x key.
    """
    disc = flat(cyl(at, axis, r, h), at, axis, r, h, key)
    shift = Vector(*key) * error[0] + Vector(*axis).cross(Vector(*key)) * error[1]
    start = Vector(*at) - Vector(*axis) * deep + shift
    return disc + cyl(start, axis, journal, deep + h / 2)


def bolts(at, axis, r, count, size, h):
    """Return `count` bolt heads on a circle of radius r, each as a solid of radius `size` and height h."""
    out = []
    a, b = Vector(*X), Vector(*axis).cross(Vector(*X))
    for k in range(count):
        w = 2 * np.pi * (k + 0.5) / count
        p = Vector(*at) + a * (r * cos(w)) + b * (r * sin(w))
        out.append(cyl(p, axis, size, h))
    return out


def cap(at, axis, r, h):
    """Return the cover of a joint motor: a domed disc."""
    solid = cyl(at, axis, r, h)
    group = Axis.Y if axis in (Y, (0, -1, 0)) else Axis.Z
    return soft(solid, group, min(h, r) * 0.6, -1 if axis in (Y, Z) else 0)


def polar(r, degrees, z=0.0):
    """Return the point at a radius, an angle about z and a height."""
    return (r * cos(radians(degrees)), r * sin(radians(degrees)), z)


def location(matrix):
    """Return the location with a pose (4, 4)."""
    return Location(Plane(origin=tuple(matrix[:3, 3]), x_dir=tuple(matrix[:3, 0]), z_dir=tuple(matrix[:3, 2])))


def joint(at, axis, long, offset=(0, 0), tilt=0.0):
    """Return the location of a joint axis (z = axis, x = long), shifted and tilted by the errors of one part."""
    about = list(tilt) if isinstance(tilt, (list, tuple)) else [tilt, 0.0]
    nominal = Location(Plane(origin=at, x_dir=long, z_dir=axis))
    return nominal * Location((offset[0], offset[1], 0), (about[0], about[1], 0))


def cannula(d):
    """Draw a trocar: a tube with a ball in the abdominal wall, and a head with a tap above the wall."""
    ball = Solid.make_sphere(d.ball, Plane.XY)
    tube = cyl((0, 0, -d.tube_out), Z, d.cannula, d.tube_out + d.tube_in)
    head = cyl((0, 0, -d.tube_out - 26), Z, 11, 26)
    head = soft(head, Axis.Z, 3, 0)
    tap = cyl((9, 0, -d.tube_out - 13), X, 3.5, 14)
    bore = cyl((0, 0, -200), Z, d.tube + 0.25, 400)
    key = box(9.5, 20, -20, 20, -d.tube_out - 4, -d.tube_out)
    return [
        ("ball", ball - cyl((0, 0, -200), Z, d.cannula, 400), "plastic"),
        ("tube", tube - bore, "plastic"),
        ("head", head + tap - bore - key, "cover"),
    ]
