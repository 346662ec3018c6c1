"""Values at many random states at once: exact in the prime field, and real in double precision.

An angle is a point of the unit circle, because only its cosine and sine are algebraic. What has no exact value, such as
the logarithm of a length, keeps its real value and is unknown in the field.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from twin.core.spatial import Array
from twin.proof import field as prime
from twin.proof import form as forms
from twin.proof import program
from twin.proof.constants import ExactNumber, decimal, exact_angle, exact_number
from twin.proof.constants import exact as exact_of
from twin.proof.degree import Degree, Truths, signature_of
from twin.proof.field import Residues
from twin.proof.form import Form
from twin.proof.program import ProgramStep


@dataclass(frozen=True)
class ExactValue:
    """A number at k states.

    Attributes:
        residue: the exact value (k,) in the prime field.
        known: whether the exact value is known (k,).
        real: the value (k,) in double precision; NaN where the expression is not defined.
        degree: as an algebraic function of the random numbers.
        constant: the value if it is a constant of the equations; None otherwise.
        form: the value as a polynomial; None if it is none, or if nobody asked for it.
        node: the operations that give the value; None if they have no exact form.
    """

    residue: Residues
    known: Truths
    real: Array
    degree: Degree = field(default_factory=Degree)
    constant: float | None = None
    form: Form | None = None
    node: ProgramStep | None = None


@dataclass(frozen=True)
class Angle:
    """An angle at k states.

    Attributes:
        cosine, sine: its point of the unit circle.
        real: the angle (k,) in rad.
        published: for a parameter, its published value in rad.
    """

    cosine: ExactValue
    sine: ExactValue
    real: Array
    published: float = math.nan


@dataclass(frozen=True)
class DrawnCondition:
    """A condition at k states; the real values decide it. `node` is as that of an `ExactValue`."""

    real: Truths
    node: ProgramStep | None = None


Value = ExactValue | Angle | DrawnCondition

_LARGEST_MULTIPLE = 4
"""Largest multiple of an angle that is computed; the degree of its cosine grows with it."""

ROUNDING = 1e-12
"""Error in m of a length that was computed with double precision."""


# ------------------------------------------------------------------------------------------- constants


def constant(value: float, states: int) -> ExactValue:
    """Return a constant of the equations; it is unknown in the field if it has no exact form."""
    return _constant(float(value).hex(), states, prime.prime())


@lru_cache(maxsize=1024)
def _constant(digits: str, states: int, _prime: int) -> ExactValue:
    """Return the constant with these hexadecimal digits, which tell 0 from -0, modulo the prime in use.

    Its arrays have one number in memory, and cannot be changed.
    """
    value = float.fromhex(digits)
    exact = exact_number(value)
    residue = 0
    form = None
    node = ProgramStep("real", text=repr(value))
    if exact is not None:
        residue = exact.residue
        form = forms.number(exact)
        node = program.number(exact)
    is_exact = np.broadcast_to(np.bool_(exact is not None), states)
    real = np.broadcast_to(np.float64(value), states)
    residues = np.broadcast_to(np.uint64(residue), states)
    return ExactValue(residues, is_exact, real, constant=value, form=form, node=node)


def exact(number: ExactNumber, states: int) -> ExactValue:
    """Return an exact number as a value."""
    residue = np.full(states, number.residue, np.uint64)
    real = np.full(states, float(number))
    return ExactValue(residue, np.ones(states, bool), real, form=forms.number(number), node=program.number(number))


def unknown(real: Array) -> ExactValue:
    """Return a value without an exact form."""
    return ExactValue(np.zeros(len(real), np.uint64), np.zeros(len(real), bool), real)


def real_of(value: Value) -> Array:
    """Return the real values (k,); a condition is 1 or 0."""
    return value.real.astype(float)


def stacked_reals(numbers: Iterable[Value], states: int) -> Array:
    """Return the real values (n, k) of n numbers at k states."""
    rows = list(map(real_of, numbers))
    return np.array(rows).reshape(-1, states)  # (0, k) without numbers


def taken(value: Value, places: NDArray[np.integer]) -> Value:
    """Return a value at some of its states, given by their places (m,)."""
    if isinstance(value, DrawnCondition):
        return replace(value, real=value.real[places])
    if isinstance(value, Angle):
        return Angle(
            number_at(value.cosine, places), number_at(value.sine, places), value.real[places], value.published
        )
    return number_at(value, places)


def number_at(value: ExactValue, places: NDArray[np.integer]) -> ExactValue:
    """Return a number at some of its states, given by their places (m,)."""
    return replace(value, residue=value.residue[places], known=value.known[places], real=value.real[places])


def known_at(value: Value) -> Truths:
    """Return the states (k,) where a value is known in the field."""
    if isinstance(value, DrawnCondition):
        return np.ones(len(value.real), bool)
    if isinstance(value, Angle):
        return value.cosine.known & value.sine.known
    return value.known


def scalar(value: Value) -> ExactValue:
    """Return a value as a number: a condition is 1 or 0; an angle as a number has no exact form."""
    if isinstance(value, ExactValue):
        return value
    if isinstance(value, DrawnCondition):
        states = len(value.real)
        return _either(value, constant(1.0, states), constant(0.0, states))
    return replace(unknown(value.real), node=program.operation("angle", value.cosine.node, value.sine.node))


def truth(value: Value) -> DrawnCondition:
    """Return a value as a condition."""
    if isinstance(value, DrawnCondition):
        return value
    return negated(compared("equal", value, constant(0.0, len(value.real))))


# ------------------------------------------------------------------------------------------- numbers


def add(a: Value, b: Value) -> Value:
    """Return a + b; a sum with an angle is an angle."""
    if isinstance(a, Angle) or isinstance(b, Angle):
        return turned(angle(a), angle(b))
    return total(scalar(a), scalar(b))


def negative(a: Value) -> Value:
    """Return -a."""
    if isinstance(a, Angle):
        return turned_back(a)
    return minus(scalar(a))


def minus(a: ExactValue) -> ExactValue:
    """Return -a of a number."""
    negated = None
    if a.constant is not None:
        negated = -a.constant
    return replace(
        a,
        residue=prime.negative(a.residue),
        real=-a.real,
        constant=negated,
        form=forms.minus(a.form),
        node=program.operation("negative", a.node),
    )


def multiply(a: Value, b: Value) -> Value:
    """Return a b; a whole multiple or a half of an angle is an angle."""
    for factor, angle_operand in ((a, b), (b, a)):
        if isinstance(angle_operand, Angle) and isinstance(factor, ExactValue) and factor.constant is not None:
            return _multiple(angle_operand, factor.constant)
    return product(scalar(a), scalar(b))


def product(a: ExactValue, b: ExactValue) -> ExactValue:
    """Return a b of two numbers."""
    residue = prime.multiply(a.residue, b.residue)
    form = forms.product(a.form, b.form)
    node = program.operation("multiply", a.node, b.node)
    return ExactValue(residue, a.known & b.known, a.real * b.real, a.degree * b.degree, form=form, node=node)


def total(a: ExactValue, b: ExactValue) -> ExactValue:
    """Return a + b of two numbers."""
    residue = prime.add(a.residue, b.residue)
    form = forms.total(a.form, b.form)
    node = program.operation("add", a.node, b.node)
    return ExactValue(residue, a.known & b.known, a.real + b.real, a.degree + b.degree, form=form, node=node)


def difference(a: ExactValue, b: ExactValue) -> ExactValue:
    """Return a - b of two numbers."""
    return total(a, minus(b))


def reciprocal(a: ExactValue) -> ExactValue:
    """Return 1 / a."""
    with np.errstate(divide="ignore"):
        real = 1 / a.real
    known = a.known & (a.residue != 0)
    form = forms.reciprocal(a.form)
    node = program.operation("inverse", a.node)
    return ExactValue(prime.inverse(a.residue), known, real, a.degree.inverse(), form=form, node=node)


def divide(a: Value, b: Value) -> Value:
    """Return a / b."""
    if isinstance(a, Angle) and isinstance(b, ExactValue) and b.constant:
        return _multiple(a, 1 / b.constant)
    numerator = scalar(a)
    denominator = scalar(b)
    quotient = product(numerator, reciprocal(denominator))
    # the product with a reciprocal is rounded twice; the quotient of the equations once
    with np.errstate(divide="ignore", invalid="ignore"):
        return replace(quotient, real=numerator.real / denominator.real)


def root(a: Value) -> ExactValue:
    """Return the root of a; it is unknown where the residue is no square."""
    number = scalar(a)
    with np.errstate(invalid="ignore"):
        real = np.sqrt(number.real)
    node = program.operation("root", number.node)
    residues = number.residue[number.known]
    if len(residues) and (residues == residues[0]).all():
        # a length that does not depend on the state, written as a root; in the field both signs are roots
        length = decimal(float(real[number.known][0]), ROUNDING)
        if length is not None and length.residue**2 % prime.prime() == residues[0]:
            residue = np.full(len(real), length.residue, np.uint64)
            return ExactValue(residue, number.known, real, node=node)
    residue = prime.root(number.residue)
    squares = prime.multiply(residue, residue) == number.residue
    known = number.known & squares
    return ExactValue(residue, known, real, number.degree.root(signature_of(number.residue, number.known)), node=node)


def power(a: Value, exponent: Value) -> Value:
    """Return a to a constant whole exponent, or to a half."""
    number = scalar(a)
    with np.errstate(all="ignore"):
        real = number.real ** real_of(exponent)
    if not isinstance(exponent, ExactValue) or exponent.constant is None:
        return unknown(real)
    if exponent.constant == 0.5:
        return root(number)
    if not float(exponent.constant).is_integer():
        return unknown(real)
    whole = int(exponent.constant)
    if whole < 0:
        number = reciprocal(number)
    result = constant(1.0, len(real))
    for _ in range(abs(whole)):
        result = product(result, number)
    return replace(result, real=real, constant=None)


def choose(condition: DrawnCondition, a: Value, b: Value) -> Value:
    """Return a where a condition is true, and b elsewhere."""
    if isinstance(a, Angle) or isinstance(b, Angle):
        first = angle(a)
        second = angle(b)
        cosine = _either(condition, first.cosine, second.cosine)
        sine = _either(condition, first.sine, second.sine)
        return Angle(cosine, sine, np.where(condition.real, first.real, second.real))
    return _either(condition, scalar(a), scalar(b))


def _either(condition: DrawnCondition, a: ExactValue, b: ExactValue) -> ExactValue:
    """Return the number a where a condition is true, and b elsewhere."""
    residue = np.where(condition.real, a.residue, b.residue)
    known = np.where(condition.real, a.known, b.known)
    real = np.where(condition.real, a.real, b.real)
    node = program.operation("choose", condition.node, a.node, b.node)
    return ExactValue(residue, known, real, a.degree.either(b.degree), node=node)


# ------------------------------------------------------------------------------------------- angles


def angle(value: Value) -> Angle:
    """Return a value as an angle; a number is one if it is 0 or a constant with a known cosine."""
    if isinstance(value, Angle):
        return value
    number = scalar(value)
    states = len(number.real)
    if number.constant is not None:
        point = exact_angle(number.constant)
        if point is not None:
            exact_cosine, exact_sine = point
            return Angle(exact(exact_cosine, states), exact(exact_sine, states), number.real)
    # the part of a conditional expression that is not chosen is the number 0
    known = number.known & (number.residue == 0) & (number.real == 0)
    cosine_node = None
    sine_node = None
    if known.all():
        cosine_node = program.number(exact_of(1))
        sine_node = program.number(exact_of(0))
    cosine = ExactValue(np.ones(states, np.uint64), known, np.cos(number.real), node=cosine_node)
    sine = ExactValue(np.zeros(states, np.uint64), known, np.sin(number.real), node=sine_node)
    return Angle(cosine, sine, number.real)


def turned_back(a: Angle) -> Angle:
    """Return -a of an angle."""
    return Angle(a.cosine, minus(a.sine), -a.real, -a.published)


def turned(a: Angle, b: Angle) -> Angle:
    """Return a + b of two angles."""
    cosine = difference(product(a.cosine, b.cosine), product(a.sine, b.sine))
    sine = total(product(a.sine, b.cosine), product(a.cosine, b.sine))
    return Angle(cosine, sine, a.real + b.real)


def _multiple(a: Angle, factor: float) -> Value:
    """Return a whole multiple or a half of an angle; any other multiple has no exact form."""
    if abs(factor) == 0.5:
        half = _half(a)
        if factor > 0:
            return half
        return negative(half)
    if not float(factor).is_integer() or abs(factor) > _LARGEST_MULTIPLE:
        return unknown(a.real * factor)
    result = angle(constant(0.0, len(a.real)))
    step = a
    if factor < 0:
        step = turned_back(a)
    for _ in range(int(abs(factor))):
        result = turned(result, step)
    return result


def _half(a: Angle) -> Angle:
    """Return half of an angle: cos(a/2) = sqrt((1 + cos a) / 2), with the sign of its real value."""
    states = len(a.real)
    one = constant(1.0, states)
    two = constant(2.0, states)
    half = a.real / 2
    # only the square of the cosine is an algebraic function of the angle's: its sign is that of the real value
    cosine = root(product(total(one, a.cosine), reciprocal(two)))
    cosine = _either(DrawnCondition(np.cos(half) < 0), minus(cosine), cosine)
    sine = product(a.sine, reciprocal(product(two, cosine)))
    return Angle(replace(cosine, real=np.cos(half)), replace(sine, real=np.sin(half)), half)


def direction(y: Value, x: Value) -> Angle:
    """Return atan2(y, x)."""
    opposite = scalar(y)
    adjacent = scalar(x)
    square_of_length = total(product(opposite, opposite), product(adjacent, adjacent))
    length = root(square_of_length)
    scale = reciprocal(length)
    real = np.arctan2(opposite.real, adjacent.real)
    cosine = replace(product(adjacent, scale), real=np.cos(real))
    sine = replace(product(opposite, scale), real=np.sin(real))
    return Angle(cosine, sine, real)


def of_cosine(x: Value) -> Angle:
    """Return acos(x)."""
    cosine = scalar(x)
    # the root with the sign + in real values: acos has angles from 0 to a half turn
    sine = root(_one_less_square(cosine))
    with np.errstate(invalid="ignore"):
        return Angle(cosine, sine, np.arccos(cosine.real))


def of_sine(x: Value) -> Angle:
    """Return asin(x)."""
    sine = scalar(x)
    cosine = root(_one_less_square(sine))
    with np.errstate(invalid="ignore"):
        return Angle(cosine, sine, np.arcsin(sine.real))


def _one_less_square(a: ExactValue) -> ExactValue:
    """Return 1 - a^2."""
    return difference(constant(1.0, len(a.real)), product(a, a))


# ------------------------------------------------------------------------------------------- signs


def magnitude(a: Value) -> Value:
    """Return |a|."""
    return choose(compared("less", a, constant(0.0, len(a.real))), negative(a), a)


def sign(a: Value) -> ExactValue:
    """Return 1, 0 or -1."""
    zero = constant(0.0, len(a.real))
    one = constant(1.0, len(a.real))
    not_above = _either(compared("less", a, zero), minus(one), zero)
    return _either(compared("less", zero, a), one, not_above)


_RELATIONS = {"less": np.less, "at most": np.less_equal, "equal": np.equal}


def compared(relation: Literal["less", "at most", "equal"], a: Value, b: Value) -> DrawnCondition:
    """Return a condition on the real values."""
    node = program.operation(relation, scalar(a).node, scalar(b).node)
    with np.errstate(invalid="ignore"):
        return DrawnCondition(_RELATIONS[relation](real_of(a), real_of(b)), node)


def negated(a: DrawnCondition) -> DrawnCondition:
    """Return whether a condition is false."""
    return DrawnCondition(~a.real, program.operation("not", a.node))


def both(a: DrawnCondition, b: DrawnCondition) -> DrawnCondition:
    """Return whether two conditions are true."""
    return DrawnCondition(a.real & b.real, program.operation("both", a.node, b.node))


def one_of(a: DrawnCondition, b: DrawnCondition) -> DrawnCondition:
    """Return whether one of two conditions is true."""
    return DrawnCondition(a.real | b.real, program.operation("one of", a.node, b.node))
