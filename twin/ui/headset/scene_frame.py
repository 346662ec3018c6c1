"""Frame of a scene: the frames of its robots, followed by the vertices of its deformables (fields).

The frame of each robot is a complete frame of the module `protocol`, so that clients can reuse their code for a single
robot. Vertices are stored as 16-bit fractions of the field's bounding box; the resolution is 16 µm for a box of 1 m.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from twin.core.errors import TwinError
from twin.core.spatial import Array
from twin.ui.headset import stream_frames as wire

MAGIC = 0x324E5754
"""First four bytes of a scene's frame: "TWN2"."""

MAX_VERTICES = 1 << 16
"""Maximum number of vertices in a field."""

QUANTISATION_STEPS = 65535
"""Number of quantisation steps along an edge of the bounding box."""

HEARTBEAT_TICKS = 6
"""Number of ticks, of 1 / `timeline.TICK_RATE` s, after which a stream sends a frame even if nothing has moved."""

_HEADER = struct.Struct("<IIddHHI")
_BOX = struct.Struct("<I3f3f")


@dataclass(frozen=True, eq=False)
class SceneFrame:
    """A complete frame of a scene.

    Attributes:
        seq, server_time: see `wire.RobotFrame`.
        time: time of the scene's clock in s.
        flags: `wire.PLAYING_FLAG`, and `wire.HELD_FLAG` if a client holds a robot.
        robots: frames of the robots, in the order of the scene.
        fields: vertices (n, 3) of each field, float32, in m in the world frame; n = 0 if the vertices are unknown at
            this time. The fields are in the order of the scene.
    """

    seq: int
    server_time: float
    time: float
    flags: int
    robots: tuple[wire.RobotFrame, ...]
    fields: tuple[np.ndarray, ...]


def pack_scene(
    seq: int, server_time: float, time: float, flags: int, robots: Sequence[bytes], fields: Sequence[bytes]
) -> bytes:
    """Return a scene's frame as bytes, from frames of robots (`wire.pack`) and fields (`pack_field`)."""
    head = _HEADER.pack(MAGIC, seq & 0xFFFFFFFF, server_time, time, len(robots), len(fields), flags)
    return b"".join([head, *robots, *fields])


def pack_field(vertices: Array) -> bytes:
    """Return vertices (n, 3) in m as bytes; the error is at most half a quantisation step, plus the rounding error.

    Raises:
        TwinError: there are too many vertices.
    """
    v = np.asarray(vertices, float).reshape(-1, 3)
    if len(v) > MAX_VERTICES:
        raise TwinError(
            f"a deformable of {len(v)} vertices exceeds the maximum of {MAX_VERTICES}: send a coarser surface"
        )
    low = np.zeros(3, "<f4")
    step = np.zeros(3, "<f4")
    if len(v):
        low = v.min(axis=0).astype("<f4")
        # the largest value is quantised from the rounded `low`, from which a client computes it back
        step = ((v.max(axis=0) - low) / QUANTISATION_STEPS).astype("<f4")
    parts = np.divide(v - low, step, out=np.zeros_like(v), where=step > 0)
    levels = np.clip(np.rint(parts), 0, QUANTISATION_STEPS).astype("<u2").tobytes()
    return _BOX.pack(len(v), *low.tolist(), *step.tolist()) + levels + bytes(-len(levels) % 4)


def unpack_scene(data: bytes) -> SceneFrame:
    """Return the scene's frame in a binary message.

    Raises:
        TwinError: the message is not a frame of a scene, or its length does not match its parts.
    """
    if len(data) < _HEADER.size:
        raise TwinError(f"frame of a scene: {len(data)} bytes; the header needs {_HEADER.size}")
    magic, seq, server_time, time, robots, fields, flags = _HEADER.unpack_from(data)
    if magic != MAGIC:
        raise TwinError(f"frame of a scene: begins with {magic:#010x}, not with {MAGIC:#010x}")
    at = _HEADER.size
    parts = []
    bends = []
    for _ in range(robots):
        end = at + wire.size_of(data[at:])
        parts.append(wire.unpack(data[at:end]))
        at = end
    for field in range(fields):
        if len(data) < at + _BOX.size:
            raise TwinError(f"frame of a scene: {len(data)} bytes; field {field} begins at byte {at} and is truncated")
        n, *box = _BOX.unpack_from(data, at)
        at += _BOX.size
        end = at + 6 * n + (-6 * n) % 4
        if n > MAX_VERTICES or len(data) < end:
            raise TwinError(f"frame of a scene: {len(data)} bytes; field {field} with {n} vertices ends at byte {end}")
        levels = np.frombuffer(data, "<u2", 3 * n, at).reshape(n, 3)
        low = np.array(box[:3], np.float32)
        step = np.array(box[3:], np.float32)
        bends.append(low + step * levels.astype(np.float32))
        at = end
    if at != len(data):
        raise TwinError(f"frame of a scene: {len(data)} bytes; its parts need {at}")
    return SceneFrame(seq, server_time, time, flags, tuple(parts), tuple(bends))
