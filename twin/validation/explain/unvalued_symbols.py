"""Find symbols without a value in equations, and for each symbol the parameter that was probably meant."""

from __future__ import annotations

import numpy as np

from twin.core.findings import Finding, error
from twin.formula.contract import unread
from twin.formula.scalar import Value
from twin.validation.explain.row_deviations import Judge, worst


def unvalued(judge: Judge) -> list[Finding]:
    """Return a finding for every symbol without a value.

    The missing symbol may be a parameter that no equation uses, under another name. Each unused parameter is therefore
    substituted for the symbol, and the resulting rows are compared with the mechanism.
    """
    formula, reference = judge.formula, judge.reference
    given = set(reference.symbols)
    for equation in formula.equations:
        given.update(equation.outputs)
    unused_names = unread(formula, judge.variants)
    unused = [p for p in formula.parameters if p.name in unused_names]
    readers: dict[str, list[str]] = {}
    for step in judge.steps:
        for name in step.required:
            if name not in given:
                readers.setdefault(name, []).append(step.equation.name)
    findings: list[Finding] = []
    for name, equations in readers.items():
        where = ", ".join(equations)
        fitting = [p for p in unused if _holds(judge, name, p.name, equations)]
        if fitting:
            p = fitting[0]
            suggestion = (
                f"replace {name} by {p.name} = {p.shown:g} {p.unit}: then every row of {where} that uses "
                f"{p.name} agrees"
            )
        elif unused:
            names = ", ".join(p.name for p in unused)
            suggestion = f"give {name} a value, or replace it by a parameter that is not used: {names}"
        else:
            suggestion = f"give {name} a value among the parameters"
        message = f"{where} uses '{name}', which has no value"
        findings.append(error("formula.unvalued", where, message, suggestion=suggestion))
    return findings


def _holds(judge: Judge, name: str, parameter: str, equations: list[str]) -> bool:
    """Return whether the rows of the equations agree if a symbol has the value of a parameter."""
    symbols = judge.reference.symbols
    values: dict[str, Value] = {}
    for equation in equations:
        values |= judge.step(equation).computed
    values |= {**symbols, name: symbols[parameter]}
    reference = judge.reference.with_parameters(values)
    with np.errstate(all="ignore"):
        residuals = judge.on(reference, equations).residuals
    return bool(residuals) and all(worst(r) <= 1 for r in residuals.values())
