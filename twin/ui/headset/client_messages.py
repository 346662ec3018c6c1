"""Messages of clients to `twin serve`: JSON text, validated with strict pydantic models; see docs/stream.md."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError, model_validator
from pydantic_core import from_json

from twin.core.errors import TwinError
from twin.schema import first_mistake

_MAX_ID_LENGTH = 40
"""Maximum number of characters of a message's identifier."""

LONGEST_MESSAGE = 4096
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

_Coordinate = Annotated[float, Field(ge=-100, le=100)]
_Name = Annotated[str, Field(min_length=1, max_length=64)]
_Vector = tuple[_Coordinate, _Coordinate, _Coordinate]
_Near = Annotated[float, Field(ge=-10, le=10)]
_OPEN = 2 * math.pi
_Part = Annotated[float, Field(ge=-1.01, le=1.01)]

_DRAG_TOLERANCE = 0.1
"""Tolerance of the squared length of a quaternion in a drag, which may have few digits."""

_HAND_TOLERANCE = 0.001
"""Tolerance of the squared length of a hand's quaternion: the instruments repeat the rotation of the hand."""


def _is_unit(quaternion: Sequence[float], tolerance: float) -> bool:
    """Return whether the squared length of a quaternion differs from 1 by less than a tolerance."""
    squared_length = 0.0
    for component in quaternion:
        squared_length += component * component
    return 1 - tolerance < squared_length < 1 + tolerance


class _Message(BaseModel):
    model_config = ConfigDict(strict=True, extra="forbid", frozen=True, allow_inf_nan=False)

    id: Annotated[int, Field(ge=0, le=2**53)] | Annotated[str, Field(max_length=_MAX_ID_LENGTH)] | None = None


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
        targets = [target for target in (self.pose, self.value, self.point) if target is not None]
        if len(targets) != 1:
            raise ValueError("give exactly one of pose, value and point")
        if self.pose is not None and not _is_unit(self.pose[3:], _DRAG_TOLERANCE):
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
        if not _is_unit(self.pose[3:], _HAND_TOLERANCE):
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

ClientMessage = (
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


_MESSAGE_ADAPTER: TypeAdapter[ClientMessage] = TypeAdapter(Annotated[ClientMessage, Field(discriminator="type")])


class RefusedError(TwinError):
    """A refused message.

    Attributes:
        code: key of `ERRORS`.
        id: identifier of the refused message; None if the message has no identifier.
    """

    def __init__(self, code: str, text: str, id: int | str | None = None) -> None:
        super().__init__(text)
        self.code = code
        self.id = id


def parse_message(text: str | bytes) -> ClientMessage:
    """Return the client message in a JSON text of at most `LONGEST_MESSAGE` bytes.

    Raises:
        RefusedError: the message is invalid (code "invalid"). The error text, of at most 300 characters, names the
            field and the rule. The text may repeat an unknown type or key of the message, but no value of a field.
    """
    if isinstance(text, bytes):
        raise RefusedError("invalid", "clients send JSON text, not binary messages")
    if len(text.encode(errors="surrogatepass")) > LONGEST_MESSAGE:
        raise RefusedError("invalid", f"the message is longer than {LONGEST_MESSAGE} bytes")
    try:
        return _MESSAGE_ADAPTER.validate_json(text)
    except ValidationError as error:
        field, problem = first_mistake(error)
        if field:
            problem = f"{field}: {problem}"
        raise RefusedError("invalid", problem[:300], _id(text)) from None


def _id(text: str) -> int | str | None:
    """Return the identifier of an invalid message, so that its client can match the answer; None: there is none."""
    try:
        data = from_json(text)
    except (ValueError, TypeError):  # not JSON, or an unpaired surrogate
        return None
    if not isinstance(data, dict):
        return None
    identifier = data.get("id")
    if isinstance(identifier, str):
        return identifier[:_MAX_ID_LENGTH]
    # a boolean is an int for isinstance
    if type(identifier) is int:
        return identifier
    return None
