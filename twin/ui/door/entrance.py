"""Check every request and count every WebSocket of the viewer's and the headset's server."""

from __future__ import annotations

import logging
import ssl
from collections.abc import Awaitable, Callable, Mapping
from dataclasses import dataclass
from http import HTTPStatus
from typing import Any
from urllib.parse import parse_qs

from websockets.asyncio.server import ServerConnection, serve
from websockets.datastructures import Headers
from websockets.http11 import Request, Response

from twin.ui.door.answers import File, answer, refusal
from twin.ui.door.connection import Connection
from twin.ui.door.gate import Gate
from twin.ui.door.limits import BYTES, FRAMES, Doorman

CLOSED = 1013
"""Close code for a WebSocket that would exceed the maximum number of WebSockets."""


@dataclass(frozen=True)
class Visit:
    """A request whose Host and Origin headers are accepted.

    Attributes:
        path: path of the request target.
        query: query parameters by name; for a repeated parameter, its first value.
        head: whether the method is HEAD.
        upgrade: whether a WebSocket is requested.
        known: whether the client may enter without a token.
        headers: headers of the request.
    """

    path: str
    query: dict[str, str]
    head: bool
    upgrade: bool
    known: bool
    headers: Headers


def visit(gate: Gate, connection: ServerConnection, request: Request) -> Visit | Response:
    """Return the checked request, or an error response: wrong Host (421), wrong Origin (403), repeated header (400)."""
    assert isinstance(connection, Connection)
    head, headers = connection.head_only, request.headers
    try:
        host, origin, cookies = headers.get("Host"), headers.get("Origin"), "; ".join(headers.get_all("Cookie"))
        upgrade = "websocket" in headers.get("Upgrade", "").lower()
    except LookupError:  # a repeated header
        return refusal(HTTPStatus.BAD_REQUEST, "a header is repeated", head)
    if not gate.answers_to(host, connection.local_address[0]):
        return refusal(HTTPStatus.MISDIRECTED_REQUEST, "the Host header does not match this server", head)
    if not gate.same_origin(origin, host):
        return refusal(HTTPStatus.FORBIDDEN, "the Origin header is that of another page", head)
    known = not gate.open or gate.known(cookies)
    return Visit(request.path.partition("?")[0], query_of(request.path), head, upgrade, known, headers)


def page(gate: Gate, seen: Visit, files: Mapping[str, File]) -> Response:
    """Return the response to a request for a file; the requested path must be a key of `files`.

    A client without a session must send the token with its request for "/"; the response then sets a session cookie.
    """
    cookie = None
    if not seen.known:
        if seen.path == "/" and not seen.head:
            cookie = gate.enter(seen.query.get("token", ""))
        if cookie is None:
            text = "This address works once, for one device. Use the newest address that the terminal shows."
            return refusal(HTTPStatus.FORBIDDEN, text, seen.head)
    file = files.get(seen.path)
    if file is None:
        return refusal(HTTPStatus.NOT_FOUND, "not found", seen.head)
    return answer(file, seen.headers, seen.head, cookie)


def stranger() -> Response:
    """Return the error response to a WebSocket request without a session."""
    return refusal(HTTPStatus.FORBIDDEN, "open the page first, at the address that the terminal shows")


def listen(
    handler: Callable[[Connection], Awaitable[None]],
    host: str | None,
    port: int | None,
    request: Callable[[ServerConnection, Request], Response | None],
    doorman: Doorman,
    *,
    kind: type[Connection] = Connection,
    longest: int,
    bytes: tuple[float, float] = BYTES,
    frames: tuple[float, float] = FRAMES,
    patience: float = 10.0,
    context: ssl.SSLContext | None = None,
    **more: Any,
) -> serve:
    """Return a `websockets` server with access control; use it with `await` or `async with`.

    Args:
        handler: called with each accepted WebSocket.
        host: address to listen on.
        port: port to listen on.
        request: function that checks a request with `visit` and returns the response, or None to accept a WebSocket.
        doorman: counter of connections and WebSockets.
        kind: class of the connections.
        longest: maximum length of a message in bytes.
        bytes: limit of bytes on one connection: (per second, burst).
        frames: limit of frames on one connection: (per second, burst).
        patience: maximum time in s until the answer to a ping.
        context: TLS context; None: no TLS.
        more: further arguments of `websockets.serve`.
    """

    async def counted(connection: ServerConnection) -> None:
        assert isinstance(connection, Connection)
        if not doorman.join(connection.household):
            await connection.close(CLOSED, "too many clients")
            return
        try:
            await handler(connection)
        finally:
            doorman.part(connection.household)

    logger = logging.getLogger("twin.ui.door.websockets")
    logger.setLevel(logging.CRITICAL)  # errors of clients are not logged
    return serve(
        counted,
        host,
        port,
        process_request=request,
        create_connection=type("OwnConnection", (kind,), {"doorman": doorman, "bytes": bytes, "frames": frames}),
        ssl=context,
        compression=None,
        server_header=None,
        open_timeout=60.0,
        ping_interval=5.0,
        ping_timeout=patience,
        close_timeout=1.0,
        max_size=longest,
        max_queue=32,
        logger=logger,
        ssl_handshake_timeout=None if context is None else 5.0,
        **more,
    )


def query_of(target: str) -> dict[str, str]:
    """Return the query parameters of a request target; for a repeated parameter, the first value."""
    try:
        return {k: v[0] for k, v in parse_qs(target.partition("?")[2], max_num_fields=8).items()}
    except ValueError:
        return {}
