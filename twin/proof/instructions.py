"""The instructions of a compiled function of scalars, in the order in which they are carried out.

A compiled function works on a memory of numbered places: each instruction reads some places, and writes one.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca


@dataclass(frozen=True)
class Instruction:
    """One instruction.

    Attributes:
        number: its place in the order of instructions.
        operation: CasADi's number of what it does, as `ca.OP_ADD`.
        operands: places of memory that it reads; none of a constant and of an input.
        target: place of memory that it writes; -1 of an output.
        port: for an input or an output: (number of the input or output, entry of it).
        constant: the number that it writes, if it is a constant.
    """

    number: int
    operation: int
    operands: tuple[int, ...]
    target: int = -1
    port: tuple[int, int] = (-1, -1)
    constant: float = 0.0


def _operation_names() -> dict[int, str]:
    """Return {CasADi's number of an operation: its name, as "log"}."""
    names = {}
    for constant in dir(ca):
        if constant.startswith("OP_"):
            names[getattr(ca, constant)] = constant.removeprefix("OP_").lower()
    return names


OPERATION_NAMES = _operation_names()
"""{CasADi's number of an operation: its name, as "log"}."""


def instructions(function: ca.Function) -> list[Instruction]:
    """Return the instructions of a function of scalars and vectors."""
    steps = []
    for number in range(function.n_instructions()):
        operation = function.instruction_id(number)
        results = function.instruction_output(number)
        operands = tuple(function.instruction_input(number))
        if operation == ca.OP_CONST:
            step = Instruction(number, operation, (), results[0], constant=function.instruction_constant(number))
        elif operation == ca.OP_INPUT:
            # CasADi gives number and entry of an input where others have operands: they are not places of memory.
            step = Instruction(number, operation, (), results[0], port=(operands[0], operands[1]))
        elif operation == ca.OP_OUTPUT:
            step = Instruction(number, operation, operands, port=(results[0], results[1]))
        else:
            step = Instruction(number, operation, operands, results[0])
        steps.append(step)
    return steps
