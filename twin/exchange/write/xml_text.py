"""Text of XML files, and of the numbers and colours in MJCF and URDF."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from xml.etree import ElementTree as ET

from twin.core import units

DECIMALS = 12
"""Largest number of decimals, and of significant digits, of values in m and rad.

Rounding makes the file independent of the processor.
"""


def numbers(values: Iterable[float]) -> str:
    """Return numbers as text, separated by spaces, with at most `DECIMALS` decimals and significant digits."""
    words = []
    for value in values:
        shortened = round(float(value), DECIMALS) + 0.0  # adding 0.0 removes a negative zero
        words.append(f"{shortened:.{DECIMALS}g}")
    return " ".join(words)


def gains(values: Iterable[float]) -> str:
    """Return numbers that may be small, such as gains and efforts, as text with `DECIMALS` significant digits."""
    words = []
    for value in values:
        number = float(value) + 0.0
        words.append(f"{number:.{DECIMALS}g}")
    return " ".join(words)


def srgb(color_rgba: tuple[float, float, float, float]) -> str:
    """Return the display values (sRGB) of a linear colour as text; viewers of MJCF and URDF expect display values."""
    r, g, b, a = color_rgba
    return f"{units.srgb(r):.4g} {units.srgb(g):.4g} {units.srgb(b):.4g} {a:.4g}"


def xml_text(root: ET.Element) -> str:
    """Return an XML document as text, with one element per line."""
    ET.indent(root)
    return '<?xml version="1.0"?>\n' + ET.tostring(root, encoding="unicode") + "\n"


def write_xml(root: ET.Element, path: Path) -> Path:
    """Write an XML document with one element per line, and return its path."""
    path.write_text(xml_text(root), "utf-8", newline="\n")  # the same bytes on Windows
    return path
