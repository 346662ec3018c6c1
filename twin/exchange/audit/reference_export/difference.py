"""Find where the content of a file differs from that of a reference."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from difflib import SequenceMatcher
from typing import Any

import numpy as np

from twin.exchange.audit.reference_export.entries import FEW, LONGEST_QUOTE, Entry, quoted, shape

_RELATIVE = 1e-6
"""Relative difference of two numbers that only rounding explains: single precision keeps seven digits."""

_OF_LARGEST = 1e-7
"""Difference of two numbers that only rounding explains, as a fraction of the largest number of the same list."""

_SMALLEST = 1e-15
"""Difference of two numbers that only rounding explains, in any unit: a sum that should be zero."""

_CONTEXT = 20
"""Number of characters that are quoted before the first that differs."""

_REFERENCE = "a new export"

Pair = tuple[Entry | None, Entry | None]
"""(entry of the reference, entry of the file); None: it has no counterpart."""


@dataclass(frozen=True)
class FieldDifference:
    """A place where a file differs from the reference.

    Attributes:
        form: "value", "missing", "extra" or "order".
        place: labels of the entries around it, the outermost first.
        pattern: the same for all places of one sort, "/joint/limit@upper" for a limit of any joint: the kinds of the
            entries around it, and the key of a value. What another program writes in its own way has few patterns and
            many places.
        text: the difference in words.
        entry: the entry that is missing or added; None if it is a value, or something else differs.
    """

    form: str
    place: str
    pattern: str
    text: str
    entry: Entry | None = None


def differences(
    reference: Entry, found: Entry, place: Sequence[str] = (), pattern: str = ""
) -> Iterator[FieldDifference]:
    """Yield the differences of an entry of a file from that of the reference, and of all entries inside.

    Args:
        reference: the expected entry.
        found: the entry of the file.
        place: labels of the entries around the two.
        pattern: kinds of the entries around the two.
    """
    where = ", ".join(place)
    for key in dict.fromkeys((*reference.values, *found.values)):
        key_pattern = f"{pattern}@{key}"
        if key not in found.values:
            text = f"'{key}' is missing; in {_REFERENCE} it is {quoted(reference.values[key])}"
            yield FieldDifference("missing", where, key_pattern, text)
        elif key not in reference.values:
            text = f"'{key}' is {quoted(found.values[key])}; {_REFERENCE} does not have it"
            yield FieldDifference("extra", where, key_pattern, text)
        else:
            change = _change(reference.values[key], found.values[key])
            if change:
                yield FieldDifference("value", where, key_pattern, f"'{key}' {change}")
    for kind in dict.fromkeys(entry.kind for entry in (*reference.entries, *found.entries)):
        expected_entries = [entry for entry in reference.entries if entry.kind == kind]
        found_entries = [entry for entry in found.entries if entry.kind == kind]
        yield from _of_kind(expected_entries, found_entries, place, f"{pattern}/{kind}")
        if reference.is_ordered:
            yield from _order(expected_entries, found_entries, where, f"{pattern}/{kind}")


def _of_kind(
    expected_entries: Sequence[Entry], found_entries: Sequence[Entry], place: Sequence[str], pattern: str
) -> Iterator[FieldDifference]:
    """Yield the differences of the entries of one kind in the same place."""
    where = ", ".join(place)
    for expected, found in _matched(expected_entries, found_entries):
        if found is None and expected is not None:
            yield FieldDifference(
                "missing", where, pattern, f"{expected.label} is missing, which {_REFERENCE} has", expected
            )
        elif expected is None and found is not None:
            yield FieldDifference("extra", where, pattern, f"{found.label} is not in {_REFERENCE}", found)
        elif expected is not None and found is not None:
            yield from differences(expected, found, (*place, found.label), pattern)


def _order(
    expected_entries: Sequence[Entry], found_entries: Sequence[Entry], where: str, pattern: str
) -> Iterator[FieldDifference]:
    """Yield a difference if the named entries that both have are in another order."""
    found_names = {entry.name for entry in found_entries}
    expected_names = [entry.name for entry in expected_entries if entry.name and entry.name in found_names]
    common_names = set(expected_names)
    own_order = [entry for entry in found_entries if entry.name in common_names]
    for expected_name, entry in zip(expected_names, own_order, strict=True):
        if entry.name != expected_name:
            text = f"{entry.label} stands where {_REFERENCE} has '{expected_name}'"
            yield FieldDifference("order", where, pattern, text)
            return


def _matched(expected: Sequence[Entry], found: Sequence[Entry]) -> list[Pair]:
    """Return the entries in pairs: by name, those without a name by position."""
    found_by_name = {entry.name: entry for entry in found if entry.name}
    pairs: list[Pair] = []
    for entry in expected:
        if entry.name:
            pairs.append((entry, found_by_name.pop(entry.name, None)))
    for entry in found_by_name.values():
        pairs.append((None, entry))
    unnamed_expected = [entry for entry in expected if not entry.name]
    unnamed_found = [entry for entry in found if not entry.name]
    return pairs + _aligned(unnamed_expected, unnamed_found)


def _aligned(expected: Sequence[Entry], found: Sequence[Entry]) -> list[Pair]:
    """Return entries without names in pairs by position or, if one has more, around the entries that are equal."""
    if len(expected) == len(found):
        return list(zip(expected, found, strict=True))
    expected_prints = [entry.fingerprint() for entry in expected]
    found_prints = [entry.fingerprint() for entry in found]
    matcher = SequenceMatcher(None, expected_prints, found_prints, autojunk=False)
    pairs: list[Pair] = []
    for _, i, i_end, j, j_end in matcher.get_opcodes():
        expected_run = list(expected[i:i_end])
        found_run = list(found[j:j_end])
        for k in range(max(len(expected_run), len(found_run))):
            entry = expected_run[k] if k < len(expected_run) else None
            own_entry = found_run[k] if k < len(found_run) else None
            pairs.append((entry, own_entry))
    return pairs


def _change(expected: Any, found: Any) -> str:
    """Return how a value differs from the expected one, as text; "" if only rounding explains the difference."""
    if isinstance(expected, np.ndarray) and isinstance(found, np.ndarray):
        if expected.shape == found.shape:
            return _change_of_numbers(expected, found)
        if expected.size > FEW or found.size > FEW:
            return f"has {shape(found)}; in {_REFERENCE} it has {shape(expected)}"
    elif type(expected) is type(found) and expected == found:
        return ""
    elif isinstance(expected, str) and isinstance(found, str):
        return _change_of_text(expected, found)
    return f"is {quoted(found)}; in {_REFERENCE} it is {quoted(expected)}"


def _change_of_text(expected: str, found: str) -> str:
    """Return how a text differs from the expected one, as text; of long texts, the part from which they differ."""
    start = 0
    if max(len(expected), len(found)) > LONGEST_QUOTE:
        common = 0
        while expected[: common + 1] == found[: common + 1]:
            common += 1
        start = max(common - _CONTEXT, 0)
    dots = ""
    if start:
        dots = "…"
    return f"is {quoted(dots + found[start:])}; in {_REFERENCE} it is {quoted(dots + expected[start:])}"


def _change_of_numbers(expected: np.ndarray, found: np.ndarray) -> str:
    """Return how an array of numbers differs from the expected one of the same shape, as text; "" for rounding."""
    are_finite = np.isfinite(expected) & np.isfinite(found)
    largest = np.abs(expected[are_finite]).max(initial=0.0)
    with np.errstate(invalid="ignore"):
        deviation = np.where(are_finite, np.abs(found - expected), np.inf)
        tolerance = _RELATIVE * np.abs(expected) + _OF_LARGEST * largest + _SMALLEST
    are_same = (expected == found) | (np.isnan(expected) & np.isnan(found))
    are_wrong = ~are_same & ~(are_finite & (deviation <= tolerance))
    count = int(are_wrong.sum())
    if not count:
        return ""
    if expected.size <= FEW:
        return f"is {quoted(found)}; in {_REFERENCE} it is {quoted(expected)}"
    worst = np.unravel_index(int(np.argmax(np.where(are_wrong, deviation, -1.0))), expected.shape)
    index = ", ".join(str(int(i)) for i in worst)
    return (
        f"differs in {count} of {expected.size} numbers, most at [{index}]: there it is {found[worst]:.9g}; in "
        f"{_REFERENCE} it is {expected[worst]:.9g}"
    )
