"""The conditions in a compiled function of the equations: what they compare, and which results depend on them."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import casadi as ca

from twin.core.spatial import Array
from twin.formula.contract import Formula
from twin.proof.degree import Truths
from twin.proof.formula_side import Outputs
from twin.proof.instructions import Instruction, instructions
from twin.proof.intervals import Intervals
from twin.proof.undefined_answers import undefined_answers

_REQUIRED = ("pose", "joints", "reach")
"""Outputs that must be numbers at a state within reach."""

_COMPARISON_MARGINS = {
    ca.OP_LT: lambda a, b: b - a,
    ca.OP_LE: lambda a, b: b - a,
    ca.OP_EQ: lambda a, b: -ca.fabs(a - b),
    ca.OP_NE: lambda a, b: ca.fabs(a - b),
}
"""Margins of comparisons, positive where they are true."""

_TRUE_AT_ZERO = (ca.OP_LE, ca.OP_EQ)
"""Comparisons that are true where their margin is 0."""

_CHOICE_MARGINS = {
    ca.OP_FABS: lambda a: a,
    ca.OP_FMIN: lambda a, b: b - a,
    ca.OP_FMAX: lambda a, b: a - b,
    ca.OP_COPYSIGN: lambda a, b: b,
    ca.OP_SIGN: lambda a: a,
}
"""Margins of operations that choose by themselves."""


@dataclass(frozen=True)
class EquationCondition:
    """A condition that chooses between expressions.

    Attributes:
        margin: positive where it is true, and negative where it is false, as an expression of state and parameters.
        at_zero: the answer where the margin is 0; None if it may be both.
        undefined: answers at which the equations have no value, or none that depends on the condition, at any state.
        effects: names of the results that depend on it, as "pose", "joints", "margin arm", "measure wrist".
    """

    margin: ca.SX
    at_zero: bool | None
    undefined: frozenset[bool]
    effects: frozenset[str]

    def has(self, answer: bool, margin: Array | Intervals) -> Truths:
        """Return where the answer certainly is a given one, by values or by intervals of the margin."""
        includes_zero = self.at_zero is answer
        if answer:
            if includes_zero:
                return margin >= 0
            return margin > 0
        if includes_zero:
            return margin <= 0
        return margin < 0

    @property
    def refuses(self) -> bool:
        """Whether a margin of reach depends on it: where that is not a number, the equations say "out of reach"."""
        return any(effect.startswith("margin ") for effect in self.effects)

    def only_affects(self, results: Collection[str]) -> bool:
        """Return whether no result but the given ones depends on it."""
        return bool(self.effects) and self.effects <= set(results)


def expressions_and_conditions(
    formula: Formula, outputs: Outputs, inputs: Sequence[ca.SX]
) -> tuple[dict[str, ca.SX], list[EquationCondition]]:
    """Return the outputs of the equations as expressions of inputs, by name, and the conditions in them.

    Args:
        formula: the equations.
        outputs: a function of them.
        inputs: expressions of the inputs of this function, as columns.
    """
    function = outputs.function
    results = []
    for output in range(function.n_out()):
        results.append(ca.SX.zeros(function.sparsity_out(output)))
    steps = instructions(function)
    walk = _Walk(inputs)
    for step in steps:
        if step.operation == ca.OP_OUTPUT:
            output, entry = step.port
            results[output].nz[entry] = walk.memory[step.operands[0]]  # nz: by instructions, zeros are left out
            walk.note_use(step)
        else:
            walk.take(step)
    required = set()
    for output, name in enumerate(outputs.names):
        if name in _REQUIRED:
            required.add(output)
    undefined = undefined_answers(steps, required, walk.choosing)
    effects = _effects(formula, outputs.names, steps, walk.choosing)
    conditions = []
    for number in sorted(walk.choosing):
        conditions.append(
            EquationCondition(walk.margins[number], walk.at_zero.get(number), undefined[number], effects[number])
        )
    return dict(zip(outputs.names, results, strict=True)), conditions


class _Walk:
    """A walk through the instructions of a function, which finds its conditions.

    Attributes:
        inputs: expressions of the inputs, as columns.
        memory: {place: expression of its value}.
        margins: {instruction of a condition: its margin}; also of conditions that are only parts of others.
        at_zero: {instruction of a condition: its answer where the margin is 0}; none of one with several parts.
        choosing: instructions of the conditions that choose between expressions.
    """

    def __init__(self, inputs: Sequence[ca.SX]) -> None:
        self.inputs = inputs
        self.memory: dict[int, ca.SX] = {}
        self.margins: dict[int, ca.SX] = {}
        self.at_zero: dict[int, bool | None] = {}
        self.choosing: set[int] = set()
        # {place: (instruction of the condition that is there, whether it is negated)}
        self._conditions: dict[int, tuple[int, bool]] = {}

    def take(self, step: Instruction) -> None:
        """Follow one instruction that is no output."""
        condition = None
        if step.operation == ca.OP_CONST:
            value = ca.SX(step.constant)
        elif step.operation == ca.OP_INPUT:
            number, entry = step.port
            value = self.inputs[number][entry]
        else:
            operands = [self.memory[place] for place in step.operands]
            condition = self._condition(step, operands)
            if condition is None:
                self.note_use(step)
            self._note_choice(step, operands)
            if len(operands) == 1:
                value = ca.SX.unary(step.operation, *operands)
            else:
                value = ca.SX.binary(step.operation, *operands)
        self.memory[step.target] = value
        self._conditions.pop(step.target, None)
        if condition is not None:
            self._conditions[step.target] = condition

    def note_use(self, step: Instruction) -> None:
        """Note the conditions that an instruction uses as numbers, to choose by, or as an output."""
        for place in step.operands:
            if place in self._conditions:
                instruction, _ = self._conditions[place]
                self.choosing.add(instruction)

    def _condition(self, step: Instruction, operands: Sequence[ca.SX]) -> tuple[int, bool] | None:
        """Return (instruction, whether it is negated) of the condition that an instruction gives; None if it is none.

        The margin of a new condition is kept.
        """
        operation = step.operation
        if operation in _COMPARISON_MARGINS:
            self.margins[step.number] = _COMPARISON_MARGINS[operation](*operands)
            self.at_zero[step.number] = operation in _TRUE_AT_ZERO
            return step.number, False
        if operation == ca.OP_NOT and step.operands[0] in self._conditions:
            instruction, is_negated = self._conditions[step.operands[0]]
            return instruction, not is_negated
        if operation in (ca.OP_AND, ca.OP_OR):
            first, second = map(self._margin_at, step.operands)
            # both are true where the smaller margin is positive, one of them where the larger one is
            if operation == ca.OP_AND:
                self.margins[step.number] = ca.fmin(first, second)
            else:
                self.margins[step.number] = ca.fmax(first, second)
            return step.number, False
        return None

    def _margin_at(self, place: int) -> ca.SX:
        """Return the margin of the condition at a place; a number is a condition that is false where it is 0."""
        if place not in self._conditions:
            return ca.fabs(self.memory[place])
        instruction, is_negated = self._conditions[place]
        if is_negated:
            return -self.margins[instruction]
        return self.margins[instruction]

    def _note_choice(self, step: Instruction, operands: Sequence[ca.SX]) -> None:
        """Note an instruction that is itself a condition which chooses."""
        operation = step.operation
        if operation in _CHOICE_MARGINS:
            self.margins[step.number] = _CHOICE_MARGINS[operation](*operands)
            self.at_zero[step.number] = False
            if operation in (ca.OP_COPYSIGN, ca.OP_SIGN):
                self.at_zero[step.number] = None  # 0 and -0 have different signs, and `sign` has a third result there
            self.choosing.add(step.number)
        elif operation == ca.OP_IF_ELSE_ZERO and step.operands[0] not in self._conditions:
            self.margins[step.number] = ca.fabs(operands[0])
            self.at_zero[step.number] = False
            self.choosing.add(step.number)


def _effects(
    formula: Formula, names: Sequence[str], steps: Sequence[Instruction], choosing: Collection[int]
) -> dict[int, frozenset[str]]:
    """Return, for each condition that chooses, the names of the results that depend on it; `names`: of the outputs."""
    conditions_at: dict[int, set[int]] = {}  # {place: conditions on which its value depends}
    results_of: dict[int, set[str]] = {}
    for number in choosing:
        results_of[number] = set()
    for step in steps:
        conditions: set[int] = set()
        for place in step.operands:
            conditions |= conditions_at.get(place, set())
        if step.operation == ca.OP_OUTPUT:
            output, entry = step.port
            result = _result_name(formula, names[output], entry)
            for condition in conditions:
                results_of[condition].add(result)
            continue
        if step.number in results_of:
            conditions.add(step.number)
        conditions_at[step.target] = conditions
    return {number: frozenset(results) for number, results in results_of.items()}


def _result_name(formula: Formula, output: str, entry: int) -> str:
    """Return the name of an entry of an output of the equations."""
    if output == "passive":
        return f"passive joint {formula.passive[entry]}"
    if output == "reach":
        return f"margin {list(formula.reach)[entry]}"
    if output == "measures":
        return f"measure {formula.measures[entry].name}"
    if output == "aspects":
        return f"aspect {formula.aspects[entry].symbol}"
    return output
