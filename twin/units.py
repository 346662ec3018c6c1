"""Unit factors: multiply to get SI, divide to leave it. SI is used everywhere inside."""

from math import pi

MM = 1e-3
UM = 1e-6
DEG = pi / 180

LENGTH = {"m": 1.0, "cm": 1e-2, "mm": MM, "um": UM, "in": 0.0254}
"""Length units that a CAD mesh may declare, in metres."""
