"""The numbers of a claim with 60 digits: roots have their signs there, and a wrong sign shows however small it is.

In the prime field, both signs of a root are roots; in double precision, a small error may be rounding. Here each number
has a bound of its rounding error.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from decimal import Context, Decimal, localcontext
from fractions import Fraction

from twin.proof import program
from twin.proof.program import ProgramStep, Row

_DIGITS = 60
"""Number of digits."""

_ROUNDING = 1e-58
"""Bound of the relative rounding error of an operation, which is at most 5e-60, with a margin."""

_BOUND_MARGIN = 1 + 1e-12
"""Factor by which bounds are increased, because they are computed in double precision."""

_ANGLE_ERROR = 1e-14
"""Error in rad of an angle, which has double precision."""


@dataclass(frozen=True)
class PreciseNumber:
    """A number, and a bound of the distance from its exact value."""

    value: Decimal
    error: float

    @property
    def size(self) -> float:
        """Magnitude in double precision."""
        return abs(float(self.value))


_Result = PreciseNumber | bool | None
"""A number or a condition; None where the expression is not defined."""


StateOfFractions = Mapping[str, Fraction]
"""{name of a random number: its value in m, or the tangent of half of the angle}."""


def numbers_at(nodes: Iterable[ProgramStep], state: StateOfFractions) -> list[PreciseNumber | None]:
    """Return numbers at a state; None for one that is not defined there."""
    rows, places = program.rows(nodes)
    with localcontext(Context(prec=_DIGITS)):
        results = _results(rows, _constants(rows), state)
    numbers: list[PreciseNumber | None] = []
    for place in places:
        result = results[place]
        if not isinstance(result, PreciseNumber):
            result = None
        numbers.append(result)
    return numbers


def certainly_not_zero(nodes: Iterable[ProgramStep], states: Iterable[Mapping[str, float]]) -> float:
    """Return the largest of the numbers that certainly are not zero at one of some states; 0 if there is none.

    Args:
        nodes: the operations of numbers that must be zero.
        states: {name of a random number: its value} at each state, in m and rad.
    """
    rows, places = program.rows(nodes)
    largest = 0.0
    with localcontext(Context(prec=_DIGITS)):
        constants = _constants(rows)
        for state in states:
            results = _results(rows, constants, state)
            for place in places:
                result = results[place]
                if isinstance(result, PreciseNumber) and abs(result.value) > Decimal(result.error):
                    largest = max(largest, result.size)
    return largest


def _constants(rows: Sequence[Row]) -> dict[int, _Result]:
    """Return {number of a row: its value} of the constants."""
    constants: dict[int, _Result] = {}
    for number, row in enumerate(rows):
        if row[0] in ("number", "real"):
            constants[number] = _constant(row)
    return constants


def _results(
    rows: Sequence[Row], constants: Mapping[int, _Result], state: Mapping[str, float | Fraction]
) -> list[_Result]:
    """Return the results of all rows at a state."""
    results: list[_Result] = []
    for number, row in enumerate(rows):
        if number in constants:
            results.append(constants[number])
        else:
            results.append(_evaluated(row, results, state))
    return results


def _constant(row: Row) -> PreciseNumber | None:
    """Return a constant of the equations or of the mechanism."""
    text = str(row[1])
    if row[0] == "real":
        value = Decimal(text)
        if value.is_finite():
            return PreciseNumber(value, 0.0)
        return None
    total = PreciseNumber(Decimal(0), 0.0)
    for word in text.split(" + "):
        fraction, radicand = word.split("*sqrt(")
        exact = Fraction(fraction)
        root = Decimal(radicand.rstrip(")")).sqrt()
        term = Decimal(exact.numerator) / Decimal(exact.denominator) * root
        total = _sum(total, PreciseNumber(term, abs(float(term)) * _ROUNDING))
    return total


def _evaluated(row: Row, results: Sequence[_Result], state: Mapping[str, float | Fraction]) -> _Result:
    """Return the result of an operation at a state."""
    name = str(row[0])
    if name == "input":
        return _fraction(Fraction(state[str(row[1])]))
    if name in ("cosine", "sine"):
        value = state[str(row[1])]
        if isinstance(value, Fraction):
            return _cosine_or_sine(name, value)
        # the tangent of half of the angle is taken as exact: another state near this one
        t = Decimal(math.tan(math.remainder(value, math.tau) / 2))
        part = 2 * t
        if name == "cosine":
            part = 1 - t * t
        return PreciseNumber(part / (1 + t * t), _ROUNDING)
    operands = [results[int(place)] for place in row[1:]]
    if name == "choose":
        condition, if_true, if_false = operands
        if condition is None:
            return None
        if condition:
            return if_true
        return if_false
    if None in operands:
        return None
    if name in _LOGIC:
        return _LOGIC[name](*operands)
    numbers = []
    for operand in operands:
        if not isinstance(operand, PreciseNumber):
            operand = PreciseNumber(Decimal(bool(operand)), 0.0)  # a condition is 1 or 0
        numbers.append(operand)
    return _NUMERIC[name](*numbers)


def _cosine_or_sine(name: str, t: Fraction) -> PreciseNumber:
    """Return cosine or sine of the angle whose half has the tangent t."""
    part = 2 * t
    if name == "cosine":
        part = 1 - t * t
    return _fraction(part / (1 + t * t))


def _fraction(x: Fraction) -> PreciseNumber:
    value = Decimal(x.numerator) / Decimal(x.denominator)
    return PreciseNumber(value, abs(float(value)) * _ROUNDING)


def _sum(a: PreciseNumber, b: PreciseNumber) -> PreciseNumber:
    value = a.value + b.value
    return PreciseNumber(value, (a.error + b.error + abs(float(value)) * _ROUNDING) * _BOUND_MARGIN)


def _product(a: PreciseNumber, b: PreciseNumber) -> PreciseNumber:
    value = a.value * b.value
    error = a.size * b.error + b.size * a.error + a.error * b.error
    return PreciseNumber(value, (error + abs(float(value)) * _ROUNDING) * _BOUND_MARGIN)


def _reciprocal(a: PreciseNumber) -> PreciseNumber | None:
    """Return 1 / a; it is not defined where a may be 0."""
    # with an error of at most half of a, that of 1 / a is at most twice the error of first order
    if not a.size > 2 * a.error:
        return None
    value = 1 / a.value
    return PreciseNumber(value, (2 * a.error / a.size**2 + abs(float(value)) * _ROUNDING) * _BOUND_MARGIN)


def _root(a: PreciseNumber) -> PreciseNumber | None:
    """Return the root of a; a number below 0 by rounding alone is 0."""
    if a.value < -Decimal(a.error):
        return None
    value = max(a.value, Decimal(0)).sqrt()
    spread = math.sqrt(2 * a.error)  # the root of a sum is at most the sum of the roots
    if a.error < float(a.value):
        spread = min(spread, a.error / float(value))
    return PreciseNumber(value, (spread + float(value) * _ROUNDING) * _BOUND_MARGIN)


_NUMERIC: dict[str, Callable[..., _Result]] = {
    "add": _sum,
    "multiply": _product,
    "negative": lambda a: PreciseNumber(-a.value, a.error),
    "inverse": _reciprocal,
    "root": _root,
    "angle": lambda x, y: PreciseNumber(Decimal(math.atan2(y.value, x.value)), _ANGLE_ERROR),
    "less": lambda a, b: a.value < b.value,
    "at most": lambda a, b: a.value <= b.value,
    "equal": lambda a, b: a.value == b.value,
}

_LOGIC: dict[str, Callable[..., bool]] = {
    "both": lambda a, b: bool(a and b),
    "one of": lambda a, b: bool(a or b),
    "not": lambda a: not a,
}
