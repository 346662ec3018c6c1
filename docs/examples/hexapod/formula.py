"""Hexapod: six legs between base and platform; a joint value is the length of its leg."""

import numpy as np

from twin.formula import deg, mm

PARAMETERS = {
    "r_a": mm(165.0, "ASSUMED", "radius of the circle of the universal joints on the base"),
    "h_a": mm(30.0, "ASSUMED", "height of the universal joints above the base plate"),
    "alpha": deg(18.0, "ASSUMED", "half angle between the two universal joints of a pair"),
    "r_b": mm(95.0, "ASSUMED", "radius of the circle of the ball joints under the platform"),
    "h_b": mm(34.0, "ASSUMED", "depth of the ball joints below the top face of the platform"),
    "beta": deg(45.0, "ASSUMED", "half angle between the ball joints of the same two legs"),
}


def on_circle(radius, angle, height):
    return np.array([radius * np.cos(angle), radius * np.sin(angle), height])


def inverse(pose, r_a, h_a, alpha, r_b, h_b, beta):
    R, p = pose[:3, :3], pose[:3, 3]
    q = []
    for leg in range(6):
        middle, side = 2 * np.pi / 3 * (leg // 2), (-1, 1)[leg % 2]
        a = on_circle(r_a, middle + side * alpha, h_a)
        b = on_circle(r_b, middle + side * beta, -h_b)
        q.append(np.linalg.norm(p + R @ b - a))
    return q
