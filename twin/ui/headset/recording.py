"""Record a session of a server: all sent frames and documents and all requests, with their ticks.

Frames are stored as bytes, so that a replay (`replay`) sends exactly the same frames.
"""

from __future__ import annotations

import base64
import json
from collections.abc import Callable
from pathlib import Path

from pydantic_core import from_json, to_json

from twin.core.assets import atomic_folder
from twin.core.json_types import JsonObject
from twin.ui.headset import protocol as wire
from twin.ui.headset.protocol import RefusedError
from twin.ui.session.timeline import RATE

MAX_DURATION = 30 * 60
"""Maximum duration in s of a recording; one second has up to 60 frames of about 1 kB each."""

MAX_SIZE = 200_000_000
"""Maximum total size in bytes of the frames, documents and requests of a recording."""

MAX_RECORDINGS = 50
"""Maximum number of recordings by one server."""

MAX_TOTAL_SIZE = 1_000_000_000
"""Maximum total size in bytes of the recordings by one server."""

_ENTRY = 64
"""Approximate overhead in bytes of each entry in the file."""


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
        version: int = wire.ALONE,
    ) -> None:
        """Begin the first recording; in version `wire.VERSION`, `robot` is the scene's name, `links` are its links."""
        self.path = Path(path)
        self._stem = self.path.stem
        self._saved = 0
        self._written = 0
        self._version = version
        self._head = {"robot": robot, "model_hash": model_hash, "links": list(links), "joints": list(joints)}
        self.running = False
        self.begin(0)

    def begin(self, tick: int) -> None:
        """Begin a recording at a tick; an earlier recording must be finished."""
        self.running = True
        self._first = tick
        self._size = 0
        self._frames: list[tuple[int, bytes]] = []
        self._documents: list[tuple[int, JsonObject]] = []
        self._requests: list[tuple[int, str, JsonObject]] = []

    def check_room(self) -> None:
        """Check that another recording is allowed.

        Raises:
            RefusedError: the maximum number or total size of recordings is reached.
        """
        running = self.running and bool(self._frames)
        if self._saved + running >= MAX_RECORDINGS or self._written + self._size >= MAX_TOTAL_SIZE:
            text = (
                f"{self._saved} recordings with {self._written / 1e6:.0f} MB: one run of the server records at most "
                f"{MAX_RECORDINGS} recordings and {MAX_TOTAL_SIZE / 1e6:.0f} MB; start the server again"
            )
            raise RefusedError("refused", text)

    def add_frame(self, tick: int, frame: bytes) -> None:
        """Add a frame sent at a tick."""
        if self.running:
            self._size += 4 * len(frame) // 3 + _ENTRY
            self._frames.append((tick - self._first, frame))

    def full(self, tick: int) -> bool:
        """Return whether the recording has reached its maximum duration or size."""
        return self.running and (tick - self._first > MAX_DURATION * RATE or self._size > MAX_SIZE)

    def add_document(self, tick: int, document: JsonObject) -> None:
        """Add a document sent to all clients; infinite and NaN numbers are stored as null, as they are sent."""
        if self.running:
            text = to_json(document, inf_nan_mode="null")
            self._size += len(text) + _ENTRY
            self._documents.append((tick - self._first, from_json(text)))

    def add_request(self, tick: int, client: str, message: wire.Message) -> None:
        """Add an accepted or refused request of a client."""
        if self.running:
            request = message.model_dump(mode="json", exclude_none=True)
            self._size += len(json.dumps(request)) + _ENTRY
            self._requests.append((tick - self._first, client, request))

    def finish(self) -> Callable[[], None]:
        """End the recording; return a function that writes the file, for use in any thread.

        The returned function raises `OutputError` if the file cannot be written.
        """
        if not self.running or not self._frames:
            self.running = False
            return lambda: None
        self.running = False
        # `write` may run while the next recording has begun
        path = self.path
        frames = self._frames
        documents = self._documents
        requests = self._requests
        self._saved += 1
        self._written += self._size
        self._size = 0
        self.path = path.with_name(f"{self._stem}-{self._saved + 1}{path.suffix}")

        def write() -> None:
            request_entries = []
            for tick, client, message in requests:
                request_entries.append({"tick": tick, "client": client, "message": message})
            document_entries = []
            for tick, document in documents:
                document_entries.append({"tick": tick, "document": document})
            frame_entries = []
            for tick, frame in frames:
                frame_entries.append({"tick": tick, "frame": base64.b64encode(frame).decode()})
            data = {
                "schema": "twin-stream-session",
                "version": self._version,
                **self._head,
                "rate": RATE,
                "requests": request_entries,
                "documents": document_entries,
                "frames": frame_entries,
            }
            with atomic_folder(path.parent) as work:
                (work / path.name).write_text(json.dumps(data, allow_nan=False) + "\n", encoding="utf-8")

        return write
