"""Symbols that equations read and nobody gives a value, and the parameters that are probably meant."""

from __future__ import annotations

import numpy as np

from twin.core.findings import Finding
from twin.formula.contract import unread
from twin.validation.explain.judge import Judge, worst


def unvalued(judge: Judge) -> list[Finding]:
    """Return a finding for every symbol without a value.

    A parameter that has a value and that no equation reads may be the same under another name: each is put in its
    place, and the mechanism says whether the rows then hold.
    """
    formula, truth = judge.formula, judge.truth
    given = {n for e in formula.equations for n in e.outputs} | set(truth.symbols)
    waiting = [p for p in formula.parameters if p.name in unread(formula, judge.variants)]
    readers: dict[str, list[str]] = {}
    for step in judge.steps:
        for name in step.required:
            if name not in given:
                readers.setdefault(name, []).append(step.equation.name)
    out = []
    for name, equations in readers.items():
        where = ", ".join(equations)
        fits = [p for p in waiting if _holds(judge, name, p.name, equations)]
        if fits:
            p = fits[0]
            way = f"take {name} for {p.name} = {p.shown:g} {p.unit}: every row of {where} that reads it then holds"
        elif waiting:
            names = ", ".join(p.name for p in waiting)
            way = f"give {name} a value, or the name of what has one and is read by nothing: {names}"
        else:
            way = f"give {name} a value among the parameters"
        out.append(
            Finding(
                "formula.unvalued",
                "error",
                f"{where} reads '{name}', and nothing gives it a value",
                where=where,
                suggestion=way,
            )
        )
    return out


def _holds(judge: Judge, name: str, parameter: str, equations: list[str]) -> bool:
    """Return whether the rows of some equations agree when a symbol has the value of a parameter."""
    symbols = judge.truth.symbols
    computed = {n: v for e in equations for n, v in judge.step(e).computed.items()}
    truth = judge.truth.with_parameters({**computed, **symbols, name: symbols[parameter]})
    with np.errstate(all="ignore"):
        found = judge.on(truth, equations).residuals
    return bool(found) and all(worst(r) <= 1 for r in found.values())
