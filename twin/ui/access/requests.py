"""Check every request and count every WebSocket of the viewer's and the headset's server."""

from __future__ import annotations

import asyncio
import logging
import ssl
from collections.abc import Awaitable, Callable, Mapping
from dataclasses import dataclass
from http import HTTPStatus
from typing import Any
from urllib.parse import parse_qs

from websockets.asyncio.server import Server, ServerConnection, serve
from websockets.datastructures import Headers
from websockets.http11 import Request, Response

from twin.ui.access.connection import Connection
from twin.ui.access.rate_limits import BYTE_LIMIT, FRAME_LIMIT, ConnectionCounter
from twin.ui.access.responses import File, error_response, file_response
from twin.ui.access.rules import AccessRules

TRY_AGAIN_LATER = 1013
"""Close code for a WebSocket that would exceed the maximum number of WebSockets."""


@dataclass(frozen=True)
class CheckedRequest:
    """A request whose Host and Origin headers are accepted.

    Attributes:
        path: path of the request target.
        query: query parameters by name; for a repeated parameter, its first value.
        head_only: whether the method is HEAD.
        upgrade: whether a WebSocket is requested.
        authorized: whether the client needs no token.
        headers: headers of the request.
    """

    path: str
    query: dict[str, str]
    head_only: bool
    upgrade: bool
    authorized: bool
    headers: Headers


def check_request(rules: AccessRules, connection: ServerConnection, request: Request) -> CheckedRequest | Response:
    """Return the checked request, or an error response: wrong Host (421), wrong Origin (403), repeated header (400)."""
    assert isinstance(connection, Connection)
    head_only = connection.head_only
    headers = request.headers
    try:
        host = headers.get("Host")
        origin = headers.get("Origin")
        upgrade = headers.get("Upgrade", "").lower()
    except LookupError:  # a repeated header
        return error_response(HTTPStatus.BAD_REQUEST, "a header is repeated", head_only)
    own_address = connection.local_address[0]
    if not rules.accepts_host(host, own_address):
        text = "the Host header does not match this server"
        return error_response(HTTPStatus.MISDIRECTED_REQUEST, text, head_only)
    if not rules.accepts_origin(origin, host):
        text = "the Origin header is that of another page"
        return error_response(HTTPStatus.FORBIDDEN, text, head_only)
    cookies = "; ".join(headers.get_all("Cookie"))
    return CheckedRequest(
        path=request.path.partition("?")[0],
        query=query_of(request.path),
        head_only=head_only,
        upgrade="websocket" in upgrade,
        authorized=not rules.needs_token or rules.has_session(cookies),
        headers=headers,
    )


def serve_file(rules: AccessRules, request: CheckedRequest, files: Mapping[str, File]) -> Response:
    """Return the response to a request for a file; the requested path must be a key of `files`.

    A client without a session must send the token with its request for "/"; the response then sets a session cookie.
    """
    cookie = None
    if not request.authorized:
        # A HEAD request uses up no token: programs that preview a link send one.
        if request.path == "/" and not request.head_only:
            cookie = rules.open_session(request.query.get("token", ""))
        if cookie is None:
            text = "This address works once, for one device. Use the newest address that the terminal shows."
            return error_response(HTTPStatus.FORBIDDEN, text, request.head_only)
    file = files.get(request.path)
    if file is None:
        return error_response(HTTPStatus.NOT_FOUND, "not found", request.head_only)
    return file_response(file, request.headers, request.head_only, cookie)


def websocket_without_session() -> Response:
    """Return the error response to a WebSocket request without a session."""
    return error_response(HTTPStatus.FORBIDDEN, "open the page first, at the address that the terminal shows")


@dataclass(frozen=True)
class WebSocketLimits:
    """Limits of one WebSocket.

    Attributes:
        longest: maximum length of a message in bytes.
        bytes: limit of bytes on one connection: (per second, burst).
        frames: limit of frames on one connection: (per second, burst).
        patience: maximum time in s until the answer to a ping.
    """

    longest: int
    bytes: tuple[float, float] = BYTE_LIMIT
    frames: tuple[float, float] = FRAME_LIMIT
    patience: float = 10.0


def listen(
    handler: Callable[[Connection], Awaitable[None]],
    host: str | None,
    port: int | None,
    check: Callable[[ServerConnection, Request], Response | None],
    counter: ConnectionCounter,
    limits: WebSocketLimits,
    *,
    kind: type[Connection] = Connection,
    context: ssl.SSLContext | None = None,
    **more: Any,
) -> serve:
    """Return a `websockets` server with access control; use it with `await` or `async with`.

    Args:
        handler: called with each accepted WebSocket.
        host: address to listen on.
        port: port to listen on.
        check: function that calls `check_request` and returns the response, or None to accept a WebSocket.
        counter: counter of connections and WebSockets.
        limits: limits of each WebSocket.
        kind: class of the connections.
        context: TLS context; None: no TLS.
        more: further arguments of `websockets.serve`.
    """

    async def counted(connection: ServerConnection) -> None:
        assert isinstance(connection, Connection)
        if not counter.open_client(connection.address):
            await connection.close(TRY_AGAIN_LATER, "too many clients")
            return
        try:
            await handler(connection)
        finally:
            counter.close_client(connection.address)

    # `websockets` makes the connections itself, from a class; a subclass gives them counter and limits of this server.
    attributes = {"counter": counter, "bytes": limits.bytes, "frames": limits.frames}
    own_connection = type("OwnConnection", (kind,), attributes)
    logger = logging.getLogger("twin.ui.access.websockets")
    logger.setLevel(logging.CRITICAL)  # errors of clients are not logged
    return serve(
        counted,
        host,
        port,
        process_request=check,
        create_connection=own_connection,
        ssl=context,
        compression=None,
        server_header=None,
        open_timeout=60.0,
        ping_interval=5.0,
        ping_timeout=limits.patience,
        close_timeout=1.0,
        max_size=limits.longest,
        max_queue=32,
        logger=logger,
        ssl_handshake_timeout=None if context is None else 5.0,
        **more,
    )


async def end(server: Server) -> None:
    """Close all connections (code 1001) and stop; clients that do not close in time are disconnected."""
    server.close(code=1001, reason="the server ends")
    try:
        async with asyncio.timeout(0.5):
            await server.wait_closed()
    except TimeoutError:
        for connection in list(server.handlers):
            connection.transport.abort()


def query_of(target: str) -> dict[str, str]:
    """Return the query parameters of a request target; for a repeated parameter, the first value."""
    text = target.partition("?")[2]
    try:
        values = parse_qs(text, max_num_fields=8)
    except ValueError:
        return {}
    return {name: repeated[0] for name, repeated in values.items()}
