"""Numbers and colours as MJCF and URDF write them."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from xml.etree import ElementTree as ET

from twin.core import units

DECIMALS = 12
"""Of m and of rad: the last bits of a processor do not reach the file."""


def numbers(values: Iterable[float]) -> str:
    """Return numbers with spaces between, rounded to `DECIMALS`."""
    return " ".join(f"{round(float(v), DECIMALS) + 0.0:.{DECIMALS}g}" for v in values)


def srgb(color_rgba: tuple[float, float, float, float]) -> str:
    """Return a linear colour as the display values that viewers of these formats show unchanged."""
    return " ".join(f"{v:.4g}" for v in (*map(units.srgb, color_rgba[:3]), color_rgba[3]))


def write_xml(root: ET.Element, path: Path) -> Path:
    """Write an XML file with one element a line, and return its path."""
    ET.indent(root)
    path.write_text('<?xml version="1.0"?>\n' + ET.tostring(root, encoding="unicode") + "\n", "utf-8", newline="\n")
    return path
