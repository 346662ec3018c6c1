"""Rename links and joints where the names of a file differ from those of the robot."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import TypeVar

_Value = TypeVar("_Value")


def renamed(names: Collection[str], new_names: Mapping[str, str]) -> tuple[str, ...]:
    """Return names after renaming by {old: new}; other names stay."""
    return tuple(new_names.get(name, name) for name in names)


def with_new_keys(values: Mapping[str, _Value], new_names: Mapping[str, str]) -> dict[str, _Value]:
    """Return values by name after renaming by {old: new}; other names stay."""
    renamed_values = {}
    for name, value in values.items():
        renamed_values[new_names.get(name, name)] = value
    return renamed_values
