"""Repeat the operations of a compiled function with exact values."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import casadi as ca
import numpy as np

from twin.proof import values
from twin.proof.values import Angle, DrawnCondition, Truths, Value

_UNARY: dict[int, Callable[[Value], Value]] = {
    ca.OP_ASSIGN: lambda a: a,
    ca.OP_NEG: values.negative,
    ca.OP_SQ: lambda a: values.multiply(a, a),
    ca.OP_TWICE: lambda a: values.add(a, a),
    ca.OP_INV: lambda a: values.reciprocal(values.scalar(a)),
    ca.OP_SIN: lambda a: values.angle(a).sine,
    ca.OP_COS: lambda a: values.angle(a).cosine,
    ca.OP_TAN: lambda a: values.divide(values.angle(a).sine, values.angle(a).cosine),
    ca.OP_FABS: values.magnitude,
    ca.OP_SIGN: values.sign,
    ca.OP_NOT: lambda a: values.negated(values.truth(a)),
}

_BINARY: dict[int, Callable[[Value, Value], Value]] = {
    ca.OP_ADD: values.add,
    ca.OP_SUB: lambda a, b: values.add(a, values.negative(b)),
    ca.OP_MUL: values.multiply,
    ca.OP_DIV: values.divide,
    ca.OP_POW: values.power,
    ca.OP_CONSTPOW: values.power,
    ca.OP_LT: lambda a, b: values.compared("less", a, b),
    ca.OP_LE: lambda a, b: values.compared("at most", a, b),
    ca.OP_EQ: lambda a, b: values.compared("equal", a, b),
    ca.OP_NE: lambda a, b: values.negated(values.compared("equal", a, b)),
    ca.OP_AND: lambda a, b: values.both(values.truth(a), values.truth(b)),
    ca.OP_OR: lambda a, b: values.one_of(values.truth(a), values.truth(b)),
    ca.OP_FMIN: lambda a, b: values.choose(values.compared("at most", a, b), a, b),
    ca.OP_FMAX: lambda a, b: values.choose(values.compared("at most", b, a), a, b),
    ca.OP_IF_ELSE_ZERO: lambda a, b: values.choose(values.truth(a), b, values.constant(0.0, len(a.real))),
    ca.OP_COPYSIGN: lambda a, b: values.choose(
        values.compared("less", b, values.constant(0.0, len(b.real))),
        values.negative(values.magnitude(a)),
        values.magnitude(a),
    ),
}


_NAMES = {getattr(ca, name): name.removeprefix("OP_").lower() for name in dir(ca) if name.startswith("OP_")}


def _known(value: Value) -> bool:
    """Return whether a value is known in the field at any state; a constant is always an angle or a number."""
    if isinstance(value, DrawnCondition):
        return True
    if isinstance(value, Angle):
        return bool(value.cosine.known.any() and value.sine.known.any())
    return bool(value.known.any())


_CHOOSING: dict[int, Callable[..., Truths]] = {
    ca.OP_IF_ELSE_ZERO: lambda condition, chosen: values.truth(condition).real,
    ca.OP_FABS: lambda a: values.real_of(a) < 0,
    ca.OP_FMIN: lambda a, b: values.real_of(a) <= values.real_of(b),
    ca.OP_FMAX: lambda a, b: values.real_of(a) >= values.real_of(b),
}
"""Operations that choose between expressions, and which one they choose."""


@dataclass
class Notes:
    """What a proof must say of the repeated operations.

    Attributes:
        conditions: the answers (k,) of each condition that chooses between expressions.
        inexact: operations that are the first to make a value unknown in the field at all states.
    """

    conditions: list[Truths] = field(default_factory=list)
    inexact: list[str] = field(default_factory=list)


def replay(function: ca.Function, inputs: Sequence[Sequence[Value]], notes: Notes) -> list[list[Value]]:
    """Return the outputs of a function of scalars and vectors, one value for each entry, by columns.

    A value without an exact form is unknown in the field; `notes` are completed.
    """
    states = len(inputs[0][0].real)
    one = values.constant(1.0, states)
    memory: dict[int, Value] = {}
    outputs: list[list[Value]] = []
    for k in range(function.n_out()):
        outputs.append([values.constant(0.0, states)] * function.nnz_out(k))
    for k in range(function.n_instructions()):
        operation = function.instruction_id(k)
        targets = function.instruction_output(k)
        if operation == ca.OP_CONST:
            number = function.instruction_constant(k)
            memory[targets[0]] = values.constant(number, states)
            continue
        sources = function.instruction_input(k)
        if operation == ca.OP_INPUT:
            result = inputs[sources[0]][sources[1]]
        elif operation == ca.OP_OUTPUT:
            outputs[targets[0]][targets[1]] = memory[sources[0]]
            continue
        elif operation == ca.OP_SQRT:
            result = values.root(memory[sources[0]])
        elif operation == ca.OP_ACOS:
            result = values.of_cosine(memory[sources[0]])
        elif operation == ca.OP_ASIN:
            result = values.of_sine(memory[sources[0]])
        elif operation == ca.OP_ATAN:
            result = values.direction(memory[sources[0]], one)
        elif operation == ca.OP_ATAN2:
            result = values.direction(memory[sources[0]], memory[sources[1]])
        elif operation in _UNARY:
            result = _UNARY[operation](memory[sources[0]])
        elif operation in _BINARY:
            result = _BINARY[operation](memory[sources[0]], memory[sources[1]])
        else:
            result = values.unknown(np.full(states, np.nan))
        if not _known(result) and all(_known(memory[source]) for source in sources if operation != ca.OP_INPUT):
            notes.inexact.append(f"operation {_NAMES.get(operation, operation)}")
        if operation in _CHOOSING:
            notes.conditions.append(_CHOOSING[operation](*[memory[source] for source in sources]))
        memory[targets[0]] = result
    return outputs
