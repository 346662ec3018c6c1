"""The server of `twin serve`: files and stream on one port, for several clients that show the same robots."""

from __future__ import annotations

import asyncio
import secrets
import ssl
import time
from collections.abc import Callable, Mapping
from http import HTTPStatus

from pydantic_core import to_json
from websockets.asyncio.server import Server, ServerConnection
from websockets.exceptions import ConnectionClosed
from websockets.http11 import Request, Response

from twin.core.errors import TwinError
from twin.core.json_types import JsonObject
from twin.ui.access.connection import Connection
from twin.ui.access.rate_limits import MALFORMED_LIMIT, MESSAGE_LIMIT, Bucket, ConnectionCounter
from twin.ui.access.requests import (
    WebSocketLimits,
    check_request,
    end,
    listen,
    query_of,
    serve_file,
    websocket_without_session,
)
from twin.ui.access.responses import File, error_response
from twin.ui.access.rules import AccessRules
from twin.ui.headset.client import Client, StreamSource
from twin.ui.headset.client_messages import (
    LONGEST_MESSAGE,
    ClientMessage,
    DragMessage,
    HandsMessage,
    PingMessage,
    RecordMessage,
    RefusedError,
    parse_message,
)
from twin.ui.headset.recording import StreamRecording
from twin.ui.session.timeline import TICK_RATE

STATE_TICKS = 6
"""Number of ticks between two `state` documents."""

MIN_FRAME_GAP = 0.004
"""Minimum time in s between two frames; after a message `hands`, a frame may also be sent between two ticks."""

SHORT_FRAME_GAP = 0.001
"""Minimum time in s between two frames after a message to another server, whose programs send 500 per second."""

SILENCE_TIMEOUT = 5.0
"""Time in s since the last message of a client after which its grab is released."""

RECONNECTION_TIME = 3.0
"""Time in s since a client disconnected after which its grab is released; until then it can reconnect and go on."""

MAX_REMEMBERED_CLIENTS = 256
"""Maximum number of disconnected clients whose identity is stored, so that they can reconnect."""


class StreamServer:
    """Server of the files and the stream of one source.

    Attributes:
        source: source of the stream; its `send` is set to a function that sends a document to all clients.
        hello: data of the robots for the first document that each client gets.
        files: {path: file} that clients can load.
        rules: which clients have access.
        recording: recording of the stream; None: the stream is not recorded.
        clients: connected clients.
        port: port on which the server listens; valid after `start`.
        stopping: event that ends the server.
    """

    def __init__(
        self,
        source: StreamSource,
        hello: JsonObject,
        files: Mapping[str, File],
        rules: AccessRules,
        recording: StreamRecording | None = None,
    ) -> None:
        self.rules = rules
        self.files = files
        self.recording = recording
        self.hello = hello
        self.stopping = asyncio.Event()
        self.clients: list[Client] = []
        self._server: Server | None = None  # None before `start`
        self._counter = ConnectionCounter()
        # Identifiers of clients by the token with which each can reconnect, also of clients that have disconnected.
        self._identifiers: dict[str, str] = {}
        # Times in s at which clients that hold something have disconnected, by identifier.
        self._disconnected: dict[str, float] = {}
        self._tasks: set[asyncio.Future[None]] = set()
        self._frame: bytes | None = None
        self._state: JsonObject = {}
        self._is_state_due = False
        self._tick = 0
        self._frame_tick = 0.0
        self._has_made_up_tick = False
        now = time.monotonic()
        self._begin_time = now
        self._frame_time = now
        self._frame_duration = 0.0
        self._response_timer: asyncio.TimerHandle | None = None
        self._last_number = 0
        self.source = source
        source.send = self._send_to_all

    # -- start and stop -------------------------------------------------------------------------------

    async def start(self, host: str, port: int, context: ssl.SSLContext | None = None) -> None:
        """Start listening on an address and a port; `context` enables TLS."""
        limits = WebSocketLimits(LONGEST_MESSAGE)
        self._server = await listen(
            self._serve_client, host, port, self._check_request, self._counter, limits, context=context
        )
        first_socket = next(iter(self._server.sockets))
        self.port = int(first_socket.getsockname()[1])

    async def run(self) -> None:
        """Send a frame at each tick until `stopping` is set; one missed tick is made up for, see `_tick_to_send`."""
        begin = time.monotonic()
        self._begin_time = begin
        stopped = asyncio.ensure_future(self.stopping.wait())
        try:
            while not self.stopping.is_set():
                ticks = int((time.monotonic() - begin) * TICK_RATE)
                self._tick = self._tick_to_send(ticks)
                self._send_tick(begin + self._tick / TICK_RATE)
                next_tick = begin + (self._tick + 1) / TICK_RATE
                remaining = next_tick - time.monotonic()
                await asyncio.wait((stopped,), timeout=max(remaining, 0.0))
        finally:
            stopped.cancel()
            await self.close()

    async def close(self) -> None:
        """Close all connections (code 1001) and stop; clients that do not close in time are disconnected."""
        if self._response_timer is not None:
            self._response_timer.cancel()
        self._send_state()
        if self._server is not None:
            await end(self._server)
        self.source.close()
        if self.recording is not None:
            write = self.recording.finish()
            write()

    # -- the stream -----------------------------------------------------------------------------------

    def _tick_to_send(self, now: int) -> int:
        """Return the tick to send at tick `now`: `now` - 1 if this is the only tick that was missed, otherwise `now`.

        A missed tick is not made up for twice in succession: on a slow machine, all frames would then be late.
        """
        missed_one = now - self._tick == 2
        # A message `hands` may have moved the robots beyond the missed tick already; time does not go back.
        not_passed = self._frame_tick <= now - 1
        self._has_made_up_tick = missed_one and not_passed and not self._has_made_up_tick
        if self._has_made_up_tick:
            return now - 1
        return now

    def _send_tick(self, server_time: float) -> None:
        self._advance_source(self._tick, server_time)
        if self.recording is not None and self.recording.full(self._tick):
            self._write_recording(self.recording.finish())
        now = time.monotonic()
        if self._is_state_due or self._tick % STATE_TICKS == 0:
            self._release_silent(now)
            self._send_state()
        for client in list(self.clients):
            client.flush(self._frame, now)

    def _advance_source(self, tick: float, server_time: float) -> None:
        """Advance the source to a tick, possibly with a fraction; store its frame for the clients."""
        begun = time.monotonic()
        self._frame_tick = tick
        frame = self.source.frame(tick, server_time)
        self._frame_time = time.monotonic()
        self._frame_duration = self._frame_time - begun
        if frame is None:
            return
        self._frame = frame
        if self.recording is not None:
            self.recording.add_frame(self._tick, frame)
        for client in self.clients:
            client.behind = True

    def respond_soon(self) -> None:
        """Send a frame as soon as `SHORT_FRAME_GAP` allows: a message to another server has moved the robots."""
        if self._response_timer is None:
            self._respond_to_hands(time.monotonic(), SHORT_FRAME_GAP)

    def _respond_to_hands(self, now: float, gap: float = MIN_FRAME_GAP) -> None:
        """Send the effect of a message `hands` as soon as `gap` allows, instead of at the next tick.

        The pause before a frame is as long as the computation of the last frame, but at least `gap` and at most a tick.
        Without the pause, more and more messages would wait on a slow machine, and the delay would grow without limit.
        """
        self._response_timer = None
        pause = min(max(gap, self._frame_duration), 1 / TICK_RATE)
        wait = pause - (now - self._frame_time)
        if wait > 0:
            loop = asyncio.get_running_loop()
            self._response_timer = loop.call_later(wait, lambda: self._respond_to_hands(time.monotonic(), gap))
            return
        tick = (now - self._begin_time) * TICK_RATE
        self._advance_source(max(tick, self._tick), now)
        for client in list(self.clients):
            client.flush(self._frame, now)

    def _send_state(self) -> None:
        self._is_state_due = False
        state = {**self.source.state(), "clients": len(self.clients)}
        if self.recording is not None and not self.source.replays:
            state["recording"] = self.recording.running
        if state != self._state:
            self._state = state
            self._send_to_all(state)

    def _send_to_all(self, document: JsonObject) -> None:
        """Send a document to every client."""
        if self.recording is not None:
            self.recording.add_document(self._tick, document)
        text = _json_text(document)
        for client in self.clients:
            client.queue(document["type"], text)

    def _release_silent(self, now: float) -> None:
        """Release grabs of silent or disconnected clients."""
        for name, since in list(self._disconnected.items()):
            if now - since > RECONNECTION_TIME:
                del self._disconnected[name]
                self.source.release(name)
        for client in self.clients:
            if now - client.heard > SILENCE_TIMEOUT and self.source.holds(client.id):
                self.source.release(client.id)
                self._send_error(client, "released", f"no message for {SILENCE_TIMEOUT:g} s: the grab was released")

    # -- clients --------------------------------------------------------------------------------------

    async def _serve_client(self, connection: Connection) -> None:
        client = self._add_client(connection)
        try:
            async for text in connection:
                self._receive(client, text)
        except ConnectionClosed:
            pass
        finally:
            self._remove_client(client)

    def _add_client(self, ws: Connection) -> Client:
        """Return a new client for a connection; its first documents are queued."""
        assert ws.request is not None
        token = query_of(ws.request.path).get("resume", "")
        now = time.monotonic()
        if token in self._identifiers:
            self._disconnect(token)  # the new connection replaces the old one
        else:
            token = self._new_identifier()
        name = self._identifiers[token]
        self._disconnected.pop(name, None)
        ws.limit_send_queue()
        client = Client(name, token, ws, Bucket(*MESSAGE_LIMIT, now), Bucket(*MALFORMED_LIMIT, now), now)
        self.clients.append(client)
        hello = {**self.hello, "type": "hello", "protocol": self.source.version, "client": name, "resume": token}
        state = self._state or self.source.state()
        for document in (hello, state, *self.source.welcome()):
            client.queue(document["type"], _json_text(document))
        self._is_state_due = True
        client.flush(self._frame, now)
        return client

    def _disconnect(self, token: str) -> None:
        """Disconnect the client that has a token, if it is connected."""
        for client in list(self.clients):
            if client.token == token:
                self.clients.remove(client)
                client.ws.cut()

    def _new_identifier(self) -> str:
        """Return the token of a new identifier; forget the oldest identifiers of disconnected clients."""
        self._last_number += 1
        token = secrets.token_urlsafe(18)
        self._identifiers[token] = f"c{self._last_number}"
        connected = {client.token for client in self.clients}
        connected.add(token)
        disconnected = [known for known in self._identifiers if known not in connected]
        surplus = max(len(disconnected) - MAX_REMEMBERED_CLIENTS, 0)
        for oldest in disconnected[:surplus]:
            del self._identifiers[oldest]
        return token

    def _remove_client(self, client: Client) -> None:
        if client in self.clients:
            self.clients.remove(client)
            if self.source.holds(client.id):
                self._disconnected[client.id] = time.monotonic()
            self._is_state_due = True

    def _receive(self, client: Client, text: str | bytes) -> None:
        """Handle a message of a client."""
        now = time.monotonic()
        if not client.messages.take(now):
            if now - client.told_rate > 1.0:
                client.told_rate = now
                most = MESSAGE_LIMIT[0]
                self._send_error(client, "rate", f"more than {most:g} messages per second: some were dropped")
            return
        try:
            message = parse_message(text)
        except RefusedError as error:
            self._send_error(client, error.code, str(error), error.id)
            if not client.garbage.take(now):
                self._close_connection(client, 1008, "too many malformed messages")
            return
        client.heard = now
        if isinstance(message, PingMessage):
            pong = {"type": "pong", "t": message.t, "server_time": time.monotonic(), "id": message.id}
            self._send_to(client, pong)
            return
        self._handle_request(client, message, now)

    def _handle_request(self, client: Client, message: ClientMessage, now: float) -> None:
        """Handle a valid request of a client at the time `now` in s."""
        if self.recording is not None:
            self.recording.add_request(self._tick, client.id, message)
        was_holding = self.source.holds(client.id)
        try:
            if isinstance(message, RecordMessage):
                self._switch_recording(message.on)
            else:
                self.source.ask(client.id, message)
        except RefusedError as error:
            self._send_error(client, error.code, str(error), message.id)
            return
        if isinstance(message, HandsMessage) and self._response_timer is None:
            self._respond_to_hands(now)
        # `hands` arrives 100 times per second: only the first one causes a `state` at once.
        is_repeated = isinstance(message, DragMessage) or (was_holding and isinstance(message, HandsMessage))
        if not is_repeated:
            self._is_state_due = True
        if message.id is not None:
            self._send_to(client, {"type": "ack", "id": message.id})

    def _switch_recording(self, on: bool) -> None:
        if self.recording is None:
            raise RefusedError("refused", "nothing can be recorded: start the server with --record FILE")
        if on:
            self.recording.check_room()
        self._send_state()
        self._write_recording(self.recording.finish())
        if on:
            self.recording.begin(self._tick)
            for document in (self.source.state(), *self.source.welcome()):
                self.recording.add_document(self._tick, document)

    def _write_recording(self, write: Callable[[], None]) -> None:
        """Write a recording in a thread; on failure notify all clients."""

        async def work() -> None:
            try:
                await asyncio.to_thread(write)
            except TwinError as error:
                self._send_to_all({"type": "error", "code": "failed", "message": str(error)[:500]})

        self._keep_task(asyncio.ensure_future(work()))

    def _keep_task(self, task: asyncio.Future[None]) -> None:
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    def _send_to(self, client: Client, document: JsonObject) -> None:
        content = {name: value for name, value in document.items() if value is not None}
        client.queue(document["type"], to_json(content).decode())
        client.flush(self._frame, time.monotonic())

    def _send_error(self, client: Client, code: str, text: str, id: int | str | None = None) -> None:
        self._send_to(client, {"type": "error", "code": code, "message": text, "id": id})

    def _close_connection(self, client: Client, code: int, reason: str) -> None:
        self._keep_task(asyncio.ensure_future(client.ws.close(code, reason)))

    # -- requests -------------------------------------------------------------------------------------

    def _check_request(self, connection: ServerConnection, request: Request) -> Response | None:
        """Return the response to a request for a file, or None to accept a WebSocket."""
        checked = check_request(self.rules, connection, request)
        if isinstance(checked, Response):
            return checked
        if checked.path != "/ws":
            return serve_file(self.rules, checked, self.files)
        if not checked.upgrade or checked.head_only:
            response = error_response(
                HTTPStatus.UPGRADE_REQUIRED, "this address accepts only WebSockets", checked.head_only
            )
            response.headers["Upgrade"] = "websocket"
            return response
        if checked.authorized or checked.query.get("resume") in self._identifiers:
            return None
        # A headset program may open the stream without the page: then the token is used up here.
        if self.rules.use_token(checked.query.get("token", "")):
            return None
        return websocket_without_session()


def _json_text(document: JsonObject) -> str:
    return to_json(document, inf_nan_mode="null").decode()
