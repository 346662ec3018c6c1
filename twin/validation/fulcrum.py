"""The trocar as a fulcrum: the tip goes to one side when what holds the shaft goes to the other."""

from __future__ import annotations

import numpy as np

from twin.core.spatial import Array
from twin.planning.trajectory import Trajectory

OUTSIDE = 0.1
"""Length in m of shaft between the trocar and the point outside that is shown."""


def fulcrum(trajectory: Trajectory) -> Array:
    """Return (k, 2) m, sideways of the tip and of the shaft `OUTSIDE` of the trocar; NaN where none is registered.

    Sideways is along the direction, across the mean shaft, in which the tip moves most.
    """
    rcm = trajectory.rcm
    inside = np.isfinite(rcm).all(axis=1) & (trajectory.depth > 0)
    out = np.full((len(rcm), 2), np.nan)
    if not inside.any():
        return out
    shaft = trajectory.Ts_base_frame[inside, :3, :3] @ (trajectory.shaft_axis / np.linalg.norm(trajectory.shaft_axis))
    mean = shaft.mean(axis=0) / np.linalg.norm(shaft.mean(axis=0))
    tip = trajectory.Ts_base_frame[inside, :3, 3] - rcm[inside]
    across = (tip - tip.mean(axis=0)) @ (np.eye(3) - np.outer(mean, mean))
    direction = np.linalg.svd(across, full_matrices=False)[2][0]
    direction *= np.sign(direction[np.argmax(np.abs(direction))])
    out[inside] = np.column_stack([tip @ direction, -OUTSIDE * shaft @ direction])
    return out
