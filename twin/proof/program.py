"""The operations behind a value, so that a certificate can repeat them without the prover."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

from twin.proof.constants import ExactNumber

Row = list[str | int]
"""An operation of a certificate: its name, then a text, or the numbers of the rows of its operands."""


@dataclass(frozen=True, eq=False)
class ProgramStep:
    """An operation.

    Attributes:
        name: "number" (a constant), "real" (a constant without an exact form), "input" (a random fraction), "cosine"
            and "sine" (of a random angle), "add", "multiply", "negative", "inverse", "root", "angle" (rad, of a cosine
            and a sine; a real value alone), "less", "at most", "equal", "both", "one of", "not", and "choose" (the
            second operand where the first is true, else the third).
        operands: nodes of its operands.
        text: of a constant, or name of a random number.
    """

    name: str
    operands: tuple[ProgramStep, ...] = field(default=(), repr=False)
    text: str = ""


def number(value: ExactNumber) -> ProgramStep:
    """Return a constant, as "1/2*sqrt(3) + 5"."""
    words = [f"{fraction}*sqrt({radicand})" for radicand, fraction in value.parts]
    return ProgramStep("number", text=" + ".join(words) or _ZERO)


_ZERO = "0*sqrt(1)"
_ONE = "1*sqrt(1)"


def is_zero(node: ProgramStep | None) -> bool:
    """Return whether a value is the constant 0."""
    return node is not None and node.text == _ZERO


def is_one(node: ProgramStep | None) -> bool:
    """Return whether a value is the constant 1."""
    return node is not None and node.text == _ONE


def operation(name: str, *operands: ProgramStep | None) -> ProgramStep | None:
    """Return an operation; None if an operand is unknown. What adds 0 or multiplies by 0 or 1 is left out."""
    known = [operand for operand in operands if operand is not None]
    if len(known) != len(operands):
        return None
    if name in ("add", "multiply"):
        first, second = known
        for one, other in ((first, second), (second, first)):
            if name == "add" and one.text == _ZERO:
                return other
            if name == "multiply" and one.text == _ONE:
                return other
            if name == "multiply" and one.text == _ZERO:
                return one
    if name == "negative" and known[0].text == _ZERO:
        return known[0]
    return ProgramStep(name, tuple(known))


def depends(nodes: Iterable[ProgramStep]) -> bool:
    """Return whether one of some results depends on the state."""
    waiting = list(nodes)
    seen: set[int] = set()
    while waiting:
        node = waiting.pop()
        if id(node) in seen:
            continue
        seen.add(id(node))
        if node.name in ("input", "cosine", "sine"):
            return True
        waiting += node.operands
    return False


def rows(results: Iterable[ProgramStep]) -> tuple[list[Row], list[int]]:
    """Return all operations that results need, operands first, and the number of the row of each result."""
    places: dict[int, int] = {}
    found: list[Row] = []
    kept = list(results)
    for result in kept:
        # depth first without recursion, because a formula has thousands of operations in a chain
        waiting = [result]
        while waiting:
            node = waiting[-1]
            if id(node) in places:
                waiting.pop()
                continue
            open_operands = [operand for operand in node.operands if id(operand) not in places]
            if open_operands:
                waiting += open_operands
                continue
            waiting.pop()
            places[id(node)] = len(found)
            operands = [places[id(operand)] for operand in node.operands]
            found.append([node.name, *(operands or [node.text])])
    return found, [places[id(result)] for result in kept]
