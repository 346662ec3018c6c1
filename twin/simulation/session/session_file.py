"""File of a session: the device's signals of every tick, written second by second while the session runs.

A `twin-session` file is one line of JSON (`Head`), then chunks of at most `CHUNK` ticks, then an end mark. All numbers
are little-endian. A chunk has, in this order: "TWNS"; its number of ticks and its number of packed bytes (u32 each);
the SHA-256 of all signals of the World in these ticks (float64, row by row); the packed bytes. The packed bytes are
compressed by zlib. They contain the device's signals in these ticks, then the row of all signals after the last tick
(float64). The end mark is "TWNE", the total number of ticks, 0 (u32 each), and the SHA-256 of all chunks' digests.
"""

from __future__ import annotations

import hashlib
import json
import struct
import zlib
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, BinaryIO, Literal

import numpy as np
from pydantic import Field, ValidationError

from twin.core.errors import OutputError, WorldError
from twin.core.json_types import JsonObject
from twin.core.spatial import Array
from twin.core.version import __version__
from twin.schema import Identifier, Table, first_mistake
from twin.simulation.condition import Condition
from twin.simulation.world.recording import SignalTable
from twin.simulation.world.signals import columns

NAME = "hands.session"
"""Name of the session file that a simulated surgeon writes."""

CHUNK = 1000
"""Number of ticks in a chunk: one second at the usual 1 ms. A crash loses at most one chunk."""

LONGEST = 3600.0
"""Maximum duration of a session in s."""

_HEAD = struct.Struct("<4sII32s")
_MAGIC = b"TWNS"
_END = b"TWNE"

_LONGEST_HEAD = 1_000_000
"""Maximum length of the file's first line in bytes."""

_MOST_NUMBERS = 10_000
"""Maximum number of values in one row of signals."""

LARGEST = 4_000_000_000
"""Maximum size of all unpacked chunks in bytes: enough for `LONGEST` s at 1 kHz, if the device has 138 values."""


class Head(Table):
    """First line of a `twin-session` file. All values are SI; a row holds the signals at the end of its tick."""

    schema_: Annotated[Literal["twin-session"], Field(alias="schema")]
    version: Literal[1]
    twin: Annotated[str, Field(description="version of twin that wrote the file")]
    scene: Annotated[str, Field(description="name of the scene")]
    identity: Annotated[str, Field(pattern="^sha256:[0-9a-f]{64}$", description="hash of the World's inputs")]
    dt: Annotated[float, Field(gt=0, description="duration of one tick in s")]
    device: Annotated[
        list[SignalTable],
        Field(min_length=1, description="signals of the device, in the order in which a row contains them"),
    ]
    world: Annotated[
        list[SignalTable], Field(min_length=1, description="all signals, in the order in which a row contains them")
    ]
    task: Annotated[Identifier | None, Field(description="task of the scene; null: none")] = None
    seed: Annotated[int | None, Field(description="random seed of a simulated surgeon; null: a person")] = None
    condition: Annotated[Condition | None, Field(description="condition; null: without forces on the hands")] = None


@dataclass(frozen=True)
class Chunk:
    """Part of a session: at most `CHUNK` successive ticks.

    Attributes:
        device: (k, n) signals of the device, one row per tick.
        last: (m,) all signals after the last tick of the chunk.
        digest: SHA-256 of the rows of all signals.
    """

    device: Array
    last: Array
    digest: bytes


@dataclass(frozen=True)
class Session:
    """A session that was read from a file.

    Attributes:
        head: the first line.
        chunks: the chunks, in order.
        lost: "" if the file is complete; otherwise a sentence that states where the file ends.
    """

    head: Head
    chunks: tuple[Chunk, ...]
    lost: str

    @property
    def device(self) -> Array:
        """The signals of the device (k, n), one row per tick."""
        return np.concatenate([chunk.device for chunk in self.chunks])


def sizes(signals: list[SignalTable]) -> dict[str, int]:
    """Return {signal: number of values}."""
    return {signal.name: signal.size for signal in signals}


def digest(rows: Array) -> bytes:
    """Return the SHA-256 of rows (k, m) of signals."""
    return hashlib.sha256(np.ascontiguousarray(rows, "<f8").tobytes()).digest()


def head(
    scene: str,
    identity: str,
    dt: float,
    device: Mapping[str, int],
    world: Mapping[str, int],
    task: str | None = None,
    seed: int | None = None,
    condition: Condition | None = None,
) -> Head:
    """Return the first line of a file; `device` and `world`: {signal: number of values}, as in `Signals.sizes`."""
    return Head.model_validate(
        {
            "schema": "twin-session",
            "version": 1,
            "twin": __version__,
            "scene": scene,
            "identity": identity,
            "dt": dt,
            "device": _signal_tables(device),
            "world": _signal_tables(world),
            "task": task,
            "seed": seed,
            "condition": condition,
        }
    )


def _signal_tables(sizes: Mapping[str, int]) -> list[JsonObject]:
    """Return the rows of the first line for {signal: number of values}."""
    tables = []
    for name, size in sizes.items():
        tables.append({"name": name, "size": size})
    return tables


class SessionWriter:
    """Writes a session while it runs; until `close`, the file has the suffix `.part`.

    In a `with` statement, the file is closed at the end, and abandoned after an error.

    Attributes:
        path: the file.
        ticks: number of ticks so far.
    """

    def __init__(self, path: Path, head: Head) -> None:
        """Create the file.

        Raises:
            OutputError: the file or its `.part` exists, or cannot be written.
        """
        self.path = Path(path)
        self.ticks = 0
        self._head = head
        self._part = self.path.with_name(self.path.name + ".part")
        if self.path.exists():
            raise OutputError(f"{self.path} exists; sessions are not overwritten: choose another name")
        world_sizes = sizes(head.world)
        column_of = columns(world_sizes)
        device_columns = []
        for signal in head.device:
            # what the device wrote, also if a hazard has changed the signal since
            columns_of_signal = column_of.get(f"{signal.name}.written", column_of[signal.name])
            device_columns.append(np.arange(columns_of_signal.start, columns_of_signal.stop))
        self._device = np.concatenate(device_columns)
        chunk_size = 8 * (CHUNK * len(self._device) + sum(world_sizes.values()))  # bytes, unpacked
        self._most = LARGEST // chunk_size * CHUNK
        self._rows: list[Array] = []
        self._waiting = 0  # rows that are not in the file yet
        self._digests = hashlib.sha256()
        if self._part.exists():
            raise OutputError(
                f"{self._part} is left from a session that was interrupted: rename it (`twin session` reads it), or "
                "delete it"
            )
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            self._file: BinaryIO | None = self._part.open("xb")
        except OSError as error:
            raise OutputError(f"cannot write to {self._part}: {error.strerror or error}") from error
        try:
            self._put(json.dumps(head.model_dump(by_alias=True)).encode() + b"\n")
        except OutputError:
            self.abandon()
            raise

    def __enter__(self) -> SessionWriter:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        try:
            if kind is None:
                self.close()
        finally:
            self.abandon()

    @property
    def full(self) -> bool:
        """Whether the maximum duration or size of a session is reached."""
        return self.ticks * self._head.dt >= LONGEST or self.ticks + CHUNK > self._most

    def add(self, rows: Array) -> None:
        """Add rows (k, m) of all signals; complete chunks are written to the file immediately.

        Raises:
            OutputError: the file cannot be written; data written before remain in the `.part`.
        """
        self._rows.append(rows)
        self._waiting += len(rows)
        self.ticks += len(rows)
        if self._waiting >= CHUNK:
            waiting_rows = np.concatenate(self._rows)
            complete_count = len(waiting_rows) // CHUNK * CHUNK
            for start in range(0, complete_count, CHUNK):
                self._write(waiting_rows[start : start + CHUNK])
            self._rows = [waiting_rows[complete_count:]]
            self._waiting = len(waiting_rows) - complete_count

    def close(self) -> None:
        """Write the remaining rows and the end mark, and rename the file; a session without ticks leaves no file.

        Raises:
            OutputError: the file cannot be written; data written before remain in the `.part`.
        """
        if self._file is None:
            return
        try:
            if self._waiting:
                self._write(np.concatenate(self._rows))
            self._put(_HEAD.pack(_END, self.ticks, 0, self._digests.digest()))
        except OutputError:
            self.abandon()
            raise
        self._file.close()
        self._file = None
        try:
            # only a complete session has a name without `.part`
            if self.ticks:
                self._part.replace(self.path)
            else:
                self._part.unlink()
        except OSError as error:
            raise OutputError(f"cannot write to {self.path}: {error.strerror or error}") from error

    def abandon(self) -> None:
        """After an error, close the file without an end mark; keep the `.part` if it has a complete chunk."""
        if self._file is None:
            return
        with suppress(OSError):
            self._file.close()
        self._file = None
        if self.ticks == self._waiting:  # no chunk was written: there is nothing to replay
            with suppress(OSError):
                self._part.unlink()

    def _write(self, rows: Array) -> None:
        digest_of_chunk = digest(rows)
        self._digests.update(digest_of_chunk)
        # a replay computes all other signals from those of the device; the last row tells where it differs
        body = np.concatenate([rows[:, self._device].ravel(), rows[-1]])
        packed = zlib.compress(body.astype("<f8").tobytes(), 6)
        chunk_head = _HEAD.pack(_MAGIC, len(rows), len(packed), digest_of_chunk)
        self._put(chunk_head + packed)

    def _put(self, data: bytes) -> None:
        if self._file is None:
            raise OutputError(f"{self._part} is closed")
        try:
            self._file.write(data)
            self._file.flush()  # passes the data to the system, so that a crash of this process loses nothing
        except OSError as error:
            raise OutputError(f"cannot write to {self._part}: {error.strerror or error}") from error


def read_session(path: Path) -> Session:
    """Read the session in a file; if the file ends too early, read all complete chunks.

    Raises:
        WorldError: the file is missing, damaged, not a `twin-session` file of version 1, too long, or has no complete
            chunk.
    """
    try:
        with path.open("rb") as file:
            line = file.readline(_LONGEST_HEAD)
            head_of_file = _head(path, line)
            chunks, truncation = _chunks(path, file, head_of_file)
    except OSError as error:
        raise WorldError(f"{path}: cannot be read: {error.strerror or error}") from error
    if not chunks:
        raise WorldError(f"{path}: the file has no complete chunk, so nothing can be replayed")
    return Session(head_of_file, tuple(chunks), truncation)


def _head(path: Path, line: bytes) -> Head:
    try:
        head_of_file = Head.model_validate_json(line)
    except ValidationError as error:
        where, what = first_mistake(error)
        raise WorldError(f"{path}: not a twin-session file of version 1: {where or 'first line'}: {what}") from None
    sizes_of_device = sizes(head_of_file.device)
    all_signals = sizes(head_of_file.world)
    if len(sizes_of_device) < len(head_of_file.device) or len(all_signals) < len(head_of_file.world):
        raise WorldError(f"{path}: two signals have the same name")
    for name, size in sizes_of_device.items():
        if all_signals.get(name) != size:
            raise WorldError(f"{path}: signal '{name}' of the device is not among the signals of the World")
    numbers = sum(all_signals.values())
    if numbers > _MOST_NUMBERS:
        raise WorldError(f"{path}: a row has {numbers} numbers (limit {_MOST_NUMBERS})")
    return head_of_file


def _chunks(path: Path, file: BinaryIO, start: Head) -> tuple[list[Chunk], str]:
    """Read the chunks; return them, and a sentence that states where the file ends too early, "" if it is complete."""
    device_width = sum(sizes(start.device).values())
    row_width = sum(sizes(start.world).values())
    chunks: list[Chunk] = []
    digests = hashlib.sha256()
    ticks = 0
    unpacked = 0
    while True:
        position = f"after {ticks * start.dt:.3f} s"
        chunk_head = file.read(_HEAD.size)
        if len(chunk_head) < _HEAD.size:
            return chunks, f"it ends {position} without its end mark: the recording was interrupted"
        magic, count, length, digest_of_chunk = _HEAD.unpack(chunk_head)
        if magic == _END:
            if count != ticks or digest_of_chunk != digests.digest() or file.read(1):
                raise WorldError(
                    f"{path}: the end mark does not match the {ticks} ticks in the file: the file was changed"
                )
            return chunks, ""
        size = 8 * (count * device_width + row_width)
        unpacked += size
        longest = size + size // 100 + 1000  # numbers that zlib cannot compress become slightly longer
        if magic != _MAGIC or not 0 < count <= CHUNK or length > longest:
            raise WorldError(f"{path}: damaged {position}: there is no valid chunk")
        if unpacked > LARGEST:
            raise WorldError(f"{path}: the session has more than {LARGEST:,} unpacked bytes, the limit for a session")
        packed = file.read(length)
        if len(packed) < length:
            return chunks, f"it ends {position}, within a chunk: the recording was interrupted"
        ticks += count
        if ticks * start.dt > LONGEST + CHUNK * start.dt:
            raise WorldError(f"{path}: the session is longer than {LONGEST:g} s, the maximum duration of a session")
        numbers = _unpacked(packed, size, f"{path}: damaged {position}")
        digests.update(digest_of_chunk)
        device = numbers[: count * device_width].reshape(count, device_width)
        chunks.append(Chunk(device, numbers[count * device_width :], digest_of_chunk))


def _unpacked(packed: bytes, size: int, damaged: str) -> Array:
    """Return the numbers in a chunk of `size` unpacked bytes; `damaged`: begin of the message of an error."""
    unpacker = zlib.decompressobj()
    try:
        body = unpacker.decompress(packed, size + 1)  # one byte more, so that a longer chunk is noticed
    except zlib.error as error:
        raise WorldError(f"{damaged}: {error}") from None
    if len(body) != size or not unpacker.eof:
        raise WorldError(f"{damaged}: a chunk has {len(body)} bytes; expected {size}")
    numbers = np.frombuffer(body, "<f8").astype(float)
    if not np.isfinite(numbers).all():
        raise WorldError(f"{damaged}: a number is not finite")
    return numbers
