"""WebSocket server of the protocol rosbridge v2, by which programs of ROS systems move and watch a console.

Messages are JSON text; a subscription may ask for CBOR. There is one queue place a topic and client: a client that
receives slowly gets the newest message, never an old one.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
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
from twin.ui.access.limits import GARBAGE, Bucket, ConnectionCounter
from twin.ui.access.requests import WebSocketLimits, check_request, listen
from twin.ui.access.responses import error_response
from twin.ui.access.rules import AccessRules
from twin.ui.headset.ros import operations
from twin.ui.headset.ros.topics import ConsoleTopics

MESSAGES = (4000.0, 8000.0)
"""Limit of WebSocket frames from one client: (per second, burst); two hands at 500 Hz with grips send 2000."""

BYTES = (2_000_000.0, 4_000_000.0)
"""Limit of bytes from one client: (per second, burst)."""

_SUBSCRIPTIONS = 256
"""Maximum number of topics to which one client subscribes."""

_QUIET = 1.0
"""Time in s after a status message about a topic during which the same message is not repeated."""

_LEVELS = ("info", "warning", "error", "none")
"""Severities of status messages, the least first."""


@dataclass
class _Subscription:
    """Topic to which a client subscribes; times in s."""

    pause: float
    cbor: bool
    sent: float = -math.inf


@dataclass(eq=False)
class _Client:
    """A connected client."""

    name: str
    ws: Connection
    garbage: Bucket
    advertised: set[str] = field(default_factory=set)
    subscriptions: dict[str, _Subscription] = field(default_factory=dict)
    level: str = "error"
    told: dict[str, float] = field(default_factory=dict)

    def send(self, document: JsonObject) -> None:
        broadcast([self.ws], to_json(document).decode())

    def status(self, level: str, text: str, id: str | int | None = None) -> None:
        """Send a status message, unless its level is below that of the client."""
        if _LEVELS.index(level) < _LEVELS.index(self.level):
            return
        document: JsonObject = {"op": "status", "level": level, "msg": text}
        if id is not None:
            document["id"] = id
        self.send(document)

    def status_once(self, text: str, now: float) -> None:
        """Send a status message of level error, unless the same text was sent in the last `_QUIET` s."""
        if now - self.told.get(text, -_QUIET) < _QUIET:
            return
        if len(self.told) > _SUBSCRIPTIONS:
            self.told.clear()
        self.told[text] = now
        self.status("error", text)


class RosBridge:
    """Server of the topics of a console.

    Attributes:
        port: port on which the server listens; valid after `start`.
        hurry: function that is called after a message that moves a robot.
    """

    def __init__(self, topics: ConsoleTopics, rules: AccessRules) -> None:
        """Prepare to serve the topics of a console to clients that the rules accept."""
        self.topics = topics
        self.port = 0
        self.hurry: Callable[[], object] = lambda: None
        self._rules = rules
        self._clients: list[_Client] = []
        self._counter = ConnectionCounter()
        self._last_number = 0

    async def start(self, host: str, port: int) -> None:
        """Start listening on an address and a port (0: any free port)."""
        limits = WebSocketLimits(operations.LONGEST, BYTES, MESSAGES)
        self._server: Server = await listen(self._serve, host, port, self._check, self._counter, limits)
        first_socket = next(iter(self._server.sockets))
        self.port = int(first_socket.getsockname()[1])

    async def close(self) -> None:
        """Disconnect all clients and stop."""
        self._server.close(code=1001, reason="the server ends")
        for client in list(self._clients):
            client.ws.cut()
        await self._server.wait_closed()

    def state(self) -> JsonObject:
        """Return port, number of clients, client of each hand, and number of refused poses, as an entry of `state`."""
        hands = self.topics.hands
        return {
            "port": self.port,
            "clients": len(self._clients),
            "from": hands.senders(),
            "ignored": hands.refused,
        }

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
        client = _Client(f"ROS client {self._last_number}", connection, Bucket(*GARBAGE, time.monotonic()))
        connection.limit_send_queue()
        self._clients.append(client)
        try:
            async for text in connection:
                self._hear(client, text)
        except ConnectionClosed:
            pass
        finally:
            self._clients.remove(client)
            self.topics.hands.leave(client.name)

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
            client.status_once(f"{_subject(operation)}: {error}", now)

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
                client.subscriptions.pop(operation.topic, None)
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
        if len(client.subscriptions) >= _SUBSCRIPTIONS:
            raise DeviceError(f"a client may subscribe to at most {_SUBSCRIPTIONS} topics")
        cbor = operation.compression == "cbor"
        if cbor:
            require("cbor2", "a subscription with CBOR")
        client.subscriptions[operation.topic] = _Subscription(operation.throttle_rate / 1000, cbor)
        self._send_to([client], {operation.topic}, time.monotonic())

    def _require_type(self, topic: str, kind: str | None, known: dict) -> None:
        """Check that a topic exists and has the type that a client names, if it names one.

        Raises:
            DeviceError: there is no such topic, or it has another type.
        """
        if topic not in known:
            raise DeviceError(_unknown_topic(topic, known))
        own = known[topic].type
        if kind is not None and short_name(kind) != own:
            raise DeviceError(f"the type of the topic is {full_name(own)}, not {kind}")

    def _call(self, client: _Client, operation: operations.CallService) -> None:
        answer: JsonObject = {"op": "service_response", "service": operation.service, "result": True}
        if operation.id is not None:
            answer["id"] = operation.id
        try:
            answer["values"] = self.topics.call(operation.service, operation.args)
        except DeviceError as error:
            answer["result"] = False
            answer["values"] = str(error)
        client.send(answer)

    # -- messages to clients --------------------------------------------------------------------------

    def send(self) -> None:
        """Send the newest message of each topic to its subscribers."""
        wanted = set()
        for client in self._clients:
            wanted.update(client.subscriptions)
        if wanted:
            self._send_to(self._clients, wanted, time.monotonic())

    def _send_to(self, clients: list[_Client], topics: set[str], now: float) -> None:
        for topic in topics:
            receivers: dict[bool, list[Connection]] = {True: [], False: []}
            for client in clients:
                subscription = client.subscriptions.get(topic)
                if subscription is None or client.ws.waiting or now - subscription.sent < subscription.pause:
                    continue
                subscription.sent = now
                receivers[subscription.cbor].append(client.ws)
            if not any(receivers.values()):
                continue
            document = {"op": "publish", "topic": topic, "msg": self.topics.outputs[topic].make()}
            if receivers[False]:
                broadcast(receivers[False], to_json(document, inf_nan_mode="null").decode())
            if receivers[True]:
                cbor = require("cbor2", "a subscription with CBOR")
                broadcast(receivers[True], cbor.dumps(document))


def _subject(operation: operations.Operation) -> str:
    """Return what a refused operation was about: its topic or service, else its name."""
    if isinstance(operation, operations.CallService):
        return operation.service
    return getattr(operation, "topic", operation.op)


def _unknown_topic(topic: str, known: dict) -> str:
    return f"there is no such topic here; known: {', '.join(sorted(known))}"
