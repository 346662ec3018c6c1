"""Values with their units, and numbers that differ, as the messages of an audit state them."""

from __future__ import annotations


def quantity(value: float, unit: str, digits: int = 4) -> str:
    """Return a value with its unit as text, such as "1.5 mm"; values in m are converted to um, mm or m."""
    if unit == "m" and abs(value) < 1e-3:
        value *= 1e6
        unit = "um"
    elif unit == "m" and abs(value) < 1.0:
        value *= 1e3
        unit = "mm"
    return f"{value:.{digits}g} {unit}"


def distinguishable(a: float, b: float) -> tuple[str, str]:
    """Return two numbers as text with enough digits, at least four, to show that they differ."""
    digits = 4
    while digits < 16 and f"{a:.{digits}g}" == f"{b:.{digits}g}":
        digits += 1
    return f"{a:.{digits}g}", f"{b:.{digits}g}"
