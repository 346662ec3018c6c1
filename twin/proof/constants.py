"""The exact number behind a rounded one: a decimal, or a fraction multiplied by the root of 2, 3 or 6."""

from __future__ import annotations

import math
from dataclasses import dataclass
from fractions import Fraction
from functools import cache

from twin.proof import field

ROOTS = (2, 3, 6)
"""Numbers whose roots appear in drawings: of squares, of equilateral triangles, and products of both."""

_MOST_WRITTEN_DIGITS = 12
"""A number with fewer significant digits was written as a decimal."""

_LARGEST_DENOMINATOR = 240
"""Largest denominator of a fraction that multiplies a root, or that is a part of a half turn or of a number."""

_STEPS_PER_METRE = 10**7
"""Steps in a metre of the decimals of a drawing: 0.1 micrometres."""

_ROUNDING = 4e-16
"""Rounding error of a number up to 1 that was computed with double precision, as 6e-17 for the cosine of 90 degrees."""


_ANGLE_ROUNDING = 4e-15
"""Relative rounding error of an angle that was computed with double precision, in multiples of 30 or 45 degrees."""

_COSINE_ROUNDING = 1e-14
"""Rounding error of cosine and sine of a rounded multiple of 30 or 45 degrees within a few turns."""


@dataclass(frozen=True)
class ExactNumber:
    """A sum of fractions multiplied by roots.

    Attributes:
        parts: (radicand, fraction) of each term, without fractions of 0; a fraction alone has the radicand 1.
    """

    parts: tuple[tuple[int, Fraction], ...]

    def __float__(self) -> float:
        terms = []
        for radicand, fraction in self.parts:
            terms.append(float(fraction) * math.sqrt(radicand))
        # rounded once, whatever the order of the parts
        return math.fsum(terms)

    @property
    def residue(self) -> int:
        """The number in the prime field."""
        total = 0
        for radicand, fraction in self.parts:
            total += field.residue(fraction) * _root(radicand, field.prime())
        return total % field.prime()

    @property
    def decimal(self) -> Fraction | None:
        """The number if it is a fraction; None if it has a root."""
        if not self.parts:
            return Fraction(0)
        if len(self.parts) == 1 and self.parts[0][0] == 1:
            return self.parts[0][1]
        return None

    @property
    def in_mm(self) -> str:
        """A length in m as text, in mm."""
        words = []
        for radicand, fraction in self.parts:
            word = _text(1000 * fraction)
            if radicand != 1:
                word += f" sqrt({radicand})"
            words.append(word)
        return " + ".join(words).replace("+ -", "- ") or "0"


def exact(fraction: Fraction | int, radicand: int = 1) -> ExactNumber:
    """Return a fraction multiplied by a root."""
    if not fraction:
        return ExactNumber(())
    return ExactNumber(((radicand, Fraction(fraction)),))


def both(first: ExactNumber, second: ExactNumber) -> ExactNumber:
    """Return the sum of two exact numbers."""
    totals: dict[int, Fraction] = {}
    for radicand, fraction in (*first.parts, *second.parts):
        totals[radicand] = totals.get(radicand, Fraction(0)) + fraction
    # sorted, so that equal numbers have equal parts
    parts = []
    for radicand, fraction in sorted(totals.items()):
        if fraction:
            parts.append((radicand, fraction))
    return ExactNumber(tuple(parts))


def _text(fraction: Fraction) -> str:
    """Return a fraction as a decimal if it is one, else as a quotient."""
    decimal_text = f"{float(fraction):.12g}"
    if Fraction(decimal_text) == fraction:
        return decimal_text
    return str(fraction)


@cache
def _root(radicand: int, prime: int) -> int:
    """Return a root in the field; that of 6 is the product of those of 2 and 3."""
    if radicand == 1:
        return 1
    if radicand == 6:
        return _root(2, prime) * _root(3, prime) % prime
    # the root that is itself a square, as `field.root` has it: a product of two is the root of the product
    return pow(radicand, (prime + 1) // 4, prime)


def exact_number(value: float) -> ExactNumber | None:
    """Return the exact form of a number in an equation; None if there is none.

    A decimal with few digits is meant as it is written. Other numbers were computed: fractions, multiples of roots.
    """
    if not math.isfinite(value):
        return None
    # a conversion of units may have rounded the decimal, as in 0.013000000000000001
    written = Fraction(f"{value:.{_MOST_WRITTEN_DIGITS - 1}g}")
    if abs(float(written) - value) <= _ROUNDING * abs(value):
        return exact(written)
    return recognised(value, _ROUNDING * max(1.0, abs(value)))


def recognised(value: float, tolerance: float) -> ExactNumber | None:
    """Return the fraction, or the fraction multiplied by a root, within a tolerance of a value; None: there is none."""
    for radicand in (1, *ROOTS):
        quotient = value / math.sqrt(radicand)
        fraction = Fraction(quotient).limit_denominator(_LARGEST_DENOMINATOR)
        if abs(float(fraction) - quotient) <= tolerance:
            return exact(fraction, radicand)
    return None


def decimal(value: float, tolerance: float) -> ExactNumber | None:
    """Return a length in m as a decimal of a drawing, or as one multiplied by a root; None if there is none."""
    if not math.isfinite(value):
        return None
    for radicand in (1, *ROOTS):
        root = math.sqrt(radicand)
        count = round(value / root * _STEPS_PER_METRE)
        if abs(count / _STEPS_PER_METRE * root - value) <= tolerance:
            return exact(Fraction(count, _STEPS_PER_METRE), radicand)
    return None


def exact_angle(value: float, tolerance: float = _ANGLE_ROUNDING) -> tuple[ExactNumber, ExactNumber] | None:
    """Return cosine and sine of an angle in rad that is a multiple of 30 or of 45 degrees; None for other angles."""
    if not math.isfinite(value):
        return None
    for part in (6, 4):  # 30 degrees are a sixth of a half turn, 45 degrees a fourth
        parts = value / (math.pi / part)
        if abs(parts - round(parts)) > tolerance * max(1.0, abs(parts)):
            continue
        angle = round(parts) * math.pi / part
        cosine = recognised(math.cos(angle), _COSINE_ROUNDING)
        sine = recognised(math.sin(angle), _COSINE_ROUNDING)
        if cosine is not None and sine is not None:
            return cosine, sine
    return None
