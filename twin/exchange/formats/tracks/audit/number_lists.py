"""Read the lists of numbers in a track, and name the place at which there is something else."""

from __future__ import annotations

import json

import numpy as np

from twin.core.json_types import JsonObject
from twin.exchange.audit.ledger import Ledger, ReadError
from twin.exchange.audit.poses import Array

_SHOWN_CHARACTERS = 40
"""Maximum number of characters of a wrong value in a message."""


def flat_numbers(data: JsonObject, key: str) -> Array:
    """Return the entry `key` of a track, a flat list of k numbers, as an array (k,); a missing entry is empty.

    Raises:
        ReadError: the entry is not a flat list of numbers; the message names the place and the value.
    """
    numbers = entry_numbers(data, key)
    if numbers.ndim != 1:
        raise ReadError(_nested_text(key))
    return numbers


def entry_numbers(data: JsonObject, key: str) -> Array:
    """Return the entry `key` of a track, a list of numbers or of such lists, as an array; a missing entry is empty.

    The numbers may be NaN or infinite, see `report_not_finite`.

    Raises:
        ReadError: the entry contains something else; the message names the place and the value.
    """
    value = data.get(key)
    if value is None:
        return np.zeros(0)
    if isinstance(value, np.ndarray):  # of a CSV, whose numbers were read as such
        return np.asarray(value, float)
    # NumPy would convert "0.5", null and true to numbers, which other readers refuse or read as 0.
    if not isinstance(value, list) or not _has_only_numbers(value):
        raise ReadError(_fault(key, value))
    try:
        return np.array(value, float)
    except (ValueError, OverflowError) as error:  # lists of different lengths, an integer beyond a double
        raise ReadError(_fault(key, value)) from error


def report_not_finite(numbers: Array, key: str, ledger: Ledger) -> None:
    """Report an entry `key` of a track whose numbers are not all finite."""
    if not np.all(np.isfinite(numbers)):
        ledger.wrong("tracks.finite", f"{key} contains numbers that are not finite.", key)


def _has_only_numbers(value: list) -> bool:
    """Return whether a list, and each list in it, contains only numbers: no text, null, true or false."""
    unvisited = [value]
    while unvisited:
        entries = unvisited.pop()
        types = set(map(type, entries))  # one pass in C: a track has up to millions of numbers
        if not types <= {int, float, list}:
            return False
        if list in types:
            unvisited += [entry for entry in entries if isinstance(entry, list)]
    return True


def _fault(key: str, value: object) -> str:
    """Return a text on the first entry of a value that is not a number."""
    if isinstance(value, list):
        for place, entry in enumerate(value):
            if isinstance(entry, list):
                return _nested_text(key)
            if isinstance(entry, bool) or not isinstance(entry, int | float):
                return f"'{key}' is not a flat list of numbers: entry {place} is {_shown(entry)}, expected a number"
    return f"'{key}' is {_shown(value)}, expected a flat list of numbers"


def _nested_text(key: str) -> str:
    return f"'{key}' is not a flat list: Unity's parser (JsonUtility) reads no nested lists"


def _shown(entry: object) -> str:
    """Return the first characters of a value, in quotes; null, true and false as the file spells them."""
    text = str(entry)
    if entry is None or isinstance(entry, bool):
        text = json.dumps(entry)
    return repr(text[:_SHOWN_CHARACTERS])
