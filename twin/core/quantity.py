"""A number with its unit, in the unit of JSON and messages."""

from __future__ import annotations

from dataclasses import dataclass

from twin.core import format
from twin.core.units import DEG, MM, UM

_LARGE = 1e4
"""Millimetres from which on a length is shown in m."""


@dataclass(frozen=True)
class Quantity:
    """A value and its unit, as in JSON; `str` gives both in a unit that suits the size ("12.3 nm").

    `mm`, `um`, `deg` and `moved` make one from SI values.
    """

    value: float
    unit: str = ""

    def __str__(self) -> str:
        value = float(self.value)
        if self.unit.startswith("mm") and abs(value) >= _LARGE:
            return format.quantity(value * MM, self.unit[1:])
        if self.unit == "m":
            return format.quantity(value, "m")
        return format.shown(value, "" if self.unit == "1" else self.unit)


def mm(metres: float) -> Quantity:
    """Return a length in m as mm."""
    return Quantity(metres / MM, "mm")


def um(metres: float) -> Quantity:
    """Return a length in m as µm."""
    return Quantity(metres / UM, "um")


def deg(radians: float) -> Quantity:
    """Return an angle in rad as degrees."""
    return Quantity(radians / DEG, "deg")


def moved(value: float, angle: bool, per: str = "") -> Quantity:
    """Return a length (m) or an angle (rad) as mm or degrees; `per`: "/s", "/s2" for its rates."""
    return Quantity(value / (DEG if angle else MM), ("deg" if angle else "mm") + per)


def si(value: float, unit: str) -> Quantity:
    """Return a value in "m", "rad" or a rate of them ("m/s") as mm or degrees."""
    base, slash, per = unit.partition("/")
    return moved(value, base == "rad", slash + per)
