"""Whether a line of a xacro states the number that an edit names: a macro is used several times, or has expressions."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from twin.comparison.compared_items import NumberEdit
from twin.comparison.side import RobotSide

_EXPRESSION = re.compile(r"\$\{[^}]*\}|\$\([^)]*\)")
"""An expression of a xacro: "${...}", or "$(...)"."""

_INDEX = re.compile(r"\[(\d+)\]$")
"""Index of the edited number among those of its attribute, at the end of the name of a number: "origin xyz[2]"."""

_ROUNDING_RATIO = 1e-11
"""Relative difference of two texts of one number: the old text of an edit has twelve digits."""


def with_obstacle(side: RobotSide, edit: NumberEdit, file: str) -> NumberEdit:
    """Return an edit of an expanded xacro without its new number if its line in `file` does not state the number."""
    if side.text is None:
        return edit
    reason = obstacle(side.xacro_places, file, edit.line, edit.what, edit.old)
    if not reason:
        return edit
    return replace(edit, new="", confirmed=False, obstacle=reason)


def obstacle(places: Mapping[str, tuple[str, int]], file: str, line: int, what: str, old: str) -> str:
    """Return why an edit of the numbers `old` in a line of a xacro does not do what it does in the expanded text.

    "" if the line states these numbers, for one element.

    Args:
        places: (file, line) in the xacro of each element of the expanded text, by kind, name and, for an element inside
            another, inner element: "joint/shoulder", "joint/shoulder/origin".
        file: the xacro file.
        line: number of the edited line.
        what: ends with element and attribute, and the index of the first of the numbers `old` if it is not 0, as
            "origin xyz[2]".
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
    index = 0
    match = _INDEX.search(what)
    if match is not None:
        index = int(match.group(1))
    text = _attribute_text(text, _INDEX.sub("", what))
    # An expression becomes a word that is not a number, also where digits or a sign stand beside it, as in "1${a}".
    if _holds_numbers(_EXPRESSION.sub("$", text), old.split(), index):
        return ""
    if _EXPRESSION.search(text):
        return f"line {line} holds an expression"
    return f"line {line} does not state it"


def _attribute_text(text: str, name: str) -> str:
    """Return the value of the attribute in a line; "" if the line does not have it.

    `name` ends with element and attribute, as "origin xyz".
    """
    words = name.split()
    if len(words) < 2:  # a number of the robot itself, of which no place is known
        return ""
    element = re.escape(words[-2])
    attribute = re.escape(words[-1])
    value = rf"\s{attribute}\s*=\s*([\"'])(.*?)\1"
    match = re.search(rf"<{element}\b[^<>]*?{value}", text)
    if match is None:
        # The element can begin in a line before: then the attribute stands before any other element of this line.
        end_of_element, _, _ = text.partition("<")
        match = re.search(value, f" {end_of_element}")
    if match is None:
        return ""
    return match.group(2)


def _holds_numbers(text: str, numbers: list[str], index: int) -> bool:
    """Return whether a text has these numbers, one after another, from the word `index` on."""
    values: list[float | None] = []
    for word in re.split(r"[\s,]+", text.strip()):
        try:
            values.append(float(word))
        except ValueError:
            values.append(None)
    stated = list(map(float, numbers))
    window = values[index : index + len(stated)]
    return len(window) == len(stated) and _are_same(window, stated)


def _are_same(values: list[float | None], stated: list[float]) -> bool:
    """Return whether the words of a text, None for those that are no number, are these numbers."""
    for value, number in zip(values, stated, strict=True):
        if value is None or abs(value - number) > _ROUNDING_RATIO * abs(number):
            return False
    return True
