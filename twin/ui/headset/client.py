"""Interface of the source of a stream, and data of a connected client."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Protocol

from websockets.asyncio.server import broadcast

from twin.core.json_types import JsonObject
from twin.ui.access.connection import Connection
from twin.ui.access.rate_limits import Bucket
from twin.ui.headset.client_messages import ClientMessage

STALL_TIMEOUT = 10.0
"""Time in s after which a client that receives no data is disconnected."""

_NEWEST_ONLY_KINDS = ("state", "target")
"""Kinds of documents for which only the newest document is queued for a client."""

MAX_QUEUED_DOCUMENTS = 64
"""Maximum number of documents queued for one client; the client is disconnected if there are more."""


class StreamSource(Protocol):
    """Source of a stream: live robots or a recorded session.

    Attributes:
        replays: whether the source is a recorded session.
        version: version of the stream protocol.
        send: function that sends a document to all clients.
    """

    replays: bool
    send: Callable[[JsonObject], object]

    @property
    def version(self) -> int: ...  # noqa: D102
    def frame(self, tick: float, server_time: float) -> bytes | None: ...  # noqa: D102
    def state(self) -> JsonObject: ...  # noqa: D102
    def welcome(self) -> list[JsonObject]: ...  # noqa: D102
    def ask(self, client: str, message: ClientMessage) -> None: ...  # noqa: D102
    def release(self, client: str) -> None: ...  # noqa: D102
    def holds(self, client: str) -> bool: ...  # noqa: D102
    def close(self) -> None: ...  # noqa: D102


@dataclass(eq=False)
class Client:
    """A connected client.

    Attributes:
        id: public identifier.
        token: secret with which the client can reconnect.
        ws: connection of the client.
        messages: rate limit of the client's messages.
        garbage: rate limit of the client's malformed messages.
        heard: time in s of the client's last message.
        documents: queued documents: (kind, text).
        behind: whether the newest frame must still be sent to the client.
        stalled: time in s at which the connection stopped accepting data; None while the connection accepts data.
        told_rate: time in s at which the client was last warned that it sends too many messages.
    """

    id: str
    token: str
    ws: Connection
    messages: Bucket
    garbage: Bucket
    heard: float
    documents: deque[tuple[str, str]] = field(default_factory=deque)
    behind: bool = True
    stalled: float | None = None
    told_rate: float = -1.0

    def queue(self, kind: str, text: str) -> None:
        """Queue a document; a document of kind `state` or `target` replaces a queued document of the same kind."""
        if kind in _NEWEST_ONLY_KINDS:
            for i, (waiting, _) in enumerate(self.documents):
                if waiting == kind:
                    self.documents[i] = (kind, text)
                    return
        self.documents.append((kind, text))

    def flush(self, frame: bytes | None, now: float) -> None:
        """Send queued documents and the newest frame while the kernel accepts data; disconnect a stalled client."""
        ws = self.ws
        while self.documents and not ws.waiting:
            _, text = self.documents.popleft()
            broadcast([ws], text)
        if self.behind and frame is not None and not ws.waiting:
            broadcast([ws], frame)
            self.behind = False
        if not ws.waiting:
            self.stalled = None
        elif self.stalled is None:
            self.stalled = now
        has_stalled = self.stalled is not None and now - self.stalled > STALL_TIMEOUT
        if has_stalled or len(self.documents) > MAX_QUEUED_DOCUMENTS:
            ws.cut()
