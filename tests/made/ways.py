"""Directions in which a tool can move: two for a planar arm, three for a spatial arm."""

from __future__ import annotations

import numpy as np

from twin.api.robot import Robot


def leads(robot: Robot) -> np.ndarray:
    """Return orthonormal directions (3, k) in the base frame in which the tool can move from home.

    They are computed from small displacements of each driven joint of the reference model.
    """
    model = robot.reference()
    home = model.home()
    step = 1e-5 * np.eye(len(home.q))
    ends = [[model.solve(home.q + s * h, home).T_base_tool[:3, 3] for s in (1, -1)] for h in step]
    moved = np.array([(a - b) / 2e-5 for a, b in ends]).T
    u, sizes, _ = np.linalg.svd(moved, full_matrices=False)
    return u[:, sizes > 1e-6]
