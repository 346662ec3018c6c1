"""Record a session (all sent frames and documents and all requests, with their ticks), and replay a recorded session.

Frames are stored as bytes, so that a replay sends exactly the same frames.
"""

from __future__ import annotations

import base64
import binascii
import json
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, ValidationError
from pydantic_core import from_json, to_json

from twin.core.assets import atomic_folder
from twin.core.errors import TwinError
from twin.core.foreign.text import read_text
from twin.core.json_types import JsonObject
from twin.schema import Table, first_mistake
from twin.ui.headset import protocol as wire
from twin.ui.headset.protocol import RefusedError
from twin.ui.headset.scene_frame import unpack_scene
from twin.ui.session.timeline import RATE

LONGEST = 30 * 60
"""Maximum duration in s of a recording; one second has up to 60 frames of about 1 kB each."""

LARGEST = 200_000_000
"""Maximum total size in bytes of the frames, documents and requests of a recording."""

FILES = 50
"""Maximum number of recordings by one server."""

IN_ALL = 1_000_000_000
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
        self._of = {"robot": robot, "model_hash": model_hash, "links": list(links), "joints": list(joints)}
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
        if self._saved + running >= FILES or self._written + self._size >= IN_ALL:
            text = (
                f"{self._saved} recordings with {self._written / 1e6:.0f} MB: one run of the server records at most "
                f"{FILES} recordings and {IN_ALL / 1e6:.0f} MB; start the server again"
            )
            raise RefusedError("refused", text)

    def add_frame(self, tick: int, frame: bytes) -> None:
        """Add a frame sent at a tick."""
        if self.running:
            self._size += 4 * len(frame) // 3 + _ENTRY
            self._frames.append((tick - self._first, frame))

    def full(self, tick: int) -> bool:
        """Return whether the recording has reached its maximum duration or size."""
        return self.running and (tick - self._first > LONGEST * RATE or self._size > LARGEST)

    def add_document(self, tick: int, document: JsonObject) -> None:
        """Add a document sent to all clients; infinite and NaN numbers are stored as null, as they are sent."""
        if self.running:
            text = to_json(document, inf_nan_mode="null")
            self._size += len(text) + _ENTRY
            self._documents.append((tick - self._first, from_json(text)))

    def add_request(self, tick: int, client: str, message: wire.Message) -> None:
        """Add an accepted or refused request of a client."""
        if self.running:
            said = message.model_dump(mode="json", exclude_none=True)
            self._size += len(json.dumps(said)) + _ENTRY
            self._requests.append((tick - self._first, client, said))

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
                **self._of,
                "rate": RATE,
                "requests": request_entries,
                "documents": document_entries,
                "frames": frame_entries,
            }
            with atomic_folder(path.parent) as work:
                (work / path.name).write_text(json.dumps(data, allow_nan=False) + "\n", encoding="utf-8")

        return write


class _Request(Table):
    tick: int
    client: str
    message: JsonObject


class _Document(Table):
    tick: int
    document: JsonObject


class _Frame(Table):
    tick: Annotated[int, Field(ge=0)]
    frame: str


class _File(Table):
    kind: Annotated[Literal["twin-stream-session"], Field(alias="schema")]
    version: Literal[1, 2]  # version of the stream protocol
    robot: str
    model_hash: str
    links: list[str]
    joints: list[str]
    rate: float
    requests: list[_Request]
    documents: list[_Document]
    frames: Annotated[list[_Frame], Field(min_length=1)]


class Replay:
    """Source of a stream: a recorded session; each call of `frame` plays the next recorded tick and skips none."""

    replays = True

    def __init__(self, path: Path, robot: str, model_hash: str) -> None:
        try:
            file = _File.model_validate_json(read_text(Path(path), "JSON"))
        except (OSError, UnicodeDecodeError) as error:
            raise TwinError(f"{path}: cannot be read as a session: {error}") from error
        except ValidationError as error:
            where, what = first_mistake(error)
            raise TwinError(f"{path}: {where}: {what}; give a file written by --record") from error
        if (file.robot, file.model_hash) != (robot, model_hash):
            what = "of an earlier version of the robot, or of another task"
            way_out = "record it again, or give the --task of the recorded scene"
            if file.robot != robot:
                what = f"of '{file.robot}'"
                way_out = "record it again"
            raise TwinError(f"{path}: the session is {what}, not of the present '{robot}': {way_out}")
        self._frames: dict[int, bytes] = {}
        unpack = wire.unpack if file.version == wire.ALONE else unpack_scene
        try:
            for entry in file.frames:
                self._frames[entry.tick] = base64.b64decode(entry.frame, validate=True)
            # a frame that no client could read is refused before the replay
            for frame in self._frames.values():
                unpack(frame)
        except (binascii.Error, TwinError) as error:
            raise TwinError(f"{path}: frames: {error}") from error
        self._documents: dict[int, list[JsonObject]] = {}
        for entry in file.documents:
            self._documents.setdefault(entry.tick, []).append(entry.document)
        # A document may follow the last frame, because no frames are sent while the robot does not move.
        self.last = max(self._frames.keys() | self._documents.keys())
        self.version = int(file.version)
        self.send: Callable[[JsonObject], object] = lambda document: None
        self._at = -1
        self._running = False
        self._begun = False
        self._state: JsonObject = {"type": "state"}
        self._others: dict[tuple[str, str], JsonObject] = {}

    def frame(self, tick: float, server_time: float) -> bytes | None:
        """Play the next recorded tick, and return its frame with the recorded time; None if paused or without frame."""
        if self._at >= self.last:
            self._running = False
        if not self._running:
            return None
        self._at += 1
        self._play(self._at)
        return self._frames.get(self._at)

    def _play(self, tick: int) -> None:
        """Play the documents of a recorded tick: store them as the last played documents of their kinds."""
        for document in self._documents.get(tick, ()):
            if document.get("type") == "state":
                self._state = document
            else:
                self._others[str(document.get("type")), str(document.get("robot"))] = document

    def state(self) -> JsonObject:
        """Return the last played document `state`, with an additional entry `replay` (time and duration in s)."""
        return {**self._state, "replay": {"time": max(self._at, 0) / RATE, "duration": self.last / RATE}}

    def welcome(self) -> list[JsonObject]:
        """Start the replay if this is the first client; return the last played document `path` of each robot."""
        if not self._begun:
            self._begun = True
            self._running = True
        paths = []
        for (kind, _), document in self._others.items():
            if kind == "path":
                paths.append(document)
        return paths

    def ask(self, client: str, message: wire.Message) -> None:
        """Play, pause or seek; refuse other requests.

        Raises:
            RefusedError: the message is not a request to play, pause or seek.
        """
        if isinstance(message, wire.PlayMessage):
            if message.on and self._at >= self.last:
                self._at = -1
            self._running = message.on
        elif isinstance(message, wire.SeekMessage):
            self._at = min(int(message.t * RATE), self.last) - 1
            self._state, self._others = {"type": "state"}, {}
            for tick in sorted(t for t in self._documents if t <= self._at):
                self._play(tick)
            self._running = True
        else:
            raise RefusedError("refused", "a recorded session is replayed: only play, pause and seek are possible")

    def holds(self, client: str) -> bool:
        """Return False, because robots in a recording cannot be grabbed."""
        return False

    def release(self, client: str) -> None:
        """Do nothing, because robots in a recording cannot be grabbed."""

    def close(self) -> None:
        """Do nothing, because there are no processes or threads to end."""
