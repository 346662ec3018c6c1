"""Organs of the abdomen, in the world frame of the scene vsrs."""

import numpy as np
from build123d import Edge, Plane, Solid, Wire

MATERIALS = {  # sRGB, density in kg/m3
    "liver": ((0.50, 0.13, 0.10), 1060),
    "gallbladder": ((0.35, 0.52, 0.22), 1020),
    "stomach": ((0.86, 0.55, 0.48), 1040),
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
