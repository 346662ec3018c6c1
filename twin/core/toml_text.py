"""Write values as TOML, with all digits of a double."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from typing import SupportsFloat

from twin.core.json_types import JsonMapping


def toml(value: object) -> str:
    """Return a truth value, text, number, list or inline table (mapping) as TOML; whole numbers too as floats.

    Keys whose value is None are omitted, because TOML has no null value.
    """
    # Before numbers: a bool is an int in Python, and would be written as 1.0.
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):  # a JSON string; TOML requires one more character to be escaped
        value = value.encode(errors="backslashreplace").decode()  # lone surrogates, of file names that are not UTF-8
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, Mapping):
        return f"{{ {', '.join(rows(value))} }}"
    if isinstance(value, Iterable):
        return f"[{', '.join(map(toml, value))}]"
    assert isinstance(value, SupportsFloat), "TOML has no such value"
    return repr(float(value) + 0.0)  # turns -0.0 into 0.0


def rows(values: JsonMapping) -> list[str]:
    """Return a line "key = value" for each value that is not None; keys are bare keys, which need no quotes."""
    lines = []
    for key, value in values.items():
        if value is not None:
            lines.append(f"{key} = {toml(value)}")
    return lines


def table(header: str, **values: object) -> list[str]:
    """Return the lines of a TOML section: an empty line, a header such as "[tool]", and values that are not None."""
    return ["", header, *rows(values)]


def one_line(text: str) -> str:
    """Return a text as one line without control characters, for a comment."""
    characters = []
    for character in text:
        if not character.isprintable():
            character = " "
        characters.append(character)
    return "".join(characters)
