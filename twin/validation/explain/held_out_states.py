"""Check repairs at states that the search did not use."""

from __future__ import annotations

from dataclasses import replace

from twin.core.errors import TwinError
from twin.reference import ReferenceModel
from twin.validation.explain.candidate import Candidate, GroupResult
from twin.validation.explain.equation_steps import RowKey
from twin.validation.explain.reference_values import symbol_values
from twin.validation.explain.row_deviations import Judge, evaluate, worst
from twin.validation.explain.sampled_states import sample_states

_STATES = 12
_SEED = 101  # other states than those of the search

_ROUNDING = 10
"""Largest residual of a correct repair at new states, in units of the tolerance; wrong repairs have far larger ones."""


def held_out(
    judge: Judge, model: ReferenceModel, found: list[GroupResult], lost: list[RowKey]
) -> tuple[list[GroupResult], list[RowKey]]:
    """Return (search results without the repairs that fail at new states, rows for which no repair is left).

    If a repaired row agrees at all states of the search, but not at the new states, its agreement was a coincidence.
    """
    fresh = _fresh(judge, model)
    if fresh is None or not any(f.cures for f in found):
        return found, lost
    failing = {p.key for p in fresh.failing()}
    kept: list[GroupResult] = []
    unexplained = list(lost)
    for result in found:
        cures: list[list[Candidate]] = []
        for readings in result.cures:
            holding = [c for c in readings if _holds(fresh, c, result.rows, failing)]
            if holding:
                cures.append(holding)
        if result.cures and not cures:
            for row in result.rows:
                if row not in unexplained:
                    unexplained.append(row)
        kept.append(replace(result, cures=cures))
    return kept, unexplained


def _fresh(judge: Judge, model: ReferenceModel) -> Judge | None:
    """Return a judge of the formula at new states; None if a row that agrees in `judge` is wrong at the new states."""
    try:
        run = sample_states(model, _STATES, _SEED, regular=model.redundant)
    except TwinError:
        return None
    values = {p.name: float(judge.reference.symbols[p.name]) for p in judge.formula.parameters}
    fresh = judge.on(symbol_values(judge.formula, run, model, values))
    failing = {p.key for p in judge.failing()}
    return fresh if {p.key for p in fresh.failing()} <= failing else None


def _holds(fresh: Judge, c: Candidate, rows: list[RowKey], failing: set[RowKey]) -> bool:
    """Return whether the rows agree at the new states after a candidate's edits."""
    if c.extra:  # names defined by the edits have values only at the states of the search
        return True
    residuals = evaluate(fresh, fresh.step(c.step.equation.name), c.edits)
    if residuals is None:
        return False
    for place, residual in residuals.items():
        if place.key in rows and place.key in failing and worst(residual) > _ROUNDING:
            return False
    return True
