"""Read text, tables and meshes as entries."""

from __future__ import annotations

import csv
import hashlib
from pathlib import Path

import numpy as np

from twin.exchange.audit.obj_file import read_obj
from twin.exchange.audit.reference_export.entries import Entry, numbered
from twin.exchange.audit.reference_export.json_entries import entry_of


def read_lines(path: Path) -> Entry:
    """Return the lines of a text, without space at their ends."""
    text = path.read_text(encoding="utf-8-sig")
    entries = []
    for line in text.rstrip().splitlines():
        entries.append(Entry("line", values={"text": line.rstrip()}))
    return Entry("file", entries=numbered(entries))


def read_table(path: Path) -> Entry:
    """Return a CSV with a header "# key: value" a line, as a CSV track has it, and a row of titles above its numbers.

    Raises:
        ValueError: a row has not the length of the titles, or a cell is not a number.
    """
    lines = path.read_text(encoding="utf-8-sig").splitlines()
    header: dict[str, str] = {}
    row_lines = []
    for line in lines:
        if line.startswith("#"):
            key, _, value = line.lstrip("# ").partition(":")
            header[key] = value.strip()
        elif line.strip():
            row_lines.append(line)
    rows = list(csv.reader(row_lines))
    entry = entry_of("file", "", header)
    if rows:
        titles = tuple(rows[0])
        entry.values["columns"] = titles
        cells = np.zeros((0, len(titles)))
        if len(rows) > 1:
            cells = np.array(rows[1:], float)
        for title, column in zip(titles, cells.T, strict=True):
            entry.values[f"column {title}"] = column
    return entry


def read_mesh(path: Path) -> Entry:
    """Return the corners (triangles, 3, 3) of the triangles of an OBJ file: no program that saves it changes these.

    Raises:
        ReadError: the file is not an OBJ.
    """
    points, triangles = read_obj(path)
    return Entry("file", values={"corners of the triangles": points[triangles]})


def read_bytes(path: Path) -> Entry:
    """Return the hash of a file of any other syntax."""
    return Entry("file", values={"sha256": hashlib.sha256(path.read_bytes()).hexdigest()})
