"""Receive the motion scale of a console over MQTT, for example from a tablet, and publish the console's current scale.

A message to `<topic>/set` contains the new scale as decimal text, such as 0.25. This client publishes the current
scale to `<topic>`, and `online` to `<topic>/available` while connected; both messages are retained. The console
of the SILS paper receives its scale from a tablet over MQTT; the paper states neither the topic nor the format.
"""

from __future__ import annotations

import asyncio
import logging
import socket
import time
from collections.abc import AsyncIterator, Callable, Sequence
from contextlib import asynccontextmanager, suppress
from typing import TYPE_CHECKING, cast

from twin.core.errors import TwinError
from twin.core.extras import require
from twin.core.json_types import JsonObject
from twin.ui.headset.problem_reports import ProblemReports

if TYPE_CHECKING:
    from aiomqtt import Client, Message
    from paho.mqtt.reasoncodes import ReasonCode

_RETRY_PAUSE = 2.0
"""Pause in s between two attempts to connect."""

_TIMEOUT = 5.0
"""Maximum time in s until the broker answers."""

_KEEPALIVE = 10
"""Keep-alive interval in s."""

_NO_DELAY = [(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)]
"""Socket option to send small messages at once; without it, TCP can delay a message by 40 ms."""

_REPORT_PAUSE = 1.0
"""Time in s after an invalid payload during which further ones are not reported."""

_MAX_SHOWN_BYTES = 40
"""Maximum number of bytes of a payload that a report shows."""

_MAX_TOPIC_LENGTH = 200
"""Maximum number of characters of a topic."""


class ScaleTopic:
    """An MQTT topic by which other programs set the motion scale.

    Attributes:
        connected: whether the broker is connected.
        problem: why the broker cannot be reached, or why the last payload was refused; None if there is no problem.
        reports: reporter of connection problems and refused payloads.
    """

    def __init__(
        self,
        host: str,
        port: int,
        topic: str,
        limits: tuple[float, float],
        scale: float,
        apply: Callable[[float], object],
    ) -> None:
        """Prepare to connect to the broker at host and port.

        Args:
            host: name or address of the broker.
            port: port of the broker.
            topic: topic of the published scale; new scales are received from `<topic>/set`.
            limits: smallest and largest scale.
            scale: the current scale.
            apply: function that sets the scale.

        Raises:
            TwinError: the topic is invalid, or the package aiomqtt is not installed.
        """
        # + and # are wildcards of subscriptions, and MQTT forbids the null character.
        has_forbidden = bool(set(topic) & set("+#\0"))
        if not 0 < len(topic) <= _MAX_TOPIC_LENGTH or has_forbidden or topic != topic.strip("/ "):
            raise TwinError(
                f"--mqtt-topic {topic!r} is not a valid topic: use 1 to {_MAX_TOPIC_LENGTH} characters without + and "
                "#, and without / or space at the ends"
            )
        self._mqtt = require("aiomqtt", "--mqtt")
        self.broker = f"[{host}]:{port}" if ":" in host else f"{host}:{port}"
        self.topic = topic
        self.connected = False
        self.problem: str | None = None
        self.reports = ProblemReports(_REPORT_PAUSE)
        self._host = host
        self._port = port
        self._limits = limits
        self._apply = apply
        self._scale = scale
        self._scale_changed = asyncio.Event()

    @property
    def state(self) -> JsonObject:
        """State of the connection as plain data, which the server publishes: broker, topic, connected, problem."""
        return {"broker": self.broker, "topic": self.topic, "connected": self.connected, "problem": self.problem}

    def show(self, scale: float) -> None:
        """Store `scale` as the current motion scale, which `run` then publishes."""
        self._scale = scale
        self._scale_changed.set()

    async def run(self) -> None:
        """Connect, receive scales, and publish the current scale; connect again if the connection ends."""
        was_disconnected = False
        while True:
            try:
                async with self._connection() as client:
                    await self._subscribe(client)
                    self.connected = True
                    self.problem = None
                    if was_disconnected:
                        self.reports.tell(f"MQTT broker {self.broker} is connected again")
                    await self._publish_and_listen(client)
            except* (self._mqtt.MqttError, ValueError) as errors:  # ValueError: an invalid host name
                what = "has disconnected"
                if not self.connected:
                    what = f"cannot be reached ({errors.exceptions[0]})"
                self.problem = (
                    f"MQTT broker {self.broker} {what}: the motion scale stays {self._scale:g}; trying again every "
                    f"{_RETRY_PAUSE:g} s"
                )
                # Of the attempts in succession that fail, only the first is reported.
                if self.connected or not was_disconnected:
                    self.reports.tell(self.problem)
                self.connected = False
                was_disconnected = True
            await asyncio.sleep(_RETRY_PAUSE)

    async def _subscribe(self, client: Client) -> None:
        """Subscribe to the topic of new scales; raise the library's error if the broker rejects the subscription."""
        answers = await client.subscribe(f"{self.topic}/set", qos=1)
        codes = cast("Sequence[ReasonCode]", answers)  # numbers only in versions of MQTT before 5
        for code in codes:
            if code.is_failure:
                raise self._mqtt.MqttError(f"the broker refuses the topic {self.topic}/set ({codes[0]})")

    @asynccontextmanager
    async def _connection(self) -> AsyncIterator[Client]:
        """Yield a connected client; close its socket at the end.

        After an invalid message of the broker, the library would close the socket only after the keep-alive interval.
        """
        client = self._client()
        _ignore_end(client)
        try:
            async with client:
                _ignore_end(client)
                yield client
        finally:
            client._client._sock_close()

    def _client(self) -> Client:
        will = self._mqtt.Will(f"{self.topic}/available", "offline", qos=1, retain=True)
        # Without this logger, the library would also report each problem.
        quiet = logging.getLogger(f"{__name__}.library")
        quiet.setLevel(logging.CRITICAL)
        return self._mqtt.Client(
            self._host,
            self._port,
            will=will,
            timeout=_TIMEOUT,
            keepalive=_KEEPALIVE,
            socket_options=_NO_DELAY,
            logger=quiet,
        )

    async def _publish_and_listen(self, client: Client) -> None:
        try:
            async with asyncio.TaskGroup() as group:
                group.create_task(self._listen(client))
                group.create_task(self._publish(client))
        except asyncio.CancelledError:
            with suppress(self._mqtt.MqttError):
                await client.publish(f"{self.topic}/available", "offline", qos=1, retain=True, timeout=1.0)
            raise

    async def _publish(self, client: Client) -> None:
        await client.publish(f"{self.topic}/available", "online", qos=1, retain=True)
        while True:
            self._scale_changed.clear()
            await client.publish(self.topic, repr(self._scale), retain=True)
            await self._scale_changed.wait()

    async def _listen(self, client: Client) -> None:
        async for message in client.messages:
            try:
                scale = self._read_message(message)
            except TwinError as error:
                self.problem = f"MQTT topic {self.topic}/set: {error}; the motion scale stays {self._scale:g}"
                self.reports.report("payload", time.monotonic(), self.problem)
                self._scale_changed.set()  # publish the current scale again, to correct displays of the refused one
                continue
            self.problem = None
            self._apply(scale)

    def _read_message(self, message: Message) -> float:
        """Return the scale in a message; raise `TwinError` if the message has no valid scale."""
        low, high = self._limits
        if message.retain:
            raise TwinError("a retained message is ignored, because it may be old; publish it without retain")
        payload = b""  # a message without payload has None
        if isinstance(message.payload, bytes):
            payload = message.payload
        scale = _scale_in(payload)
        if scale is None:
            text = payload[:_MAX_SHOWN_BYTES].decode("utf-8", "replace")
            raise TwinError(f"{text!r} is not a number; send {low:g} to {high:g}")
        if not low <= scale <= high:  # also true for NaN
            raise TwinError(f"{scale:g} is outside {low:g} to {high:g}")
        return scale


def _scale_in(payload: bytes) -> float | None:
    """Return the number that a payload states as decimal text; None if it states none."""
    if b"_" in payload:  # Python would read 1_0 as 10
        return None
    try:
        return float(payload)
    except ValueError:
        return None


def _ignore_end(client: Client) -> None:
    """Retrieve the error with which a connection ends; otherwise asyncio logs it when nothing waits for the end.

    The library sets the error of a broker's invalid message in a future, and replaces the future when it has connected.
    """

    def retrieve(end: asyncio.Future[None]) -> None:
        if not end.cancelled():
            end.exception()

    client._disconnected.add_done_callback(retrieve)
