"""The viewer's server; this module has few imports, so that a browser can load the page while the robot is read.

viser has no access control. Therefore, this module replaces the call with which viser opens its socket, so that page,
WebSockets and messages pass through the access control of `twin.ui.access`. If a version of viser opens its socket
differently, the server is stopped.
"""

from __future__ import annotations

import asyncio
import contextlib
import io
import json
import threading
import time
import weakref
from collections.abc import Awaitable, Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any, ClassVar, Literal

import viser
import websockets.datastructures
import websockets.exceptions
from pydantic_core import to_json
from viser.infra import _infra
from websockets.asyncio.server import ServerConnection
from websockets.asyncio.server import serve as serve_sockets
from websockets.http11 import Request, Response
from websockets.protocol import Event

from twin.core.errors import TwinError
from twin.core.json_types import JsonObject
from twin.ui.access.connection import Connection
from twin.ui.access.rate_limits import (
    MALFORMED_LIMIT,
    MAX_CONNECTIONS,
    MAX_CONNECTIONS_OF_ADDRESS,
    MESSAGE_LIMIT,
    Bucket,
    ConnectionCounter,
)
from twin.ui.access.requests import (
    TRY_AGAIN_LATER,
    WebSocketLimits,
    check_request,
    listen,
    serve_file,
    websocket_without_session,
)
from twin.ui.access.responses import File
from twin.ui.access.rules import AccessRules
from twin.ui.viewer.admission import FIRST_MESSAGE_TIMEOUT, Admission
from twin.ui.viewer.message_filter import MAX_MESSAGE_BYTES, MessageFilter, NonsenseError, StaleError

PAGE_BYTE_LIMIT = (8e6, 40e6)
"""Limit of bytes from one page: (per second, burst); the page sends the 36 pictures of a turntable."""

PAGE_FRAME_LIMIT = (600.0, 1200.0)
"""Limit of WebSocket frames from one page: (per second, burst)."""

PING_TIMEOUT = 60.0
"""Maximum time in s until a page answers a ping; pages with software rendering are slow."""

PAGE_POLICY = (
    "default-src 'none'; script-src 'unsafe-inline' 'unsafe-eval' blob: data:; worker-src blob: data:; "
    "style-src 'unsafe-inline'; img-src 'self' data: blob:; font-src data:; media-src data: blob:; "
    "connect-src 'self' data: blob:; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
"""Content-Security-Policy of viser's page (a single file): it may connect only to its own server.

Without this policy, a link with `?websocket=` or `?playbackPath=` could connect the page to another server.
"""

_SCRIPTS = ("page_additions.js", "page_tools.js")
"""Scripts that are added to viser's page, in order."""

Content = Literal["robot", "faces"]
"""What a page shows: robots that move, or the faces of a STEP file."""

STATE_PATH = "/state.json"
"""URL path of the state that `publish` stores."""

_socket_lock = threading.Lock()


class PageConnection(Connection):
    """A connection whose messages are filtered, and which is admitted after its first valid one.

    Attributes:
        message_filter: filter of the messages.
        admission: counter of the pages of the server.
        heard: time in s of the last frame of any type.
    """

    message_filter: ClassVar[MessageFilter]
    admission: ClassVar[Admission]

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        now = time.monotonic()
        self._messages = Bucket(*MESSAGE_LIMIT, now)
        self._garbage = Bucket(*MALFORMED_LIMIT, now)
        self.heard = now
        self._first_message_timer: asyncio.TimerHandle | None = None

    def process_event(self, event: Event) -> None:
        """Note the time of a frame."""
        self.heard = time.monotonic()
        super().process_event(event)

    def wait_for_admission(self) -> None:
        """Let the client wait for its first valid message, for a limited time."""
        self.admission.wait(self)
        self._first_message_timer = self.loop.call_later(FIRST_MESSAGE_TIMEOUT, self.cut)

    async def recv(self, decode: bool | None = None) -> Any:
        """Return the next valid message; disconnect clients that repeatedly send invalid messages.

        The client is admitted with its first valid message; if there are too many pages, the connection is closed.
        """
        while True:
            raw = await super().recv(decode)
            now = time.monotonic()
            if not self._messages.take(now):
                continue
            try:
                self.message_filter.check(raw, self, now)
            except StaleError:
                continue
            except NonsenseError:
                if not self._garbage.take(now):
                    self.cut()
                continue
            if self._first_message_timer is not None:
                self._first_message_timer.cancel()
                self._first_message_timer = None
                if not self.admission.admit(self, now):
                    await self.close(TRY_AGAIN_LATER, "too many clients")
                    continue  # the next call of `recv` says that the connection is closed
            return raw

    def connection_lost(self, exc: Exception | None) -> None:
        """Remove the connection from all counts, and cancel its upload."""
        if self._first_message_timer is not None:
            self._first_message_timer.cancel()
        self.admission.remove(self)
        self.message_filter.forget(self)
        super().connection_lost(exc)


def with_additions(page: bytes, command: str, content: Content = "robot") -> bytes:
    """Return viser's page with the scripts `page_additions.js` and `page_tools.js` at its end.

    `command` is the command line that opened the page, for the notice that the server has ended; "": not known.
    `content` is what the page shows.
    """
    script = b"\n".join(Path(__file__).with_name(name).read_bytes() for name in _SCRIPTS)
    # a file name may contain "</script>"
    text = json.dumps(command).replace("<", "\\u003c")
    head, end, tail = page.rpartition(b"</body>")
    if not end:
        return page
    return (
        head
        + f"<script>window.twinCommand = {text}; window.twinContent = '{content}';</script>\n<script>".encode()
        + script
        + b"</script>\n"
        + end
        + tail
    )


class ViewerAccess:
    """The access control of one viser server.

    Attributes:
        rules: access rules.
        message_filter: filter of the messages of all pages.
        opened: whether viser's socket was opened by `listen` and is thus protected.
    """

    def __init__(self, rules: AccessRules, command: str, shown: Content) -> None:
        self.rules = rules
        self.message_filter = MessageFilter()
        self.opened = False
        page = Path(viser.__file__).parent / "client" / "build" / "index.html"
        content = with_additions(page.read_bytes(), command, shown)
        self._files = {"/": File(content, "text/html; charset=utf-8", policy=PAGE_POLICY)}

    def publish(self, state: bytes) -> None:
        """Store the content of `STATE_PATH`, as JSON."""
        self._files[STATE_PATH] = File(state, "application/json")

    def listen(
        self,
        handler: Callable[[ServerConnection], Awaitable[None]],
        host: str,
        port: int,
        *,
        select_subprotocol: Callable[..., object],
        **of_viser: object,
    ) -> serve_sockets:
        """Open viser's socket instead of `websockets.serve`, with the access control and limits of this module.

        viser's own limits (`of_viser`) are replaced by those of this module.
        """
        self.opened = True

        async def wait_and_handle(connection: Connection) -> None:
            assert isinstance(connection, PageConnection)
            connection.wait_for_admission()
            await handler(connection)

        attributes = {"message_filter": self.message_filter, "admission": Admission()}
        return listen(
            wait_and_handle,
            host,
            port,
            self._check,
            ConnectionCounter(MAX_CONNECTIONS, MAX_CONNECTIONS_OF_ADDRESS),
            WebSocketLimits(MAX_MESSAGE_BYTES, PAGE_BYTE_LIMIT, PAGE_FRAME_LIMIT, PING_TIMEOUT),
            kind=type("OwnPageConnection", (PageConnection,), attributes),
            select_subprotocol=select_subprotocol,
        )

    def _check(self, connection: ServerConnection, request: Request) -> Response | None:
        """Return the response to a request for the page, or None to accept a WebSocket."""
        checked = check_request(self.rules, connection, request)
        if isinstance(checked, Response):
            return checked
        # viser's page opens its WebSocket at the path of the page itself.
        if not checked.upgrade or checked.head_only:
            return serve_file(self.rules, checked, self._files)
        if not checked.authorized:
            return websocket_without_session()
        return None


def serve(
    title: str,
    host: str,
    port: int,
    rules: AccessRules | None = None,
    command: str = "",
    content: Content = "robot",
) -> viser.ViserServer:
    """Start a server and return it.

    Args:
        title: title of the page.
        host: address to listen on.
        port: port to listen on; 0: any free port.
        rules: access rules. None: a request is accepted if its Host header names `host` or this machine, and if the
            request comes from the server's own page or from a program that is not a browser.
        command: command that opens the page again, which the page shows when the server has ended; "": not known.
        content: what the page shows; its help and its keys depend on it.

    Raises:
        TwinError: this version of viser opens its socket differently.
    """
    if rules is None:
        rules = AccessRules(host, port, False, lambda token: None)
    access = ViewerAccess(rules, command, content)
    with contextlib.redirect_stdout(io.StringIO()), _opening(access):  # viser prints its address
        server = viser.ViserServer(host=host, port=port, label=title, verbose=False)
    if not access.opened:
        stop(server)
        raise TwinError(f"viser {viser.__version__} opens its port without access control: install viser 1.1")
    _access_by_server[server] = access
    access.message_filter.set_server(server)
    access.message_filter.notify = lambda text: tell(server, title, text, bad=True)
    return server


_access_by_server: weakref.WeakKeyDictionary[viser.ViserServer, ViewerAccess] = weakref.WeakKeyDictionary()


def publish(server: viser.ViserServer, state: JsonObject) -> None:
    """Store the state that the page reads at `STATE_PATH`, for pages with a session; it replaces an earlier one."""
    access = _access_by_server.get(server)
    if access is not None:
        access.publish(to_json(state))


def tell(server: viser.ViserServer, title: str, text: str, bad: bool = False) -> None:
    """Show a notice in every browser."""
    color = (222, 48, 48) if bad else None
    for client in server.get_clients().values():
        client.add_notification(title, text, color=color, auto_close_seconds=8.0)


def stop(server: viser.ViserServer) -> None:
    """Stop a server, and suppress the messages that viser prints."""
    with contextlib.redirect_stdout(io.StringIO()):
        server.stop()


@contextlib.contextmanager
def _opening(access: ViewerAccess) -> Iterator[None]:
    """Replace `websockets.asyncio.server.serve` by `ViewerAccess.listen` while viser opens its socket."""
    server_module = SimpleNamespace(serve=access.listen)
    replacement = SimpleNamespace(
        asyncio=SimpleNamespace(server=server_module),
        exceptions=websockets.exceptions,
        datastructures=websockets.datastructures,
    )
    # viser opens the socket in a thread of its own, which reads the name from its module: the module's name is
    # replaced for as long as this takes, by one server at a time.
    with _socket_lock:
        original = _infra.websockets
        _infra.websockets = replacement
        try:
            yield
        finally:
            _infra.websockets = original
