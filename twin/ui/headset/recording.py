"""Record a session of a server: all sent frames and documents and all requests, with their ticks.

Frames are stored as bytes, so that a replay (`replay`) sends exactly the same frames.
"""

from __future__ import annotations

import base64
import json
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from pydantic_core import from_json, to_json

from twin.core.assets import atomic_folder
from twin.core.json_types import JsonObject
from twin.ui.headset import stream_frames as wire
from twin.ui.headset.client_messages import ClientMessage, RefusedError
from twin.ui.session.timeline import TICK_RATE

MAX_DURATION = 30 * 60
"""Maximum duration in s of a recording; one second has up to 60 frames of about 1 kB each."""

MAX_SIZE = 200_000_000
"""Maximum total size in bytes of the frames, documents and requests of a recording."""

MAX_RECORDINGS = 50
"""Maximum number of recordings by one server."""

MAX_TOTAL_SIZE = 1_000_000_000
"""Maximum total size in bytes of the recordings by one server."""

_ENTRY_OVERHEAD = 64
"""Approximate overhead in bytes of each entry in the file."""


@dataclass
class _SentMessages:
    """The messages of one recording, each with its tick since the first one.

    Attributes:
        first_tick: tick of the server at which the recording began.
        size: size in bytes that the messages have in the file, approximately.
        frames: (tick, bytes) of each sent frame.
        documents: (tick, document) of each document sent to all clients.
        requests: (tick, client, message) of each request.
    """

    first_tick: int
    size: int = 0
    frames: list[tuple[int, bytes]] = field(default_factory=list)
    documents: list[tuple[int, JsonObject]] = field(default_factory=list)
    requests: list[tuple[int, str, JsonObject]] = field(default_factory=list)

    def as_dict(self) -> JsonObject:
        """Return the messages as they are written to the file."""
        requests = []
        for tick, client, message in self.requests:
            requests.append({"tick": tick, "client": client, "message": message})
        documents = []
        for tick, document in self.documents:
            documents.append({"tick": tick, "document": document})
        frames = []
        for tick, frame in self.frames:
            frames.append({"tick": tick, "frame": base64.b64encode(frame).decode()})
        return {"requests": requests, "documents": documents, "frames": frames}


class StreamRecording:
    """Recorder of the messages of a server; `finish` returns a function that writes the file.

    Attributes:
        running: whether a recording is in progress.
        path: file of the present recording; between two recordings, file of the next one. The name of a server's second
            file ends with -2.
    """

    def __init__(
        self,
        path: Path,
        robot: str,
        model_hash: str,
        links: tuple[str, ...],
        joints: tuple[str, ...],
        version: int = wire.ROBOT_VERSION,
    ) -> None:
        """Begin the first recording; for `wire.SCENE_VERSION`, `robot` and `links` are those of the scene."""
        self.path = Path(path)
        self._stem = self.path.stem
        self._recordings = 0  # finished ones, and their total size in bytes
        self._total_size = 0
        self._head = {
            "schema": "twin-stream-session",
            "version": version,
            "robot": robot,
            "model_hash": model_hash,
            "links": list(links),
            "joints": list(joints),
            "rate": TICK_RATE,
        }
        self.running = False
        self.begin(0)

    def begin(self, tick: int) -> None:
        """Begin a recording at a tick; an earlier recording must be finished."""
        self.running = True
        self._sent = _SentMessages(tick)

    def check_room(self) -> None:
        """Check that another recording is allowed.

        Raises:
            RefusedError: the maximum number or total size of recordings is reached.
        """
        recordings = self._recordings
        if self.running and self._sent.frames:
            recordings += 1
        if recordings >= MAX_RECORDINGS or self._total_size + self._sent.size >= MAX_TOTAL_SIZE:
            text = (
                f"{self._recordings} recordings with {self._total_size / 1e6:.0f} MB: one run of the server records at "
                f"most {MAX_RECORDINGS} recordings and {MAX_TOTAL_SIZE / 1e6:.0f} MB; start the server again"
            )
            raise RefusedError("refused", text)

    def add_frame(self, tick: int, frame: bytes) -> None:
        """Add a frame sent at a tick."""
        if not self.running:
            return
        self._sent.frames.append((tick - self._sent.first_tick, frame))
        self._sent.size += 4 * len(frame) // 3 + _ENTRY_OVERHEAD  # base64 has four characters for three bytes

    def full(self, tick: int) -> bool:
        """Return whether the recording has reached its maximum duration or size."""
        if not self.running:
            return False
        duration = (tick - self._sent.first_tick) / TICK_RATE
        return duration > MAX_DURATION or self._sent.size > MAX_SIZE

    def add_document(self, tick: int, document: JsonObject) -> None:
        """Add a document sent to all clients; infinite and NaN numbers are stored as null, as they are sent."""
        if not self.running:
            return
        text = to_json(document, inf_nan_mode="null")
        self._sent.documents.append((tick - self._sent.first_tick, from_json(text)))
        self._sent.size += len(text) + _ENTRY_OVERHEAD

    def add_request(self, tick: int, client: str, message: ClientMessage) -> None:
        """Add an accepted or refused request of a client."""
        if not self.running:
            return
        request = message.model_dump(mode="json", exclude_none=True)
        self._sent.requests.append((tick - self._sent.first_tick, client, request))
        self._sent.size += len(json.dumps(request)) + _ENTRY_OVERHEAD

    def finish(self) -> Callable[[], None]:
        """End the recording; return a function that writes the file, for use in any thread.

        Without frames there is nothing to play: the function writes no file, and documents and requests are dropped.
        The returned function raises `OutputError` if the file cannot be written.
        """
        was_running = self.running
        self.running = False
        if not was_running or not self._sent.frames:
            return lambda: None
        # the next recording may have begun when `write` runs: it has another path and other messages
        path = self.path
        sent = self._sent
        self._recordings += 1
        self._total_size += sent.size
        self._sent = _SentMessages(0)
        self.path = path.with_name(f"{self._stem}-{self._recordings + 1}{path.suffix}")

        def write() -> None:
            text = json.dumps({**self._head, **sent.as_dict()}, allow_nan=False)
            with atomic_folder(path.parent) as work:
                (work / path.name).write_text(text + "\n", encoding="utf-8")

        return write
