"""Compare the JSON Schema beside tracks with the schema that twin has."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

from twin.exchange.audit.ledger import Ledger
from twin.schema import json_schema
from twin.schema.track import Track

NAME = "track.schema.json"
"""Name of the file."""


def check_schema(folder: Path, ledger: Ledger) -> None:
    """Report the entries in which the schema in a folder, if there is one, differs from that of twin.

    Other programs read tracks by this file: a wrong entry makes them refuse a right track, or take a wrong one.
    """
    file = folder / NAME
    if not file.is_file():
        return
    try:
        stated = json.loads(file.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, ValueError, RecursionError) as error:
        ledger.wrong("tracks.schema", f"{NAME} cannot be read: {str(error)[:100]}.", NAME)
        return
    differences = list(_differences("", stated, json_schema(Track)))
    ledger.row(f"entries of {NAME}", float(len(differences)), "differ", 0.0, where=NAME)
    if differences:
        text = f"{NAME} differs from the schema of twin: {differences[0]}"
        if len(differences) > 1:
            text += f", and {len(differences) - 1} more"
        ledger.wrong("tracks.schema", f"{text}.", NAME, suggestion="export the tracks again")


def _differences(place: str, stated: object, expected: object) -> Iterator[str]:
    """Yield texts on the entries in which JSON data `stated` differ from `expected`."""
    if isinstance(stated, dict) and isinstance(expected, dict):
        for key in dict.fromkeys((*expected, *stated)):
            inner = f"{place}/{key}"
            if key not in stated:
                yield f"'{inner}' is missing"
            elif key not in expected:
                yield f"'{inner}' is not in it"
            else:
                yield from _differences(inner, stated[key], expected[key])
    # In Python, True equals 1; in JSON Schema, `true` and 1 are different.
    elif stated != expected or isinstance(stated, bool) != isinstance(expected, bool):
        yield f"'{place}' is {str(stated)[:40]!r}, not {str(expected)[:40]!r}"
