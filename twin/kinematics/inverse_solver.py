"""Solve inverse kinematics without an inverse equation, by Levenberg-Marquardt on the joints."""

from __future__ import annotations

import numpy as np

from twin.core.errors import KinematicsError
from twin.core.spatial import Array
from twin.kinematics.compiled import Compiled
from twin.kinematics.solve import Pose, solve


def inverse_by_solver(kin: Compiled, T: Array, seed: object) -> Array:
    """Return q (n,) at a pose (4, 4) for a formula that has only forward equations."""
    return solve(kin, Pose(T), seed=seed).q  # type: ignore[arg-type]


def inverse_by_solver_many(kin: Compiled, Ts: Array, seed: object = None) -> Array:
    """Return q (k, n) at poses (k, 4, 4), each solved from the previous solution; NaN rows without a solution."""
    qs = np.full((len(Ts), len(kin.joints)), np.nan)
    for i, T in enumerate(Ts):
        try:
            q = inverse_by_solver(kin, T, seed)
        except KinematicsError:
            continue
        qs[i] = q
        seed = q
    return qs
