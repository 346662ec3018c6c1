"""Unit factors: multiplication converts to SI, division converts back. All internal values are in SI units."""

from collections.abc import Sequence
from math import floor, log10, pi

MM = 1e-3
UM = 1e-6
DEG = pi / 180
MS = 1e-3
"""A millisecond in s."""

ROUNDING = 1e-9
"""Largest excess over a limit, in m or rad, that counts as a rounding error; a path may end exactly at a limit."""

SI = {"mm": MM, "deg": DEG, "mm/s": MM, "deg/s": DEG, "mm/s2": MM, "deg/s2": DEG, "g": 1e-3, "kPa": 1e3, "N mm": MM}
SI |= {"N/mm": 1 / MM, "N s/mm": 1 / MM}
"""Factor from each unit to the coherent SI unit: 5 mm is 5 * SI["mm"] in m. A unit that is not listed has factor 1."""

LENGTH = {"m": 1.0, "cm": 1e-2, "mm": MM, "um": UM, "in": 0.0254}
"""{unit that a description may declare for a mesh file: size of the unit in m}."""


def display_unit(angle: bool) -> tuple[str, float]:
    """Return (name, size in SI) of the display unit: of degrees if `angle` is true, else of millimetres."""
    if angle:
        return "deg", DEG
    return "mm", MM


def srgb(linear: float) -> float:
    """Convert a linear colour component, 0..1, to sRGB, 0..1 (IEC 61966-2-1)."""
    component = _clipped(linear)
    if component <= 0.0031308:
        return 12.92 * component
    return 1.055 * component ** (1 / 2.4) - 0.055


def linear(encoded: float) -> float:
    """Convert an sRGB colour component, 0..1, to a linear one, 0..1: the inverse of `srgb`."""
    component = _clipped(encoded)
    if component <= 0.04045:
        return component / 12.92
    return ((component + 0.055) / 1.055) ** 2.4


def _clipped(component: float) -> float:
    return min(max(component, 0.0), 1.0)


def linear_rgba(color: str) -> tuple[float, float, float, float]:
    """Return the linear, opaque colour of an sRGB text such as "#20a040"."""
    red = linear(int(color[1:3], 16) / 255)
    green = linear(int(color[3:5], 16) / 255)
    blue = linear(int(color[5:7], 16) / 255)
    return red, green, blue, 1.0


def hex_digits(color_rgba: Sequence[float]) -> str:
    """Return a linear colour as sRGB hexadecimal digits, as on web pages; opacity is left out if it is 1."""
    components = list(map(srgb, color_rgba[:3]))
    if len(color_rgba) > 3 and color_rgba[3] < 1:
        components.append(color_rgba[3])
    digits = [f"{round(255 * _clipped(component)):02x}" for component in components]
    return "".join(digits)


def decimals(difference: float) -> int:
    """Return the number of decimals (3 to 9) at which a difference has three significant digits."""
    if not difference:
        return 3
    magnitude = floor(log10(abs(difference)))
    return min(max(2 - magnitude, 3), 9)
