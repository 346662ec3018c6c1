"""Unit factors: multiplication converts to SI, division converts back. All internal values are in SI units."""

from collections.abc import Sequence
from math import floor, log10, pi

MM = 1e-3
UM = 1e-6
DEG = pi / 180

ROUNDING = 1e-9
"""Largest excess over a limit, in m or rad, that counts as a rounding error; a path may end exactly at a limit."""

SI = {"mm": MM, "deg": DEG, "mm/s": MM, "deg/s": DEG, "mm/s2": MM, "deg/s2": DEG, "g": 1e-3, "kPa": 1e3, "N mm": MM}
SI |= {"N/mm": 1 / MM, "N s/mm": 1 / MM}
"""Factor from each unit to the coherent SI unit: 5 mm is 5 * SI["mm"] in m. A unit that is not listed has factor 1."""

LENGTH = {"m": 1.0, "cm": 1e-2, "mm": MM, "um": UM, "in": 0.0254}
"""{unit that a description may declare for a mesh file: size of the unit in m}."""


def display_unit(angle: bool) -> tuple[str, float]:
    """Return (name, size in SI) of the display unit: of degrees if `angle` is true, else of millimetres."""
    return ("deg", DEG) if angle else ("mm", MM)


def srgb(linear: float) -> float:
    """Convert a linear colour component, 0..1, to sRGB, 0..1 (IEC 61966-2-1)."""
    part = min(max(linear, 0.0), 1.0)
    return 12.92 * part if part <= 0.0031308 else 1.055 * part ** (1 / 2.4) - 0.055


def linear(shown: float) -> float:
    """Convert an sRGB colour component, 0..1, to a linear one, 0..1: the inverse of `srgb`."""
    part = min(max(shown, 0.0), 1.0)
    return part / 12.92 if part <= 0.04045 else ((part + 0.055) / 1.055) ** 2.4


def linear_rgba(color: str) -> tuple[float, float, float, float]:
    """Return the linear, opaque colour of an sRGB text such as "#20a040"."""
    red, green, blue = (linear(int(color[k : k + 2], 16) / 255) for k in (1, 3, 5))
    return red, green, blue, 1.0


def hex_digits(color_rgba: Sequence[float]) -> str:
    """Return a linear colour as sRGB hexadecimal digits, as on web pages; opacity is left out if it is 1."""
    parts = [*map(srgb, color_rgba[:3]), *(a for a in color_rgba[3:] if a < 1)]
    return "".join(f"{round(255 * min(max(part, 0.0), 1.0)):02x}" for part in parts)


def decimals(difference: float) -> int:
    """Return the number of decimals (3 to 9) at which a difference has three significant digits."""
    return min(max(2 - floor(log10(abs(difference))), 3), 9) if difference else 3
