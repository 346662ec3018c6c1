"""Tracks in lists of formats."""

from __future__ import annotations

import json
from pathlib import Path

from twin.core.foreign.budget import BUDGETS
from twin.exchange.format import Format, FormatVariant, Holds, Places

_SCHEMA = "twin-track"


def is_track(file: Path) -> bool:
    """Return whether a JSON or CSV file is a track: it names the schema."""
    try:
        return _is_table(file) if file.suffix.lower() == ".csv" else _is_object(file)
    except OSError:
        return False


def _is_object(file: Path) -> bool:
    """Return whether the entry `schema` of a JSON file, wherever it stands, is that of a track.

    A file that names the schema, but is not JSON, is a damaged track.
    """
    # track.schema.json, which an export has beside its tracks, names the schema too, and has no motion.
    if file.name.endswith(".schema.json"):
        return False
    data = file.read_bytes()
    # A search of bytes first: to parse every large JSON file of other programs in a folder would take long.
    if f'"{_SCHEMA}"'.encode() not in data:
        return False
    try:
        content = json.loads(data)
    except (ValueError, RecursionError):
        return True
    return isinstance(content, dict) and content.get("schema") == _SCHEMA


def _is_table(file: Path) -> bool:
    """Return whether one of the lines `# name: value` at the start of a CSV file names the schema."""
    with file.open("rb") as lines:
        for line in lines:
            if not line.startswith(b"#"):
                return False
            if _SCHEMA.encode() in line:
                return True
    return False


FORMAT = Format(
    name="tracks",
    title="tracks",
    places=Places(export=50, use=50, audit=10),
    variants=(
        FormatVariant("tracks", ".json", "JSON", BUDGETS["JSON"], rank=10, trust=30),
        FormatVariant("csv", ".csv", "CSV", BUDGETS["CSV"], rank=40, trust=50),
    ),
    recognise=is_track,
    holds=Holds.LINKS | Holds.ONE_MOTION | Holds.COORDINATES,
    code="tracks",
    use="- Other programs: tracks/*.csv opens in a spreadsheet, tracks/*.json follows track.schema.json.",
)
