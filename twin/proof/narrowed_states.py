"""States of a repeated function, narrowed to those where some of its roots exist in the field."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from twin.proof import values
from twin.proof.instructions import Instruction
from twin.proof.values import Value


@dataclass
class NarrowedStates:
    """The states where some roots exist in the field: others are dropped at each root, so that a search is fast.

    Attributes:
        roots: instructions of the function with the roots.
        results: outputs of the function that are needed besides.
        places: (m,) of these states among the first ones.
    """

    roots: Collection[int]
    results: Collection[int]
    places: NDArray[np.integer]

    def needed(self, steps: Sequence[Instruction]) -> list[Instruction]:
        """Return those of the instructions of the function that roots and results need, in their order."""
        writers: dict[int, int] = {}  # {place: instruction that wrote it last}
        sources: dict[int, list[int]] = {}  # {instruction: those whose results it reads}
        waiting = list(self.roots)
        for step in steps:
            sources[step.number] = [writers[place] for place in step.operands]
            if step.operation != ca.OP_OUTPUT:
                writers[step.target] = step.number
                continue
            output, _ = step.port
            if output in self.results:
                waiting.append(step.number)
        needed: set[int] = set()
        while waiting:
            number = waiting.pop()
            if number not in needed:
                needed.add(number)
                waiting += sources[number]
        return [step for step in steps if step.number in needed]

    def narrow(self, instruction: int, result: Value) -> NDArray[np.integer] | None:
        """Drop the states without the root of an instruction, unless none has it.

        Returns:
            the places (m,) of the states that stay, among those before the instruction; None if all do.
        """
        if instruction not in self.roots:
            return None
        has_root = values.known_at(result)
        if not has_root.any() or has_root.all():
            return None
        places = np.flatnonzero(has_root)
        self.places = self.places[places]
        return places
