"""Read JSON as entries."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from twin.exchange.audit.reference_export.entries import Entry, numbered


def read_json(path: Path) -> Entry:
    """Return the content of a JSON file.

    Raises:
        ValueError: the file is not JSON.
    """
    return entry_of("file", "", json.loads(path.read_text(encoding="utf-8-sig")))


def entry_of(kind: str, name: str, content: Any) -> Entry:
    """Return parsed JSON as an entry: objects, and lists of objects, become entries inside it, all else values."""
    entry = Entry(kind, name, is_ordered=True)
    if not isinstance(content, dict):
        content = {"content": content}
    for key, value in content.items():
        if isinstance(value, dict):
            entry.entries.append(entry_of(key, "", value))
        elif isinstance(value, list) and any(isinstance(element, dict) for element in value):
            for element in value:
                entry.entries.append(entry_of(key, _name(element), element))
        else:
            entry.values[key] = plain(value)
    entry.entries = numbered(entry.entries)
    return entry


def _name(element: Any) -> str:
    """Return the name of an object in a list; "" if it has none."""
    if isinstance(element, dict):
        for key in ("name", "id", "file"):
            if isinstance(element.get(key), str):
                return element[key]
    return ""


def plain(value: Any) -> Any:
    """Return a value without objects as `Entry.values` has it."""
    if isinstance(value, bool) or value is None or isinstance(value, str):
        return value
    if isinstance(value, int | float):
        return np.array(value, float)
    if not value:
        return ()
    if all(isinstance(element, str) for element in value):
        return tuple(value)
    if _are_numbers(value):
        try:
            return np.array(value, float)
        except ValueError:  # rows of different lengths
            pass
    return json.dumps(value)


def _are_numbers(value: Any) -> bool:
    """Return whether a value is a number, or a list of numbers or such lists."""
    if isinstance(value, list):
        return all(_are_numbers(element) for element in value)
    return isinstance(value, int | float) and not isinstance(value, bool)
