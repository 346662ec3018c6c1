"""Every request of both servers goes through here, and every WebSocket is counted: there is no other way in."""

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
"""Close code of WebSockets for which there is no place."""


@dataclass(frozen=True)
class Visit:
    """A request by a right name from a right page.

    Attributes:
        path, query: of its target; the first of each name.
        head, upgrade: whether it is HEAD; whether it asks for a WebSocket.
        known: whether it may come in without a token.
        headers: of the request.
    """

    path: str
    query: dict[str, str]
    head: bool
    upgrade: bool
    known: bool
    headers: Headers


def visit(gate: Gate, connection: ServerConnection, request: Request) -> Visit | Response:
    """Return who asks for what, or the refusal of a foreign name (421), a foreign page (403), a double header (400)."""
    assert isinstance(connection, Connection)
    head, headers = connection.head_only, request.headers
    try:
        host, origin, cookies = headers.get("Host"), headers.get("Origin"), "; ".join(headers.get_all("Cookie"))
        upgrade = "websocket" in headers.get("Upgrade", "").lower()
    except LookupError:  # a header that is there twice
        return refusal(HTTPStatus.BAD_REQUEST, "a header is there twice", head)
    if not gate.answers_to(host, connection.local_address[0]):
        return refusal(HTTPStatus.MISDIRECTED_REQUEST, "this server is not known by that name", head)
    if not gate.same_origin(origin, host):
        return refusal(HTTPStatus.FORBIDDEN, "another page's origin", head)
    known = not gate.open or gate.known(cookies)
    return Visit(request.path.partition("?")[0], query_of(request.path), head, upgrade, known, headers)


def page(gate: Gate, seen: Visit, files: Mapping[str, File]) -> Response:
    """Return a file by its exact path; who is not known comes in by the token, at "/" alone, and gets its session."""
    cookie = None
    if not seen.known:
        if seen.path == "/" and not seen.head:
            cookie = gate.enter(seen.query.get("token", ""))
        if cookie is None:
            text = "This address opens once, for one device. Take the newest one from the terminal."
            return refusal(HTTPStatus.FORBIDDEN, text, seen.head)
    file = files.get(seen.path)
    if file is None:
        return refusal(HTTPStatus.NOT_FOUND, "there is nothing here", seen.head)
    return answer(file, seen.headers, seen.head, cookie)


def stranger() -> Response:
    """Return the refusal of a WebSocket without a session."""
    return refusal(HTTPStatus.FORBIDDEN, "open the page first, by the address that the terminal shows")


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
    """Return a server of `websockets` behind the door: await it, or enter it.

    Args:
        handler: called with each WebSocket for which there is a place.
        host: to listen on.
        port: to listen on.
        request: says what is answered to a request; None lets a WebSocket come in. It begins with `visit`.
        doorman: counts connections and WebSockets.
        kind: of the connections.
        longest: message in bytes.
        bytes: of one connection: a second, and at once.
        frames: of one connection: a second, and at once.
        patience: in s with a peer that does not answer a ping.
        context: of TLS.
        more: for `websockets.serve`.
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
    logger.setLevel(logging.CRITICAL)  # whatever peers do wrong is theirs
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
    """Return the query of a request target, the first of each name."""
    try:
        return {k: v[0] for k, v in parse_qs(target.partition("?")[2], max_num_fields=8).items()}
    except ValueError:
        return {}
