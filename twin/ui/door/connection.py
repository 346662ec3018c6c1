"""A TCP connection with limits that the library `websockets` does not enforce.

The connection reads the head of the HTTP request, with limits on method, length and time. Then it counts received bytes
and frames. A server sends a frame only if no bytes are queued (`waiting`), so that at most one frame is queued.
"""

from __future__ import annotations

import asyncio
import contextlib
import re
import socket
import time
from http import HTTPStatus
from typing import Any, ClassVar

from websockets.asyncio.server import ServerConnection
from websockets.datastructures import Headers
from websockets.http11 import Response

from twin.ui.door.limits import BYTES, FRAMES, Bucket, Doorman, household

HEAD_SECONDS = 5.0
"""Maximum time in s between the start of a connection and the end of the HTTP request's head."""

_HEAD_BYTES, _TARGET_BYTES = 16_384, 2048
_SLICE = 1024
"""Maximum number of bytes parsed before frames are counted again; one read may contain ten thousand small frames."""

_UNSENT = 4096
"""Maximum number of bytes queued in the kernel for sending, so that old frames do not delay the newest frame."""

_REQUEST = re.compile(rb"([A-Z]{1,20}) (\S+) HTTP/1\.(\d)")


class Connection(ServerConnection):
    """A connection with limits. A server uses a subclass that sets `doorman`, and optionally `bytes` and `frames`.

    Attributes:
        doorman: counter of connections.
        bytes: limit of received bytes: (per second, burst).
        frames: limit of received frames: (per second, burst).
        household: the client's IPv4 address or IPv6 /64 network; connections are counted for each household.
        head_only: whether the request method was HEAD.
    """

    doorman: ClassVar[Doorman]
    bytes: ClassVar[tuple[float, float]] = BYTES
    frames: ClassVar[tuple[float, float]] = FRAMES

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self.household, self.head_only = "", False
        self._head = b""
        self._admitted = self._refused = False
        self._deadline: asyncio.TimerHandle | None = None
        now = time.monotonic()
        self._bytes, self._frames = Bucket(*self.bytes, now), Bucket(*self.frames, now)

    # -- the transport --------------------------------------------------------------------------------

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Accept the connection if the counts of connections are within their limits, else close it."""
        assert isinstance(transport, asyncio.Transport)
        peer = transport.get_extra_info("peername")
        self.household = household(peer[0] if peer else "")
        self._admitted = self.doorman.admit(self.household, time.monotonic())
        if not self._admitted:
            self._refused = True
            transport.abort()
            return
        self._deadline = self.loop.call_later(HEAD_SECONDS, self._late)
        super().connection_made(transport)

    def connection_lost(self, exc: Exception | None) -> None:
        """Remove the connection from the counts."""
        if self._deadline is not None:
            self._deadline.cancel()
        if self._admitted:
            self._admitted = False
            self.doorman.leave(self.household)
            super().connection_lost(exc)

    def eof_received(self) -> None:
        """Handle the end of the input; if no request was received, abort without a response."""
        if self.request is None:
            if self._admitted:
                self.transport.abort()
            return
        super().eof_received()

    def data_received(self, data: bytes) -> None:
        """Read the request head, then count bytes; disconnect clients that exceed the limits."""
        if self._refused:
            return
        if self.request is None:
            self._read_head(data)
            return
        if not self._bytes.take(time.monotonic(), len(data)):
            self.cut()
            return
        for first in range(0, len(data), _SLICE):
            super().data_received(data[first : first + _SLICE])
            if self._refused:
                return

    def process_event(self, event: Any) -> None:
        """Count a frame of any type."""
        if self.request is not None and not self._frames.take(time.monotonic()):
            self.cut()
            return
        super().process_event(event)

    def cut(self) -> None:
        """Abort the connection."""
        self._refused = True
        self.transport.abort()

    # -- sending --------------------------------------------------------------------------------------

    def send_data(self) -> None:
        """Write queued data at once; write nothing to a closed connection, because asyncio would log each write."""
        parts = self.protocol.data_to_send()
        if self.transport.is_closing():
            return
        if any(parts):
            self.transport.write(b"".join(parts))
        if parts and not parts[-1]:  # an empty part marks the end of the stream
            with contextlib.suppress(OSError, RuntimeError):
                self.transport.write_eof() if self.transport.can_write_eof() else self.transport.close()

    def keep_little(self) -> None:
        """Limit the kernel's send queue to `_UNSENT` bytes (Linux, macOS)."""
        sock = self.transport.get_extra_info("socket")
        option = getattr(socket, "TCP_NOTSENT_LOWAT", None)
        if sock is not None and option is not None:
            sock.setsockopt(socket.IPPROTO_TCP, option, _UNSENT)

    @property
    def waiting(self) -> int:
        """Number of bytes that are queued in this process for sending."""
        # With TLS, encrypted bytes are queued in an inner transport, which asyncio does not expose.
        inner = getattr(getattr(self.transport, "_ssl_protocol", None), "_transport", None)
        return self.transport.get_write_buffer_size() + (0 if inner is None else inner.get_write_buffer_size())

    # -- the request head -----------------------------------------------------------------------------

    def _late(self) -> None:
        if self.request is None and not self._refused:
            self._refuse(HTTPStatus.REQUEST_TIMEOUT)

    def _read_head(self, data: bytes) -> None:
        self._head += data
        head, end, rest = self._head.partition(b"\r\n\r\n")
        line = head.partition(b"\r\n")[0]
        if len(line) > _TARGET_BYTES + 100:
            return self._refuse(HTTPStatus.REQUEST_URI_TOO_LONG)
        if len(head) > _HEAD_BYTES:
            return self._refuse(HTTPStatus.REQUEST_HEADER_FIELDS_TOO_LARGE)
        if not end:
            return None
        found = _REQUEST.fullmatch(line)
        if found is None or not found[2].startswith(b"/"):
            return self._refuse(HTTPStatus.BAD_REQUEST)
        method, target, minor = found.groups()
        if len(target) > _TARGET_BYTES:
            return self._refuse(HTTPStatus.REQUEST_URI_TOO_LONG)
        if method not in (b"GET", b"HEAD"):
            return self._refuse(HTTPStatus.METHOD_NOT_ALLOWED, Allow="GET, HEAD")
        if minor != b"1":
            return self._refuse(HTTPStatus.HTTP_VERSION_NOT_SUPPORTED)
        if rest:  # a body, or a frame before the handshake, which no valid client sends
            return self._refuse(HTTPStatus.BAD_REQUEST)
        if self._deadline is not None:
            self._deadline.cancel()
        self.head_only = method == b"HEAD"
        self._head = b""
        return super().data_received(b"GET" + head[len(method) :] + b"\r\n\r\n")

    def _refuse(self, status: HTTPStatus, **headers: str) -> None:
        """Send an error response to a request that `websockets` would not answer."""
        self._refused = True
        body = f"{status.value} {status.phrase}\n".encode()
        fields = Headers({"Connection": "close", "Content-Type": "text/plain", "Content-Length": str(len(body))})
        fields.update(headers)
        self.transport.write(Response(status.value, status.phrase, fields, body).serialize())
        self.transport.close()
        # Abort after 1 s if the client does not read the response; closing would wait until it is written.
        self.loop.call_later(1.0, self.transport.abort)
