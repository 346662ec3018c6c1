"""What a server streams from, and whom it streams to."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Protocol

from websockets.asyncio.server import broadcast

from twin.ui.door.connection import Connection
from twin.ui.door.limits import Bucket
from twin.ui.headset import protocol as wire

STALL = 10.0
"""Seconds after which a client that takes nothing is cut."""

WAITING = 64
"""Documents that may wait for one client."""


class Source(Protocol):
    """What is streamed: a robot live, or a recorded session."""

    replays: bool
    send: Callable[[dict[str, Any]], object]

    def frame(self, tick: int, server_time: float) -> bytes | None: ...  # noqa: D102
    def state(self) -> dict[str, Any]: ...  # noqa: D102
    def welcome(self) -> list[dict[str, Any]]: ...  # noqa: D102
    def ask(self, client: str, message: wire.Message) -> None: ...  # noqa: D102
    def release(self, client: str) -> None: ...  # noqa: D102
    @property
    def holder(self) -> str | None: ...  # noqa: D102
    def close(self) -> None: ...  # noqa: D102


@dataclass(eq=False)
class Client:
    """One WebSocket: `id` is known to all, `token` to itself and lets it come back as the same."""

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
        """Let a document wait; a state replaces one that waits already."""
        if kind == "state":
            for i, (waiting, _) in enumerate(self.documents):
                if waiting == "state":
                    self.documents[i] = (kind, text)
                    return
        self.documents.append((kind, text))

    def flush(self, frame: bytes | None, now: float) -> None:
        """Send what waits and the newest frame, as long as nothing waits below; cut whoever takes nothing."""
        ws = self.ws
        while self.documents and not ws.waiting:
            broadcast([ws], self.documents.popleft()[1])
        if self.behind and frame is not None and not ws.waiting:
            broadcast([ws], frame)
            self.behind = False
        if not ws.waiting:
            self.stalled = None
        elif self.stalled is None:
            self.stalled = now
        if len(self.documents) > WAITING or (self.stalled is not None and now - self.stalled > STALL):
            ws.cut()
