"""The viewer's server; this module has few imports, so that a browser can load the page while the robot is read.

viser has no access control. Therefore, this module replaces the call with which viser opens its socket, so that page,
WebSockets and messages pass through the access control of `twin.ui.door`. If a version of viser opens its socket
differently, the server is stopped.
"""

from __future__ import annotations

import asyncio
import contextlib
import io
import threading
import time
from collections.abc import Awaitable, Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any, ClassVar

import viser
import websockets.datastructures
import websockets.exceptions
from viser.infra import _infra
from websockets.asyncio.server import ServerConnection
from websockets.http11 import Request, Response

from twin.core.errors import TwinError
from twin.ui.door.answers import File
from twin.ui.door.connection import Connection
from twin.ui.door.entrance import CLOSED, listen, page, stranger, visit
from twin.ui.door.gate import Gate
from twin.ui.door.limits import GARBAGE, MESSAGES, SOCKETS, SOCKETS_OF_ONE, Bucket, Doorman
from twin.ui.viewer.letters import LONGEST, Letters, NonsenseError, StaleError
from twin.ui.viewer.seats import FIRST, Seats

BYTES = (8e6, 40e6)
"""Limit of bytes from one page: (per second, burst); the page sends the 36 pictures of a turntable."""

FRAMES = (600.0, 1200.0)
"""Limit of WebSocket frames from one page: (per second, burst)."""

PATIENCE = 60.0
"""Maximum time in s until a page answers a ping; pages with software rendering are slow."""

POLICY = (
    "default-src 'none'; script-src 'unsafe-inline' 'unsafe-eval' blob: data:; worker-src blob: data:; "
    "style-src 'unsafe-inline'; img-src 'self' data: blob:; font-src data:; media-src data: blob:; "
    "connect-src 'self' data: blob:; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
"""Content-Security-Policy of viser's page (a single file): it may connect only to its own server.

Without this policy, a link with `?websocket=` or `?playbackPath=` could connect the page to another server.
"""

_lock = threading.Lock()


class PageConnection(Connection):
    """A connection whose messages are filtered by `letters`, and which has one of the `seats` after its first one.

    Attributes:
        heard: time in s of the last frame of any type.
    """

    letters: ClassVar[Letters]
    seats: ClassVar[Seats]

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        now = time.monotonic()
        self._messages, self._garbage = Bucket(*MESSAGES, now), Bucket(*GARBAGE, now)
        self.heard = now
        self._unseated: asyncio.TimerHandle | None = None

    def process_event(self, event: Any) -> None:
        """Note the time of a frame."""
        self.heard = time.monotonic()
        super().process_event(event)

    def wait_for_seat(self) -> None:
        """Let the client wait for a seat, for a limited time."""
        self.seats.enter(self)
        self._unseated = self.loop.call_later(FIRST, self.cut)

    async def recv(self, decode: bool | None = None) -> Any:
        """Return the next valid message; disconnect clients that repeatedly send invalid messages.

        The first valid message gives the client a seat; if none is free, the connection is closed.
        """
        while True:
            raw = await super().recv(decode)
            now = time.monotonic()
            if not self._messages.take(now):
                continue
            try:
                self.letters.check(raw, self, now)
            except StaleError:
                continue
            except NonsenseError:
                if not self._garbage.take(now):
                    self.cut()
                continue
            if self._unseated is not None:
                self._unseated.cancel()
                self._unseated = None
                if not self.seats.sit(self, now):
                    await self.close(CLOSED, "too many clients")
                    continue  # the next call of `recv` says that the connection is closed
            return raw

    def connection_lost(self, exc: Exception | None) -> None:
        """Remove the connection from the counts, give back its seat, and cancel its upload."""
        if self._unseated is not None:
            self._unseated.cancel()
        self.seats.leave(self)
        self.letters.forget(self)
        super().connection_lost(exc)


class Door:
    """The access control of one viser server.

    Attributes:
        gate: access rules.
        letters: message filter.
        stands: whether viser's socket was opened by `listen` and is thus protected.
    """

    def __init__(self, gate: Gate) -> None:
        self.gate, self.letters, self.stands = gate, Letters(), False
        content = (Path(viser.__file__).parent / "client" / "build" / "index.html").read_bytes()
        self._files = {"/": File(content, "text/html; charset=utf-8", policy=POLICY)}

    def listen(
        self,
        handler: Callable[[ServerConnection], Awaitable[None]],
        host: str,
        port: int,
        *,
        select_subprotocol: Callable[..., Any],
        **ours: Any,
    ) -> Any:
        """Open viser's socket instead of `websockets.serve`, with the access control and limits of this module."""
        self.stands = True

        async def seated(connection: Connection) -> None:
            assert isinstance(connection, PageConnection)
            connection.wait_for_seat()
            await handler(connection)

        return listen(
            seated,
            host,
            port,
            self._request,
            Doorman(SOCKETS, SOCKETS_OF_ONE),
            kind=type("OwnPage", (PageConnection,), {"letters": self.letters, "seats": Seats()}),
            longest=LONGEST,
            bytes=BYTES,
            frames=FRAMES,
            patience=PATIENCE,
            select_subprotocol=select_subprotocol,
        )

    def _request(self, connection: ServerConnection, request: Request) -> Response | None:
        seen = visit(self.gate, connection, request)
        if isinstance(seen, Response):
            return seen
        if seen.upgrade and not seen.head:
            return None if seen.known else stranger()
        return page(self.gate, seen, self._files)


def serve(title: str, host: str, port: int, gate: Gate | None = None) -> viser.ViserServer:
    """Start a server and return it.

    Args:
        title: title of the page.
        host: address to listen on.
        port: port to listen on; 0: any free port.
        gate: access rules. None: a request is accepted if its Host header names `host` or this machine, and if the
            request comes from the server's own page or from a program that is not a browser.

    Raises:
        TwinError: this version of viser opens its socket differently.
    """
    door = Door(gate or Gate(host, port, False, lambda token: None))
    with contextlib.redirect_stdout(io.StringIO()), _opening(door):
        server = viser.ViserServer(host=host, port=port, label=title, verbose=False)
    if not door.stands:
        stop(server)
        raise TwinError(f"viser {viser.__version__} opens its port without access control: install viser 1.1")
    door.letters.belong_to(server)
    door.letters.notify = lambda text: tell(server, title, text, bad=True)
    return server


def tell(server: viser.ViserServer, title: str, text: str, bad: bool = False) -> None:
    """Show a notice in every browser."""
    for client in server.get_clients().values():
        client.add_notification(title, text, color=(222, 48, 48) if bad else None, auto_close_seconds=8.0)


def stop(server: viser.ViserServer) -> None:
    """Stop a server, and suppress the messages that viser prints."""
    with contextlib.redirect_stdout(io.StringIO()):
        server.stop()


@contextlib.contextmanager
def _opening(door: Door) -> Iterator[None]:
    """Replace `websockets.asyncio.server.serve` by `Door.listen` while viser opens its socket."""
    ours = SimpleNamespace(
        asyncio=SimpleNamespace(server=SimpleNamespace(serve=door.listen)),
        exceptions=websockets.exceptions,
        datastructures=websockets.datastructures,
    )
    with _lock:
        theirs, _infra.websockets = _infra.websockets, ours
        try:
            yield
        finally:
            _infra.websockets = theirs
