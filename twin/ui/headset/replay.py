"""Play a session that `recording` has written, frame by frame."""

from __future__ import annotations

import base64
import binascii
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, ValidationError

from twin.core.errors import TwinError
from twin.core.foreign.text import read_text
from twin.core.json_types import JsonObject
from twin.schema import Table, first_mistake
from twin.ui.headset import stream_frames as wire
from twin.ui.headset.client_messages import ClientMessage, PlayMessage, RefusedError, SeekMessage
from twin.ui.headset.scene_frame import unpack_scene
from twin.ui.session.timeline import TICK_RATE


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
    rate: Annotated[float, Field(ge=TICK_RATE, le=TICK_RATE)]  # ticks in 1/s: the server plays at its own rate
    requests: list[_Request]
    documents: list[_Document]
    frames: Annotated[list[_Frame], Field(min_length=1)]


class Replay:
    """A recorded session as a source of a stream (`client.StreamSource`).

    Each call of `frame` plays the next recorded tick and skips none. Arguments of this protocol that a recording does
    not need are unused.

    Attributes:
        replays: True: only play, pause and seek are possible.
        last: the last tick with a frame or a document.
        version: version of the stream's protocol in the file.
        send: called by the server's other sources to send a document; a recording sends none by itself.
    """

    replays = True

    def __init__(self, path: Path, robot: str, model_hash: str) -> None:
        """Read a recording of this robot, or of the scene `robot`.

        Raises:
            TwinError: the file cannot be read, is malformed, is of another robot, model or task, or has a frame that no
                client could read.
        """
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
        unpack = wire.unpack if file.version == wire.ROBOT_VERSION else unpack_scene
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
        self._shown_tick = -1
        self._running = False
        self._has_begun = False
        self._state: JsonObject = {"type": "state"}
        self._other_documents: dict[tuple[str, str], JsonObject] = {}

    def frame(self, tick: float, server_time: float) -> bytes | None:
        """Play the next recorded tick, and return its frame with the recorded time; None if paused or without frame."""
        if self._shown_tick >= self.last:
            self._running = False
        if not self._running:
            return None
        self._shown_tick += 1
        self._play(self._shown_tick)
        return self._frames.get(self._shown_tick)

    def _play(self, tick: int) -> None:
        """Play the documents of a recorded tick: store them as the last played documents of their kinds."""
        for document in self._documents.get(tick, ()):
            if document.get("type") == "state":
                self._state = document
            else:
                self._other_documents[str(document.get("type")), str(document.get("robot"))] = document

    def state(self) -> JsonObject:
        """Return the last played document `state`, with an additional entry `replay` (time and duration in s)."""
        return {
            **self._state,
            "replay": {"time": max(self._shown_tick, 0) / TICK_RATE, "duration": self.last / TICK_RATE},
        }

    def welcome(self) -> list[JsonObject]:
        """Start the replay if this is the first client; return the last played document `path` of each robot."""
        if not self._has_begun:
            self._has_begun = True
            self._running = True
        paths = []
        for (kind, _), document in self._other_documents.items():
            if kind == "path":
                paths.append(document)
        return paths

    def ask(self, client: str, message: ClientMessage) -> None:
        """Play, pause or seek; refuse other requests.

        Raises:
            RefusedError: the message is not a request to play, pause or seek.
        """
        if isinstance(message, PlayMessage):
            if message.on and self._shown_tick >= self.last:
                self._shown_tick = -1
            self._running = message.on
        elif isinstance(message, SeekMessage):
            self._shown_tick = min(int(message.t * TICK_RATE), self.last) - 1
            self._state, self._other_documents = {"type": "state"}, {}
            for tick in sorted(t for t in self._documents if t <= self._shown_tick):
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
