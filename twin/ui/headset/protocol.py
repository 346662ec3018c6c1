"""What goes over the wire between `twin serve` and a page, a headset or Unity; docs/stream.md is its description.

Frames are binary and whole: the poses of all links at one time. Everything else is JSON text. What a client says is
checked here against strict models before anything looks at it.
"""

from __future__ import annotations

import base64
import struct
from dataclasses import dataclass
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError, model_validator
from pydantic_core import from_json

from twin.core import spatial
from twin.core.errors import TwinError
from twin.core.spatial import Array

VERSION = 1
"""Of the protocol, told in `hello`."""

MAGIC = 0x314E5754
"""First four bytes of a frame: "TWN1"."""

GHOST, PLAYING, REFUSED, HELD = 1, 2, 4, 8
"""Flags of a frame: a ghost follows, a protocol runs, the last request was refused, somebody holds the robot."""

LONGEST = 4096
"""Bytes of the longest message that a client may send."""

ERRORS = {
    "invalid": "the message is not one of this protocol, or a value is out of range",
    "unknown": "there is no protocol, posture, joint, link or variant of that name",
    "held": "somebody else holds the robot",
    "not_held": "a drag without a grab, or one that does not fit the grab",
    "refused": "this robot, or this server as it was started, cannot do that",
    "rate": "too many messages; what was too much is dropped",
    "released": "the grab is lost: its holder was silent",
    "failed": "something was tried and did not succeed; the message says what",
}
"""Codes of `error`."""

_HEADER = struct.Struct("<IIddHHI")


# -- frames ---------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Frame:
    """One whole frame.

    Attributes:
        seq: counts frames from 0, modulo 2^32.
        server_time: s of the server's monotonic clock, for which the poses were due.
        clip_time: s in the protocol.
        poses: (links, 7) float32: x y z in m and quaternion x y z w, of every link in world, z up.
        q: (joints,) float32 in m or rad, of the active joints.
        flags: see `GHOST`, `PLAYING`, `REFUSED`, `HELD`.
        ghost: (7,) float32, the tool in world by the equations; with the flag `GHOST`.
    """

    seq: int
    server_time: float
    clip_time: float
    poses: np.ndarray
    q: np.ndarray
    flags: int
    ghost: np.ndarray | None = None


def pack(seq: int, server_time: float, clip_time: float, flags: int, body: bytes, links: int, joints: int) -> bytes:
    """Return a frame of a body made by `pack_body`."""
    return _HEADER.pack(MAGIC, seq & 0xFFFFFFFF, server_time, clip_time, links, joints, flags) + body


def pack_body(poses: np.ndarray, q: np.ndarray, ghost: np.ndarray | None) -> bytes:
    """Return the part of a frame that speaks of the robot: poses (links, 7), q (joints,), ghost (7,) or None."""
    parts = (poses, q) if ghost is None else (poses, q, ghost)
    return b"".join(np.ascontiguousarray(p, "<f4").tobytes() for p in parts)


def unpack(data: bytes) -> Frame:
    """Return the frame in a binary message.

    Raises:
        TwinError: it is no frame, or its length is not what its header says.
    """
    if len(data) < _HEADER.size:
        raise TwinError(f"frame: {len(data)} bytes; a header alone has {_HEADER.size}")
    magic, seq, server_time, clip_time, links, joints, flags = _HEADER.unpack_from(data)
    if magic != MAGIC:
        raise TwinError(f"frame: begins with {magic:#010x}, not with {MAGIC:#010x}")
    counts = (7 * links, joints, 7 if flags & GHOST else 0)
    size = _HEADER.size + 4 * sum(counts)
    if len(data) != size:
        raise TwinError(f"frame: {len(data)} bytes; {links} links and {joints} joints make {size}")
    values = np.frombuffer(data, "<f4", offset=_HEADER.size)
    poses, q, ghost = np.split(values, np.cumsum(counts)[:2])
    return Frame(seq, server_time, clip_time, poses.reshape(links, 7), q, flags, ghost if flags & GHOST else None)


def sevens(Ts: Array) -> Array:
    """Return poses (..., 4, 4) as (..., 7): x y z, and the quaternion x y z w with w >= 0."""
    q = spatial.quat_from_matrix_wxyz(Ts[..., :3, :3])
    return np.concatenate([Ts[..., :3, 3], np.roll(q, -1, axis=-1)], axis=-1)


def pose_of(seven: Any) -> Array:
    """Return the pose (4, 4) of x y z and a quaternion x y z w of any length but zero."""
    v = np.asarray(seven, float)
    q = np.roll(v[3:], 1)
    return spatial.pose(spatial.matrix_from_quat_wxyz(q / np.linalg.norm(q)), v[:3])


def near_signs(sevens: Array, last: Array | None) -> Array:
    """Return poses (n, 7) with each quaternion's sign as near to the last ones (n, 7) as can be."""
    if last is None or len(last) != len(sevens):
        return sevens
    out = sevens.copy()
    out[np.sum(sevens[:, 3:] * last[:, 3:], axis=1) < 0, 3:] *= -1
    return out


def floats(values: np.ndarray) -> str:
    """Return float32 values, little endian, in base64: how clouds are sent."""
    return base64.b64encode(np.ascontiguousarray(values, "<f4").tobytes()).decode()


# -- what a client says ---------------------------------------------------------------------------------

_Coordinate = Annotated[float, Field(ge=-100, le=100)]
_Name = Annotated[str, Field(min_length=1, max_length=64)]
_Vector = tuple[_Coordinate, _Coordinate, _Coordinate]
_Part = Annotated[float, Field(ge=-1.01, le=1.01)]


class _Message(BaseModel):
    model_config = ConfigDict(strict=True, extra="forbid", frozen=True, allow_inf_nan=False)

    id: Annotated[int, Field(ge=0, le=2**53)] | Annotated[str, Field(max_length=40)] | None = None


class Play(_Message):
    """Let the protocol run, or hold it."""

    type: Literal["play"]
    on: bool


class Seek(_Message):
    """Stand at a time of the protocol, in s."""

    type: Literal["seek"]
    t: Annotated[float, Field(ge=0, le=1e6)]


class Speed(_Message):
    """Seconds played for each that passes."""

    type: Literal["speed"]
    value: Annotated[float, Field(ge=0.05, le=8)]


class Loop(_Message):
    """Whether the protocol begins again at its end."""

    type: Literal["loop"]
    on: bool


class Protocol(_Message):
    """Take another protocol of the robot."""

    type: Literal["protocol"]
    name: _Name


class Posture(_Message):
    """Go to a named posture."""

    type: Literal["posture"]
    name: _Name


class Grab(_Message):
    """Take hold of the tool, of a joint, or of a link at a point (3,) in the link's frame, in m."""

    type: Literal["grab"]
    target: Literal["tool", "joint", "link"]
    name: _Name | None = None
    point: _Vector | None = None

    @model_validator(mode="after")
    def _fits(self) -> Grab:
        if (self.name is None) != (self.target == "tool"):
            raise ValueError("name: a joint or a link is grabbed by its name, the tool has none")
        if (self.point is None) != (self.target != "link"):
            raise ValueError("point: a link, and nothing else, is grabbed at a point [x, y, z] in its frame")
        return self


class Drag(_Message):
    """Lead what is held: the tool to a pose, a joint to a value in m or rad, a point of a link to a place in world."""

    type: Literal["drag"]
    pose: tuple[_Coordinate, _Coordinate, _Coordinate, _Part, _Part, _Part, _Part] | None = None
    value: Annotated[float, Field(ge=-1e4, le=1e4)] | None = None
    point: _Vector | None = None

    @model_validator(mode="after")
    def _one(self) -> Drag:
        if sum(v is not None for v in (self.pose, self.value, self.point)) != 1:
            raise ValueError("exactly one of pose, value and point")
        if self.pose is not None and not 0.9 < sum(v * v for v in self.pose[3:]) < 1.1:
            raise ValueError("pose: the quaternion x y z w must have length 1")
        return self


class Release(_Message):
    """Let go."""

    type: Literal["release"]


class Variant(_Message):
    """Show the tool by the equations in a variant ("printed" or "eq1=printed"); null shows no ghost."""

    type: Literal["variant"]
    name: _Name | None


class Workspace(_Message):
    """Find the positions that the tool reaches in its present orientation, or stop and forget them."""

    type: Literal["workspace"]
    on: bool


class Record(_Message):
    """Begin or end a recording; only where the server was started with --record."""

    type: Literal["record"]
    on: bool


class Ping(_Message):
    """Ask for a `pong` with the same t and the server's clock; keeps a grab alive."""

    type: Literal["ping"]
    t: Annotated[float, Field(ge=-1e15, le=1e15)]


Message = Play | Seek | Speed | Loop | Protocol | Posture | Grab | Drag | Release | Variant | Workspace | Record | Ping
"""Everything that a client may say."""

_ADAPTER: TypeAdapter[Message] = TypeAdapter(Annotated[Message, Field(discriminator="type")])


class RefusedError(TwinError):
    """A message that is not followed.

    Attributes:
        code: one of `ERRORS`.
        id: the message's own, or None.
    """

    def __init__(self, code: str, text: str, id: int | str | None = None) -> None:
        super().__init__(text)
        self.code, self.id = code, id


def parse(text: str | bytes) -> Message:
    """Return the message in a text of at most `LONGEST` bytes.

    Raises:
        RefusedError: "invalid"; the text says what is wrong, not what was sent.
    """
    if isinstance(text, bytes):
        raise RefusedError("invalid", "clients send JSON text, not binary messages")
    if len(text) > LONGEST:
        raise RefusedError("invalid", f"the message is longer than {LONGEST} bytes")
    try:
        return _ADAPTER.validate_json(text)
    except ValidationError as error:
        first = error.errors(include_url=False, include_input=False, include_context=False)[0]
        where = ".".join(str(p) for p in first["loc"])
        raise RefusedError("invalid", f"{where + ': ' if where else ''}{first['msg']}"[:300], _id(text)) from None


def _id(text: str) -> int | str | None:
    try:
        data = from_json(text)
    except (ValueError, TypeError):  # no JSON, or a lone surrogate
        return None
    found = data.get("id") if isinstance(data, dict) else None
    return found[:40] if isinstance(found, str) else found if type(found) is int else None
