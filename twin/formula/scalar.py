"""Objects that replace plain numbers as entries of NumPy arrays: a symbol, or the values of a scalar at many samples.

NumPy functions work on arrays of such objects: arithmetic calls the operators of `Scalar`, `np.sin` calls the method
`Scalar.sin`, and so on. Subclasses define the operations. Operations that require a plain number (`if`, `math.sin`)
raise an error.
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Mapping
from typing import Any, ClassVar, Self

import numpy as np

Value = Any
"""What a symbol of a formula stands for: a number, a `Scalar`, a CasADi matrix, or a NumPy array of numbers or scalars.

Authors write for all of these at once, and no stub of NumPy or CasADi describes arrays whose entries are symbols.
"""

METHODS = (
    "sin",
    "cos",
    "tan",
    "arcsin",
    "arccos",
    "arctan",
    "sinh",
    "cosh",
    "tanh",
    "exp",
    "log",
    "sqrt",
    "arctan2",
    "hypot",
    "fabs",
)
"""Functions that NumPy calls as methods of the objects in an array."""

_BINARY_OPERATORS = ("add", "sub", "mul", "truediv", "pow")
"""Names of the operators with two operands that give a number, in the module `operator`."""

_COMPARISON_OPERATORS = ("lt", "le", "gt", "ge", "eq", "ne")
"""Names of the operators that give a condition."""


class NeedsNumberError(TypeError):
    """A plain number is required, but the value is a symbol; the message suggests a fix."""


class Scalar:
    """One scalar `x`; subclasses define the operations on `x`.

    Attributes:
        functions: {name of the operation: function}; the names are those of `METHODS`, and "if_else".
    """

    __slots__ = ("x",)
    functions: ClassVar[Mapping[str, Callable[..., Value]]] = {}

    def __init__(self, x: Value) -> None:
        self.x = x

    def _of(self, name: str, *others: object) -> Self:
        """Return the result of an operation of `functions` with other values."""
        values = []
        for other in others:
            value = _value(other)
            if value is NotImplemented:
                return NotImplemented
            values.append(value)
        result = self.functions[name](self.x, *values)
        return type(self)(result)

    __hash__ = None  # type: ignore[assignment] # equality is a symbol

    def __neg__(self) -> Self:
        return type(self)(-self.x)

    def __pos__(self) -> Self:
        return self

    def __abs__(self) -> Self:
        return self._of("fabs")

    def conjugate(self) -> Self:
        """Return self, because the value is real; `np.linalg.norm` along an axis requires this method."""
        return self

    def radians(self) -> Self:
        """Return this angle converted from degrees to radians."""
        return self._after_operator(np.pi / 180, operator.mul)

    def degrees(self) -> Self:
        """Return this angle converted from radians to degrees."""
        return self._after_operator(180 / np.pi, operator.mul)

    deg2rad = radians
    rad2deg = degrees

    def if_else(self, yes: object, no: object) -> Self:
        """Return `yes` where this condition is true, else `no`."""
        return self._of("if_else", yes, no)

    def __bool__(self) -> bool:
        raise NeedsNumberError(
            "`if`, `and`, `not`, max() and sorted() do not work on values that depend on the pose or the joints. "
            "Write if_else(condition, yes, no) of twin.formula, or np.where, np.maximum, np.minimum"
        )

    def __float__(self) -> float:
        raise NeedsNumberError(
            "a plain number is needed, but this value depends on the pose or the joints: remove float() and "
            ".astype(float), and use NumPy functions"
        )

    __int__ = __index__ = __float__  # type: ignore[assignment]

    def _after_operator(self, other: object, operation: Callable[[Value, Value], Value]) -> Self:
        """Return the result of an operator with another value."""
        value = _value(other)
        if value is NotImplemented:
            return NotImplemented
        return type(self)(operation(self.x, value))


def _value(other: object) -> Value:
    """Return what `other` contributes to an operation; NotImplemented: an operand of another kind."""
    if isinstance(other, Scalar):
        return other.x
    if isinstance(other, bool | int | float | np.number | np.bool_):
        return float(other)
    return NotImplemented  # an array: NumPy handles its entries one by one


def _method(name: str) -> Callable[..., Scalar]:
    """Return the method of `Scalar` that NumPy calls for its function of this name."""

    def method(self: Scalar, *others: object) -> Scalar:
        return self._of(name, *others)

    method.__name__ = name
    method.__doc__ = f"Return the result of np.{name} for this scalar."
    return method


def _operator(name: str, reflected: bool = False) -> Callable[[Scalar, object], Scalar]:
    """Return the operator of `Scalar` of this name; `reflected`: the one for a `Scalar` on the right."""
    compute = getattr(operator, name)
    operation = compute
    if reflected:  # `other` is on the left

        def operation(a: Value, b: Value) -> Value:
            return compute(b, a)

    return lambda self, other: self._after_operator(other, operation)


for _name in METHODS:
    setattr(Scalar, _name, _method(_name))
for _name in (*_BINARY_OPERATORS, *_COMPARISON_OPERATORS):
    setattr(Scalar, f"__{_name}__", _operator(_name))
for _name in _BINARY_OPERATORS:
    setattr(Scalar, f"__r{_name}__", _operator(_name, reflected=True))
