"""Operations of the protocol rosbridge v2 that clients send, validated with pydantic models.

The protocol is that of RobotWebTools (rosbridge_suite, ROSBRIDGE_PROTOCOL.md). Fragments, PNG compression, actions and
authentication are refused.
"""

from __future__ import annotations

from typing import Annotated, Literal, TypeVar

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError, field_validator

from twin.core.errors import DeviceError
from twin.core.json_types import JsonObject
from twin.schema import first_mistake

MAX_MESSAGE_BYTES = 16_384
"""Maximum length in bytes of a client's message."""

_Name = Annotated[str, Field(min_length=1, max_length=200)]
_Id = Annotated[str, Field(max_length=200)] | int | None


class _Operation(BaseModel):
    # Clients send further keys, such as queue_size and latch, which have no meaning here.
    model_config = ConfigDict(extra="ignore", frozen=True)

    id: _Id = None


class Advertise(_Operation):
    """The client will publish messages of a type to a topic."""

    op: Literal["advertise"]
    topic: _Name
    type: _Name


class Unadvertise(_Operation):
    """The client will no longer publish to a topic."""

    op: Literal["unadvertise"]
    topic: _Name


class Publish(_Operation):
    """A message for a topic."""

    op: Literal["publish"]
    topic: _Name
    msg: JsonObject


class Subscribe(_Operation):
    """A request for the messages of a topic, at most one in `throttle_rate` ms."""

    op: Literal["subscribe"]
    topic: _Name
    type: Annotated[str, Field(max_length=200)] | None = None
    throttle_rate: Annotated[float, Field(ge=0, le=3_600_000)] = 0
    compression: Annotated[str, Field(max_length=40)] = "none"

    @field_validator("compression", mode="before")
    @classmethod
    def _none(cls, value: object) -> object:
        return "none" if value is None else value


class Unsubscribe(_Operation):
    """The end of a subscription."""

    op: Literal["unsubscribe"]
    topic: _Name


class CallService(_Operation):
    """A call of a service."""

    op: Literal["call_service"]
    service: _Name
    args: JsonObject | list[object] | None = None


class SetLevel(_Operation):
    """The least severity of the status messages that the client wants."""

    op: Literal["set_level"]
    level: Literal["info", "warning", "error", "none"]


Operation = Advertise | Unadvertise | Publish | Subscribe | Unsubscribe | CallService | SetLevel

_OPERATION_ADAPTER: TypeAdapter[Operation] = TypeAdapter(Annotated[Operation, Field(discriminator="op")])


def parse(text: str | bytes) -> Operation:
    """Return the operation in a message.

    Raises:
        DeviceError: the message is no such operation; the error text, of at most 300 characters, names key and rule.
    """
    if isinstance(text, bytes):
        raise DeviceError("a binary message was received; send JSON text")
    try:
        return _OPERATION_ADAPTER.validate_json(text)
    except ValidationError as error:
        raise DeviceError(_mistake(error)) from None


def _mistake(error: ValidationError) -> str:
    where, what = first_mistake(error)
    text = f"{where}: {what}" if where else what
    return text[:300]


# -- messages -------------------------------------------------------------------------------------------


class _Message(BaseModel):
    # Time stamps are ignored: the time of a message is that of its arrival.
    model_config = ConfigDict(extra="ignore", frozen=True, allow_inf_nan=False)


class Vector(_Message):
    """geometry_msgs/Point or Vector3."""

    x: float
    y: float
    z: float


class Quaternion(_Message):
    """geometry_msgs/Quaternion."""

    x: float
    y: float
    z: float
    w: float


class Pose(_Message):
    """geometry_msgs/Pose."""

    position: Vector
    orientation: Quaternion


class Header(_Message):
    """std_msgs/Header."""

    frame_id: Annotated[str, Field(max_length=200)] = ""


class PoseStamped(_Message):
    """geometry_msgs/PoseStamped; without a frame, the pose is in that of the topic."""

    header: Header = Field(default_factory=Header)
    pose: Pose

    @property
    def p(self) -> tuple[float, float, float]:
        """Position in m."""
        position = self.pose.position
        return position.x, position.y, position.z

    @property
    def q_wxyz(self) -> tuple[float, float, float, float]:
        """Quaternion, w first."""
        q = self.pose.orientation
        return q.w, q.x, q.y, q.z

    def require_frame(self, frame: str) -> None:
        """Check that the pose is in this frame.

        Raises:
            DeviceError: the header names another one.
        """
        frame_id = self.header.frame_id
        if frame_id not in ("", frame):
            raise DeviceError(f"frame_id is {frame_id[:100]!r}; give the pose in {frame}, or leave frame_id empty")


class Joy(_Message):
    """sensor_msgs/Joy; of a pedal, button 0."""

    buttons: Annotated[list[Annotated[int, Field(ge=0, le=2)]], Field(min_length=1, max_length=64)]


class Float64(_Message):
    """std_msgs/Float64."""

    data: float


class JointState(_Message):
    """sensor_msgs/JointState; names may be omitted, then the order is that of the robot."""

    name: Annotated[list[str], Field(max_length=64)] = Field(default_factory=list)
    position: Annotated[list[float], Field(min_length=1, max_length=64)]

    def value_of(self, joint: str) -> float:
        """Return the position of the one joint of a topic.

        Raises:
            DeviceError: the message has several positions, or names another joint.
        """
        if len(self.position) != 1:
            raise DeviceError(f"there are {len(self.position)} positions; give one, that of {joint}")
        if self.name not in ([], [joint]):
            raise DeviceError(f"name is {str(self.name)[:100]}; give [{joint!r}], or leave it empty")
        return self.position[0]


class StateCommand(_Message):
    """crtk_msgs/StringStamped of the topic state_command.

    `enable` and `home` press the start button of a machine, with which it moves to home; `disable` presses the stop
    button; `pause` releases the pedal.
    """

    string: Literal["enable", "home", "disable", "pause"]


_MessageType = TypeVar("_MessageType", bound=_Message)


def checked_message(kind: type[_MessageType], message: JsonObject) -> _MessageType:
    """Return a message as a model.

    Raises:
        DeviceError: the message does not have the fields of its type; the error text names field and rule.
    """
    try:
        return kind.model_validate(message)
    except ValidationError as error:
        raise DeviceError(_mistake(error)) from None
