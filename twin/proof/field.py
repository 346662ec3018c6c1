"""Exact arithmetic modulo a prime, for arrays.

Sums, products and quotients of whole numbers modulo a prime follow the rules of fractions. An identity between
fractions therefore holds modulo the prime as well; an expression that is not identically zero is zero at a random state
with a probability of at most its degree divided by the prime (J. T. Schwartz, J. ACM 27(4), 1980; R. Zippel, 1979).

A product of two residues has up to 100 bits. Its quotient by the prime is estimated with double precision, which is
right within one; the remainder then follows from the lower 64 bits alone.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

Residues = NDArray[np.uint64]
"""Whole numbers from 0 to the prime less 1."""

PRIMES = tuple(2**50 - k for k in (53147225, 45340433, 73593833, 77276753, 100644185, 19411265, 116849825, 130192145))
"""Primes near 2^50 that leave the remainder 7 when divided by 8, so that the root of a square is a power, and in which
2 and all odd primes up to 61 have roots. A constant without a root in one of them may have one in the next."""

_chosen: ContextVar[int] = ContextVar("prime", default=PRIMES[0])


def prime() -> int:
    """Return the prime in use."""
    return _chosen.get()


@contextmanager
def modulo(number: int) -> Iterator[None]:
    """Use another prime of `PRIMES`."""
    token = _chosen.set(number)
    try:
        yield
    finally:
        _chosen.reset(token)


def residue(number: Fraction | int) -> int:
    """Return the residue of a fraction; its denominator must not be a multiple of the prime."""
    fraction = Fraction(number)
    return fraction.numerator * pow(fraction.denominator, -1, prime()) % prime()


def add(a: Residues, b: Residues) -> Residues:
    """Return a + b."""
    total = a + b
    modulus = np.uint64(prime())
    return total - modulus * (total >= modulus)


def negative(a: Residues) -> Residues:
    """Return -a."""
    return (np.uint64(prime()) - a) * (a != 0)


def multiply(a: Residues, b: Residues) -> Residues:
    """Return a b."""
    modulus = prime()
    quotient = (a.astype(float) * b.astype(float) / modulus).astype(np.uint64)
    remainder = (a * b - quotient * np.uint64(modulus)).view(np.int64)
    # the estimated quotient may be too large or too small by one
    remainder += modulus * (remainder < 0)
    remainder -= modulus * (remainder >= modulus)
    return remainder.view(np.uint64)


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
    """Return 1 / a; 0 where a is 0.

    Only the product of all numbers is inverted: 1 / x = y / (x y), and so on for products of pairs.
    """
    if not len(a):
        return a
    levels = [np.where(a == 0, np.uint64(1), a)]
    while len(levels[-1]) > 1:
        numbers = levels[-1]
        if len(numbers) % 2:
            numbers = levels[-1] = np.append(numbers, np.uint64(1))
        levels.append(multiply(numbers[0::2], numbers[1::2]))
    inverses = np.array([pow(int(levels[-1][0]), -1, prime())], np.uint64)
    for numbers in reversed(levels[:-1]):
        pairs = np.empty_like(numbers)
        pair_inverses = inverses[: len(numbers) // 2]
        pairs[0::2] = multiply(pair_inverses, numbers[1::2])
        pairs[1::2] = multiply(pair_inverses, numbers[0::2])
        inverses = pairs
    return np.where(a == 0, np.uint64(0), inverses[: len(a)])


def root(a: Residues) -> Residues:
    """Return the root that is itself a square, where `a` is a square; any number elsewhere.

    Roots of this kind are multiplicative: root(a) root(b) = root(a b) where all three exist.
    """
    return power(a, (prime() + 1) // 4)
