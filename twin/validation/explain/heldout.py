"""Check repairs at states that the search did not use."""

from __future__ import annotations

from dataclasses import replace

from twin.core.errors import TwinError
from twin.reference import ReferenceModel
from twin.validation.explain.candidate import Candidate, Found
from twin.validation.explain.judge import Judge, evaluate, worst
from twin.validation.explain.rows import Key
from twin.validation.explain.truth import gather, sample

_STATES, _SEED = 12, 101

_ROUNDING = 10
"""Largest residual of a correct repair at new states, in units of the tolerance; wrong repairs have far larger ones."""


def held_out(judge: Judge, model: ReferenceModel, found: list[Found], lost: list[Key]) -> tuple[list[Found], list[Key]]:
    """Return (search results without the repairs that fail at new states, rows for which no repair is left).

    If a repaired row agrees at all states of the search, but not at the new states, its agreement was a coincidence.
    """
    fresh = _fresh(judge, model)
    if fresh is None or not any(f.cures for f in found):
        return found, lost
    here = {p.key for p in fresh.failing()}
    out, gone = [], list(lost)
    for f in found:
        cures = [kept for way in f.cures if (kept := [c for c in way if _holds(fresh, c, f.rows, here)])]
        if f.cures and not cures:
            gone += [k for k in f.rows if k not in gone]
        out.append(replace(f, cures=cures))
    return out, gone


def _fresh(judge: Judge, model: ReferenceModel) -> Judge | None:
    """Return a judge of the formula at new states; None if a row that agrees in `judge` is wrong at the new states."""
    try:
        run = sample(model, _STATES, _SEED, regular=model.redundant)
    except TwinError:
        return None
    values = {p.name: float(judge.truth.symbols[p.name]) for p in judge.formula.parameters}
    fresh = judge.on(gather(judge.formula, run, model, values))
    off = {p.key for p in judge.failing()}
    return fresh if {p.key for p in fresh.failing()} <= off else None


def _holds(fresh: Judge, c: Candidate, rows: list[Key], off: set[Key]) -> bool:
    """Return whether the rows agree at the new states after a candidate's edits."""
    if c.extra:  # names defined by the edits have values only at the states of the search
        return True
    step = fresh.step(c.step.equation.name)
    residuals = evaluate(fresh, step, c.edits)
    if residuals is None:
        return False
    mine = {p.key: worst(r) for p, r in residuals.items()}
    return all(mine.get(k, 0.0) <= _ROUNDING for k in rows if k in off)
