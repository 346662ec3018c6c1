"""The operations behind a value, so that a certificate can repeat them without the prover.

A step is an operation or a constant. Steps are a graph: several may have one step as operand. A certificate has them as
rows, in an order in which operands come first.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

from twin.proof.constants import ExactNumber

Row = list[str | int]
"""A step as a certificate states it: its name, then its text, or the numbers of the rows of its operands."""

_ZERO = "0*sqrt(1)"
"""Text of the constant 0."""

_ONE = "1*sqrt(1)"
"""Text of the constant 1."""


@dataclass(frozen=True, eq=False)
class ProgramStep:
    """An operation or a constant.

    Attributes:
        name: "number" (a constant), "real" (a constant without an exact form), "input" (a random fraction), "cosine"
            and "sine" (of a random angle), "add", "multiply", "negative", "inverse", "root", "angle" (rad, of a cosine
            and a sine; a real value alone), "less", "at most", "equal", "both", "one of", "not", and "choose" (the
            second operand where the first is true, else the third).
        operands: the steps whose values it takes; none of a constant and of a random number.
        text: of a constant, as that of `number`, or name of a random number.
    """

    name: str
    operands: tuple[ProgramStep, ...] = field(default=(), repr=False)
    text: str = ""


def number(value: ExactNumber) -> ProgramStep:
    """Return a constant; its text is as "1/2*sqrt(3) + 5*sqrt(1)", which certificates and `precise` read."""
    words = []
    for radicand, fraction in value.parts:
        words.append(f"{fraction}*sqrt({radicand})")
    return ProgramStep("number", text=" + ".join(words) or _ZERO)


def is_zero(step: ProgramStep | None) -> bool:
    """Return whether a value is the constant 0."""
    return step is not None and step.text == _ZERO


def is_one(step: ProgramStep | None) -> bool:
    """Return whether a value is the constant 1."""
    return step is not None and step.text == _ONE


def operation(name: str, *operands: ProgramStep | None) -> ProgramStep | None:
    """Return the step of an operation; None if an operand is unknown.

    What adds 0 or multiplies by 0 or 1 is left out.
    """
    known_operands = []
    for operand in operands:
        if operand is None:
            return None
        known_operands.append(operand)
    # Most entries of poses are 0 or 1: operations with these would only make certificates longer.
    if name in ("add", "multiply"):
        first, second = known_operands
        for factor, remaining_operand in ((first, second), (second, first)):
            if name == "add" and factor.text == _ZERO:
                return remaining_operand
            if name == "multiply" and factor.text == _ONE:
                return remaining_operand
            if name == "multiply" and factor.text == _ZERO:
                return factor
    if name == "negative" and known_operands[0].text == _ZERO:
        return known_operands[0]
    return ProgramStep(name, tuple(known_operands))


def depends(results: Iterable[ProgramStep]) -> bool:
    """Return whether one of some results depends on the state."""
    waiting = list(results)
    visited: set[int] = set()
    while waiting:
        step = waiting.pop()
        if id(step) in visited:
            continue
        visited.add(id(step))
        if step.name in ("input", "cosine", "sine"):
            return True
        waiting += step.operands
    return False


def rows(results: Iterable[ProgramStep]) -> tuple[list[Row], list[int]]:
    """Return all steps that results need as rows, operands first, and the number of the row of each result."""
    # by identity: a step that two results share is one row, and comparing operands would walk all of them
    places: dict[int, int] = {}  # {id of a step: number of its row}
    all_rows: list[Row] = []
    result_steps = list(results)
    for result in result_steps:
        # depth first without recursion, because a formula has thousands of operations in a chain
        waiting = [result]
        while waiting:
            step = waiting[-1]
            if id(step) in places:
                waiting.pop()
                continue
            open_operands = [operand for operand in step.operands if id(operand) not in places]
            if open_operands:
                waiting += open_operands
                continue
            waiting.pop()
            places[id(step)] = len(all_rows)
            row: Row = [step.name]
            if step.operands:
                row += [places[id(operand)] for operand in step.operands]
            else:
                row.append(step.text)
            all_rows.append(row)
    numbers_of_results = [places[id(result)] for result in result_steps]
    return all_rows, numbers_of_results
