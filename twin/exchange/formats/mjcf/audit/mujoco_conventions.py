"""Numbers by which MuJoCo states joints and flags, and poses as it states them."""

from __future__ import annotations

import mujoco
import numpy as np

from twin.exchange.audit import poses
from twin.exchange.audit.poses import Array

FREE, BALL, SLIDE, HINGE = range(4)
"""Numbers of MuJoCo's joint types (enumeration mjtJoint)."""

NO_GRAVITY = int(mujoco.mjtDisableBit.mjDSBL_GRAVITY)
"""Flag of <option> with which MuJoCo ignores gravity."""

NO_LIMITS = int(mujoco.mjtDisableBit.mjDSBL_LIMIT)
"""Flag of <option> with which MuJoCo ignores the limits of joints."""

NO_LOOPS = int(mujoco.mjtDisableBit.mjDSBL_EQUALITY)
"""Flag of <option> with which MuJoCo ignores equality constraints."""

NO_DRIVES = int(mujoco.mjtDisableBit.mjDSBL_ACTUATION)
"""Flag of <option> with which MuJoCo ignores actuators."""

XYZ_W = [1, 2, 3, 0]
"""Indices that turn MuJoCo's quaternions (w, x, y, z) into those of `poses` (x, y, z, w)."""

W_XYZ = [3, 0, 1, 2]
"""Indices of the other direction."""


def pose_of(p: Array, wxyz: Array) -> Array:
    """Return the pose (4, 4) with the position p (3,) and the quaternion wxyz (4,)."""
    return poses.pose(poses.rotation(np.asarray(wxyz)[XYZ_W]), np.array(p))
