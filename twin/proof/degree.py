"""The degree of an algebraic function of the random numbers, from which the odds of a zero by chance follow.

A function that is not identically zero is zero at a random state with a probability of at most its degree divided by
the number of values among which a random number is drawn (J. T. Schwartz, J. ACM 27(4), 1980; R. Zippel, 1979). A root
has two signs in the prime field: each root in the function doubles this bound, and equal roots must count once.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import count
from weakref import WeakValueDictionary

import numpy as np
from numpy.typing import NDArray

from twin.proof.field import Residues

Truths = NDArray[np.bool_]
"""Whether something is so, at each of k states."""

ALIKE = 4
"""Number of states at which arguments of roots are equal, each by chance with odds of 1e-9 at most."""


@dataclass(frozen=True, eq=False)
class RootSignature:
    """A root, by the residues (k,) of its argument and whether they are known (k,)."""

    residue: Residues
    known: Truths

    def fits(self, residue: Residues, known: Truths) -> bool:
        """Return whether another argument equals this one at `ALIKE` states at least, and at all where both are known.

        Args:
            residue: (k,) residues of the other argument.
            known: (k,) whether they are known.
        """
        if len(residue) != len(self.residue):
            return False
        both_known = known & self.known
        is_equal = (residue == self.residue)[both_known]
        return len(is_equal) >= ALIKE and bool(is_equal.all())


_identifiers = count()
"""Identifiers of roots and of factors of denominators, each used once."""

_signatures: WeakValueDictionary[int, RootSignature] = WeakValueDictionary()
"""{identifier: signature} of the roots of all values that exist; a signature goes with the last value that has it."""


def signature_of(residue: Residues, known: Truths) -> RootSignature:
    """Return the signature of a root of an argument (k,); arguments that fit one another have one root."""
    for identifier in sorted(_signatures):  # in the order in which they were made: the same seed gives the same proof
        signature = _signatures.get(identifier)
        if signature is not None and signature.fits(residue, known):
            return signature
    signature = RootSignature(residue, known)
    _signatures[next(_identifiers)] = signature
    return signature


@dataclass(frozen=True)
class Degree:
    """A bound of the degree of an algebraic function of the random numbers.

    Attributes:
        numerator: degree of the numerator; a root counts half of the degree of its argument.
        factors: {factor of the denominator: (its degree, its exponent)}.
        roots: the roots in the function; each doubles the number of states where the function can be zero.
    """

    numerator: int = 0
    factors: Mapping[int, tuple[int, int]] = field(default_factory=dict)
    roots: frozenset[RootSignature] = frozenset()

    @property
    def denominator(self) -> int:
        """Degree of the denominator."""
        return sum(degree * exponent for degree, exponent in self.factors.values())

    def __add__(self, other: Degree) -> Degree:
        """Return the degree of a sum, over the least common denominator."""
        factors = dict(self.factors)
        for factor, (degree, exponent) in other.factors.items():
            _, own_exponent = factors.get(factor, (degree, 0))
            factors[factor] = (degree, max(own_exponent, exponent))
        common_denominator = Degree(0, factors).denominator
        # each numerator is multiplied by what its own denominator lacks
        numerator = self.numerator + common_denominator - self.denominator
        other_numerator = other.numerator + common_denominator - other.denominator
        return Degree(max(numerator, other_numerator), factors, self.roots | other.roots)

    def __mul__(self, other: Degree) -> Degree:
        """Return the degree of a product."""
        factors = dict(self.factors)
        for factor, (degree, exponent) in other.factors.items():
            _, own_exponent = factors.get(factor, (degree, 0))
            factors[factor] = (degree, own_exponent + exponent)
        return Degree(self.numerator + other.numerator, factors, self.roots | other.roots)

    def inverse(self) -> Degree:
        """Return the degree of the reciprocal value; the numerator becomes a new factor."""
        factors = {}
        if self.numerator:
            factors[next(_identifiers)] = (self.numerator, 1)
        return Degree(self.denominator, factors, self.roots)

    def root(self, signature: RootSignature) -> Degree:
        """Return the degree of the root of the function; its signature distinguishes it from other roots."""
        half = -(-(self.numerator + self.denominator) // 2)
        return Degree(half, self.factors, self.roots | {signature})

    def either(self, other: Degree) -> Degree:
        """Return a degree that holds for both functions."""
        total = self + other
        return Degree(max(self.numerator, other.numerator, total.numerator), total.factors, total.roots)

    @property
    def zero_bound(self) -> int:
        """Bound of the share of states where the function is zero by chance, multiplied by the count of fractions."""
        return max(self.numerator, 1) << len(self.roots)
