"""Evaluate a compiled function, such as that of the equations, on arrays of intervals.

    from twin.proof.interval_function import IntervalFunction
    f = IntervalFunction(function)                  # a CasADi function of scalars and vectors
    (position, angles) = f([[x, y], [length]])      # inputs by columns; arrays of intervals of any equal shape
    slopes = IntervalFunction(function.jacobian())  # derivatives, for bounds of first order

Nothing of CasADi is trusted but the list of its operations: `twin.proof.intervals` computes each of them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import casadi as ca
import numpy as np

from twin.proof import intervals
from twin.proof.instructions import instructions
from twin.proof.intervals import Certainty, Intervals

_CONSTANT_ROUNDING = 2.0**-50
"""Relative error of a constant that is no small binary fraction: a decimal, pi, or a root that was computed."""

_EXACT_STEPS = 1024.0
"""Multiples of the reciprocal of this are taken as they are."""

_NO_RESULT = -1
"""Instead of the number of a result, for an entry that no instruction writes: it is 0."""


def constant(value: float) -> Intervals:
    """Return a constant of the equations; one that is no multiple of 1/1024 has been rounded."""
    if not math.isfinite(value):
        return intervals.unknown(())
    if value * _EXACT_STEPS == round(value * _EXACT_STEPS):
        return intervals.exactly(value)
    return intervals.around(value, abs(value) * _CONSTANT_ROUNDING)


def _truth(certain: Certainty, possible: Certainty) -> Intervals:
    """Return a condition as a number: 1 if it is certain, 0 if it is impossible, else from 0 to 1."""
    return Intervals(certain.astype(float), possible.astype(float))


# each answer is certain if it holds for all values of both intervals, and possible if its opposite is not certain


def _less(a: Intervals, b: Intervals) -> Intervals:
    return _truth(a < b, ~(a >= b))


def _at_most(a: Intervals, b: Intervals) -> Intervals:
    return _truth(a <= b, ~(a > b))


def _equal(a: Intervals, b: Intervals) -> Intervals:
    certain = (a.low == a.high) & (a.low == b.low) & (b.low == b.high)
    return _truth(certain, ~((a < b) | (a > b)))


def _negated(a: Intervals) -> Intervals:
    """Return "not a"; a number counts as true if it is not 0."""
    return _equal(a, intervals.exactly(0.0))


def _as_truth(a: Intervals) -> Intervals:
    return _negated(_negated(a))


def _both(a: Intervals, b: Intervals) -> Intervals:
    return intervals.smaller(_as_truth(a), _as_truth(b))


def _one_of(a: Intervals, b: Intervals) -> Intervals:
    return intervals.larger(_as_truth(a), _as_truth(b))


def _if_else_zero(condition: Intervals, chosen: Intervals) -> Intervals:
    """Return the chosen value where the condition is true, 0 where it is not, and both where that is open."""
    truth = _as_truth(condition)
    low = np.where(truth.low == 1, chosen.low, np.minimum(chosen.low, 0.0))
    high = np.where(truth.low == 1, chosen.high, np.maximum(chosen.high, 0.0))
    impossible = truth.high == 0
    return Intervals(np.where(impossible, 0.0, low), np.where(impossible, 0.0, high))


def _sign(a: Intervals) -> Intervals:
    return Intervals(np.sign(a.low), np.sign(a.high))


def _copysign(a: Intervals, b: Intervals) -> Intervals:
    """Return |a| with the sign of b; where b may be 0, both signs, because a zero has one."""
    size = abs(a)
    positive = b > 0
    negative = b < 0
    low = np.where(positive, size.low, -size.high)
    high = np.where(negative, -size.low, size.high)
    return Intervals(low, high)


_UNARY: dict[int, Callable[[Intervals], Intervals]] = {
    ca.OP_ASSIGN: lambda a: a,
    ca.OP_NEG: lambda a: -a,
    ca.OP_SQ: intervals.square,
    ca.OP_TWICE: lambda a: a * 2.0,
    ca.OP_INV: lambda a: 1.0 / a,
    ca.OP_SQRT: intervals.root,
    ca.OP_SIN: intervals.sine,
    ca.OP_COS: intervals.cosine,
    ca.OP_TAN: intervals.tangent,
    ca.OP_ASIN: intervals.arcsine,
    ca.OP_ACOS: intervals.arccosine,
    ca.OP_ATAN: intervals.arctangent,
    ca.OP_EXP: intervals.exponential,
    ca.OP_LOG: intervals.logarithm,
    ca.OP_FABS: abs,
    ca.OP_SIGN: _sign,
    ca.OP_NOT: _negated,
}

_BINARY_OPERATIONS: dict[int, Callable[[Intervals, Intervals], Intervals]] = {
    ca.OP_ADD: lambda a, b: a + b,
    ca.OP_SUB: lambda a, b: a - b,
    ca.OP_MUL: lambda a, b: a * b,
    ca.OP_DIV: lambda a, b: a / b,
    ca.OP_ATAN2: intervals.direction,
    ca.OP_FMIN: intervals.smaller,
    ca.OP_FMAX: intervals.larger,
    ca.OP_LT: _less,
    ca.OP_LE: _at_most,
    ca.OP_EQ: _equal,
    ca.OP_NE: lambda a, b: _negated(_equal(a, b)),
    ca.OP_AND: _both,
    ca.OP_OR: _one_of,
    ca.OP_IF_ELSE_ZERO: _if_else_zero,
    ca.OP_COPYSIGN: _copysign,
}


class IntervalFunction:
    """A function whose operations are repeated on intervals.

    Attributes:
        function: the compiled function.
    """

    def __init__(self, function: ca.Function) -> None:
        self.function = function
        self._constants: dict[int, Intervals] = {}  # {number of a result: its value}
        self._inputs: list[tuple[int, int, int]] = []  # number of a result, of the input, and of the entry of this
        self._steps: list[tuple[int, int, tuple[int, ...]]] = []  # number of a result, operation, results it reads
        self._outputs: list[list[int]] = []  # number of the result that is each entry
        for output in range(function.n_out()):
            self._outputs.append([_NO_RESULT] * function.nnz_out(output))
        # each result has a number of its own, that of its instruction: work that is used again would need copies
        result_at: dict[int, int] = {}  # {place of memory: number of the result that is there}
        for step in instructions(function):
            operands = tuple(result_at[place] for place in step.operands)
            if step.operation == ca.OP_OUTPUT:
                output, entry = step.port
                self._outputs[output][entry] = operands[0]
                continue
            if step.operation == ca.OP_CONST:
                self._constants[step.number] = constant(step.constant)
            elif step.operation == ca.OP_INPUT:
                self._inputs.append((step.number, *step.port))
            else:
                self._steps.append((step.number, step.operation, operands))
            result_at[step.target] = step.number

    def __call__(self, inputs: Sequence[Sequence[Intervals]]) -> list[list[Intervals]]:
        """Return the outputs, one array of intervals for each entry, by columns.

        An output that depends on no input has the shape (). An operation without bounds, such as a remainder, gives an
        unknown interval.
        """
        results = dict(self._constants)
        for number, column, entry in self._inputs:
            results[number] = inputs[column][entry]
        for number, operation, sources in self._steps:
            operands = [results[source] for source in sources]
            results[number] = _evaluated(operation, operands)
        results[_NO_RESULT] = intervals.exactly(0.0)
        return [list(map(results.__getitem__, numbers)) for numbers in self._outputs]


def _evaluated(operation: int, operands: list[Intervals]) -> Intervals:
    """Return the result of an operation."""
    if operation in _UNARY:
        return _UNARY[operation](operands[0])
    if operation in _BINARY_OPERATIONS:
        return _BINARY_OPERATIONS[operation](operands[0], operands[1])
    if operation in (ca.OP_POW, ca.OP_CONSTPOW):
        exponent = operands[1]
        if exponent.shape == () and exponent.low == exponent.high:
            return intervals.power(operands[0], float(exponent.low))
        return intervals.exponential(exponent * intervals.logarithm(operands[0]))
    return intervals.unknown(operands[0].shape)
