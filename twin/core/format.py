"""Format SI values as text such as "12.3 nm", "45.78 mm" or "0.05°", for the viewer, plots and the command line."""

from __future__ import annotations

import math
from collections.abc import Iterable

from twin.core.units import DEG, MM, UM

NONE = "–"
"""Text for a missing number."""

EXACT = "exact"
"""Text for a difference that is a rounding error."""

EXACT_BELOW = 1e-9
"""Differences in m, rad or their rates below this value are rounding errors: texts say `EXACT`, JSON has the number."""

_SIZE_IN_SI = {"m": 1.0, "mm": MM, "um": UM, "rad": 1.0, "deg": DEG}
"""{unit of a length or an angle: its size in SI}."""

_LENGTH_UNITS = ((1.0, ""), (1e-3, "m"), (1e-6, "µ"), (1e-9, "n"), (1e-12, "p"))
"""(size in m, prefix) of the units of lengths, the largest first."""

_SMALLEST_UNIT = 1e-12
# below these values, a length in m or an angle in degrees counts as a rounding error
_ROUNDING_LENGTH = 1e-12
_ROUNDING_ANGLE = 1e-9
_METRES_FROM = 10.0  # length in m from which lengths are shown in m instead of mm
_ANGLE_POWER_BELOW = 1e-4  # angle in degrees below which angles are shown with a power of ten
_SMALLER_UNIT_BELOW = 1e-3  # number of mm or um below which a length is shown in a smaller unit
# below and from these values, numbers are shown with a power of ten
_POWER_BELOW = 1e-4
_POWER_FROM = 1e7
_SUPERSCRIPT = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
_NARROW_SPACE = "\u202f"  # never at the end of a line; without it, 10⁻⁷° reads as 10 to the power of -70
_UNIT_SIGNS = {"um": "µm", "deg": "°", "ohm": "Ω", "percent": "%"}


def quantity(value: float | None, unit: str, digits: int | None = None) -> str:
    """Return an SI value as text, in a unit that suits its size.

    Lengths, speeds and accelerations are converted to m, mm, µm, nm or pm, angles to degrees; lengths below 1 pm are
    shown as "< 1 pm". Other units stay unchanged. By default, values of at least 1 mm or 1 degree have four significant
    digits, smaller values three. None and NaN are shown as a dash.
    """
    if value is None or not math.isfinite(value):
        return _not_finite(value)
    base, _, per = unit.partition("/")
    if per:
        per = f"/{pretty_unit(per)}"
    if base == "m":
        return _length(value, per, digits)
    if base == "rad":
        return _angle(value / DEG, per, digits)
    return shown(value, unit, digits or 4)


def deviation(value: float | None, unit: str, limit: float | None = None) -> str:
    """Return a difference that should be 0 as text: `EXACT` if it is a rounding error, else as `quantity` or `shown`.

    `value` and `limit` are in `unit`. Only lengths, angles and their rates can be `EXACT`, and only within `limit`.
    """
    if is_exact(value, unit, limit):
        return EXACT
    base, _, _ = unit.partition("/")
    if base in ("m", "rad"):
        return quantity(value, unit)
    return shown(value, unit)


def is_exact(value: float | None, unit: str, limit: float | None = None) -> bool:
    """Return whether a difference (`value` in `unit`) is a rounding error: see `deviation`."""
    base, _, _ = unit.partition("/")
    if value is None or base not in _SIZE_IN_SI or not abs(value) * _SIZE_IN_SI[base] < EXACT_BELOW:  # false for NaN
        return False
    return limit is None or abs(value) <= limit


def shown(value: float | None, unit: str, digits: int = 4) -> str:
    """Return a number as text in its own unit: `shown(0.5, "um")` is "0.5 µm".

    Only lengths below 0.001 mm or 0.001 µm are converted to a smaller unit: `shown(0.0005, "um")` is "500 pm".
    """
    if value is None or not math.isfinite(value):
        return _not_finite(value)
    if 0 < abs(value) < _SMALLER_UNIT_BELOW:
        if unit == "mm":
            return quantity(value * 1e-3, "m", digits)
        if unit == "um":
            return quantity(value * 1e-6, "m", digits)
    if value == 0 or _POWER_BELOW <= abs(value) < _POWER_FROM:
        text = plain(value, digits)
    else:
        text = power(value, digits)
    sign = pretty_unit(unit)
    if sign.startswith("°"):
        return with_degrees(text, sign)
    if not sign:
        return text
    return f"{text} {sign}"


def pretty_unit(unit: str) -> str:
    """Return a unit as printed: "kg/m3" is "kg/m³", "um" is "µm", "deg/s2" is "°/s²"."""
    parts = [part.strip() for part in unit.split("/")]
    pretty = []
    for part in parts:
        name = part.rstrip("23")
        exponent = part[len(name) :].translate(_SUPERSCRIPT)
        pretty.append(_UNIT_SIGNS.get(name, name) + exponent)
    return "/".join(pretty)


def plain(value: float, digits: int) -> str:
    """Return a number as text with `digits` significant digits, without exponent and trailing zeros."""
    if value == 0:
        return "0"
    # rounded first: 9.996 with three digits has a digit more before the point than 9.99
    rounded = float(f"{value:.{digits}g}")
    magnitude = math.floor(math.log10(abs(rounded)))
    decimals = max(0, digits - 1 - magnitude)
    text = f"{rounded:.{decimals}f}"
    if "." in text:
        text = text.rstrip("0").rstrip(".")
    return text


def power(value: float, digits: int = 3) -> str:
    """Return a number as mantissa times a power of ten: "5.73×10⁻¹²"."""
    if value == 0:
        return "0"
    mantissa, exponent = f"{value:.{digits - 1}e}".split("e")
    if "." in mantissa:
        mantissa = mantissa.rstrip("0").rstrip(".")
    return f"{mantissa}×10{str(int(exponent)).translate(_SUPERSCRIPT)}"


def with_degrees(number: str, sign: str) -> str:
    """Return a number in degrees with the sign of its unit, "°" or that of a rate; a power of ten gets a space."""
    if number[-1:] in "⁰¹²³⁴⁵⁶⁷⁸⁹":
        return f"{number}{_NARROW_SPACE}{sign}"
    return f"{number}{sign}"


def ratio(value: float, limit: float | None) -> str:
    """Return value / limit as text: "1270×", "0.42×", "3×10⁻⁸"; a dash if there is no limit."""
    if not limit or not math.isfinite(value) or not math.isfinite(limit):
        return NONE
    quotient = value / limit
    if quotient == 0:
        return "0"
    if 0.01 <= abs(quotient) < 1e6:
        return f"{plain(quotient, 3)}×"
    return power(quotient, 2)


def seconds(t: float | None) -> str:
    """Return a time or duration in s as text, to the millisecond: "6.214 s", "75 s"."""
    if t is None:
        return NONE
    return shown(round(t, 3), "s", 7)


def point(p: Iterable[float] | None) -> str:
    """Return a position in m as text in mm: "(380.00, 280.00, 185.00) mm"."""
    if p is None:
        return NONE
    coordinates = [f"{coordinate * 1e3:.2f}" for coordinate in p]
    return f"({', '.join(coordinates)}) mm"


def count(n: int, singular: str, plural: str = "") -> str:
    """Return a count with its noun: "1 warning", "3 warnings", "12 001 samples"."""
    noun = plural or f"{singular}s"
    if n == 1:
        noun = singular
    return f"{n:,} {noun}".replace(",", "\u202f")


def _not_finite(value: float | None) -> str:
    """Return the text of a missing or infinite number."""
    if value is None or math.isnan(value):
        return NONE
    if value > 0:
        return "∞"
    return "-∞"


def _length(value: float, per: str, digits: int | None) -> str:
    """Return a length in m, or its rate with `per`, in a unit that suits its size."""
    if value == 0:
        return f"0 mm{per}"
    if abs(value) < _ROUNDING_LENGTH:
        return f"< 1 pm{per}"
    for factor, prefix in _LENGTH_UNITS:
        significant = digits or (4 if factor >= 1e-3 else 3)
        number = float(f"{value / factor:.{significant}g}")
        smallest = 1.0
        if factor == 1.0:
            smallest = _METRES_FROM
        if factor == _SMALLEST_UNIT:
            smallest = 0.0
        if abs(number) >= smallest:
            return f"{plain(number, significant)} {prefix}m{per}"
    raise AssertionError("the last step accepts every value")


def _angle(deg: float, per: str, digits: int | None) -> str:
    """Return an angle in degrees, or its rate with `per`."""
    size = abs(deg)
    if 0 < size < _ROUNDING_ANGLE:
        return with_degrees("< 10⁻⁹", f"°{per}")
    if 0 < size < _ANGLE_POWER_BELOW:
        return with_degrees(power(deg, digits or 3), f"°{per}")
    if not digits:
        digits = 4 if size >= 1 else 3
    return f"{plain(deg, digits)}°{per}"
