"""Exact arithmetic modulo a prime, for arrays.

Sums, products and quotients of whole numbers modulo a prime follow the rules of fractions. An identity between
fractions therefore holds modulo the prime as well; an expression that is not identically zero is zero at a random state
with a probability of at most its degree divided by the prime (J. T. Schwartz, J. ACM 27(4), 1980; R. Zippel, 1979).
"""

from __future__ import annotations

from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

Residues = NDArray[np.uint64]
"""Whole numbers from 0 to PRIME - 1."""

PRIME = 2147483543
"""The largest prime below 2^31 that leaves the remainder 23 when divided by 24: it has square roots of 2 and of 3, the
root of a square is a power, and a product of two residues fits into 64 bits."""

_MODULUS = np.uint64(PRIME)


def residue(number: Fraction | int) -> int:
    """Return the residue of a fraction; its denominator must not be a multiple of the prime."""
    fraction = Fraction(number)
    return fraction.numerator * pow(fraction.denominator, -1, PRIME) % PRIME


def add(a: Residues, b: Residues) -> Residues:
    """Return a + b."""
    return (a + b) % _MODULUS


def negative(a: Residues) -> Residues:
    """Return -a."""
    return (_MODULUS - a) % _MODULUS


def subtract(a: Residues, b: Residues) -> Residues:
    """Return a - b."""
    return (a + (_MODULUS - b)) % _MODULUS


def multiply(a: Residues, b: Residues) -> Residues:
    """Return a b."""
    return a * b % _MODULUS


def power(a: Residues, exponent: int) -> Residues:
    """Return a to a whole exponent >= 0."""
    result = np.ones_like(a)
    square = a
    while exponent:
        if exponent & 1:
            result = multiply(result, square)
        square = multiply(square, square)
        exponent >>= 1
    return result


def inverse(a: Residues) -> Residues:
    """Return 1 / a; 0 where a is 0."""
    return power(a, PRIME - 2)


def root(a: Residues) -> Residues:
    """Return the root that is itself a square, where `a` is a square; any number elsewhere.

    Roots of this kind are multiplicative: root(a) root(b) = root(a b) where all three exist.
    """
    return power(a, (PRIME + 1) // 4)
