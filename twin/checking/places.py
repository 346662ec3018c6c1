"""Where things are: the lines of the elements of an XML file, and paths as seen from a folder."""

from __future__ import annotations

import os
import re
from pathlib import Path
from xml.etree.ElementTree import Element
from xml.parsers import expat


def element_lines(data: bytes, root: Element) -> dict[Element, int]:
    """Return {element: line, from 1} for the tree `root` that was parsed from `data`; {} if they do not fit."""
    lines: list[int] = []
    parser = expat.ParserCreate()

    def begin(name: str, attributes: dict[str, str]) -> None:
        lines.append(parser.CurrentLineNumber)

    parser.StartElementHandler = begin
    try:
        parser.Parse(data, True)
    except (expat.ExpatError, ValueError):
        return {}
    # both in the order of the start tags
    elements = list(root.iter())
    if len(elements) != len(lines):
        return {}
    return dict(zip(elements, lines, strict=True))


def within(folder: Path, message: str) -> str:
    """Return a message with the paths of files in a folder relative to it, so that it is the same on each machine."""
    beginning = re.escape(f"{folder}{os.sep}")
    return re.sub(rf"(?<![\w.~/-])(?:file://)?{beginning}", "", message)


def repository_prefix(folder: Path) -> str:
    """Return the path of a folder in its repository, such as "robots/arms/"; "" for the repository itself.

    The repository is the nearest folder around it with an entry .git; without one, the current folder, if it contains
    the folder.
    """
    place = folder.resolve()
    for root in (place, *place.parents):
        if (root / ".git").exists():
            return _below(place, root)
    current_folder = Path.cwd()
    if place.is_relative_to(current_folder):
        return _below(place, current_folder)
    return ""


def _below(place: Path, root: Path) -> str:
    """Return the path of a folder below another one, with / at its end; "" for this folder itself."""
    if place == root:
        return ""
    return f"{place.relative_to(root).as_posix()}/"
