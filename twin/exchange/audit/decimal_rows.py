"""The operations of a certificate's rows with decimals of 60 digits, each number with a bound of its rounding error.

A row is an operation on rows before it. Bounds of errors are in double precision and rounded up; a value is None where
an operation is not defined, such as a root of a negative number.
"""

from __future__ import annotations

import math
import random
import re
from collections.abc import Callable, Mapping, Sequence
from decimal import Decimal
from typing import Any

DIGITS = 60
"""Number of digits of all calculations."""

_RELATIVE_ROUNDING = 1e-58
"""Bound of the relative rounding error of an operation with 60 digits, and of its bound in double precision."""

_ANGLE_ROUNDING = 1e-14
"""Bound of the error in rad of an angle, which has double precision."""

Bounded = tuple[Decimal, float]
"""A number and a bound of its rounding error."""

Row = Sequence[Any]
"""An operation as JSON has it: its name, then numbers of rows, or a constant or the name of a variable."""

Number = Bounded | bool | None
"""A value, a condition, or None where a value is not defined."""


def row_numbers(row_numbers: Sequence[int], values: Sequence[Number]) -> list[Bounded | None]:
    """Return the values of rows as numbers; ValueError if there is no such row.

    Python would count a negative number of a row from the end.
    """
    numbers = []
    for row_number in row_numbers:
        if not 0 <= row_number < len(values):
            raise ValueError(f"there is no row {row_number}")
        numbers.append(as_number(values[row_number]))
    return numbers


def depends_on_state(rows: Sequence[Row], result: int) -> bool:
    """Return whether a row depends on the state."""
    waiting = [result]
    visited_rows: set[int] = set()
    while waiting:
        row_number = waiting.pop()
        if row_number in visited_rows:
            continue
        # Rows share operands: without this, the search would take a time exponential in their depth.
        visited_rows.add(row_number)
        if rows[row_number][0] in ("input", "cosine", "sine"):
            return True
        for operand in rows[row_number][1:]:
            if isinstance(operand, int):
                waiting.append(operand)
    return False


def as_number(value: Number) -> Bounded | None:
    """Return a value as a number; a condition is 1 or 0."""
    if isinstance(value, bool):
        return Decimal(value), 0.0
    return value


def random_state(
    ranges: Mapping[str, tuple[bool, float, float]], generator: random.Random
) -> dict[str, tuple[Bounded, Bounded]]:
    """Return a random state: {name: (number, number), or cosine and sine of an angle}."""
    state = {}
    for name, (is_angle, low, high) in ranges.items():
        if not low < high:
            raise ValueError(f"the range of {name} is empty")
        drawn_value = generator.uniform(low, high)
        if is_angle:
            middle = round((low + high) / 2 / (math.pi / 6))
            state[name] = _cosine_and_sine(drawn_value, middle)
        else:
            number = (Decimal(drawn_value), 0.0)
            state[name] = (number, number)
    return state


def _cosine_and_sine(angle: float, middle: int) -> tuple[Bounded, Bounded]:
    """Return cosine and sine of an angle near one in rad, which is drawn around `middle` times 30 degrees."""
    # half the distance has a rational tangent; it is large near half a turn, which does no harm
    half = math.remainder(angle - middle * math.pi / 6, 2 * math.pi) / 2
    tangent = Decimal(math.tan(half))
    # The formulas of the half angle: with a rational tangent, both are exact but for the last digit.
    distance_cosine = (1 - tangent * tangent) / (1 + tangent * tangent)
    distance_sine = 2 * tangent / (1 + tangent * tangent)
    root_3_half = Decimal(3).sqrt() / 2
    first_quarter = [(Decimal(1), Decimal(0)), (root_3_half, Decimal("0.5")), (Decimal("0.5"), root_3_half)]
    cosine, sine = first_quarter[middle % 3]
    for _ in range(middle // 3 % 4):  # a quarter turn each
        cosine, sine = -sine, cosine
    turned_cosine = cosine * distance_cosine - sine * distance_sine
    turned_sine = sine * distance_cosine + cosine * distance_sine
    return (turned_cosine, _RELATIVE_ROUNDING), (turned_sine, _RELATIVE_ROUNDING)


def constant(row: Row) -> Bounded | None:
    """Return a constant, as "1/2*sqrt(3) + 5*sqrt(1)", or a real number without an exact form."""
    if row[0] == "real":
        number = Decimal(row[1])
        if not number.is_finite():
            return None
        return number, 0.0
    total = Decimal(0)
    error = 0.0
    for word in row[1].split(" + "):
        term_match = re.fullmatch(r"(-?\d+)(?:/(\d+))?\*sqrt\(([1236])\)", word)
        if term_match is None:
            raise ValueError(f"{word!r} is not a number")
        numerator, denominator, radicand = term_match.groups()
        part = Decimal(numerator) / Decimal(denominator or 1) * Decimal(radicand).sqrt()
        total += part
        error += (abs(float(part)) + abs(float(total))) * _RELATIVE_ROUNDING
    return total, error


def row_values(
    rows: Sequence[Row],
    constants: Mapping[int, Bounded | None],
    state: Mapping[str, tuple[Bounded, Bounded]],
) -> list[Number]:
    """Return the values of all rows at a state."""
    values: list[Number] = []
    for row_number, row in enumerate(rows):
        name = row[0]
        if row_number in constants:
            values.append(constants[row_number])
        elif name in ("input", "cosine"):
            values.append(state[row[1]][0])
        elif name == "sine":
            values.append(state[row[1]][1])
        else:
            operands = []
            for operand in row[1:]:
                if not 0 <= operand < row_number:
                    raise ValueError(f"row {row_number} needs a row that is not before it")
                operands.append(values[operand])
            values.append(_result(name, operands))
    return values


def _result(name: str, operands: Sequence[Number]) -> Number:
    """Return the result of an operation; None if it is not defined."""
    # Before the test for None: the branch that is not taken may be undefined, as a root of a negative number is.
    if name == "choose":
        condition, first, second = operands
        if condition is None:
            return None
        if condition:
            return first
        return second
    if None in operands:
        return None
    if name in _LOGIC:
        return _LOGIC[name](*operands)
    numbers = map(as_number, operands)
    return _OPERATIONS[name](*numbers)


def _add(a: Bounded, b: Bounded) -> Bounded:
    total = a[0] + b[0]
    return total, (a[1] + b[1] + abs(float(total)) * _RELATIVE_ROUNDING) * _ROUND_UP


def _multiply(a: Bounded, b: Bounded) -> Bounded:
    product = a[0] * b[0]
    error = abs(float(a[0])) * b[1] + abs(float(b[0])) * a[1] + a[1] * b[1]
    return product, (error + abs(float(product)) * _RELATIVE_ROUNDING) * _ROUND_UP


def _inverse(a: Bounded) -> Bounded | None:
    """Return 1 / a; it is not defined where a may be zero."""
    size = abs(float(a[0]))
    if size <= a[1]:
        return None
    inverse = 1 / a[0]
    return inverse, (a[1] / size / (size - a[1]) + abs(float(inverse)) * _RELATIVE_ROUNDING) * _ROUND_UP


def _root(x: Bounded) -> Bounded | None:
    """Return the root of a number; below zero by no more than its error, it is zero."""
    number, error = x
    if number < -Decimal(error):
        return None
    root = max(number, Decimal(0)).sqrt()
    # Near zero, an error of the number becomes its root in the root; farther away, the derivative bounds it better.
    spread = math.sqrt(2 * error)
    if error < float(number):
        spread = min(spread, error / float(root))
    return root, (spread + float(root) * _RELATIVE_ROUNDING) * _ROUND_UP


def _angle(cosine: Bounded, sine: Bounded) -> Bounded:
    # Decimals have no arc tangent; that of the processor has a bound of its own.
    return Decimal(math.atan2(sine[0], cosine[0])), _ANGLE_ROUNDING


_ROUND_UP = 1 + 1e-12
"""Factor above the rounding errors of a bound in double precision."""

_OPERATIONS: dict[str, Callable[..., Number]] = {
    "add": _add,
    "multiply": _multiply,
    "negative": lambda a: (-a[0], a[1]),
    "inverse": _inverse,
    "root": _root,
    "angle": _angle,
    "less": lambda a, b: a[0] < b[0],
    "at most": lambda a, b: a[0] <= b[0],
    "equal": lambda a, b: a[0] == b[0],
}

_LOGIC: dict[str, Callable[..., bool]] = {
    "both": lambda a, b: bool(a and b),
    "one of": lambda a, b: bool(a or b),
    "not": lambda a: not a,
}
