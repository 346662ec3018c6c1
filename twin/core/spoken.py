"""Names of files as words in sentences."""

from __future__ import annotations

import re


def spoken(name: str) -> str:
    """Return a name as words, for texts and headings; in data, names are not changed.

    `cystic_duct` becomes "cystic duct", and `ring1` "ring 1".
    """
    return re.sub(r"(?<=[a-z])(?=\d+$)", " ", name.replace("_", " "))
