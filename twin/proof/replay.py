"""Repeat the operations of a compiled function with exact values."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import dataclass, field

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from twin.core.spatial import Array
from twin.proof import values
from twin.proof.values import Angle, DrawnCondition, RootMark, Truths, Value

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


_CHOOSING: dict[int, Callable[..., Truths]] = {
    ca.OP_IF_ELSE_ZERO: lambda condition, chosen: values.truth(condition).real,
    ca.OP_FABS: lambda a: values.real_of(a) < 0,
    ca.OP_FMIN: lambda a, b: values.real_of(a) <= values.real_of(b),
    ca.OP_FMAX: lambda a, b: values.real_of(a) >= values.real_of(b),
}
"""Operations that choose between expressions, and which one they choose."""

_ROOTS = (ca.OP_SQRT, ca.OP_ACOS, ca.OP_ASIN, ca.OP_ATAN, ca.OP_ATAN2)
"""Operations with a root in them."""


@dataclass
class Notes:
    """What a proof must say of the repeated operations.

    Attributes:
        conditions: the answers (k,) of each condition that chooses between expressions.
        inexact: operations that are the first to make a value unknown in the field at all states.
        roots: each root with the instruction that draws it.
        rootless: whether a constant has no root in the field; it may have one modulo another prime.
    """

    conditions: list[Truths] = field(default_factory=list)
    inexact: list[str] = field(default_factory=list)
    roots: list[tuple[RootMark, int]] = field(default_factory=list)
    rootless: bool = False


@dataclass
class RootedStates:
    """The states where some roots exist in the field: others are dropped at each root, so that a search is fast.

    Attributes:
        roots: instructions of the function with the roots.
        results: outputs of the function that are needed besides.
        places: (m,) of these states among the first ones.
    """

    roots: Collection[int]
    results: Collection[int]
    places: NDArray[np.integer]

    def needed(self, function: ca.Function) -> set[int]:
        """Return the instructions that roots and results need."""
        last: dict[int, int] = {}
        operands: dict[int, list[int]] = {}
        waiting = list(self.roots)
        for k in range(function.n_instructions()):
            operation = function.instruction_id(k)
            if operation not in (ca.OP_CONST, ca.OP_INPUT):
                operands[k] = [last[place] for place in function.instruction_input(k)]
            targets = function.instruction_output(k)
            if operation == ca.OP_OUTPUT:
                if targets[0] in self.results:
                    waiting.append(k)
                continue
            last[targets[0]] = k
        needed: set[int] = set()
        while waiting:
            k = waiting.pop()
            if k not in needed:
                needed.add(k)
                waiting += operands.get(k, [])
        return needed

    def narrowed(self, instruction: int, result: Value) -> NDArray[np.integer] | None:
        """Return the places (m,) of the states that stay after an instruction; None if all do."""
        if instruction not in self.roots:
            return None
        kept = values.known_at(result)
        if not kept.any() or kept.all():
            return None
        places = np.flatnonzero(kept)
        self.places = self.places[places]
        return places


def replay(
    function: ca.Function, inputs: Sequence[Sequence[Value]], notes: Notes, rooted: RootedStates | None = None
) -> list[list[Value]]:
    """Return the outputs of a function of scalars and vectors, one value for each entry, by columns.

    A value without an exact form is unknown in the field; `notes` are completed. If `rooted` is given, only what it
    needs is computed, and states without its roots are dropped.
    """
    states = len(inputs[0][0].real)
    one = values.constant(1.0, states)
    memory: dict[int, Value] = {}
    outputs: list[list[Value]] = []
    for k in range(function.n_out()):
        outputs.append([values.constant(0.0, states)] * function.nnz_out(k))
    steps: Iterable[int] = range(function.n_instructions())
    if rooted is not None:
        steps = sorted(rooted.needed(function))
    for k in steps:
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
            result = values.unknown(_real(operation, [memory[source] for source in sources]))
        operands = []
        if operation != ca.OP_INPUT:
            operands = [memory[source] for source in sources]
        _note(notes, operation, operands, result)
        notes.roots += [(mark, k) for mark in _roots(result) - set().union(*map(_roots, operands))]
        memory[targets[0]] = result
        kept = rooted and rooted.narrowed(k, result)
        if kept is not None:
            memory = {place: values.taken(value, kept) for place, value in memory.items()}
            inputs = [[values.taken(value, kept) for value in column] for column in inputs]
            outputs = [[values.taken(value, kept) for value in column] for column in outputs]
            one = values.number_at(one, kept)
            states = len(kept)
    return outputs


def _real(operation: int, operands: Sequence[Value]) -> Array:
    """Return the real values (k,) of an operation without an exact form, such as a logarithm."""
    symbols = [ca.SX.sym("x") for _ in operands]
    apply = ca.SX.unary if len(operands) == 1 else ca.SX.binary
    function = ca.Function("operation", symbols, [apply(operation, *symbols)])
    rows = [values.real_of(operand).reshape(1, -1) for operand in operands]
    return function.call(rows)[0].full()[0]


def _note(notes: Notes, operation: int, operands: Sequence[Value], result: Value) -> None:
    """Note which expressions an operation chooses, and whether it is the first that makes a value unknown."""
    if operation in _CHOOSING:
        notes.conditions.append(_CHOOSING[operation](*operands))
    if values.known_at(result).any() or not all(values.known_at(operand).any() for operand in operands):
        return
    if operation == ca.OP_INPUT:
        return  # a parameter, or a result of other equations, of which the reason is kept
    notes.inexact.append(f"operation {_NAMES.get(operation, operation)}")
    if operation in _ROOTS and all(_is_constant(operand) for operand in operands):
        notes.rootless = True


def _roots(value: Value) -> frozenset[RootMark]:
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
    return len(residues) >= values.ALIKE and bool((residues == residues[0]).all())
