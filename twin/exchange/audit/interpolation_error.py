"""Estimate the interpolation error between keys by removing every second key.

If accelerations change slowly, linear interpolation over two intervals has four times the error of linear interpolation
over one interval. Therefore the error stated in a file is compared with a quarter of the error that is measured with
every second key removed.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import product

import numpy as np

from twin.exchange.audit import poses
from twin.exchange.audit.file_content import FileClip, LinkShape
from twin.exchange.audit.file_joints import FileJoint
from twin.exchange.audit.poses import Array

_MIDDLE_TOL = 1e-6
"""Difference in s of the two intervals beside a key up to which they are equal but for rounding."""

_MIN_REMOVED_KEYS = 3
"""Minimum number of removed keys for an estimate: the largest error of fewer says little about the other intervals."""


def errors_at_every_second_key(
    clip: FileClip, shapes: Mapping[str, LinkShape], joints: Sequence[FileJoint]
) -> tuple[float, float, float] | None:
    """Remove every second key, and return the maximum interpolation errors at the removed keys.

    The result is (position error of a link's points in m, rotation error of a link in rad, gap of a joint in m). If
    fewer than three keys can be removed, the result is None.

    Position errors are measured at the corners of the link's bounding box. If `shapes` does not contain the link, they
    are measured at the link's origin.
    """
    times = clip.times
    removed = np.arange(1, len(times) - 1, 2)
    if len(removed):
        # Only keys in the middle between their neighbours, where `midway` gives the interpolated poses.
        off_middle = times[removed + 1] + times[removed - 1] - 2 * times[removed]
        removed = removed[np.abs(off_middle) < _MIDDLE_TOL]
    if len(removed) < _MIN_REMOVED_KEYS:
        return None
    interpolated = {}
    position = 0.0
    rotation = 0.0
    for name, T in clip.links.items():
        interpolated_poses = midway(T[removed - 1], T[removed + 1])
        expected = T[removed]
        interpolated[name] = interpolated_poses
        difference = interpolated_poses - expected
        for corner in _corners(shapes.get(name)):
            shift = difference[:, :3, :3] @ corner + difference[:, :3, 3]
            distance = float(np.linalg.norm(shift, axis=1).max())
            position = max(position, distance)
        angle = float(poses.angle(interpolated_poses[:, :3, :3], expected[:, :3, :3]).max())
        rotation = max(rotation, angle)
    largest_gap = 0.0
    for joint in joints:
        largest_gap = max(largest_gap, gap_of(joint, interpolated))
    return position, rotation, largest_gap


def _corners(shape: LinkShape | None) -> Array:
    """Return the corners (8, 3) of the bounding box of a link in m; the origin (1, 3) of a link without a shape."""
    if shape is None:
        return np.zeros((1, 3))
    ranges = zip(shape.low, shape.high, strict=True)
    return np.array(list(product(*ranges)))


def midway(A: Array, B: Array) -> Array:
    """Return the poses (k, 4, 4) halfway between A and B: mean of the positions, half of the relative rotation."""
    first = poses.quaternion(A[:, :3, :3])
    second = poses.quaternion(B[:, :3, :3])
    middle_quaternions = poses.slerp(first, second, np.full(len(first), 0.5))
    middle = (A[:, :3, 3] + B[:, :3, 3]) / 2
    return poses.pose(poses.rotation(middle_quaternions), middle)


def gap_of(joint: FileJoint, links: Mapping[str, Array]) -> float:
    """Return the maximum gap in m between a joint's two frames, in the locked directions of the joint; 0 if unknown.

    `links` maps each link to T_world_link (k, 4, 4).
    """
    if joint.parent not in links or joint.child not in links:
        return 0.0
    at_parent = joint.end(joint.parent)
    at_child = joint.end(joint.child)
    if at_parent is None or at_child is None or joint.kind.startswith(("chain", "free")):
        return 0.0
    T_parent = links[joint.parent]
    T_child = links[joint.child]
    point, direction = at_parent
    point_of_child, _ = at_child
    position = T_parent[:, :3, :3] @ point + T_parent[:, :3, 3]
    position_of_child = T_child[:, :3, :3] @ point_of_child + T_child[:, :3, 3]
    gap = position_of_child - position
    if joint.kind in ("prismatic", "cylindrical") and direction is not None:
        along = T_parent[:, :3, :3] @ direction
        gap = gap - np.sum(gap * along, axis=1, keepdims=True) * along
    return float(np.linalg.norm(gap, axis=1).max())
