"""The dome with half of its lid cut away, its floor, the cube ring and the loops, in the frame of the dome."""

from math import cos, radians, sin, tan

from build123d import Plane, Solid

__all__ = ["MATERIALS", "dome", "floor", "loops", "ring"]
MATERIALS = {  # sRGB, density in kg/m3
    "shell": ((0.78, 0.80, 0.84), 1100),
    "floor": ((0.42, 0.45, 0.50), 1100),
    "wire": ((0.16, 0.42, 0.78), 7850),
    "cube": ((0.86, 0.62, 0.10), 1100),
}


def floor(d):
    """Draw the floor, a disc below the dome."""
    return [("disc", Solid.make_cylinder(d.inner + d.wall, d.wall, Plane(origin=(0, 0, -d.wall))), "floor")]


def dome(d):
    """Draw the hemispherical shell without the half of the lid at x > 0."""
    outer = d.inner + d.wall
    shell = Solid.make_sphere(outer, Plane.XY, 0, 90, 360) - Solid.make_sphere(d.inner, Plane.XY, 0, 90, 360)
    high = 2 * outer
    cone = Solid.make_cone(0, high * tan(radians(d.lid)), high, Plane.XY)
    cut = cone & Solid.make_box(3 * high, 6 * high, 2 * high, Plane(origin=(0, -3 * high, 0)))
    return [("shell", (shell - cut).solid(), "shell")]


def loops(d):
    """Draw two loops of wire, each on a post; they face the middle."""
    out = []
    x, y, _ = d.loop_at
    for name, side in (("a", 1), ("b", -1)):
        foot = (x, side * y)
        angle = side * radians(45)
        normal = (cos(angle), sin(angle), 0)
        loop = Solid.make_torus(d.loop_radius, d.loop_wire, Plane(origin=(*foot, d.loop_high), z_dir=normal))
        post = Solid.make_cylinder(d.loop_wire, d.loop_high - d.loop_radius, Plane(origin=(*foot, 0)))
        out.append((name, (loop + post).solid(), "wire"))
    return out


def ring(d):
    """Draw the cube ring: a cube with a square hole, which lies on the floor."""
    x, y, _ = d.ring_at
    edge, hole = d.ring_edge, d.ring_hole
    outer = Solid.make_box(edge, edge, edge, Plane(origin=(x - edge / 2, y - edge / 2, 0)))
    inner = Solid.make_box(hole, 2 * edge, hole, Plane(origin=(x - hole / 2, y - edge, (edge - hole) / 2)))
    return [("cube", (outer - inner).solid(), "cube")]
