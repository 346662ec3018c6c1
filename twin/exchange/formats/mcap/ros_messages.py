"""Messages of ROS 2 as plain data: poses, joint values, forces, transforms, states."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike

from twin.core import spatial
from twin.core.json_types import JsonObject
from twin.core.spatial import Array

WORLD = "world"
"""Name of the frame to which transforms are relative."""

_NANOSECONDS = 1_000_000_000
"""Nanoseconds in a second."""


def time_of(t: float) -> JsonObject:
    """Return a time in s as builtin_interfaces/Time."""
    # Rounded as a whole: a part of a second that rounds to a full one must count as a second.
    sec, nanosec = divmod(round(t * _NANOSECONDS), _NANOSECONDS)
    return {"sec": sec, "nanosec": nanosec}


def header(t: float, frame: str = "") -> JsonObject:
    """Return std_msgs/Header of a time in s and the name of a frame."""
    return {"stamp": time_of(t), "frame_id": frame}


def _vector(values: ArrayLike) -> JsonObject:
    x, y, z = np.asarray(values, float).tolist()
    return {"x": x, "y": y, "z": z}


def _quaternion(R: Array) -> JsonObject:
    # geometry_msgs has w last, the quaternions of this project have it first.
    w, x, y, z = spatial.quat_from_matrix_wxyz(R).tolist()
    return {"x": x, "y": y, "z": z, "w": w}


def pose_stamped(t: float, frame: str, T: Array) -> JsonObject:
    """Return geometry_msgs/PoseStamped of a pose T (4, 4) in a frame."""
    pose = {"position": _vector(T[:3, 3]), "orientation": _quaternion(T[:3, :3])}
    return {"header": header(t, frame), "pose": pose}


def joint_state(t: float, names: Sequence[str], q: Array) -> JsonObject:
    """Return sensor_msgs/JointState of joint values q (n,) in rad or m, without speeds."""
    # sensor_msgs/JointState: the array of what is not known is left empty; zeros would be a claim.
    position = np.asarray(q, float).tolist()
    return {"header": header(t), "name": list(names), "position": position, "velocity": [], "effort": []}


def wrench_stamped(t: float, frame: str, force: Array) -> JsonObject:
    """Return geometry_msgs/WrenchStamped of a force (3,) in N without torque."""
    wrench = {"force": _vector(force), "torque": _vector((0.0, 0.0, 0.0))}
    return {"header": header(t, frame), "wrench": wrench}


def transforms(t: float, poses: Mapping[str, Array]) -> JsonObject:
    """Return tf2_msgs/TFMessage of poses {frame: T_world_frame (4, 4)}."""
    stamped = []
    for name, T in poses.items():
        transform = {"translation": _vector(T[:3, 3]), "rotation": _quaternion(T[:3, :3])}
        stamped.append({"header": header(t, WORLD), "child_frame_id": name, "transform": transform})
    return {"transforms": stamped}


def operating_state(t: float, state: str, is_busy: bool, is_homed: bool = True) -> JsonObject:
    """Return crtk_msgs/OperatingState of a robot; a robot that needs no homing counts as homed."""
    return {"header": header(t), "state": state, "is_homed": is_homed, "is_busy": is_busy}
