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
from dataclasses import dataclass

import casadi as ca
import numpy as np

from twin.proof import intervals
from twin.proof.intervals import Certainty, Intervals

_ROUNDED = 2.0**-50
"""Relative error of a constant that is no small binary fraction: a decimal, pi, or a root that was computed."""

_BINARY = 1024.0
"""Multiples of the reciprocal of this are taken as they are."""


def constant(value: float) -> Intervals:
    """Return a constant of the equations; one that is no multiple of 1/1024 has been rounded."""
    if not math.isfinite(value):
        return intervals.unknown(())
    if value * _BINARY == round(value * _BINARY):
        return intervals.exactly(value)
    return intervals.around(value, abs(value) * _ROUNDED)


def _truth(certain: Certainty, possible: Certainty) -> Intervals:
    """Return a condition as a number: 1 if it is certain, 0 if it is impossible, else from 0 to 1."""
    return Intervals(certain.astype(float), possible.astype(float))


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


@dataclass(frozen=True)
class _Step:
    """An operation: its code, the number of the value that it writes, those that it reads, and its constant."""

    operation: int
    target: int
    sources: tuple[int, ...]
    number: float = 0.0


class IntervalFunction:
    """A function whose operations are repeated on intervals.

    Attributes:
        function: the compiled function.
    """

    def __init__(self, function: ca.Function) -> None:
        self.function = function
        self._constants: dict[int, Intervals] = {}
        self._steps: list[_Step] = []
        self._inputs: list[tuple[int, int, int]] = []
        self._outputs: list[list[int]] = [[-1] * function.nnz_out(k) for k in range(function.n_out())]
        # each result has a number of its own: work that is used again would need copies
        place: dict[int, int] = {}
        for k in range(function.n_instructions()):
            operation = function.instruction_id(k)
            targets = function.instruction_output(k)
            sources = function.instruction_input(k)
            if operation == ca.OP_OUTPUT:
                self._outputs[targets[0]][targets[1]] = place[sources[0]]
                continue
            if operation == ca.OP_CONST:
                self._constants[k] = constant(function.instruction_constant(k))
            elif operation == ca.OP_INPUT:
                self._inputs.append((k, sources[0], sources[1]))
            else:
                self._steps.append(_Step(operation, k, tuple(place[source] for source in sources)))
            place[targets[0]] = k

    def __call__(self, inputs: Sequence[Sequence[Intervals]]) -> list[list[Intervals]]:
        """Return the outputs, one array of intervals for each entry, by columns.

        An output that depends on no input has the shape (). An operation without bounds, such as a remainder, gives an
        unknown interval.
        """
        results = dict(self._constants)
        for number, which, entry in self._inputs:
            results[number] = inputs[which][entry]
        for step in self._steps:
            operands = [results[source] for source in step.sources]
            results[step.target] = _evaluated(step.operation, operands)
        zero = intervals.exactly(0.0)
        outputs = []
        for places in self._outputs:
            outputs.append([results[place] if place >= 0 else zero for place in places])
        return outputs


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
