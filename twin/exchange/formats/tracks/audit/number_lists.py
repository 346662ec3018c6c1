"""Read the lists of numbers in a track, and name the place at which there is something else."""

from __future__ import annotations

import numpy as np

from twin.core.json_types import JsonObject
from twin.exchange.audit.poses import Array
from twin.exchange.audit.report import ReadError


def flat_numbers(data: JsonObject, key: str) -> Array:
    """Return the entry `key` of a track, a flat list of k numbers, as an array (k,); a missing entry is empty.

    Raises:
        ReadError: the entry is not a flat list of numbers; the message names the place and the value.
    """
    numbers = entry_numbers(data, key)
    if numbers.ndim != 1:
        raise ReadError(f"'{key}' is not a flat list: Unity's parser (JsonUtility) reads no nested lists")
    return numbers


def entry_numbers(data: JsonObject, key: str) -> Array:
    """Return the entry `key` of a track, a list of numbers or of such lists, as an array; a missing entry is empty.

    Raises:
        ReadError: the entry contains something else; the message names the place and the value.
    """
    value = data.get(key)
    if value is None:
        return np.zeros(0)
    try:
        numbers = np.array(value)
        # NumPy would convert a text such as "0.5", which other readers refuse or read as 0.
        if numbers.dtype.kind in "US":
            raise ValueError("an entry is a text")
        numbers = numbers.astype(float)
    except (TypeError, ValueError, OverflowError) as error:
        raise ReadError(_fault(key, value)) from error
    return numbers


def _fault(key: str, value: object) -> str:
    """Return a text on the first entry of a value that is not a number."""
    if isinstance(value, list):
        for place, entry in enumerate(value):
            if isinstance(entry, list):
                return f"'{key}' is not a flat list: Unity's parser (JsonUtility) reads no nested lists"
            if not isinstance(entry, int | float):
                return f"'{key}' is not a flat list of numbers: entry {place} is {str(entry)[:40]!r}, expected a number"
    return f"'{key}' is {str(value)[:40]!r}, expected a flat list of numbers"
