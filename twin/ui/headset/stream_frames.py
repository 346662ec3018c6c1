"""Frames of the stream from `twin serve` to a page, a headset or Unity; see docs/stream.md.

A frame is a binary message with the poses of all links of a robot at one time. All other messages are JSON text; those
from clients are in `client_messages`.
"""

from __future__ import annotations

import base64
import struct
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from twin.core import spatial
from twin.core.errors import TwinError
from twin.core.json_types import JsonObject
from twin.core.spatial import Array

ROBOT_VERSION = 1
"""Protocol version in `hello` for one robot."""

SCENE_VERSION = 2
"""Protocol version in `hello` for a scene, several robots, or deformables (fields)."""

MAGIC = 0x314E5754
"""First four bytes of a frame: "TWN1"."""

GHOST_FLAG = 1
"""Flag of a frame that contains a ghost (tool pose computed by the equations)."""

PLAYING_FLAG = 2
"""Flag of a frame while a protocol is playing."""

REFUSED_FLAG = 4
"""Flag of a frame after a refused request."""

HELD_FLAG = 8
"""Flag of a frame while a client holds the robot."""

_POSE_SIZE = 7
"""Numbers of a pose: x y z in m, and the quaternion x y z w."""

_HEADER = struct.Struct("<IIddHHI")

OBJECTS_PREFIX = "objects"
"""Prefix of the movable objects in lists of links, such as "objects/ring1"."""


@dataclass(frozen=True, eq=False)
class RobotFrame:
    """A complete frame.

    Attributes:
        seq: number of the frame, from 0, modulo 2^32.
        server_time: time of the poses in s on the server's monotonic clock.
        clip_time: time in the protocol in s.
        poses: (links, 7) float32: pose of every link in the world frame (z up), x y z in m and quaternion x y z w.
        q: (joints,) float32: active joint values in m or rad.
        flags: see `GHOST_FLAG`, `PLAYING_FLAG`, `REFUSED_FLAG`, `HELD_FLAG`.
        ghost: (7,) float32: tool pose in the world frame, computed by the equations; None without `GHOST_FLAG`.
    """

    seq: int
    server_time: float
    clip_time: float
    poses: np.ndarray
    q: np.ndarray
    flags: int
    ghost: np.ndarray | None = None


def pack(seq: int, server_time: float, clip_time: float, flags: int, body: bytes, links: int, joints: int) -> bytes:
    """Return a frame as bytes: a header, followed by `body` from `pack_body`; `links` and `joints` are counts."""
    return _HEADER.pack(MAGIC, seq & 0xFFFFFFFF, server_time, clip_time, links, joints, flags) + body


def pack_body(poses: np.ndarray, q: np.ndarray, ghost: np.ndarray | None) -> bytes:
    """Return the body of a frame as bytes: poses (links, 7), q (joints,), ghost (7,) or None."""
    parts = [poses, q]
    if ghost is not None:
        parts.append(ghost)
    return b"".join(np.ascontiguousarray(part, "<f4").tobytes() for part in parts)


def size_of(data: bytes) -> int:
    """Return the length in bytes of the frame at the start of the data, as stated in the frame's header.

    Raises:
        TwinError: the data do not begin with a frame.
    """
    if len(data) < _HEADER.size:
        raise TwinError(f"frame: {len(data)} bytes; the header needs {_HEADER.size}")
    magic, *_, links, joints, flags = _HEADER.unpack_from(data)
    if magic != MAGIC:
        raise TwinError(f"frame: begins with {magic:#010x}, not with {MAGIC:#010x}")
    numbers = _POSE_SIZE * links + joints
    if flags & GHOST_FLAG:
        numbers += _POSE_SIZE
    return _HEADER.size + 4 * numbers  # float32


def unpack(data: bytes) -> RobotFrame:
    """Return the frame in a binary message.

    Raises:
        TwinError: the message is not a frame, or its length differs from the length in its header.
    """
    size = size_of(data)
    _, seq, server_time, clip_time, links, joints, flags = _HEADER.unpack_from(data)
    if len(data) != size:
        raise TwinError(f"frame: {len(data)} bytes; {links} links and {joints} joints need {size}")
    values = np.frombuffer(data, "<f4", offset=_HEADER.size)
    end_of_poses = _POSE_SIZE * links
    end_of_joints = end_of_poses + joints
    poses = values[:end_of_poses].reshape(links, _POSE_SIZE)
    q = values[end_of_poses:end_of_joints]
    ghost = None
    if flags & GHOST_FLAG:
        ghost = values[end_of_joints:]
    return RobotFrame(seq, server_time, clip_time, poses, q, flags, ghost)


def sevens(Ts: Array) -> Array:
    """Return poses (..., 4, 4) as (..., 7): x y z in m, and the quaternion x y z w with w >= 0."""
    q = spatial.quat_from_matrix_wxyz(Ts[..., :3, :3])
    return np.concatenate([Ts[..., :3, 3], np.roll(q, -1, axis=-1)], axis=-1)


def pose_of(seven: ArrayLike) -> Array:
    """Return the pose (4, 4) for seven numbers: x y z in m, and a quaternion x y z w of any nonzero length."""
    v = np.asarray(seven, float)
    q = np.roll(v[3:], 1)
    return spatial.pose(spatial.matrix_from_quat_wxyz(q / np.linalg.norm(q)), v[:3])


def near_signs(sevens: Array, last: Array | None) -> Array:
    """Return poses (n, 7) in which the sign of each quaternion is chosen so that it is near to the previous quaternion.

    `last` (n, 7) are the previous poses. If `last` is None or has a different number of poses, no sign changes.
    """
    if last is None or len(last) != len(sevens):
        return sevens
    # a quaternion and its negative are the same rotation; the nearer one has a positive scalar product
    products = np.sum(sevens[:, 3:] * last[:, 3:], axis=1)
    near_sevens = sevens.copy()
    near_sevens[products < 0, 3:] *= -1
    return near_sevens


def still(robots: Iterable[str]) -> JsonObject:
    """Return the document `state` of a source that plays no protocol; `robots`: names of the displayed robots."""
    clock = {"playing": False, "time": 0.0, "duration": 0.0, "speed": 1.0, "loop": False}
    entries = [{"name": name, "reason": None} for name in robots]
    return {"type": "state", **clock, "robots": entries}


def floats(values: np.ndarray) -> str:
    """Return values in base64, as little-endian float32 (the format of poses and points in documents)."""
    return base64.b64encode(np.ascontiguousarray(values, "<f4").tobytes()).decode()
