"""A delta robot with turning arms: three upper arms, three pairs of rods; the platform never turns."""

import numpy as np

from twin.formula import mm

PARAMETERS = {
    "R": mm(210.0, "ASSUMED", "circle of the arm axes"),
    "r": mm(55.0, "ASSUMED", "circle of the rod ends on the platform"),
    "a": mm(240.0, "ASSUMED", "upper arm"),
    "b": mm(510.0, "ASSUMED", "rods"),
}


def inverse(pose, R, r, a, b):
    out = []
    for i in range(3):
        phi = 2 * np.pi * i / 3
        c, s = np.cos(phi), np.sin(phi)
        x = c * pose[0, 3] + s * pose[1, 3] + r - R
        y = c * pose[1, 3] - s * pose[0, 3]
        z = pose[2, 3]
        e = 2 * z * a
        f = 2 * x * a
        g = b**2 - a**2 - x**2 - y**2 - z**2
        out.append(np.arctan2(e, -f) - np.arccos(g / np.sqrt(e**2 + f**2)))
    return out
