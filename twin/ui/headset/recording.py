"""A recorded session: every frame and document that was sent and every request, with their ticks; and its replay.

Frames are kept as they went over the wire, so a replay sends the same bytes.
"""

from __future__ import annotations

import base64
import binascii
import json
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, ValidationError

from twin.core.assets import atomic_folder
from twin.core.errors import TwinError
from twin.core.foreign.text import read_text
from twin.schema import Table
from twin.ui.headset import protocol as wire
from twin.ui.headset.protocol import RefusedError
from twin.ui.session.timeline import RATE

LONGEST = 30 * 60
"""Seconds that are recorded at most: 60 frames of a kilobyte each."""

LARGEST = 200_000_000
"""Bytes of one recording: as long as that in frames, and what clients say meanwhile."""

FILES, IN_ALL = 50, 1_000_000_000
"""Recordings of one server, and their bytes: any client may begin one again and again."""


_ENTRY = 64
"""Bytes about one entry of the file."""


class Recording:
    """What goes through a server, written to a file by what `finish` returns.

    Attributes:
        running: whether it records.
        path: of the next file; a second recording of the same server gets -2 after its name.
    """

    def __init__(
        self, path: Path, robot: str, model_hash: str, links: tuple[str, ...], joints: tuple[str, ...]
    ) -> None:
        self.path, self._stem, self._saved, self._written = Path(path), Path(path).stem, 0, 0
        self._of = {"robot": robot, "model_hash": model_hash, "links": list(links), "joints": list(joints)}
        self.running = False
        self.begin(0)

    def begin(self, tick: int) -> None:
        """Begin anew; `finish` has ended what was before."""
        self.running, self._first, self._size = True, tick, 0
        self._frames: list[tuple[int, bytes]] = []
        self._documents: list[tuple[int, dict[str, Any]]] = []
        self._requests: list[tuple[int, str, dict[str, Any]]] = []

    def check_room(self) -> None:
        """Return if another recording may begin.

        Raises:
            RefusedError: there are as many as a server writes, or as large ones.
        """
        if self._saved >= FILES or self._written + self._size >= IN_ALL:
            text = f"{self._saved} recordings, {self._written / 1e6:.0f} MB: no more from one start of the server"
            raise RefusedError("refused", text)

    def add_frame(self, tick: int, frame: bytes) -> None:
        """Add a frame that was sent at a tick."""
        if self.running:
            self._size += 4 * len(frame) // 3 + _ENTRY
            self._frames.append((tick - self._first, frame))

    def full(self, tick: int) -> bool:
        """Return whether it is as long, or as large, as it may be."""
        return self.running and (tick - self._first > LONGEST * RATE or self._size > LARGEST)

    def add_document(self, tick: int, document: dict[str, Any]) -> None:
        """Add a document that all clients were sent."""
        if self.running:
            self._size += len(json.dumps(document)) + _ENTRY
            self._documents.append((tick - self._first, document))

    def add_request(self, tick: int, client: str, message: wire.Message) -> None:
        """Add what a client asked for, whether or not it was followed."""
        if self.running:
            said = message.model_dump(mode="json", exclude_none=True)
            self._size += len(json.dumps(said)) + _ENTRY
            self._requests.append((tick - self._first, client, said))

    def finish(self) -> Callable[[], None]:
        """End; return what writes the file, in whatever thread. It raises `OutputError` if it cannot."""
        if not self.running or not self._frames:
            self.running = False
            return lambda: None
        self.running = False
        path, frames, documents, requests = self.path, self._frames, self._documents, self._requests
        self._saved += 1
        self._written += self._size
        self.path = path.with_name(f"{self._stem}-{self._saved + 1}{path.suffix}")

        def write() -> None:
            data = {
                "schema": "twin-stream-session",
                "version": 1,
                **self._of,
                "rate": RATE,
                "requests": [{"tick": t, "client": c, "message": m} for t, c, m in requests],
                "documents": [{"tick": t, "document": d} for t, d in documents],
                "frames": [{"tick": t, "frame": base64.b64encode(f).decode()} for t, f in frames],
            }
            with atomic_folder(path.parent) as work:
                (work / path.name).write_text(json.dumps(data, allow_nan=False) + "\n", encoding="utf-8")

        return write


class _Request(Table):
    tick: int
    client: str
    message: dict[str, Any]


class _Document(Table):
    tick: int
    document: dict[str, Any]


class _Frame(Table):
    tick: Annotated[int, Field(ge=0)]
    frame: str


class _File(Table):
    kind: Annotated[Literal["twin-stream-session"], Field(alias="schema")]
    version: Literal[1]
    robot: str
    model_hash: str
    links: list[str]
    joints: list[str]
    rate: float
    requests: list[_Request]
    documents: list[_Document]
    frames: Annotated[list[_Frame], Field(min_length=1)]


class Replay:
    """A recorded session as a source: one recorded tick for each tick, none left out."""

    replays = True

    def __init__(self, path: Path, robot: str, model_hash: str) -> None:
        try:
            file = _File.model_validate_json(read_text(Path(path), "JSON"))
        except (OSError, UnicodeDecodeError) as error:
            raise TwinError(f"{path}: cannot be read as a session: {error}") from error
        except ValidationError as error:
            first = error.errors(include_url=False, include_input=False)[0]
            where = ".".join(map(str, first["loc"]))
            raise TwinError(f"{path}: {where}: {first['msg']}; a session is what --record wrote") from error
        if (file.robot, file.model_hash) != (robot, model_hash):
            what = f"of '{file.robot}'" if file.robot != robot else "of an earlier design of it"
            raise TwinError(f"{path}: the session is {what}, not of '{robot}' as it is: record it anew")
        try:
            self._frames = {f.tick: base64.b64decode(f.frame, validate=True) for f in file.frames}
            for frame in self._frames.values():
                wire.unpack(frame)
        except (binascii.Error, TwinError) as error:
            raise TwinError(f"{path}: frames: {error}") from error
        self._documents: dict[int, list[dict[str, Any]]] = {}
        for d in file.documents:
            self._documents.setdefault(d.tick, []).append(d.document)
        self.last = max(self._frames)
        self.send: Callable[[dict[str, Any]], object] = lambda document: None
        self._at, self._running, self._begun = -1, False, False
        self._state: dict[str, Any] = {"type": "state"}
        self._others: dict[str, dict[str, Any]] = {}

    def frame(self, tick: int, server_time: float) -> bytes | None:
        """Return the frame of the next recorded tick, if one was sent there; ticks and times are the recorded ones."""
        if self._at >= self.last:
            self._running = False
        if not self._running:
            return None
        self._at += 1
        for document in self._documents.get(self._at, ()):
            if document.get("type") == "state":
                self._state = document
            else:
                self._others[str(document.get("type"))] = document
        return self._frames.get(self._at)

    def state(self) -> dict[str, Any]:
        """Return the recorded state, with `replay`: where it is and how long it takes, in s."""
        return {**self._state, "replay": {"time": max(self._at, 0) / RATE, "duration": self.last / RATE}}

    def welcome(self) -> list[dict[str, Any]]:
        """Return the last path that was recorded; it begins when the first client has come."""
        self._running, self._begun = self._running or not self._begun, True
        return [d for n, d in self._others.items() if n == "path"]

    def ask(self, client: str, message: wire.Message) -> None:
        """Play, hold, or begin again at a time; nothing else can be asked of what is past.

        Raises:
            RefusedError: for everything else.
        """
        if isinstance(message, wire.Play):
            if message.on and self._at >= self.last:
                self._at = -1
            self._running = message.on
        elif isinstance(message, wire.Seek):
            self._at = min(int(message.t * RATE), self.last) - 1
            self._running = True
        else:
            raise RefusedError("refused", "a recorded session is replayed: it can be played and sought in, not changed")

    @property
    def holder(self) -> str | None:
        """Nobody holds what is past."""
        return None

    def release(self, client: str) -> None:
        """Do nothing: nobody holds it."""

    def close(self) -> None:
        """Do nothing: a recording holds no process and no thread."""
