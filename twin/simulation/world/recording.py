"""Recording of a World, one row with all signals per tick, and its file format.

A `twin-world` file is one line of JSON (`RecordingHead`), followed by the rows as little-endian float64, row by row.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, ValidationError

from twin.core import assets
from twin.core.errors import WorldError, unknown
from twin.core.spatial import Array
from twin.schema import Table, first_mistake
from twin.simulation.world.signals import NAME, columns

_LONGEST_HEAD = 1_000_000
"""Maximum length of the first line in bytes."""

_Name = Annotated[str, Field(pattern=f"^{NAME}$")]


class SignalTable(Table):
    """A signal: its name and its number of values."""

    name: _Name
    size: Annotated[int, Field(ge=1)]


class RecordingHead(Table):
    """First line of a `twin-world` file. All values are SI; a row holds the signals at the end of its tick."""

    schema_: Annotated[Literal["twin-world"], Field(alias="schema")]
    version: Literal[1]
    dt: Annotated[
        float, Field(gt=0, description="duration of one tick in s; row k belongs to the tick that begins at k dt")
    ]
    ticks: Annotated[int, Field(ge=0, description="number of rows that follow")]
    signals: Annotated[list[SignalTable], Field(description="names of the signals, in the order of a row")]
    sha256: Annotated[str, Field(pattern="^[0-9a-f]{64}$", description="SHA-256 of the rows")]


@dataclass(frozen=True)
class Recording:
    """Signals over time.

    Attributes:
        dt: duration of one tick in s.
        sizes: {signal: number of values}, in the order of a row.
        rows: (k, m) one row per tick.
    """

    dt: float
    sizes: Mapping[str, int]
    rows: Array

    @property
    def t(self) -> Array:
        """Start of each tick (k,) in s."""
        return np.arange(len(self.rows), dtype=float) * self.dt

    def __getitem__(self, name: str) -> Array:
        """Return a signal (k, n) by name.

        Raises:
            WorldError: there is no such signal.
        """
        if name not in self.sizes:
            raise WorldError(unknown("signal", name, self.sizes))
        return self.rows[:, columns(self.sizes)[name]]

    def samples(self, names: Iterable[str]) -> Iterator[dict[str, Array]]:
        """Yield {signal: values (n,)} for each row, in order."""
        series = {name: self[name] for name in names}
        for k in range(len(self.rows)):
            sample = {}
            for name, values in series.items():
                sample[name] = values[k]
            yield sample

    def to_bytes(self) -> bytes:
        """Return the content of the file."""
        body = self.rows.astype("<f8").tobytes()
        signals = []
        for name, size in self.sizes.items():
            signals.append({"name": name, "size": size})
        head = {
            "schema": "twin-world",
            "version": 1,
            "dt": self.dt,
            "ticks": len(self.rows),
            "signals": signals,
            "sha256": hashlib.sha256(body).hexdigest(),
        }
        return json.dumps(head).encode() + b"\n" + body

    def write(self, path: Path) -> None:
        """Write the file atomically: a failure leaves no incomplete file.

        Raises:
            OutputError: the file cannot be written.
        """
        with assets.atomic_folder(path.parent) as work:
            (work / path.name).write_bytes(self.to_bytes())


def read_recording(path: Path) -> Recording:
    """Read the recording in a file.

    Raises:
        WorldError: the file is missing, truncated, changed since it was written, or not a `twin-world` file of version
            1.
    """
    try:
        with path.open("rb") as file:
            line = file.readline(_LONGEST_HEAD)
            remaining_bytes = os.fstat(file.fileno()).st_size - len(line)
            head = RecordingHead.model_validate_json(line)
            sizes = {}
            for signal in head.signals:
                sizes[signal.name] = signal.size
            width = sum(sizes.values())
            expected_bytes = 8 * head.ticks * width  # 8 bytes per value
            if len(sizes) < len(head.signals):
                raise WorldError(f"{path}: two signals have the same name")
            # The size is checked before the rows are read: a large file that is no recording needs no memory.
            if remaining_bytes != expected_bytes:
                raise WorldError(
                    f"{path}: {remaining_bytes} bytes of rows; expected {expected_bytes}: "
                    "the file is truncated or too long"
                )
            body = file.read()
    except OSError as error:
        raise WorldError(f"{path}: cannot be read: {error.strerror or error}") from error
    except ValidationError as error:
        where, what = first_mistake(error)
        raise WorldError(f"{path}: not a twin-world file of version 1: {where or 'first line'}: {what}") from None
    if hashlib.sha256(body).hexdigest() != head.sha256:
        raise WorldError(f"{path}: the rows of the file have changed since the file was written")
    rows = np.frombuffer(body, "<f8").reshape(head.ticks, width)
    return Recording(head.dt, sizes, rows.astype(float))
