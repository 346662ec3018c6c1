"""Curves of a planned motion for the plots of a report: joints, tool, RCM, margins, sideways motion of the shaft.

The curves of `Report.series` that need equations or mechanism are added where these are compared.
"""

from __future__ import annotations

import numpy as np

from twin.core import spatial
from twin.core.spatial import Array
from twin.planning.trajectory import Trajectory

OUTER_POINT_DISTANCE = 0.1
"""Distance in m, along the shaft, from the trocar to the displayed outer point of the shaft."""


def trajectory_curves(trajectory: Trajectory) -> dict[str, Array]:
    """Return the curves of the planned motion for the report, by their names in `Report.series`."""
    angles = spatial.euler_angles(trajectory.Ts_base_tool[:, :3, :3], "zyx")
    curves = {
        "t": trajectory.t,
        "qd": trajectory.qd,
        "qdd": trajectory.qdd,
        "p_tool": trajectory.Ts_base_tool[:, :3, 3],
        "angles": np.unwrap(angles, axis=0),
        "rcm_error": trajectory.rcm_error,
        "fulcrum": sideways_motion(trajectory),
        "limit_margin": trajectory.limit_margin.min(axis=1),
    }
    for name, values in trajectory.singularity.items():
        curves[f"singularity.{name}"] = values
    for name, values in trajectory.reach.items():
        curves[f"reach.{name}"] = values
    return curves


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
