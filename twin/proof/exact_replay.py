"""Repeat the operations of a compiled function with exact values.

A value has a real number and, in a prime field, a residue (`values`). Where an operation has no exact form, as a
logarithm, or one of its operands none, the value is unknown in the field: only its real number goes on.

A root is the result of a square root, also of one within an inverse trigonometric function. Where its argument is no
square modulo the prime, it is unknown in the field. The residues of its argument are its signature: roots whose
signatures are equal are one root (`degree.signature_of`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from twin.core.spatial import Array
from twin.proof import values
from twin.proof.degree import ALIKE, RootSignature, Truths
from twin.proof.instructions import OPERATION_NAMES, Instruction, instructions
from twin.proof.narrowed_states import NarrowedStates
from twin.proof.values import Angle, DrawnCondition, Value


def _with_sign_of(a: Value, b: Value) -> Value:
    """Return |a| with the sign of b."""
    size = values.magnitude(a)
    is_negative = values.compared("less", b, values.constant(0.0, len(b.real)))
    return values.choose(is_negative, values.negative(size), size)


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
    ca.OP_SQRT: values.root,
    ca.OP_ACOS: values.of_cosine,
    ca.OP_ASIN: values.of_sine,
    ca.OP_ATAN: lambda a: values.direction(a, values.constant(1.0, len(a.real))),
}
"""Operations of one operand."""

_BINARY: dict[int, Callable[[Value, Value], Value]] = {
    ca.OP_ADD: values.add,
    ca.OP_SUB: lambda a, b: values.add(a, values.negative(b)),
    ca.OP_MUL: values.multiply,
    ca.OP_DIV: values.divide,
    ca.OP_ATAN2: values.direction,
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
    ca.OP_COPYSIGN: _with_sign_of,
}
"""Operations of two operands."""


_CHOOSING: dict[int, Callable[..., Truths]] = {
    ca.OP_IF_ELSE_ZERO: lambda condition, chosen: values.truth(condition).real,
    ca.OP_FABS: lambda a: values.real_of(a) < 0,
    ca.OP_FMIN: lambda a, b: values.real_of(a) <= values.real_of(b),
    ca.OP_FMAX: lambda a, b: values.real_of(a) >= values.real_of(b),
    ca.OP_COPYSIGN: lambda size, signed: values.real_of(signed) < 0,
    ca.OP_SIGN: lambda a: values.real_of(a) < 0,
}
"""Operations that choose between expressions, and which one they choose."""

_OF_CONDITIONS = (ca.OP_NOT, ca.OP_AND, ca.OP_OR)
"""Operations of conditions whose result is a condition, which may choose in its turn."""

_ROOTS = (ca.OP_SQRT, ca.OP_ACOS, ca.OP_ASIN, ca.OP_ATAN, ca.OP_ATAN2)
"""Operations with a root in them."""


@dataclass
class Notes:
    """What a proof must say of the repeated operations.

    Attributes:
        conditions: the answers (k,) of each condition that chooses between expressions or is used as a number.
        inexact: operations that are the first to make a value unknown in the field at all states.
        roots: each root with the instruction that draws it.
        rootless: whether a constant has no root in the field; it may have one modulo another prime.
    """

    conditions: list[Truths] = field(default_factory=list)
    inexact: list[str] = field(default_factory=list)
    roots: list[tuple[RootSignature, int]] = field(default_factory=list)
    rootless: bool = False


def replay(
    function: ca.Function, inputs: Sequence[Sequence[Value]], notes: Notes, narrowed: NarrowedStates | None = None
) -> list[list[Value]]:
    """Return the outputs of a function of scalars and vectors, one value for each entry, by columns.

    `notes` are completed. If `narrowed` is given, only what it needs is computed, and states without its roots are
    dropped.
    """
    states = len(inputs[0][0].real)
    memory: dict[int, Value] = {}
    outputs: list[list[Value]] = []
    for number in range(function.n_out()):
        outputs.append([values.constant(0.0, states)] * function.nnz_out(number))
    steps = instructions(function)
    if narrowed is not None:
        steps = narrowed.needed(steps)
    for step in steps:
        if step.operation == ca.OP_OUTPUT:
            output, entry = step.port
            outputs[output][entry] = memory[step.operands[0]]
            continue
        if step.operation == ca.OP_CONST:
            memory[step.target] = values.constant(step.constant, states)
            continue
        operands = [memory[place] for place in step.operands]
        if step.operation == ca.OP_INPUT:
            number, entry = step.port
            result = inputs[number][entry]
        else:
            result = _result(step.operation, operands)
        _note(notes, step, operands, result)
        memory[step.target] = result
        kept_places = None
        if narrowed is not None:
            kept_places = narrowed.narrow(step.number, result)
        if kept_places is not None:
            for place, value in memory.items():
                memory[place] = values.taken(value, kept_places)
            inputs = _columns_at(inputs, kept_places)
            outputs = _columns_at(outputs, kept_places)
            states = len(kept_places)
    return outputs


def _columns_at(columns: Sequence[Sequence[Value]], places: NDArray[np.integer]) -> list[list[Value]]:
    """Return columns of values at some of their states, given by their places (m,)."""
    return [[values.taken(value, places) for value in column] for column in columns]


def _result(operation: int, operands: Sequence[Value]) -> Value:
    """Return the result of an operation; one without an exact form is unknown in the field."""
    if operation in _UNARY:
        return _UNARY[operation](operands[0])
    if operation in _BINARY:
        return _BINARY[operation](operands[0], operands[1])
    return values.unknown(_real(operation, operands))


def _real(operation: int, operands: Sequence[Value]) -> Array:
    """Return the real values (k,) of an operation without an exact form, such as a logarithm."""
    x = ca.SX.sym("x")
    y = ca.SX.sym("y")
    if len(operands) == 1:
        function = ca.Function("operation", [x], [ca.SX.unary(operation, x)])
    else:
        function = ca.Function("operation", [x, y], [ca.SX.binary(operation, x, y)])
    rows = []
    for operand in operands:
        rows.append(values.real_of(operand).reshape(1, -1))  # one column for each state
    return function.call(rows)[0].full()[0]


def _note(notes: Notes, step: Instruction, operands: Sequence[Value], result: Value) -> None:
    """Note which expressions an instruction chooses, its root, and whether it is the first without an exact value."""
    operation = step.operation
    notes.conditions += _answers(operation, operands)
    old_roots: set[RootSignature] = set()
    for operand in operands:
        old_roots |= _roots(operand)
    for root_signature in _roots(result) - old_roots:
        notes.roots.append((root_signature, step.number))
    if values.known_at(result).any():
        return
    for operand in operands:
        if not values.known_at(operand).any():
            return  # another operation, before this one, is the reason
    if operation == ca.OP_INPUT:
        return  # a parameter, or a result of other equations, of which the reason is kept
    notes.inexact.append(f"operation {OPERATION_NAMES.get(operation, operation)}")
    if operation in _ROOTS and all(map(_is_constant, operands)):
        notes.rootless = True


def _answers(operation: int, operands: Sequence[Value]) -> Iterator[Truths]:
    """Yield the answers (k,) of the conditions by which an operation chooses, or that it uses as numbers."""
    if operation in _CHOOSING:
        yield _CHOOSING[operation](*operands)
    if operation in _OF_CONDITIONS:
        return
    numbers = operands
    if operation == ca.OP_IF_ELSE_ZERO:
        numbers = operands[1:]
    for number in numbers:
        if isinstance(number, DrawnCondition):
            yield number.real


def _roots(value: Value) -> frozenset[RootSignature]:
    """Return the roots in a value."""
    if isinstance(value, Angle):
        return value.cosine.degree.roots | value.sine.degree.roots
    if isinstance(value, DrawnCondition):
        return frozenset()
    return value.degree.roots


def _is_constant(value: Value) -> bool:
    """Return whether a value is the same at all states where it is known."""
    number = values.scalar(value)
    residues = number.residue[number.known]
    return len(residues) >= ALIKE and bool((residues == residues[0]).all())
