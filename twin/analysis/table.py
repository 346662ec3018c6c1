"""Store the results of a sweep on disk, one line for each evaluated design; a stopped sweep can be resumed."""

from __future__ import annotations

import csv
import hashlib
import json
import os
from dataclasses import asdict
from importlib import import_module
from pathlib import Path
from typing import Any

from twin.analysis.design import DesignJob
from twin.core.errors import TwinError
from twin.core.extras import require
from twin.core.json_types import JsonObject
from twin.core.spatial import Array


def key_of(job: DesignJob, designs: Array) -> str:
    """Return the SHA-256 hash of a job and its designs."""
    text = json.dumps([asdict(job), designs.tolist()], sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()


class SweepTable:
    """Results of a sweep, stored as `rows.csv` and `job.json` in a folder.

    `add` requires that the table is open as a context manager.

    Attributes:
        done: objectives of the designs evaluated so far, by design number.
    """

    def __init__(self, folder: Path, job: DesignJob, designs: Array, *, fresh: bool = False) -> None:
        """Open a folder, and read stored results of the same job.

        Raises:
            TwinError: the folder contains results of another job, or its job.json is damaged.
        """
        self.folder = folder
        self._job = job
        key = key_of(job, designs)
        folder.mkdir(parents=True, exist_ok=True)
        job_path = folder / "job.json"
        self._path = folder / "rows.csv"
        if job_path.is_file() and not fresh:
            try:
                stored = json.loads(job_path.read_text(encoding="utf-8"))["key"]
            except (ValueError, KeyError, TypeError) as error:
                raise TwinError(f"{job_path}: the file is damaged; give --fresh to start again") from error
            if stored != key:
                raise TwinError(
                    f"{folder}: the folder contains another sweep, or this one of a robot that has been edited since; "
                    "give another --out, or --fresh to start again"
                )
        else:
            self._path.unlink(missing_ok=True)
            text = json.dumps({"key": key, "job": asdict(job)}, indent=2)
            # Written beside and renamed: a stop while writing leaves no damaged job.json.
            part = job_path.with_suffix(".tmp")
            part.write_text(text + "\n", encoding="utf-8")
            part.replace(job_path)
        self.done = self._read()
        self._file = None

    def _read(self) -> dict[int, dict[str, float]]:
        """Return {design number: its objectives} of the stored results; what is damaged is left out."""
        rows: dict[int, dict[str, float]] = {}
        if not self._path.is_file():
            return rows
        content = self._path.read_bytes()
        complete_lines = content[
            : content.rfind(b"\n") + 1
        ]  # a truncated line is dropped, and its design is evaluated again
        if complete_lines != content:
            self._path.write_bytes(complete_lines)
        lines = complete_lines.decode("utf-8", "replace").splitlines()
        for line in csv.reader(lines):
            try:
                number, *objectives = line
                rows[int(number)] = dict(zip(self._job.objectives, map(float, objectives), strict=True))
            except ValueError:
                continue  # a damaged row: its design is evaluated again
        return rows

    def __enter__(self) -> SweepTable:
        self._file = self._path.open("a", encoding="utf-8", newline="")
        return self

    def add(self, number: int, judged: dict[str, float]) -> None:
        """Store the objectives of design `number`; when the function returns, they are on disk."""
        assert self._file is not None
        self.done[number] = judged
        values = [judged[name] for name in self._job.objectives]  # in the order in which `_read` expects them
        csv.writer(self._file, lineterminator="\n").writerow([number, *values])
        self._file.flush()
        os.fsync(self._file.fileno())

    def __exit__(self, *error: object) -> None:
        if self._file is not None:
            self._file.close()


def write(rows: list[JsonObject], folder: Path, *, parquet: bool = False) -> list[Path]:
    """Write sweep.csv, and sweep.parquet if requested; return their paths.

    Raises:
        TwinError: Parquet is requested, but pyarrow is not installed.
    """
    path = folder / "sweep.csv"
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, list(rows[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
    if not parquet:
        return [path]
    pa, pq = arrow()
    pq.write_table(pa.Table.from_pylist(rows), folder / "sweep.parquet")
    return [path, folder / "sweep.parquet"]


def arrow() -> tuple[Any, Any]:
    """Return pyarrow and its parquet module.

    Raises:
        TwinError: pyarrow is not installed.
    """
    return require("pyarrow", "--parquet"), import_module("pyarrow.parquet")
