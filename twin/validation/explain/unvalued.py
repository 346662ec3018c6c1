"""Find symbols without a value in equations, and for each symbol the parameter that was probably meant."""

from __future__ import annotations

import numpy as np

from twin.core.findings import Finding, error
from twin.formula.contract import unread
from twin.validation.explain.judge import Judge, worst


def unvalued(judge: Judge) -> list[Finding]:
    """Return a finding for every symbol without a value.

    The missing symbol may be a parameter that no equation uses, under another name. Each unused parameter is therefore
    substituted for the symbol, and the resulting rows are compared with the mechanism.
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
            way = (
                f"replace {name} by {p.name} = {p.shown:g} {p.unit}: then every row of {where} that uses "
                f"{p.name} agrees"
            )
        elif waiting:
            names = ", ".join(p.name for p in waiting)
            way = f"give {name} a value, or replace it by a parameter that is not used: {names}"
        else:
            way = f"give {name} a value among the parameters"
        out.append(error("formula.unvalued", where, f"{where} uses '{name}', which has no value", suggestion=way))
    return out


def _holds(judge: Judge, name: str, parameter: str, equations: list[str]) -> bool:
    """Return whether the rows of the equations agree if a symbol has the value of a parameter."""
    symbols = judge.truth.symbols
    computed = {n: v for e in equations for n, v in judge.step(e).computed.items()}
    truth = judge.truth.with_parameters({**computed, **symbols, name: symbols[parameter]})
    with np.errstate(all="ignore"):
        found = judge.on(truth, equations).residuals
    return bool(found) and all(worst(r) <= 1 for r in found.values())
