"""Say which rows of a formula were judged, and why the others were not.

A row counts as judged in three cases: the value of the row is compared; a judged row uses this value; or the row is a
margin (reach, singularity measure, aspect) that was tested at states of the mechanism where the margin is zero. A row
that uses a symbol without a value cannot be judged; the parameter that was probably meant is named.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from twin.core.findings import Finding, error
from twin.formula.contract import unread
from twin.formula.scalar import Value
from twin.kinematics import compile_formula
from twin.kinematics.margins import Margins
from twin.reference import ReferenceModel
from twin.reference.margin_zeros import Boundary, Judged
from twin.validation.explain.equation_steps import Step
from twin.validation.explain.row_deviations import Judge, worst
from twin.validation.explain.suspects import passed


@dataclass(frozen=True)
class Coverage:
    """Number of rows (outputs of equations), and one text for each row that was not judged: its name and the reason."""

    rows: int
    unjudged: tuple[str, ...]


def coverage(judge: Judge, margin_results: Sequence[Judged]) -> Coverage:
    """Return the coverage of all rows; `margin_results` are those of `check_margins`."""
    compared = {(place.equation, place.symbol) for place in judge.residuals}
    judged_margins: set[tuple[str, str]] = set()
    unjudged_margins: dict[tuple[str, str], Judged] = {}
    for result in margin_results:
        row = (result.equation, result.symbol)
        if result.status == "not judged":
            unjudged_margins[row] = result
        else:
            judged_margins.add(row)
    # a row with several uses counts only if each of them was judged
    judged_margins -= unjudged_margins.keys()
    known = compared | judged_margins
    used_by_known = passed(judge, known)
    judged = known | used_by_known
    steps = {step.equation.name: step for step in judge.steps}
    rows = 0
    texts: list[str] = []
    for equation in judge.formula.equations:
        for symbol in dict.fromkeys(equation.outputs):
            rows += 1
            row = (equation.name, symbol)
            if row in judged:
                continue
            reason = _reason(unjudged_margins.get(row), steps.get(equation.name))
            texts.append(f"{equation.name}.{symbol}: {reason}")
    return Coverage(rows, tuple(texts))


def _reason(margin: Judged | None, step: Step | None) -> str:
    """Return why a row was not judged, from the result of its margin and the step of its equation."""
    if margin is not None:
        return f"{margin.name}: {margin.why}"
    if step is None:
        return "the source of the equation cannot be split into rows"
    if step.missing:
        return f"{step.missing} is unknown"
    return "the mechanism has no quantity to compare with this symbol"


def check_margins(judge: Judge, model: ReferenceModel, parameters: dict[str, float] | None = None) -> list[Judged]:
    """Return the result for each margin; none without samples of the mechanism, or without margins.

    `parameters` are values in SI units that replace those of the formula.
    """
    formula = judge.formula
    samples = judge.reference.run
    if samples is None:
        return []
    if not (formula.reach or formula.measures or formula.aspects):
        return []
    extra_joints = model.mechanism.extra_joints(j.name for j in formula.joints)
    kin = compile_formula(formula, judge.variants, parameters, extra_joints)
    is_angle = {j.name: j.is_angle for j in model.mechanism.joints}
    error = judge.tolerance.length
    margins = Margins(kin, is_angle, tuple(samples.points), error)
    boundary = Boundary(model, margins, samples.x, error)
    return boundary.judge()


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
    reference = judge.reference.with_values(values)
    with np.errstate(all="ignore"):
        residuals = judge.on(reference, equations).residuals
    return bool(residuals) and all(worst(r) <= 1 for r in residuals.values())
