"""The lines on which the elements of an XML file begin."""

from __future__ import annotations

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
    elements = list(root.iter())
    if len(elements) != len(lines):
        return {}
    return dict(zip(elements, lines, strict=True))
