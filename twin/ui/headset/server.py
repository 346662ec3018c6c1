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
from twin.ui.door.answers import File, refusal
from twin.ui.door.connection import Connection
from twin.ui.door.entrance import listen, page, query_of, stranger, visit
from twin.ui.door.gate import Gate
from twin.ui.door.limits import GARBAGE, MESSAGES, Bucket, Doorman
from twin.ui.headset import protocol as wire
from twin.ui.headset.client import Client, Source
from twin.ui.headset.protocol import RefusedError
from twin.ui.headset.recording import Recording
from twin.ui.session.timeline import RATE

STATE = 6
"""Number of ticks between two `state` documents."""

GAP = 0.004
"""Minimum time in s between two frames; after a message `hands`, a frame may also be sent between two ticks."""

SILENCE, GRACE = 5.0, 3.0
"""Times in s after which a grab is released: since the last message of the client; since the client disconnected."""

REMEMBERED = 256
"""Maximum number of disconnected clients whose identity is stored, so that they can reconnect."""


class StreamServer:
    """Server of the files and the stream of one source.

    Attributes:
        port: port on which the server listens; valid after `start`.
        stopping: event that ends the server.
    """

    def __init__(
        self,
        source: Source,
        hello: JsonObject,
        files: Mapping[str, File],
        gate: Gate,
        recording: Recording | None = None,
    ) -> None:
        self.gate, self.files, self.recording = gate, files, recording
        self.hello = hello
        self.stopping = asyncio.Event()
        self.clients: list[Client] = []
        self._doorman = Doorman()
        self._known: dict[str, str] = {}
        self._left: dict[str, float] = {}
        self._tasks: set[asyncio.Future[None]] = set()
        self._frame: bytes | None = None
        self._state: JsonObject = {}
        self._dirty = False
        self._tick, self._at, self._made_up = 0, 0.0, False
        self._begin = self._framed = time.monotonic()
        self._pause = GAP
        self._response: asyncio.TimerHandle | None = None
        self._numbers = 0
        self.source = source
        source.send = self._tell

    # -- start and stop -------------------------------------------------------------------------------

    async def start(self, host: str, port: int, context: ssl.SSLContext | None = None) -> None:
        """Start listening on an address and a port; `context` enables TLS."""
        self._server: Server = await listen(
            self._client, host, port, self._request, self._doorman, longest=wire.LONGEST, context=context
        )
        self.port = int(next(iter(self._server.sockets)).getsockname()[1])

    async def run(self) -> None:
        """Send a frame at each tick until `stopping` is set; a single missed tick is made up for (see `_due`)."""
        begin = self._begin = time.monotonic()
        ends = asyncio.ensure_future(self.stopping.wait())
        try:
            while not self.stopping.is_set():
                self._tick = self._due(int((time.monotonic() - begin) * RATE))
                self._step(begin + self._tick / RATE)
                left = begin + (self._tick + 1) / RATE - time.monotonic()
                await asyncio.wait((ends,), timeout=max(left, 0.0))
        finally:
            ends.cancel()
            await self.close()

    async def close(self) -> None:
        """Close all connections (code 1001) and stop; clients that do not close in time are disconnected."""
        if self._response is not None:
            self._response.cancel()
        self._say_state()
        self._server.close(code=1001, reason="the server ends")
        try:
            async with asyncio.timeout(0.5):
                await self._server.wait_closed()
        except TimeoutError:
            for connection in list(self._server.handlers):
                connection.transport.abort()
        self.source.close()
        if self.recording is not None:
            self.recording.finish()()

    # -- the stream -----------------------------------------------------------------------------------

    def _due(self, now: int) -> int:
        """Return the tick to send at tick `now`: `now` - 1 if this is the only tick that was missed, otherwise `now`.

        A missed tick is not made up for twice in succession: on a slow machine, all frames would then be late.
        """
        made_up = now - self._tick == 2 and self._at <= now - 1 and not self._made_up
        self._made_up = made_up
        return now - made_up

    def _step(self, server_time: float) -> None:
        self._advance(self._tick, server_time)
        if self.recording is not None and self.recording.full(self._tick):
            self._write(self.recording.finish())
        now = time.monotonic()
        if self._dirty or self._tick % STATE == 0:
            self._watch(now)
            self._say_state()
        for client in list(self.clients):
            client.flush(self._frame, now)

    def _advance(self, tick: float, server_time: float) -> None:
        """Advance the source to a tick, possibly with a fraction; store its frame for the clients."""
        begun, self._at = time.monotonic(), tick
        frame = self.source.frame(tick, server_time)
        self._framed = time.monotonic()
        self._pause = min(max(GAP, self._framed - begun), 1 / RATE)
        if frame is None:
            return
        self._frame = frame
        if self.recording is not None:
            self.recording.add_frame(self._tick, frame)
        for client in self.clients:
            client.behind = True

    def _respond(self, now: float) -> None:
        """Send the effect of a message `hands` as soon as `GAP` allows, instead of at the next tick.

        The pause before a frame is as long as the computation of the last frame, but at least `GAP` and at most a tick.
        Without the pause, more and more messages would wait on a slow machine, and the delay would grow without limit.
        """
        self._response = None
        if (wait := self._pause - (now - self._framed)) > 0:
            self._response = asyncio.get_running_loop().call_later(wait, lambda: self._respond(time.monotonic()))
            return
        self._advance(max((now - self._begin) * RATE, self._tick), now)
        for client in list(self.clients):
            client.flush(self._frame, now)

    def _say_state(self) -> None:
        self._dirty = False
        state = {**self.source.state(), "clients": len(self.clients)}
        if self.recording is not None and not self.source.replays:
            state["recording"] = self.recording.running
        if state != self._state:
            self._state = state
            self._tell(state)

    def _tell(self, document: JsonObject) -> None:
        """Send a document to every client."""
        if self.recording is not None:
            self.recording.add_document(self._tick, document)
        text = to_json(document, inf_nan_mode="null").decode()
        for client in self.clients:
            client.queue(document["type"], text)

    def _watch(self, now: float) -> None:
        """Release grabs of silent or disconnected clients."""
        for name, left in list(self._left.items()):
            if now - left > GRACE:
                del self._left[name]
                self.source.release(name)
        for client in self.clients:
            if now - client.heard > SILENCE and self.source.holds(client.id):
                self.source.release(client.id)
                self._error(client, "released", f"no message for {SILENCE:g} s: the grab was released")

    # -- clients --------------------------------------------------------------------------------------

    async def _client(self, connection: Connection) -> None:
        client = self._join(connection)
        try:
            async for text in connection:
                self._hear(client, text)
        except ConnectionClosed:
            pass
        finally:
            self._leave(client)

    def _join(self, ws: Connection) -> Client:
        assert ws.request is not None
        token = query_of(ws.request.path).get("resume", "")
        now = time.monotonic()
        if token in self._known:
            name = self._known[token]
            for other in [c for c in self.clients if c.token == token]:  # the new connection replaces the old one
                self.clients.remove(other)
                other.ws.cut()
        else:
            self._numbers += 1
            name, token = f"c{self._numbers}", secrets.token_urlsafe(18)
            self._known[token] = name
            connected = {c.token for c in self.clients} | {token}
            gone = [t for t in self._known if t not in connected]
            for old in gone[: max(len(gone) - REMEMBERED, 0)]:
                del self._known[old]
        self._left.pop(name, None)
        ws.keep_little()
        client = Client(name, token, ws, Bucket(*MESSAGES, now), Bucket(*GARBAGE, now), now)
        self.clients.append(client)
        hello = {**self.hello, "type": "hello", "protocol": self.source.version, "client": name, "resume": token}
        for document in (hello, self._state or self.source.state(), *self.source.welcome()):
            client.queue(document["type"], to_json(document, inf_nan_mode="null").decode())
        self._dirty = True
        client.flush(self._frame, now)
        return client

    def _leave(self, client: Client) -> None:
        if client in self.clients:
            self.clients.remove(client)
            if self.source.holds(client.id):
                self._left[client.id] = time.monotonic()
            self._dirty = True

    def _hear(self, client: Client, text: str | bytes) -> None:
        now = time.monotonic()
        if not client.messages.take(now):
            if now - client.told_rate > 1.0:
                client.told_rate = now
                self._error(client, "rate", f"more than {MESSAGES[0]:g} messages per second: some were dropped")
            return
        try:
            message = wire.parse(text)
        except RefusedError as error:
            self._error(client, error.code, str(error), error.id)
            if not client.garbage.take(now):
                self._end(client, 1008, "too many malformed messages")
            return
        client.heard = now
        if isinstance(message, wire.Ping):
            server_time = time.monotonic()
            self._answer(client, {"type": "pong", "t": message.t, "server_time": server_time, "id": message.id})
            return
        if self.recording is not None:
            self.recording.add_request(self._tick, client.id, message)
        held = self.source.holds(client.id)
        try:
            if isinstance(message, wire.Record):
                self._record(message.on)
            else:
                self.source.ask(client.id, message)
        except RefusedError as error:
            self._error(client, error.code, str(error), message.id)
            return
        if isinstance(message, wire.Hands) and self._response is None:
            self._respond(now)
        # `hands` arrives 100 times per second: only the first one causes a `state` at once.
        self._dirty |= not (isinstance(message, wire.Drag) or (held and isinstance(message, wire.Hands)))
        if message.id is not None:
            self._answer(client, {"type": "ack", "id": message.id})

    def _record(self, on: bool) -> None:
        if self.recording is None:
            raise RefusedError("refused", "nothing can be recorded: start the server with --record FILE")
        if on:
            self.recording.check_room()
        self._say_state()
        self._write(self.recording.finish())
        if on:
            self.recording.begin(self._tick)
            for document in (self.source.state(), *self.source.welcome()):
                self.recording.add_document(self._tick, document)

    def _write(self, write: Callable[[], None]) -> None:
        """Write a recording in a thread; on failure notify all clients."""

        async def work() -> None:
            try:
                await asyncio.to_thread(write)
            except TwinError as error:
                self._tell({"type": "error", "code": "failed", "message": str(error)[:500]})

        self._keep(asyncio.ensure_future(work()))

    def _keep(self, task: asyncio.Future[None]) -> None:
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    def _answer(self, client: Client, document: JsonObject) -> None:
        client.queue(document["type"], to_json({k: v for k, v in document.items() if v is not None}).decode())
        client.flush(self._frame, time.monotonic())

    def _error(self, client: Client, code: str, text: str, id: int | str | None = None) -> None:
        self._answer(client, {"type": "error", "code": code, "message": text, "id": id})

    def _end(self, client: Client, code: int, reason: str) -> None:
        self._keep(asyncio.ensure_future(client.ws.close(code, reason)))

    # -- requests -------------------------------------------------------------------------------------

    def _request(self, connection: ServerConnection, request: Request) -> Response | None:
        """Return the response to a request for a file, or None to accept a WebSocket."""
        seen = visit(self.gate, connection, request)
        if isinstance(seen, Response):
            return seen
        if seen.path != "/ws":
            return page(self.gate, seen, self.files)
        if not seen.upgrade or seen.head:
            out = refusal(HTTPStatus.UPGRADE_REQUIRED, "this address accepts only WebSockets", seen.head)
            out.headers["Upgrade"] = "websocket"
            return out
        if seen.known or seen.query.get("resume") in self._known or self.gate.spend(seen.query.get("token", "")):
            return None
        return stranger()
