"""The comparison of two sides: by their joint lines or, where a side has only poses, by poses."""

from __future__ import annotations

from twin.comparison.line_pair import compare_lines
from twin.comparison.pose_pair import compare_poses, side_of_poses
from twin.comparison.side import RobotSide
from twin.comparison.side_pair import SidePair
from twin.core.errors import TwinError

LARGEST_TOLERANCE = 0.1
"""Largest distance in m up to which joint lines may coincide; the angle is then 0.2 rad."""


def compare_pair(first: RobotSide, second: RobotSide, tolerance: float) -> SidePair:
    """Compare two sides; `tolerance` is the distance in m up to which two joint lines coincide.

    Raises:
        TwinError: the tolerance is out of range, the joints cannot be matched, or a joint has no common range.
    """
    if not 0.0 < tolerance <= LARGEST_TOLERANCE:
        limit = f"give a number above 0 and up to {LARGEST_TOLERANCE:g} m"
        raise TwinError(f"tolerance {tolerance:g} m: {limit}: with more, all robots agree")
    rows = side_of_poses(first, second)
    if rows is not None:
        return compare_poses(first, second, rows, tolerance)
    return compare_lines(first, second, tolerance)
