"""Topics of a server for ROS clients, and the services by which clients list them, as those of the node rosapi."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from twin.core.errors import DeviceError
from twin.core.json_types import JsonObject
from twin.exchange.formats.mcap import ros_messages as ros
from twin.exchange.formats.mcap.ros_definitions import full_name, full_text

SERVICES = (
    "/rosapi/get_time",
    "/rosapi/services",
    "/rosapi/topic_type",
    "/rosapi/topics",
    "/rosapi/topics_and_raw_types",
)
"""Names of the services."""


@dataclass(frozen=True)
class InputTopic:
    """A topic to which clients publish.

    Attributes:
        type: name of the message type, such as geometry_msgs/PoseStamped.
        take: function of (client, message) that uses a message; it returns why the message is refused, or "".
        moves: whether the message moves a robot, so that the next picture is due at once.
    """

    type: str
    take: Callable[[str, JsonObject], str]
    moves: bool = False


@dataclass(frozen=True)
class OutputTopic:
    """A topic to which this program publishes.

    Attributes:
        type: name of the message type, such as geometry_msgs/PoseStamped.
        make: function that returns the newest message.
    """

    type: str
    make: Callable[[], JsonObject]


class TopicTable:
    """Inputs, outputs and services; subclasses add topics.

    Attributes:
        inputs: topics to which clients publish, by name.
        outputs: topics to which this program publishes, by name.
    """

    def __init__(self, clock: Callable[[], float]) -> None:
        """Create a table without topics; `clock` returns the time in s of the messages."""
        self._clock = clock
        self.inputs: dict[str, InputTopic] = {}
        self.outputs: dict[str, OutputTopic] = {}

    @property
    def t(self) -> float:
        """Time of the messages in s."""
        return self._clock()

    @property
    def types(self) -> dict[str, str]:
        """Type of each topic, by name."""
        types = {name: topic.type for name, topic in self.outputs.items()}
        for name, topic in self.inputs.items():
            types[name] = topic.type
        return dict(sorted(types.items()))

    def about(self) -> JsonObject:
        """Return what the state of the server says beside port and number of clients."""
        return {}

    def leave(self, client: str) -> None:
        """Forget a client that has disconnected."""

    def call(self, service: str, args: JsonObject | list[object] | None) -> JsonObject:
        """Return the answer of a service of the node rosapi.

        Raises:
            DeviceError: there is no such service, or an argument is missing or unknown.
        """
        types = self.types
        if service == "/rosapi/topics":
            return {"topics": list(types), "types": [full_name(kind) for kind in types.values()]}
        if service == "/rosapi/topics_and_raw_types":
            texts = [full_text(kind) for kind in types.values()]
            names = [full_name(kind) for kind in types.values()]
            return {"topics": list(types), "types": names, "typedefs_full_text": texts}
        if service == "/rosapi/topic_type":
            topic = _argument(args, "topic")
            kind = types.get(topic)
            return {"type": full_name(kind) if kind else ""}
        if service == "/rosapi/services":
            return {"services": list(SERVICES)}
        if service == "/rosapi/get_time":
            return {"time": ros.time_of(self.t)}
        raise DeviceError(f"there is no service {service}; there are {', '.join(SERVICES)}")


def _argument(args: JsonObject | list[object] | None, name: str) -> str:
    value = args.get(name) if isinstance(args, dict) else next(iter(args or ()), None)
    if not isinstance(value, str):
        raise DeviceError(f"the argument {name} is missing: give a text")
    return value
