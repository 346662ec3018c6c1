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
from websockets.protocol import Event

from twin.ui.access.rate_limits import BYTE_LIMIT, FRAME_LIMIT, Bucket, ConnectionCounter, counted_address

HEAD_SECONDS = 5.0
"""Maximum time in s between the start of a connection and the end of the HTTP request's head."""

_MAX_HEAD_BYTES = 16_384
_MAX_TARGET_BYTES = 2048
_BYTES_PER_PARSE = 1024
"""Maximum number of bytes parsed before frames are counted again; one read may contain ten thousand small frames."""

_MAX_UNSENT_BYTES = 4096
"""Maximum number of bytes queued in the kernel for sending, so that old frames do not delay the newest frame."""

_REQUEST_LINE = re.compile(rb"([A-Z]{1,20}) (\S+) HTTP/1\.(\d)")


class Connection(ServerConnection):
    """A connection with limits. A server uses a subclass that sets `counter`, and optionally `bytes` and `frames`.

    Attributes:
        counter: counter of connections.
        bytes: limit of received bytes: (per second, burst).
        frames: limit of received frames: (per second, burst).
        address: the client's IPv4 address or IPv6 /64 network, for which its connections are counted.
        head_only: whether the request method was HEAD.
    """

    counter: ClassVar[ConnectionCounter]
    bytes: ClassVar[tuple[float, float]] = BYTE_LIMIT
    frames: ClassVar[tuple[float, float]] = FRAME_LIMIT

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self.address = ""
        self.head_only = False
        self._head = b""
        self._counted = False
        self._refused = False
        self._deadline: asyncio.TimerHandle | None = None
        now = time.monotonic()
        self._bytes = Bucket(*self.bytes, now)
        self._frames = Bucket(*self.frames, now)

    # -- the transport --------------------------------------------------------------------------------

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Accept the connection if the counts of connections are within their limits, else close it."""
        assert isinstance(transport, asyncio.Transport)
        peer = transport.get_extra_info("peername")
        host = peer[0] if peer else ""
        self.address = counted_address(host)
        self._counted = self.counter.open_connection(self.address, time.monotonic())
        if not self._counted:
            self._refused = True
            transport.abort()
            return
        self._deadline = self.loop.call_later(HEAD_SECONDS, self._end_of_head_time)
        super().connection_made(transport)

    def connection_lost(self, exc: Exception | None) -> None:
        """Remove the connection from the counts."""
        if self._deadline is not None:
            self._deadline.cancel()
        if self._counted:
            self._counted = False
            self.counter.close_connection(self.address)
            super().connection_lost(exc)

    def eof_received(self) -> None:
        """Handle the end of the input; if no request was received, abort without a response."""
        if self.request is None:
            if self._counted:
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
        for first in range(0, len(data), _BYTES_PER_PARSE):
            super().data_received(data[first : first + _BYTES_PER_PARSE])
            if self._refused:
                return

    def process_event(self, event: Event) -> None:
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
                self._end_output()

    def _end_output(self) -> None:
        if self.transport.can_write_eof():
            self.transport.write_eof()
        else:  # TLS cannot close only one direction
            self.transport.close()

    def limit_send_queue(self) -> None:
        """Limit the kernel's send queue to `_MAX_UNSENT_BYTES` bytes (Linux, macOS)."""
        sock = self.transport.get_extra_info("socket")
        option = getattr(socket, "TCP_NOTSENT_LOWAT", None)
        if sock is not None and option is not None:
            sock.setsockopt(socket.IPPROTO_TCP, option, _MAX_UNSENT_BYTES)

    @property
    def waiting(self) -> int:
        """Number of bytes that are queued in this process for sending."""
        # With TLS, encrypted bytes are queued in an inner transport, which asyncio does not expose.
        tls = getattr(self.transport, "_ssl_protocol", None)
        inner = getattr(tls, "_transport", None)
        queued = self.transport.get_write_buffer_size()
        if inner is not None:
            queued += inner.get_write_buffer_size()
        return queued

    # -- the request head -----------------------------------------------------------------------------

    def _end_of_head_time(self) -> None:
        if self.request is None and not self._refused:
            self._refuse(HTTPStatus.REQUEST_TIMEOUT)

    def _read_head(self, data: bytes) -> None:
        self._head += data
        head, end, body = self._head.partition(b"\r\n\r\n")
        line = head.partition(b"\r\n")[0]
        if len(line) > _MAX_TARGET_BYTES + 100:
            return self._refuse(HTTPStatus.REQUEST_URI_TOO_LONG)
        if len(head) > _MAX_HEAD_BYTES:
            return self._refuse(HTTPStatus.REQUEST_HEADER_FIELDS_TOO_LARGE)
        if not end:
            return None
        request_line = _REQUEST_LINE.fullmatch(line)
        if request_line is None:
            return self._refuse(HTTPStatus.BAD_REQUEST)
        method, target, minor = request_line.groups()
        if not target.startswith(b"/"):
            return self._refuse(HTTPStatus.BAD_REQUEST)
        if len(target) > _MAX_TARGET_BYTES:
            return self._refuse(HTTPStatus.REQUEST_URI_TOO_LONG)
        if method not in (b"GET", b"HEAD"):
            return self._refuse(HTTPStatus.METHOD_NOT_ALLOWED, Allow="GET, HEAD")
        if minor != b"1":
            return self._refuse(HTTPStatus.HTTP_VERSION_NOT_SUPPORTED)
        if body:  # a body, or a frame before the handshake, which no valid client sends
            return self._refuse(HTTPStatus.BAD_REQUEST)
        if self._deadline is not None:
            self._deadline.cancel()
        self.head_only = method == b"HEAD"
        self._head = b""
        # `websockets` parses only GET; the response to HEAD is that of GET without its body.
        head_of_get = b"GET" + head[len(method) :] + b"\r\n\r\n"
        return super().data_received(head_of_get)

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
