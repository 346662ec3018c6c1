"""Organs of the abdomen, in the world frame of the scene vsrs.

Every function returns a list of ``(part name, solid, material)``.
"""

from itertools import pairwise

import numpy as np
from build123d import Edge, Face, Plane, Shell, Solid, Wire

MATERIALS = {  # sRGB, density in kg/m3
    "liver": ((0.50, 0.13, 0.10), 1060),
    "gallbladder": ((0.35, 0.52, 0.22), 1020),
    "stomach": ((0.86, 0.55, 0.48), 1040),
    "wall": ((0.83, 0.58, 0.50), 1050),
}


def organ(rows, material):
    """Loft through ellipses along a line; both ends are flat.

    Args:
        rows: (n, 5) x, y, z of the centres and two half axes across the line; the second is nearest to z.
        material: name of the material.
    """
    rows = np.array(rows, float)
    along = np.gradient(rows[:, :3], axis=0)
    wires = []
    for (x, y, z, wide, high), direction in zip(rows, along, strict=True):
        across = np.cross((0, 0, 1), direction)
        plane = Plane(origin=(x, y, z), x_dir=tuple(across), z_dir=tuple(direction))
        wires.append(Wire([Edge.make_ellipse(wide, high, plane)]))
    return [("tissue", Solid.make_loft(wires), material)]


def wall(d):
    """Draw the abdominal wall: half of a hollow ellipsoid, of flat faces, with the openings of the ports."""
    solid = _dome(d, 0.0) - _dome(d, d.wall_thick)
    for port in d.wall_ports:
        solid -= Solid.make_sphere(d.wall_opening, Plane(origin=port))
    return [("tissue", solid, "wall")]


def _dome(d, less):
    """Return the upper half of the ellipsoid of the wall, with half axes shorter by `less` in mm.

    Its corners are on circles of height and meridians; four of them are in one plane.
    """
    around, up = round(360 / d.wall_face), round(90 / d.wall_face)
    a, h = np.arange(around) * (2 * np.pi / around), np.arange(up) * (np.pi / 2 / up)
    ball = [[(np.cos(k) * np.cos(i), np.cos(k) * np.sin(i), np.sin(k)) for i in a] for k in h]
    rows = np.array(ball) * (np.array(d.wall) - less) + (0, 0, d.wall_back)
    top = (0, 0, d.wall_back + d.wall[2] - less)
    rings = [[tuple(p) for p in row] for row in rows]
    flat = [rings[0][::-1]]
    for i in range(around):
        j = (i + 1) % around
        flat += [[low[i], low[j], high[j], high[i]] for low, high in pairwise(rings)]
        flat.append([rings[-1][i], rings[-1][j], top])
    return Solid(Shell([Face(Wire.make_polygon(corners)) for corners in flat]))
