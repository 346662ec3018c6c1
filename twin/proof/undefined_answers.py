"""Answers of conditions that leave no value: equations write "not a number" where they are not defined.

The instructions are followed with one answer given: which places are not a number then, at any state.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence

import casadi as ca
import numpy as np

from twin.proof.instructions import Instruction

_CONDITIONS = (ca.OP_LT, ca.OP_LE, ca.OP_EQ, ca.OP_NE, ca.OP_AND, ca.OP_OR)
"""Operations whose result is a condition."""

_PASSING = (
    *(ca.OP_ASSIGN, ca.OP_NEG, ca.OP_ADD, ca.OP_SUB, ca.OP_MUL, ca.OP_DIV, ca.OP_SQ, ca.OP_TWICE, ca.OP_INV),
    *(ca.OP_SQRT, ca.OP_SIN, ca.OP_COS, ca.OP_TAN, ca.OP_ASIN, ca.OP_ACOS, ca.OP_ATAN, ca.OP_ATAN2, ca.OP_FABS),
)
"""Operations whose result is not a number if an operand is none."""


def undefined_answers(
    steps: Sequence[Instruction], required: Collection[int], conditions: Collection[int]
) -> dict[int, frozenset[bool]]:
    """Return, for each condition, its answers that leave nothing to judge; see `_leaves_nothing`.

    Args:
        steps: instructions of the equations.
        required: numbers of the outputs that are numbers at states within reach.
        conditions: instructions of the conditions.
    """
    has_undefined = any(step.operation == ca.OP_CONST and np.isnan(step.constant) for step in steps)
    undefined = {}
    for number in conditions:
        answers = set()
        # most equations write no "not a number": then no answer needs a look at all instructions
        if has_undefined and steps[number].operation in _CONDITIONS:
            for answer in (False, True):
                if _leaves_nothing(steps, required, number, answer):
                    answers.add(answer)
        undefined[number] = frozenset(answers)
    return undefined


def _leaves_nothing(steps: Sequence[Instruction], required: Collection[int], condition: int, answer: bool) -> bool:
    """Return whether an answer of a condition leaves nothing to judge.

    So it is if a required output is not a number then, or if none of the outputs that depend on the condition is one.

    Args:
        steps: instructions of the equations.
        required: numbers of the outputs that are numbers at states within reach.
        condition: instruction of the condition.
        answer: its answer.
    """
    known_answers: dict[int, bool] = {}  # {place: answer of the condition there}, where it is known
    undefined: set[int] = set()  # places that are not a number
    dependent: set[int] = set()  # places that depend on the condition
    with_value = 0
    without_value = 0
    for step in steps:
        if step.operation == ca.OP_OUTPUT:
            source = step.operands[0]
            output, _ = step.port
            if output in required and source in undefined:
                return True
            if source in dependent:
                without_value += source in undefined
                with_value += source not in undefined
            continue
        is_undefined = _is_undefined(step, undefined, known_answers)
        known_answer = None
        if step.number == condition:
            known_answer = answer
            is_undefined = False
        elif step.operation == ca.OP_NOT and step.operands[0] in known_answers:
            known_answer = not known_answers[step.operands[0]]
        depends = step.number == condition or not dependent.isdisjoint(step.operands)
        _set_member(dependent, step.target, depends)
        _set_member(undefined, step.target, is_undefined)
        known_answers.pop(step.target, None)
        if known_answer is not None:
            known_answers[step.target] = known_answer
    return without_value > 0 and not with_value


def _is_undefined(step: Instruction, undefined: Collection[int], known_answers: dict[int, bool]) -> bool:
    """Return whether the result of an instruction is not a number, as far as its operands tell."""
    if step.operation == ca.OP_CONST:
        return bool(np.isnan(step.constant))
    if step.operation == ca.OP_IF_ELSE_ZERO:
        condition, chosen = step.operands
        return known_answers.get(condition, False) and chosen in undefined
    if step.operation in _PASSING:
        return any(place in undefined for place in step.operands)
    return False


def _set_member(places: set[int], place: int, is_member: bool) -> None:
    """Add a place to a set, or take it away: its old value is overwritten."""
    if is_member:
        places.add(place)
    else:
        places.discard(place)
