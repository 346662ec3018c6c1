"""Unit factors: multiply to get SI, divide to leave it. SI is used everywhere inside."""

from math import floor, log10, pi

MM = 1e-3
UM = 1e-6
DEG = pi / 180

LENGTH = {"m": 1.0, "cm": 1e-2, "mm": MM, "um": UM, "in": 0.0254}
"""Length units that a CAD mesh may declare, in metres."""


def decimals(difference: float) -> int:
    """Return how many decimals show a difference with three digits: three at least, nine at most."""
    return min(max(2 - floor(log10(abs(difference))), 3), 9) if difference else 3
