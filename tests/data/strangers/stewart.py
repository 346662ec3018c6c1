"""A hexapod on vertical slides (six carriages, six rods of one length), with its platform points named."""

import numpy as np

from twin.formula import deg, mm

PARAMETERS = {
    "r_a": mm(300.0, "ASSUMED", "circle of the slides"),
    "alpha": deg(12.0, "ASSUMED", "half angle between the two slides of a pair"),
    "r_b": mm(120.0, "ASSUMED", "circle of the ball joints on the platform"),
    "beta": deg(38.0, "ASSUMED", "half angle between the two balls of a pair"),
    "l": mm(450.0, "ASSUMED", "rods"),
}


def inverse(pose, r_a, alpha, r_b, beta, l):  # noqa: E741 - a length
    n, o, w, p = pose[:3, 0], pose[:3, 1], pose[:3, 2], pose[:3, 3]
    q = []
    for i in range(6):
        turn = 2 * np.pi / 3 * (i // 2)
        side = 1 if i % 2 else -1
        base, ball = turn + side * alpha, turn + side * beta
        u, v = r_b * np.cos(ball), r_b * np.sin(ball)
        x = p[0] + u * n[0] + v * o[0] - r_a * np.cos(base)
        y = p[1] + u * n[1] + v * o[1] - r_a * np.sin(base)
        z = p[2] + u * n[2] + v * o[2] - 0.02 * w[2]
        q.append(z - np.sqrt(l**2 - x**2 - y**2))
    return q
