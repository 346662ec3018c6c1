"""A number with its unit, as used in JSON and messages."""

from __future__ import annotations

from dataclasses import dataclass

from twin.core import format
from twin.core.units import DEG, MM, UM

_METRES_FROM = 1e4
"""Length in mm from which lengths are shown in m."""


@dataclass(frozen=True)
class Quantity:
    """A value and its unit. JSON keeps this unit; `str` converts the value to a unit that suits its size ("12.3 nm").

    `mm`, `um`, `deg`, `moved` and `si` create quantities from SI values.
    """

    value: float
    unit: str = ""

    def __str__(self) -> str:
        value = float(self.value)
        if self.unit.startswith("mm") and abs(value) >= _METRES_FROM:
            return format.quantity(value * MM, self.unit[1:])
        if self.unit == "m":
            return format.quantity(value, "m")
        return format.shown(value, "" if self.unit == "1" else self.unit)


def mm(metres: float) -> Quantity:
    """Return a length, given in m, as a quantity in mm."""
    return Quantity(metres / MM, "mm")


def um(metres: float) -> Quantity:
    """Return a length, given in m, as a quantity in µm."""
    return Quantity(metres / UM, "um")


def deg(radians: float) -> Quantity:
    """Return an angle, given in rad, as a quantity in degrees."""
    return Quantity(radians / DEG, "deg")


def moved(value: float, angle: bool, per: str = "") -> Quantity:
    """Return a length (m) or an angle (rad) as a quantity in mm or degrees; for rates, `per` is "/s" or "/s2"."""
    if angle:
        return Quantity(value / DEG, f"deg{per}")
    return Quantity(value / MM, f"mm{per}")


def si(value: float, unit: str) -> Quantity:
    """Return a value in an SI unit as a quantity.

    From "m", "rad", "m/s", "rad/s2", ..., the quantity is in mm or degrees, or a rate of these. Other units are kept;
    "1", that of a number without a unit, becomes "".
    """
    base, slash, per = unit.partition("/")
    if base in ("m", "rad"):
        return moved(value, base == "rad", slash + per)
    if unit == "1":
        return Quantity(value)
    return Quantity(value, unit)
