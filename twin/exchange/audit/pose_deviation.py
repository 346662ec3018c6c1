"""How far two motions of a link are apart."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from twin.exchange.audit.poses import Array, angle

POSITION_TOL = 1e-6
"""Maximum distance in m between the positions of a link in two files that agree."""

ROTATION_TOL = 1e-4
"""Maximum angle in rad between the rotations of a link in two files that agree."""


class Deviation(NamedTuple):
    """Maximum differences between two motions of a link.

    Attributes:
        distance: maximum distance in m.
        distance_key: key of this distance.
        angle: maximum angle in rad.
        angle_key: key of this angle.
    """

    distance: float
    distance_key: int
    angle: float
    angle_key: int


def pose_deviation(poses: Array, others: Array) -> Deviation:
    """Return the maximum differences between two motions of a link, which are given as poses (k, 4, 4)."""
    distances = np.linalg.norm(poses[:, :3, 3] - others[:, :3, 3], axis=1)
    angles = angle(poses[:, :3, :3], others[:, :3, :3])
    i = int(np.argmax(distances))
    j = int(np.argmax(angles))
    return Deviation(float(distances[i]), i, float(angles[j]), j)


def poses_agree(A: Array, B: Array) -> bool:
    """Return whether poses agree; twice the tolerances, because both may differ from a third file."""
    difference = pose_deviation(A, B)
    return difference.distance <= 2 * POSITION_TOL and difference.angle <= 2 * ROTATION_TOL


def or_infinite(difference: float) -> float:
    """Return a difference; infinity for NaN, which no limit would find too large."""
    if np.isnan(difference):
        return np.inf
    return float(difference)
