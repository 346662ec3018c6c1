"""Position of the trocar of the drawn robots, and tool poses whose shaft passes through it."""

from __future__ import annotations

import numpy as np

from twin.core import spatial
from twin.core.units import DEG

TROCAR = np.array([0.40, 0.0, 0.30])


def targets(count, seed, depth, tilt=0.0):
    """Return (random generator, shaft ends (count, 3) in m inside, shaft directions (count, 3) outwards).

    `depth` is the (smallest, largest) vertical distance in m of the ends below the trocar.
    """
    rng = np.random.default_rng(seed)
    inner = TROCAR + np.column_stack([rng.uniform(-0.08, 0.08, (count, 2)), -rng.uniform(*depth, count)])
    u = (TROCAR - inner) / np.linalg.norm(TROCAR - inner, axis=1)[:, None]
    return rng, inner, u


def lapbot_poses(count, seed):
    """Return tool poses (count, 4, 4) of the lapbot.

    The shaft's end is up to 80 mm beside and 60 to 200 mm below the trocar; the tool is tilted by up to 40 deg.
    """
    rng, inner, u = targets(count, seed, (0.06, 0.20))
    Ts = np.zeros((count, 4, 4))
    for i in range(count):
        axis = np.cross(u[i], rng.normal(size=3))
        R = spatial.exp_so3(rng.uniform(0, 40 * DEG) * axis / np.linalg.norm(axis))
        z = R @ -u[i]
        x = np.cross(rng.normal(size=3), z)
        x /= np.linalg.norm(x)
        Ts[i] = spatial.pose(np.column_stack([x, np.cross(z, x), z]), inner[i] + 0.02 * z)
    return Ts
