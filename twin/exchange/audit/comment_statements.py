"""What the comments of an exported XML file state of its links: URDF and MJCF have no element for it."""

from __future__ import annotations

import re
from pathlib import Path


def assumed_masses(path: Path) -> frozenset[str]:
    """Return the names of links whose mass is unknown, as a comment in the file states."""
    return _names_in_comments(r"the mass of ([^>]*?) is unknown", path)


def partly_shown(path: Path) -> frozenset[str]:
    """Return the names of links whose shapes do not show the whole link, as a comment in the file states."""
    return _names_in_comments(r"the shapes of ([^>]*?) are for display", path)


def _names_in_comments(sentence: str, path: Path) -> frozenset[str]:
    """Return the names, separated by commas, that the group of a regular expression finds in comments of a file."""
    names: set[str] = set()
    text = path.read_text("utf-8", errors="replace")
    for listed in re.findall(rf"<!--[^>]*?{sentence}", text):
        names.update(listed.split(", "))
    return frozenset(names)
