"""Compute angle and position of the rectangle's upper side relative to the line in the picture, by projection."""

from __future__ import annotations

import numpy as np

from twin.core.spatial import Array
from twin.simulation.tasks.align.task import Alignment


def seen_ends(alignment: Alignment, T_world_picture: Array, view: float) -> Array:
    """Return the ends (2, 2) of the upper side in the picture: x right, y up, half the height of the picture is 1.

    Args:
        alignment: the task.
        T_world_picture: (4, 4) frame of the picture: x right, y up, z out of the picture, origin at the lens.
        view: angle of view over the height of the picture, in rad.

    Returns:
        The left and the right end; NaN if one of them is behind the lens.
    """
    p = (alignment.upper - T_world_picture[:3, 3]) @ T_world_picture[:3, :3]
    if (p[:, 2] >= 0).any():
        return np.full((2, 2), np.nan)
    half_height = -p[:, 2:] * np.tan(view / 2)  # of the picture, at the distance of each end
    return p[:, :2] / half_height


def angle(ends: Array) -> float:
    """Return the angle in rad of the upper side relative to the line, counter-clockwise positive; `ends` (2, 2)."""
    x, y = ends[1] - ends[0]
    return float(np.arctan2(y, x))


def off(ends: Array, line: float) -> float:
    """Return the largest distance between corresponding ends of upper side and line, divided by the line's length.

    Args:
        ends: (2, 2) ends of the upper side, as `seen_ends` returns them.
        line: length of the line divided by the height of the picture.
    """
    line_ends = np.array([[-line, 0.0], [line, 0.0]])
    distances = np.linalg.norm(ends - line_ends, axis=1)
    return float(distances.max()) / (2 * line)
