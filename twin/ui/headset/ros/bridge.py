"""WebSocket server of the protocol rosbridge v2, by which programs of ROS systems move and watch robots.

Messages are JSON text; a subscription may ask for CBOR. There is one queue place a topic and client: a client that
receives slowly gets the newest message, never an old one.
"""

from __future__ import annotations

import math
import ssl
import time
from collections.abc import Callable, Collection
from dataclasses import dataclass, field
from http import HTTPStatus

from pydantic_core import to_json
from websockets.asyncio.server import Server, ServerConnection, broadcast
from websockets.exceptions import ConnectionClosed
from websockets.http11 import Request, Response

from twin.core.errors import DeviceError, TwinError
from twin.core.extras import require
from twin.core.json_types import JsonObject
from twin.exchange.formats.mcap.ros_definitions import full_name, short_name
from twin.ui.access.connection import Connection
from twin.ui.access.rate_limits import MALFORMED_LIMIT, Bucket, ConnectionCounter
from twin.ui.access.requests import WebSocketLimits, check_request, end, listen
from twin.ui.access.responses import error_response
from twin.ui.access.rules import AccessRules
from twin.ui.headset.ros import operations
from twin.ui.headset.ros.topic_table import TopicTable

FRAME_LIMIT = (4000.0, 8000.0)
"""Limit of WebSocket frames from one client: (per second, burst); two hands at 500 Hz with grips send 2000."""

BYTE_LIMIT = (2_000_000.0, 4_000_000.0)
"""Limit of bytes from one client: (per second, burst)."""

_MAX_SUBSCRIPTIONS = 256
"""Maximum number of topics to which one client subscribes."""

_CALL_LIMIT = (1000.0, 4000.0)
"""Limit of service calls from one client: (per second, burst)."""

_MAX_UNREAD_BYTES = 1_000_000
"""Maximum number of bytes of answers that a client has not read."""

_STATUS_PAUSE = 1.0
"""Time in s after a status message about a topic during which the same message is not repeated."""

COMPRESSIONS = ("none", "cbor")
"""Compressions of messages that a client may ask for."""

_STATUS_LEVELS = ("info", "warning", "error", "none")
"""Severities of status messages, the least first."""


@dataclass
class _Subscription:
    """Topic to which a client subscribes, once or several times under different identifiers.

    Attributes:
        pauses: least time in s between two messages, by identifier; the shortest counts.
        cbor: whether one of the subscriptions wants CBOR.
        sent: time in s of the last message.
    """

    pauses: dict[str | int | None, float] = field(default_factory=dict)
    cbor: bool = False
    sent: float = -math.inf

    def due(self, now: float) -> bool:
        return now - self.sent >= min(self.pauses.values())


@dataclass(eq=False)
class _Client:
    """A connected client."""

    name: str
    ws: Connection
    garbage: Bucket
    calls: Bucket
    advertised: set[str] = field(default_factory=set)
    subscriptions: dict[str, _Subscription] = field(default_factory=dict)
    level: str = "error"
    told: dict[str, float] = field(default_factory=dict)

    def send(self, document: JsonObject) -> None:
        """Send a document; disconnect a client that does not read its answers."""
        if self.ws.waiting > _MAX_UNREAD_BYTES:
            self.ws.cut()
            return
        broadcast([self.ws], to_json(document).decode())

    def status(self, level: str, text: str, id: str | int | None = None) -> None:
        """Send a status message, unless its level is below that of the client."""
        if _STATUS_LEVELS.index(level) < _STATUS_LEVELS.index(self.level):
            return
        document: JsonObject = {"op": "status", "level": level, "msg": text}
        if id is not None:
            document["id"] = id
        self.send(document)

    def refuse(self, subject: str, text: str, id: str | int | None, now: float) -> None:
        """Send a status message of level error about a topic, unless one was sent in the last `_STATUS_PAUSE` s."""
        if now - self.told.get(subject, -math.inf) < _STATUS_PAUSE:
            return
        if len(self.told) > _MAX_SUBSCRIPTIONS:
            self.told.clear()
        self.told[subject] = now
        self.status("error", f"{subject}: {text}", id)


class RosBridge:
    """Server of the topics of a console or of a machine.

    Attributes:
        port: port on which the server listens; valid after `start`.
        hurry: function that is called after a message that moves a robot.
    """

    def __init__(self, topics: TopicTable, rules: AccessRules) -> None:
        """Prepare to serve topics to clients that the rules accept."""
        self.topics = topics
        self.port = 0
        self.hurry: Callable[[], object] = lambda: None
        self._rules = rules
        self._clients: list[_Client] = []
        self._counter = ConnectionCounter()
        self._last_number = 0

    async def start(self, host: str, port: int, context: ssl.SSLContext | None = None) -> None:
        """Start listening on an address and a port (0: any free port); `context` enables TLS."""
        limits = WebSocketLimits(operations.MAX_MESSAGE_BYTES, BYTE_LIMIT, FRAME_LIMIT)
        self._server: Server = await listen(
            self._serve, host, port, self._check, self._counter, limits, context=context
        )
        first_socket = next(iter(self._server.sockets))
        self.port = int(first_socket.getsockname()[1])

    async def close(self) -> None:
        """Disconnect all clients and stop."""
        self.hurry = lambda: None
        await end(self._server)

    def state(self) -> JsonObject:
        """Return port, number of clients, and what the topics say about them, as an entry of `state`."""
        return {"port": self.port, "clients": len(self._clients), **self.topics.about()}

    # -- clients --------------------------------------------------------------------------------------

    def _check(self, connection: ServerConnection, request: Request) -> Response | None:
        checked = check_request(self._rules, connection, request)
        if isinstance(checked, Response):
            return checked
        if not checked.upgrade or checked.head_only:
            text = "this address accepts only WebSockets of the protocol rosbridge"
            response = error_response(HTTPStatus.UPGRADE_REQUIRED, text, checked.head_only)
            response.headers["Upgrade"] = "websocket"
            return response
        if checked.authorized or self._rules.use_token(checked.query.get("token", "")):
            return None
        text = "add ?token=… to the address, with the newest token that the terminal shows"
        return error_response(HTTPStatus.FORBIDDEN, text)

    async def _serve(self, connection: Connection) -> None:
        self._last_number += 1
        now = time.monotonic()
        client = _Client(
            f"ROS client {self._last_number}", connection, Bucket(*MALFORMED_LIMIT, now), Bucket(*_CALL_LIMIT, now)
        )
        connection.limit_send_queue()
        self._clients.append(client)
        try:
            async for text in connection:
                self._hear(client, text)
        except ConnectionClosed:
            pass
        finally:
            self._clients.remove(client)
            self.topics.leave(client.name)

    def _hear(self, client: _Client, text: str | bytes) -> None:
        """Handle a message of a client."""
        now = time.monotonic()
        try:
            operation = operations.parse(text)
        except DeviceError as error:
            client.status("error", str(error))
            if not client.garbage.take(now):
                client.ws.cut()
            return
        try:
            self._handle(client, operation)
        except TwinError as error:
            client.refuse(_subject(operation), str(error), operation.id, now)

    def _handle(self, client: _Client, operation: operations.Operation) -> None:
        """Handle an operation.

        Raises:
            TwinError: the operation is refused.
        """
        match operation:
            case operations.Publish():
                self._publish(client, operation)
            case operations.Advertise():
                self._require_type(operation.topic, operation.type, self.topics.inputs)
                client.advertised.add(operation.topic)
            case operations.Unadvertise():
                client.advertised.discard(operation.topic)
            case operations.Subscribe():
                self._subscribe(client, operation)
            case operations.Unsubscribe():
                _unsubscribe(client, operation)
            case operations.CallService():
                self._call(client, operation)
            case operations.SetLevel():
                client.level = operation.level

    def _publish(self, client: _Client, operation: operations.Publish) -> None:
        topic = self.topics.inputs.get(operation.topic)
        if topic is None:
            raise DeviceError(_unknown_topic(operation.topic, self.topics.inputs))
        refusal = topic.take(client.name, operation.msg)
        if refusal:
            raise DeviceError(refusal)
        if topic.moves:
            self.hurry()

    def _subscribe(self, client: _Client, operation: operations.Subscribe) -> None:
        self._require_type(operation.topic, operation.type, self.topics.outputs)
        if len(client.subscriptions) >= _MAX_SUBSCRIPTIONS:
            raise DeviceError(f"a client may subscribe to at most {_MAX_SUBSCRIPTIONS} topics")
        if operation.compression not in COMPRESSIONS:
            raise DeviceError(f"the compression {operation.compression} is not known: {', '.join(COMPRESSIONS)}")
        subscription = client.subscriptions.get(operation.topic, _Subscription())
        if operation.compression == "cbor":
            require("cbor2", "a subscription with CBOR")
            subscription.cbor = True
        if len(subscription.pauses) >= _MAX_SUBSCRIPTIONS:
            raise DeviceError(f"a client may subscribe to a topic at most {_MAX_SUBSCRIPTIONS} times")
        subscription.pauses[operation.id] = operation.throttle_rate / 1000
        subscription.sent = -math.inf
        client.subscriptions[operation.topic] = subscription
        self._send_to([client], {operation.topic}, time.monotonic())

    def _require_type(self, topic: str, kind: str | None, known_topics: dict) -> None:
        """Check that a topic exists and has the type that a client names, if it names one.

        Raises:
            DeviceError: there is no such topic, or it has another type.
        """
        if topic not in known_topics:
            raise DeviceError(_unknown_topic(topic, known_topics))
        topic_type = known_topics[topic].type
        if kind and short_name(kind) != topic_type:
            raise DeviceError(f"the type of the topic is {full_name(topic_type)}, not {kind}")

    def _call(self, client: _Client, operation: operations.CallService) -> None:
        answer: JsonObject = {"op": "service_response", "service": operation.service, "result": True}
        if operation.id is not None:
            answer["id"] = operation.id
        try:
            if not client.calls.take(time.monotonic()):
                raise DeviceError(f"more than {_CALL_LIMIT[0]:g} calls of services per second")
            answer["values"] = self.topics.call(operation.service, operation.args)
        except DeviceError as error:
            answer["result"] = False
            answer["values"] = str(error)
        client.send(answer)

    # -- messages to clients --------------------------------------------------------------------------

    def send(self) -> None:
        """Send the newest message of each topic to its subscribers."""
        subscribed_topics = set()
        for client in self._clients:
            subscribed_topics.update(client.subscriptions)
        if subscribed_topics:
            self._send_to(self._clients, subscribed_topics, time.monotonic())

    def _send_to(self, clients: list[_Client], topics: Collection[str], now: float) -> None:
        """Send topics to clients; a topic that a client got longest ago comes first, so that none is left out."""
        oldest = dict.fromkeys(topics, now)
        for client in clients:
            for topic in oldest.keys() & client.subscriptions.keys():
                oldest[topic] = min(oldest[topic], client.subscriptions[topic].sent)
        for topic in sorted(oldest, key=lambda name: (oldest[name], name)):
            self._send_topic(clients, topic, now)

    def _send_topic(self, clients: list[_Client], topic: str, now: float) -> None:
        receivers: dict[bool, list[Connection]] = {True: [], False: []}
        for client in clients:
            subscription = client.subscriptions.get(topic)
            if subscription is None or client.ws.waiting or not subscription.due(now):
                continue
            subscription.sent = now
            receivers[subscription.cbor].append(client.ws)
        if not any(receivers.values()):
            return
        try:
            message = self.topics.outputs[topic].make()
        except TwinError:  # no pose belongs to the joint values: the topic has no message now
            return
        document = {"op": "publish", "topic": topic, "msg": message}
        if receivers[False]:
            broadcast(receivers[False], to_json(document, inf_nan_mode="null").decode())
        if receivers[True]:
            cbor = require("cbor2", "a subscription with CBOR")
            broadcast(receivers[True], cbor.dumps(document))


def _unsubscribe(client: _Client, operation: operations.Unsubscribe) -> None:
    """End the subscription of a topic with an identifier, or all of them if none is given."""
    subscription = client.subscriptions.get(operation.topic)
    if subscription is None:
        return
    subscription.pauses.pop(operation.id, None)
    if operation.id is None or not subscription.pauses:
        del client.subscriptions[operation.topic]


def _subject(operation: operations.Operation) -> str:
    """Return what a refused operation was about: its topic or service, else its name."""
    if isinstance(operation, operations.CallService):
        return operation.service
    return getattr(operation, "topic", operation.op)


def _unknown_topic(topic: str, known_topics: dict) -> str:
    return f"there is no such topic here; known: {', '.join(sorted(known_topics))}"
