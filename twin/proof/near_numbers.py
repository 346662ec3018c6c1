"""Rounded numbers that were probably roots: 38.971143 mm is sqrt(3)/6 of 135 mm, to its last digit.

A proof takes a number as it is written. What is found here is said, and nothing is changed.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from fractions import Fraction

from twin.proof.constants import ROOTS

_MOST_DIGITS = 12
"""Significant digits that are read: more are rounding of double precision."""

_FEWEST_DECIMALS = 5
"""Decimals below which a number was chosen, and is near a root by chance."""

_SAME_DIGITS = 1e-14
"""Relative difference up to which two numbers have the same digits in double precision."""

_HALF_DIGIT = 0.5000001
"""Half of a last digit, with a margin for the rounding of the number itself."""

_LARGEST_OF_FRACTION = 12
"""Largest numerator and denominator of a fraction of a parameter, or of a number without a unit."""

_STEPS_PER_MM = 4
"""Steps in a millimetre: a length may be a multiple of one, multiplied by a root."""


def near_length(value: float, lengths: Mapping[str, float]) -> str:
    """Return a length in m as a root of a drawing, as "sqrt(3)/6 l_p = 38.97114317 mm"; "" if it is not near one.

    Args:
        value: the length; its digits are those of the number in mm.
        lengths: {parameter: length in m}, which is not 0, of which it may be a part.
    """
    millimetres = 1e3 * value
    tolerance = _half_of_last_digit(millimetres)
    if not tolerance:
        return ""
    # Parts of parameters first: they say where a number comes from.
    for name, length in lengths.items():
        part = _root_part(millimetres, 1e3 * length, tolerance)
        if part is None:
            continue
        text, exact = part
        if not _has_all_digits(exact, millimetres):
            return f"{text} {name} = {exact:.10g} mm"
    for radicand in ROOTS:
        root = math.sqrt(radicand)
        factor = round(millimetres / root * _STEPS_PER_MM) / _STEPS_PER_MM
        exact = factor * root
        is_near = abs(exact - millimetres) <= tolerance
        if factor and is_near and not _has_all_digits(exact, millimetres):
            return f"{factor:g} sqrt({radicand}) = {exact:.10g} mm"
    return ""


def near_number(value: float) -> str:
    """Return a number without a unit as a fraction of a root, as "sqrt(3)/2 = 0.8660254038"; "" if it is none."""
    tolerance = _half_of_last_digit(value)
    if not tolerance:
        return ""
    part = _root_part(value, 1.0, tolerance)
    if part is None:
        return ""
    text, exact = part
    if _has_all_digits(exact, value):
        return ""
    return f"{text} = {exact:.10g}"


def _has_all_digits(exact: float, value: float) -> bool:
    """Return whether a number has all digits of a root: then it is not rounded."""
    return abs(exact - value) <= _SAME_DIGITS * abs(value)


def _half_of_last_digit(value: float) -> float:
    """Return half of the last digit of a number as it was written; 0 if it has few decimals."""
    text = f"{value:.{_MOST_DIGITS}g}"
    _, _, decimals = text.partition(".")
    if "e" in text or len(decimals) < _FEWEST_DECIMALS:
        return 0.0
    return _HALF_DIGIT * 10.0 ** -len(decimals)


def _root_part(value: float, unit: float, tolerance: float) -> tuple[str, float] | None:
    """Return a value as a fraction of a root of a unit, as text ("sqrt(3)/6") and exactly; None if it is none."""
    for radicand in ROOTS:
        quotient = value / (unit * math.sqrt(radicand))
        fraction = Fraction(quotient).limit_denominator(_LARGEST_OF_FRACTION)
        if not fraction or abs(fraction.numerator) > _LARGEST_OF_FRACTION:
            continue
        exact = float(fraction) * unit * math.sqrt(radicand)
        if abs(exact - value) > tolerance:
            continue
        factor = f"{fraction.numerator} "
        if fraction.numerator == 1:
            factor = ""
        elif fraction.numerator == -1:
            factor = "-"
        below = ""
        if fraction.denominator != 1:
            below = f"/{fraction.denominator}"
        return f"{factor}sqrt({radicand}){below}", exact
    return None
