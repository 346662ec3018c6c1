"""Evaluate the whole formula file after edits: how many rows are wrong, and whether rows agree only by chance."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from twin.formula.contract import Formula
from twin.validation.explain.edited_formula import edited_formula
from twin.validation.explain.equation_steps import RowKey
from twin.validation.explain.function_source import Edit
from twin.validation.explain.parameter_coincidences import closes, coincidences, condition
from twin.validation.explain.row_deviations import Judge, worst

_WORSE = 1.001
"""An edit is refused if the residual of a row is larger than before by this factor."""


@dataclass(frozen=True)
class FormulaState:
    """State of a whole formula after edits: number of wrong rows, and whether it holds only by chance.

    By chance means: only for the present values of equal or assumed parameters; see `varied`. `chance` is the
    condition, "because a = b"; "" if the formula holds in general. `worse`: whether a row is further off than before.
    `failing`: the wrong rows.
    """

    wrong: int
    chance: str
    worse: bool = False
    failing: frozenset[RowKey] = frozenset()


def is_worse(base: Mapping[RowKey, float], row: RowKey, off: float) -> bool:
    """Return whether a row with the worst residual `off` disagrees, and more than before; `base`: residuals before."""
    before = base.get(row, np.inf)
    return off > max(1.0, _WORSE * before)


class FormulaStates:
    """The states of one formula after edits; each is computed once."""

    def __init__(self, judge: Judge, base: Mapping[RowKey, float]) -> None:
        """Set up for a judged formula; `base` are the worst residuals of its rows, in units of the tolerance."""
        self.judge = judge
        self.base = base
        self.computed: dict[tuple[Edit, ...], FormulaState | None] = {}

    def is_known(self, change: Sequence[Edit]) -> bool:
        """Return whether the state after edits was computed before, so that `after` takes no time."""
        return tuple(change) in self.computed

    def after(self, change: Sequence[Edit]) -> FormulaState | None:
        """Return the state of the formula file after edits; None if it cannot be evaluated."""
        key = tuple(change)
        if key not in self.computed:
            self.computed[key] = self._evaluated(key)
        return self.computed[key]

    def _evaluated(self, change: Sequence[Edit]) -> FormulaState | None:
        with edited_formula(self.judge.formula, change) as formula:
            return None if formula is None else self._state(formula)

    def _state(self, formula: Formula) -> FormulaState:
        before = self.judge
        judge = Judge(formula, before.variants, before.reference, before.tolerance, before.limits)
        failing = frozenset(place.key for place in judge.failing())
        wrong = len(failing)
        worse = False
        for place, residual in judge.residuals.items():
            worse |= is_worse(self.base, place.key, worst(residual))
        conditions = [condition(group) for group in coincidences(judge)]
        chance = " and ".join(conditions)
        free = before.reference.free
        if not wrong and not chance and free and closes(judge, {}) is False:
            # The rows were judged at the best value of the free parameter, which need not be the formula's value.
            chance = f"for another {free} than that of the equations"
        return FormulaState(wrong, chance, worse, failing)
