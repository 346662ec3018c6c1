"""Polynomials of cosines, sines and lengths with exact coefficients: what is wrong in an equation, as a formula."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction

from twin.proof.constants import ROOTS, ExactNumber

Monomial = tuple[tuple[str, int], ...]
"""Powers of variables, sorted by their names."""

MOST_TERMS = 1000
"""Maximum number of terms while a formula is computed: a longer one is given up."""

_SINE = "sin "
_COSINE = "cos "
_ROOT = "sqrt "
"""What precedes the argument in the names of variables that are functions."""

_FACTORS_OF_ROOTS = {6: 1, 3: 2, 2: 3}
"""{third of the radicands 2, 3, 6: factor of its root in the product of the roots of the other two}."""


@dataclass(frozen=True)
class Form:
    """A polynomial.

    Attributes:
        terms: {monomial: its coefficient}, without squares of sines and of roots.
    """

    terms: Mapping[Monomial, Fraction]

    def __bool__(self) -> bool:
        return bool(self.terms)

    def __str__(self) -> str:
        """Return the polynomial with the common powers before a bracket, as "l_p^2 (cos(theta)^2 - cos(phi)^2)"."""
        if not self.terms:
            return "0"
        if len(self.terms) == 1:
            ((monomial, coefficient),) = self.terms.items()
            return _term(coefficient, _powers(monomial)).removeprefix("+ ")
        common = _common(self.terms)
        # the simplest coefficient stands before the bracket
        size = min(map(abs, self.terms.values()), key=lambda fraction: (fraction.denominator, fraction))
        largest_first = sorted(self.terms.items(), key=lambda term: (-term[1], term[0]))
        parts = []
        for monomial, coefficient in largest_first:
            parts.append(_term(coefficient / size, _powers(_divided(monomial, common))))
        inside = " ".join(parts).removeprefix("+ ")
        before = _powers(common)
        if size != 1:
            before = f"{_number(size)} {before}".rstrip()
        if not before:
            return inside
        return f"{before} ({inside})"


def variable(name: str) -> Form:
    """Return a variable."""
    return Form({((name, 1),): Fraction(1)})


def cosine(name: str) -> Form:
    """Return the cosine of an angle."""
    return variable(_COSINE + name)


def sine(name: str) -> Form:
    """Return the sine of an angle."""
    return variable(_SINE + name)


def number(value: ExactNumber) -> Form:
    """Return an exact number."""
    terms: dict[Monomial, Fraction] = {}
    for radicand, fraction in value.parts:
        if radicand == 1:
            terms[()] = fraction
        else:
            terms[((f"{_ROOT}{radicand}", 1),)] = fraction
    return Form(terms)


def total(a: Form | None, b: Form | None) -> Form | None:
    """Return a + b; None if one is unknown or the sum is too long."""
    if a is None or b is None:
        return None
    terms = dict(a.terms)
    for monomial, coefficient in b.terms.items():
        _add(terms, monomial, coefficient)
    return _short(terms)


def minus(a: Form | None) -> Form | None:
    """Return -a."""
    if a is None:
        return None
    return Form({monomial: -coefficient for monomial, coefficient in a.terms.items()})


def product(a: Form | None, b: Form | None) -> Form | None:
    """Return a b; None if one is unknown or the product is too long."""
    if a is None or b is None:
        return None
    terms: dict[Monomial, Fraction] = {}
    for first, first_coefficient in a.terms.items():
        for second, second_coefficient in b.terms.items():
            powers = dict(first)
            for name, exponent in second:
                powers[name] = powers.get(name, 0) + exponent
            _reduce(terms, powers, first_coefficient * second_coefficient)
    return _short(terms)


def reciprocal(a: Form | None) -> Form | None:
    """Return 1 / a of a number; None for other polynomials."""
    if a is None or set(a.terms) != {()}:
        return None
    return Form({(): 1 / a.terms[()]})


def _reduce(terms: dict[Monomial, Fraction], powers: dict[str, int], coefficient: Fraction) -> None:
    """Add a term after its squares of roots and sines are replaced: sin^2 = 1 - cos^2."""
    for name, exponent in powers.items():
        if exponent < 2:
            continue
        if name.startswith(_ROOT):
            reduced_powers = {**powers, name: exponent - 2}
            _reduce(terms, reduced_powers, coefficient * int(name.removeprefix(_ROOT)))
            return
        if name.startswith(_SINE):
            reduced_powers = {**powers, name: exponent - 2}
            _reduce(terms, reduced_powers, coefficient)
            cosine_name = _COSINE + name.removeprefix(_SINE)
            _reduce(terms, {**reduced_powers, cosine_name: reduced_powers.get(cosine_name, 0) + 2}, -coefficient)
            return
    roots = [radicand for radicand in ROOTS if powers.get(f"{_ROOT}{radicand}")]
    if len(roots) == 2:  # sqrt 2 sqrt 3 = sqrt 6, sqrt 2 sqrt 6 = 2 sqrt 3, sqrt 3 sqrt 6 = 3 sqrt 2
        first, second = roots
        (third,) = set(ROOTS) - set(roots)
        reduced_powers = {**powers, f"{_ROOT}{first}": 0, f"{_ROOT}{second}": 0, f"{_ROOT}{third}": 1}
        _reduce(terms, reduced_powers, coefficient * _FACTORS_OF_ROOTS[third])
        return
    _add(terms, tuple(sorted(_monomial(powers))), coefficient)


def _monomial(powers: Mapping[str, int]) -> Monomial:
    """Return the powers {variable: exponent} that are not 0, in their order."""
    return tuple((name, exponent) for name, exponent in powers.items() if exponent)


def _add(terms: dict[Monomial, Fraction], monomial: Monomial, coefficient: Fraction) -> None:
    """Add a term to a polynomial; terms that cancel are dropped."""
    total = terms.get(monomial, Fraction(0)) + coefficient
    if total:
        terms[monomial] = total
    else:
        terms.pop(monomial, None)


def _short(terms: dict[Monomial, Fraction]) -> Form | None:
    """Return a polynomial; None if it has too many terms."""
    if len(terms) > MOST_TERMS:
        return None
    return Form(terms)


def _common(terms: Mapping[Monomial, Fraction]) -> Monomial:
    """Return the powers that all monomials have in common."""
    first, *others = map(dict, terms)
    shared = []
    for name, exponent in first.items():
        smallest = exponent
        for powers in others:
            smallest = min(smallest, powers.get(name, 0))
        if smallest:
            shared.append((name, smallest))
    return tuple(shared)


def _divided(monomial: Monomial, common: Monomial) -> Monomial:
    """Return a monomial divided by powers that it has."""
    powers = dict(monomial)
    for name, exponent in common:
        powers[name] -= exponent
    return _monomial(powers)


def _powers(monomial: Monomial) -> str:
    """Return a monomial as text."""
    words = []
    for name, exponent in monomial:
        word = name
        if " " in name:
            function, argument = name.split(" ")
            word = f"{function}({argument})"
        if exponent > 1:
            word += f"^{exponent}"
        words.append(word)
    return " ".join(words)


def _term(coefficient: Fraction, powers: str) -> str:
    """Return a term with its sign."""
    sign = "-" if coefficient < 0 else "+"
    size = abs(coefficient)
    if size == 1 and powers:
        return f"{sign} {powers}"
    return f"{sign} {_number(size)} {powers}".rstrip()


def _number(size: Fraction) -> str:
    """Return a fraction as text: as a decimal if it is a short one."""
    decimal = f"{float(size):.12g}"
    if Fraction(decimal) == size:
        return decimal
    return str(size)
