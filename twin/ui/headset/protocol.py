"""Wire protocol between `twin serve` and a page, a headset or Unity; see docs/stream.md.

A frame is a binary message with the poses of all links at one time; all other messages are JSON text. Messages from
clients are validated with strict pydantic models.
"""

from __future__ import annotations

import base64
import math
import struct
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError, model_validator
from pydantic_core import from_json

from twin.core import spatial
from twin.core.errors import TwinError
from twin.core.json_types import JsonObject
from twin.core.spatial import Array
from twin.schema import first_mistake

ALONE, VERSION = 1, 2
"""Protocol version in `hello`: 1 for one robot; 2 for a scene, several robots, or deformables (fields)."""

MAGIC = 0x314E5754
"""First four bytes of a frame: "TWN1"."""

GHOST, PLAYING, REFUSED, HELD = 1, 2, 4, 8
"""Flags of a frame.

GHOST: the frame contains a ghost (tool pose computed by the equations). PLAYING: a protocol is playing. REFUSED: the
last request was refused. HELD: a client holds the robot.
"""

LONGEST = 4096
"""Maximum length in bytes of a client's message."""

ERRORS = {
    "invalid": "the message is unknown, or a value is out of range",
    "unknown": "there is no protocol, posture, joint, link, distance or variant of that name",
    "held": "another client holds the robot",
    "not_held": "a drag without a grab, or a drag that does not match the grab",
    "refused": "not supported by this robot or with these server options",
    "rate": "too many messages; the excess is dropped",
    "released": "the grab was released, because its client sent nothing for too long",
    "failed": "an action failed; see the message",
}
"""Meaning of each code of the document `error`."""

_HEADER = struct.Struct("<IIddHHI")


# -- frames ---------------------------------------------------------------------------------------------

OBJECTS = "objects"
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
        flags: see `GHOST`, `PLAYING`, `REFUSED`, `HELD`.
        ghost: (7,) float32: tool pose in the world frame, computed by the equations; None without the flag `GHOST`.
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
    parts = (poses, q) if ghost is None else (poses, q, ghost)
    return b"".join(np.ascontiguousarray(p, "<f4").tobytes() for p in parts)


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
    return _HEADER.size + 4 * (7 * links + joints + (7 if flags & GHOST else 0))


def unpack(data: bytes) -> RobotFrame:
    """Return the frame in a binary message.

    Raises:
        TwinError: the message is not a frame, or its length differs from the length in its header.
    """
    size = size_of(data)
    _, seq, server_time, clip_time, links, joints, flags = _HEADER.unpack_from(data)
    if len(data) != size:
        raise TwinError(f"frame: {len(data)} bytes; {links} links and {joints} joints need {size}")
    counts = (7 * links, joints, 7 if flags & GHOST else 0)
    values = np.frombuffer(data, "<f4", offset=_HEADER.size)
    poses, q, ghost = np.split(values, np.cumsum(counts)[:2])
    return RobotFrame(seq, server_time, clip_time, poses.reshape(links, 7), q, flags, ghost if flags & GHOST else None)


def sevens(Ts: Array) -> Array:
    """Return poses (..., 4, 4) as (..., 7): x y z in m, and the quaternion x y z w with w >= 0."""
    q = spatial.quat_from_matrix_wxyz(Ts[..., :3, :3])
    return np.concatenate([Ts[..., :3, 3], np.roll(q, -1, axis=-1)], axis=-1)


def pose_of(seven: Any) -> Array:
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
    out = sevens.copy()
    out[np.sum(sevens[:, 3:] * last[:, 3:], axis=1) < 0, 3:] *= -1
    return out


def still(robots: Iterable[str]) -> JsonObject:
    """Return the document `state` of a source that plays no protocol; `robots`: names of the displayed robots."""
    clock = {"playing": False, "time": 0.0, "duration": 0.0, "speed": 1.0, "loop": False}
    return {"type": "state", **clock, "robots": [{"name": n, "reason": None} for n in robots]}


def floats(values: np.ndarray) -> str:
    """Return values in base64, as little-endian float32 (the format of poses and points in documents)."""
    return base64.b64encode(np.ascontiguousarray(values, "<f4").tobytes()).decode()


# -- client messages ------------------------------------------------------------------------------------

_Coordinate = Annotated[float, Field(ge=-100, le=100)]
_Name = Annotated[str, Field(min_length=1, max_length=64)]
_Vector = tuple[_Coordinate, _Coordinate, _Coordinate]
_Near = Annotated[float, Field(ge=-10, le=10)]
_OPEN = 2 * math.pi
_Part = Annotated[float, Field(ge=-1.01, le=1.01)]


class _Message(BaseModel):
    model_config = ConfigDict(strict=True, extra="forbid", frozen=True, allow_inf_nan=False)

    id: Annotated[int, Field(ge=0, le=2**53)] | Annotated[str, Field(max_length=40)] | None = None


class _RobotMessage(_Message):
    """A message for one robot of a scene; the robot's name may be omitted if only one robot is possible."""

    robot: _Name | None = None


class PlayMessage(_Message):
    """Play or pause the protocol."""

    type: Literal["play"]
    on: bool


class SeekMessage(_Message):
    """Set the playback time in s."""

    type: Literal["seek"]
    t: Annotated[float, Field(ge=0, le=1e6)]


class SpeedMessage(_Message):
    """Set the playback speed."""

    type: Literal["speed"]
    value: Annotated[float, Field(ge=0.05, le=8)]


class LoopMessage(_Message):
    """Set whether the protocol loops."""

    type: Literal["loop"]
    on: bool


class ProtocolMessage(_RobotMessage):
    """Choose a protocol of the robot."""

    type: Literal["protocol"]
    name: _Name


class PostureMessage(_RobotMessage):
    """Move the robot to a named posture."""

    type: Literal["posture"]
    name: _Name


class UndoMessage(_RobotMessage):
    """Move the robot back to where the last grab began."""

    type: Literal["undo"]


class GrabMessage(_RobotMessage):
    """Grab the tool, a joint, or a link at `point` (3,) in m in the link's frame."""

    type: Literal["grab"]
    target: Literal["tool", "joint", "link"]
    name: _Name | None = None
    point: _Vector | None = None

    @model_validator(mode="after")
    def _fits(self) -> GrabMessage:
        if (self.name is None) != (self.target == "tool"):
            raise ValueError("name: required to grab a joint or a link, not allowed for the tool")
        if (self.point is None) != (self.target != "link"):
            raise ValueError("point: [x, y, z] in the link's frame; required to grab a link, not allowed otherwise")
        return self


class DragMessage(_RobotMessage):
    """Drag a grabbed tool to a pose, a joint to a value, or a point of a link to a position (m, rad, world frame)."""

    type: Literal["drag"]
    pose: tuple[_Coordinate, _Coordinate, _Coordinate, _Part, _Part, _Part, _Part] | None = None
    value: Annotated[float, Field(ge=-1e4, le=1e4)] | None = None
    point: _Vector | None = None

    @model_validator(mode="after")
    def _one(self) -> DragMessage:
        if sum(v is not None for v in (self.pose, self.value, self.point)) != 1:
            raise ValueError("give exactly one of pose, value and point")
        if self.pose is not None and not 0.9 < sum(v * v for v in self.pose[3:]) < 1.1:
            raise ValueError("pose: the quaternion x y z w must have length 1")
        return self


class ReleaseMessage(_RobotMessage):
    """Release the grab."""

    type: Literal["release"]


class VariantMessage(_RobotMessage):
    """Show the ghost for a variant of the equations ("printed" or "eq1=printed"); null hides the ghost."""

    type: Literal["variant"]
    name: _Name | None


class DistanceMessage(_RobotMessage):
    """Set a distance of joints, by its index in the robot's description, to a value in m; null: as drawn.

    Without an index, all distances become as drawn.
    """

    type: Literal["distance"]
    index: Annotated[int, Field(ge=0, lt=10_000)] | None = None
    value: Annotated[float, Field(gt=0, le=1e3)] | None = None

    @model_validator(mode="after")
    def _fits(self) -> DistanceMessage:
        if self.index is None and self.value is not None:
            raise ValueError("index: required with a value")
        return self


class WorkspaceMessage(_RobotMessage):
    """Compute the tool positions reachable at the present orientation, or stop the computation and clear the points."""

    type: Literal["workspace"]
    on: bool


class RecordMessage(_Message):
    """Begin or end a recording; requires a server started with --record."""

    type: Literal["record"]
    on: bool


class HandInput(BaseModel):
    """Input of one hand: pose of the console's handle, and angle of the gripper in rad.

    The pose is in frame {H}, the axes of the endoscope's picture: x y z in m, quaternion x y z w.
    """

    model_config = ConfigDict(strict=True, extra="forbid", frozen=True, allow_inf_nan=False)

    pose: tuple[_Near, _Near, _Near, _Part, _Part, _Part, _Part]
    grip: Annotated[float, Field(ge=-_OPEN, le=_OPEN)]

    @model_validator(mode="after")
    def _unit(self) -> HandInput:
        if not 0.999 < sum(v * v for v in self.pose[3:]) < 1.001:
            raise ValueError("pose: the quaternion x y z w must have length 1")
        return self


class HandsMessage(_Message):
    """Both hands and the pedals of a console; `number` increases by one with each message."""

    type: Literal["hands"]
    number: Annotated[int, Field(ge=0, lt=2**32)]
    right: HandInput
    left: HandInput
    clutch: bool
    camera: bool


class ScaleMessage(_Message):
    """Set the motion scale of a console."""

    type: Literal["scale"]
    value: Annotated[float, Field(ge=0.05, le=1)]


class TaskMessage(_Message):
    """End the present attempt at the task of a console, begin a new one, or start another task of the scene.

    `name` is the task to start; null: no task, the hands only move the robots.
    """

    type: Literal["task"]
    do: Literal["end", "restart", "start"]
    name: Annotated[str, Field(max_length=100)] | None = None


class FormMessage(_Message):
    """Answer the questionnaire that a console asks now; null: no answer to this item, or no comparisons of pairs."""

    type: Literal["form"]
    when: Literal["before", "after"]
    name: Annotated[str, Field(max_length=40)]
    answers: Annotated[list[float | None], Field(max_length=100)]
    weights: Annotated[list[float] | None, Field(max_length=100)] = None


class HapticsMessage(_Message):
    """Switch the forces on the hands of a console on or off."""

    type: Literal["haptics"]
    on: bool


class FulcrumMessage(_Message):
    """Choose which end of the instruments the hands move: the tip ("compensated") or the outer end ("direct")."""

    type: Literal["fulcrum"]
    mode: Literal["compensated", "direct"]


class TrainingMessage(_Message):
    """Request a mode of the machines' trainer: teleoperation, rehearsal, check of the rehearsed motion, or replay."""

    type: Literal["training"]
    mode: Literal["teleoperate", "rehearse", "judge", "replay"]


class ButtonMessage(_Message):
    """Press a button of the machines."""

    type: Literal["button"]
    button: Literal["start", "stop"]


class PlanMessage(_Message):
    """Planning mode for the arm of a hand: move a target, find a motion to the target, accept the motion, or cancel."""

    type: Literal["plan"]
    do: Literal["aim", "find", "accept", "cancel"]
    hand: Literal["right", "left"]


class ToolMessage(_Message):
    """Choose the tool of the instrument that a hand controls."""

    type: Literal["tool"]
    hand: Literal["right", "left"]
    name: _Name


class PingMessage(_Message):
    """Request a `pong` with the same t and the server's time; a grab is not released while its client sends pings."""

    type: Literal["ping"]
    t: Annotated[float, Field(ge=-1e15, le=1e15)]


RobotMessage = (
    ProtocolMessage
    | PostureMessage
    | UndoMessage
    | GrabMessage
    | DragMessage
    | ReleaseMessage
    | VariantMessage
    | DistanceMessage
    | WorkspaceMessage
)
"""Classes of messages for one robot; other messages concern clock, recording, console or connection."""

Message = (
    PlayMessage
    | SeekMessage
    | SpeedMessage
    | LoopMessage
    | RobotMessage
    | HandsMessage
    | ScaleMessage
    | TaskMessage
    | FormMessage
    | HapticsMessage
    | FulcrumMessage
    | TrainingMessage
    | ButtonMessage
    | PlanMessage
    | ToolMessage
    | RecordMessage
    | PingMessage
)
"""Classes of all client messages."""


_ADAPTER: TypeAdapter[Message] = TypeAdapter(Annotated[Message, Field(discriminator="type")])


class RefusedError(TwinError):
    """A refused message.

    Attributes:
        code: key of `ERRORS`.
        id: identifier of the refused message; None if the message has no identifier.
    """

    def __init__(self, code: str, text: str, id: int | str | None = None) -> None:
        super().__init__(text)
        self.code, self.id = code, id


def parse(text: str | bytes) -> Message:
    """Return the client message in a JSON text of at most `LONGEST` bytes.

    Raises:
        RefusedError: the message is invalid (code "invalid"). The error text, of at most 300 characters, names the
            field and the rule. The text may repeat an unknown type or key of the message, but no value of a field.
    """
    if isinstance(text, bytes):
        raise RefusedError("invalid", "clients send JSON text, not binary messages")
    if len(text.encode(errors="surrogatepass")) > LONGEST:
        raise RefusedError("invalid", f"the message is longer than {LONGEST} bytes")
    try:
        return _ADAPTER.validate_json(text)
    except ValidationError as error:
        where, what = first_mistake(error)
        raise RefusedError("invalid", f"{where + ': ' if where else ''}{what}"[:300], _id(text)) from None


def _id(text: str) -> int | str | None:
    try:
        data = from_json(text)
    except (ValueError, TypeError):  # not JSON, or an unpaired surrogate
        return None
    found = data.get("id") if isinstance(data, dict) else None
    return found[:40] if isinstance(found, str) else found if type(found) is int else None
