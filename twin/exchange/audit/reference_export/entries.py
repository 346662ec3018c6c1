"""The content of a file as a tree of entries, in one form for all syntaxes."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

FEW = 8
"""Up to this count, all numbers of a list are quoted in messages."""

LONGEST_QUOTE = 80
"""Number of characters from which a quoted text is cut."""


@dataclass
class Entry:
    """An element of XML, an object of JSON, a specification of USD, a line of text.

    Attributes:
        kind: what it is, as messages call it, such as "joint".
        name: its name among the entries of the same kind beside it; "" if it has none.
        values: {key: value}, each a text, a truth value, None, an array of numbers (of any shape), or a tuple of texts.
        entries: the entries inside it.
        is_ordered: whether the order of named entries inside it says something; those without a name are told apart by
            their order only.
        number: position among the entries of the same kind, from 1, for messages about entries without a name; 0 if it
            is the only one.
    """

    kind: str
    name: str = ""
    values: dict[str, Any] = field(default_factory=dict)
    entries: list[Entry] = field(default_factory=list)
    is_ordered: bool = False
    number: int = 0

    @property
    def label(self) -> str:
        """The entry as messages call it: "joint 'q1'", "geom 3"."""
        if self.name:
            return f"{self.kind} '{self.name}'"
        if self.number:
            return f"{self.kind} {self.number}"
        return self.kind

    def count(self) -> int:
        """Return the number of entries: this one and all inside."""
        count = 1
        for entry in self.entries:
            count += entry.count()
        return count

    def fingerprint(self) -> str:
        """Return a text that is the same for entries that messages could not tell apart."""
        parts = [self.kind, self.name]
        for key in sorted(self.values):
            parts.append(f"{key}={quoted(self.values[key])}")
        for entry in self.entries:
            parts.append(entry.fingerprint())
        return "\n".join(parts)


def numbered(entries: Sequence[Entry]) -> list[Entry]:
    """Return entries after numbering those of one kind, and making names unique: the second "a" is "a, number 2"."""
    kind_counts = Counter(entry.kind for entry in entries)
    positions: Counter[str] = Counter()
    name_counts: Counter[tuple[str, str]] = Counter()
    for entry in entries:
        if kind_counts[entry.kind] > 1:
            positions[entry.kind] += 1
            entry.number = positions[entry.kind]
        if entry.name:
            key = (entry.kind, entry.name)
            name_counts[key] += 1
            if name_counts[key] > 1:
                entry.name = f"{entry.name}, number {name_counts[key]}"
    return list(entries)


def quoted(value: Any) -> str:
    """Return a value as messages quote it."""
    if isinstance(value, np.ndarray):
        numbers = value.ravel()
        if value.size == 1:
            return f"{numbers[0]:.9g}"
        if value.size <= FEW:
            return "(" + ", ".join(f"{number:.9g}" for number in numbers) + ")"
        return f"{shape(value)}, {numbers[0]:.9g} and so on"
    if isinstance(value, tuple):
        value = ", ".join(map(str, value))
    if not isinstance(value, str):
        return str(value)
    if len(value) > LONGEST_QUOTE:
        value = f"{value[: LONGEST_QUOTE - 1]}…"
    return f"'{value}'"


def shape(array: np.ndarray) -> str:
    """Return the shape of an array of numbers as text: "3 x 4 numbers"."""
    return f"{' x '.join(map(str, array.shape))} numbers"
