"""Check repairs at states that the search did not use, with other swivels of a redundant mechanism."""

from __future__ import annotations

from dataclasses import replace

from twin.core.errors import TwinError
from twin.reference import ReferenceModel
from twin.validation.explain.candidate import Candidate, Found, Key, key
from twin.validation.explain.judge import Judge, evaluate, worst
from twin.validation.explain.truth import gather, sample

_STATES, _SEED = 12, 101

_ROUNDING = 10
"""Maximum residual of a repaired row at fresh states, in units of the tolerance: chance exceeds it by thousands."""


def held_out(judge: Judge, model: ReferenceModel, found: list[Found], lost: list[Key]) -> tuple[list[Found], list[Key]]:
    """Return the search results without the cures that fail at states which the search did not use.

    A row that agrees at every searched state but not at others agrees by chance, or because of a common property of
    those states.
    """
    fresh = _fresh(judge, model)
    if fresh is None or not any(f.cures for f in found):
        return found, lost
    here = {key(p) for p in fresh.failing()}
    out, gone = [], list(lost)
    for f in found:
        cures = [kept for way in f.cures if (kept := [c for c in way if _holds(fresh, c, f.rows, here)])]
        if f.cures and not cures:
            gone += [k for k in f.rows if k not in gone]
        out.append(replace(f, cures=cures))
    return out, gone


def _fresh(judge: Judge, model: ReferenceModel) -> Judge | None:
    """Return the formula at other states; None if rows that agreed are wrong at them."""
    try:
        run = sample(model, _STATES, _SEED, regular=model.redundant)
    except TwinError:
        return None
    values = {p.name: float(judge.truth.symbols[p.name]) for p in judge.formula.parameters}
    fresh = judge.on(gather(judge.formula, run, model, values))
    off = {key(p) for p in judge.failing()}
    return fresh if {key(p) for p in fresh.failing()} <= off else None


def _holds(fresh: Judge, c: Candidate, rows: list[Key], off: set[Key]) -> bool:
    """Return whether a candidate makes the rows agree at fresh states."""
    if c.extra:  # names defined by the edit have values only at the states of the search
        return True
    step = fresh.step(c.step.equation.name)
    residuals = evaluate(fresh, step, c.edits)
    if residuals is None:
        return False
    mine = {key(p): worst(r) for p, r in residuals.items()}
    return all(mine.get(k, 0.0) <= _ROUNDING for k in rows if k in off)
