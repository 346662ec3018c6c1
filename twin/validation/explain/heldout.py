"""Repairs looked at where they were not found: at fresh states of the mechanism, and off the swivel that was used."""

from __future__ import annotations

from dataclasses import replace

from twin.core.errors import TwinError
from twin.reference import ReferenceModel
from twin.validation.explain.candidate import Candidate, Found, Key, key
from twin.validation.explain.judge import Judge, evaluate, worst
from twin.validation.explain.truth import gather, sample

_STATES, _SEED = 12, 101

_ROUNDING = 10
"""Tolerances within which a repaired row holds at fresh states: chance misses by thousands, rounding by a few."""


def held_out(judge: Judge, model: ReferenceModel, found: list[Found], lost: list[Key]) -> tuple[list[Found], list[Key]]:
    """Return the findings of a search without ways that fail at states that it did not see.

    A row that holds at every state searched and not at others agrees by chance, or by what those states have in common.
    """
    fresh = _fresh(judge, model)
    if fresh is None or not any(f.ways for f in found):
        return found, lost
    here = {key(p) for p in fresh.failing()}
    out, gone = [], list(lost)
    for f in found:
        ways = [kept for way in f.ways if (kept := [c for c in way if _holds(fresh, c, f.rows, here)])]
        if f.ways and not ways:
            gone += [k for k in f.rows if k not in gone]
        out.append(replace(f, ways=ways))
    return out, gone


def _fresh(judge: Judge, model: ReferenceModel) -> Judge | None:
    """Return the formula at other states; None where none are to be had: in those, rows that were right are off."""
    try:
        run = sample(model, _STATES, _SEED, regular=model.redundant)
    except TwinError:
        return None
    values = {p.name: float(judge.truth.symbols[p.name]) for p in judge.formula.parameters}
    fresh = judge.on(gather(judge.formula, run, model, values))
    off = {key(p) for p in judge.failing()}
    return fresh if {key(p) for p in fresh.failing()} <= off else None


def _holds(fresh: Judge, c: Candidate, rows: list[Key], off: set[Key]) -> bool:
    """Return whether a candidate makes rows agree that are off at fresh states."""
    if c.extra:  # names that it defines have values at the states of the search only
        return True
    step = fresh.step(c.step.equation.name)
    residuals = evaluate(fresh, step, c.edits)
    if residuals is None:
        return False
    mine = {key(p): worst(r) for p, r in residuals.items()}
    return all(mine.get(k, 0.0) <= _ROUNDING for k in rows if k in off)
