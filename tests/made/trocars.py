"""Where the trocar of the drawn robots is, and poses of the tool through it."""

from __future__ import annotations

import numpy as np

from twin.core import spatial
from twin.core.units import DEG

TROCAR = np.array([0.40, 0.0, 0.30])


def targets(count, seed, depth, tilt=0.0):
    """Shaft ends about the trocar, and tools tilted from the shaft by up to `tilt`."""
    rng = np.random.default_rng(seed)
    inner = TROCAR + np.column_stack([rng.uniform(-0.08, 0.08, (count, 2)), -rng.uniform(*depth, count)])
    u = (TROCAR - inner) / np.linalg.norm(TROCAR - inner, axis=1)[:, None]
    return rng, inner, u


def lapbot_poses(count, seed):
    """As the fact sheet: +-80 mm beside, 60 to 200 mm below the trocar, tool up to 40 deg off the shaft."""
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
