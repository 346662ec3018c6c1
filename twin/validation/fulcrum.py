"""Compute the sideways motion of tip and outer end of a shaft, which move to opposite sides of the trocar."""

from __future__ import annotations

import numpy as np

from twin.core.spatial import Array
from twin.planning.trajectory import Trajectory

OUTER_POINT_DISTANCE = 0.1
"""Distance in m, along the shaft, from the trocar to the displayed outer point of the shaft."""


def sideways_motion(trajectory: Trajectory) -> Array:
    """Return the sideways motion (k, 2) in m of the tip and of a point of the shaft outside the patient.

    The second point is at distance `OUTER_POINT_DISTANCE` from the trocar. Sideways motion is measured along one axis:
    of all axes perpendicular to the mean shaft direction, the one with the largest motion of the tip. Samples without a
    trocar are NaN.
    """
    rcm = trajectory.rcm
    inside = np.isfinite(rcm).all(axis=1) & (trajectory.depth > 0)
    motion = np.full((len(rcm), 2), np.nan)
    if not inside.any():
        return motion
    axis = trajectory.shaft_axis / np.linalg.norm(trajectory.shaft_axis)
    shaft = trajectory.Ts_base_frame[inside, :3, :3] @ axis
    mean_shaft = shaft.mean(axis=0)
    mean_shaft /= np.linalg.norm(mean_shaft)
    tip = trajectory.Ts_base_frame[inside, :3, 3] - rcm[inside]
    across = (tip - tip.mean(axis=0)) @ (np.eye(3) - np.outer(mean_shaft, mean_shaft))
    # the first principal direction of the tip's motion
    _, _, directions = np.linalg.svd(across, full_matrices=False)
    direction = directions[0]
    # its sign is arbitrary: the largest component is made positive, so that curves look alike on every machine
    direction *= np.sign(direction[np.argmax(np.abs(direction))])
    # the tip moves inside, the outer point on the other side of the trocar
    motion[inside] = np.column_stack([tip @ direction, -OUTER_POINT_DISTANCE * shaft @ direction])
    return motion
