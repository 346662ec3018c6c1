"""Convert the names in a robot file of any format to identifiers [a-z][a-z0-9_]*."""

from __future__ import annotations

import re
from collections.abc import Iterable


def identifier(name: str) -> str:
    """Return a name in lower case, with all characters except a to z, digits and _ replaced by _.

    Several such characters in a row become one _, and every _ at the beginning and at the end is removed. CamelCase is
    split by underscores, so that FrontLeftLeg and frontleftleg remain different. A name that does not begin with a
    letter then gets the prefix "n_"; a name of which nothing remains becomes "n".
    """
    # First the words are split: in lower case, no border between them is left.
    name = re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", name)
    name = re.sub(r"[^a-z0-9_]+", "_", name.lower()).strip("_")
    if not name:
        return "n"
    if not name[0].isalpha():
        return f"n_{name}"
    return name


def unique(names: Iterable[tuple[str, str]], reserved: Iterable[str] = ()) -> dict[str, str]:
    """Return a unique identifier for each key; equal identifiers are numbered in the given order (arm, arm_2, ...).

    `names` has (key, name) of each object; all keys, such as prim paths, must be different. No object gets one of the
    identifiers `reserved`.
    """
    identifiers: dict[str, str] = {}
    used_names = set(reserved)
    for key, name in names:
        base = identifier(name)
        free = base
        number = 2
        while free in used_names:
            free = f"{base}_{number}"
            number += 1
        used_names.add(free)
        identifiers[key] = free
    return identifiers
