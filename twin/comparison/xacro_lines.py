"""Whether a line of a xacro states the number that an edit names: a macro is used several times, or has expressions."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path

_EXPRESSION = re.compile(r"\$\{[^}]*\}|\$\([^)]*\)")
"""An expression of a xacro: "${...}", or "$(...)"."""

_ROUNDING = 1e-11
"""Relative difference of two texts of one number: the old text of an edit has twelve digits."""


def obstacle(places: Mapping[str, tuple[str, int]], file: str, line: int, what: str, old: str) -> str:
    """Return why an edit of the numbers `old` in a line of a xacro does not do what it does in the expanded text.

    "" if the line states these numbers, for one element.

    Args:
        places: (file, line) in the xacro of each element of the expanded text, by kind, name and, for an element inside
            another, inner element: "joint/shoulder", "joint/shoulder/origin".
        file: the xacro file.
        line: number of the edited line.
        what: ends with element and attribute, as "origin xyz[2]".
        old: the stated numbers, with spaces between them.
    """
    names: dict[tuple[str, str], set[str]] = {}
    for key, place in places.items():
        if place != (file, line):
            continue
        kind, _, path = key.partition("/")
        name, _, inner = path.partition("/")
        names.setdefault((kind, inner), set()).add(name)
    if not names:
        return "the line of the xacro that states it is unknown"
    element_count = max(map(len, names.values()))
    if element_count > 1:
        return f"line {line} is used by {element_count} elements"
    try:
        text = Path(file).read_text(encoding="utf-8").splitlines()[line - 1]
    except (OSError, UnicodeDecodeError, IndexError):
        return f"line {line} cannot be read"
    text = _attribute(text, what)
    if _states(_EXPRESSION.sub(" $ ", text), old.split()):
        return ""
    if _EXPRESSION.search(text):
        return f"line {line} holds an expression"
    return f"line {line} does not state it"


def _attribute(text: str, what: str) -> str:
    """Return the value of the attribute in a line; the whole line if it does not have the attribute."""
    name, _, _ = what.partition("[")
    words = name.split()
    if len(words) < 2:
        return text
    element = re.escape(words[-2])
    attribute = re.escape(words[-1])
    # an element can begin in a line before
    for pattern in (rf"<{element}\b[^<>]*?\s{attribute}", rf"\b{attribute}"):
        match = re.search(pattern + r"\s*=\s*([\"'])(.*?)\1", text)
        if match is not None:
            return match.group(2)
    return text


def _states(text: str, numbers: list[str]) -> bool:
    """Return whether a text has these numbers, one after another."""
    values: list[float | None] = []
    for word in re.split(r"[\s\"',]+", text):
        try:
            values.append(float(word))
        except ValueError:
            values.append(None)
    stated = list(map(float, numbers))
    has_stated = False
    for start in range(len(values) - len(stated) + 1):
        window = values[start : start + len(stated)]
        has_stated = has_stated or _are_same(window, stated)
    return has_stated


def _are_same(values: list[float | None], stated: list[float]) -> bool:
    """Return whether the words of a text, None for those that are no number, are these numbers."""
    for value, number in zip(values, stated, strict=True):
        if value is None or abs(value - number) > _ROUNDING * abs(number):
            return False
    return True
