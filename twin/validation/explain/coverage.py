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
from twin.core.provenance import Parameter
from twin.formula.contract import unread
from twin.formula.scalar import Value
from twin.kinematics.margins import Margins
from twin.reference import ReferenceModel
from twin.reference.margin_zeros import JudgedRow, ZeroCheck
from twin.validation.explain.equation_steps import Step
from twin.validation.explain.judged_states import compiled_kinematics
from twin.validation.explain.row_deviations import Judge
from twin.validation.explain.suspect_statements import indirectly_judged


@dataclass(frozen=True)
class Coverage:
    """Number of rows (outputs of equations), and one text for each row that was not judged: its name and the reason."""

    rows: int
    unjudged: tuple[str, ...]


def coverage(judge: Judge, margin_results: Sequence[JudgedRow]) -> Coverage:
    """Return the coverage of all rows; `margin_results` are those of `check_margins`."""
    compared: set[tuple[str, str]] = set()
    for place in judge.residuals:
        compared.add((place.equation, place.symbol))
    judged_margins: set[tuple[str, str]] = set()
    unjudged_margins: dict[tuple[str, str], JudgedRow] = {}
    for result in margin_results:
        row = (result.equation, result.symbol)
        if result.status == "not judged":
            unjudged_margins[row] = result
        else:
            judged_margins.add(row)
    # a row with several uses counts only if each of them was judged
    judged_margins -= unjudged_margins.keys()
    judged_directly = compared | judged_margins
    judged = judged_directly | indirectly_judged(judge, judged_directly)
    steps = {step.equation.name: step for step in judge.steps}
    rows = 0
    texts: list[str] = []
    for equation in judge.formula.equations:
        for symbol in dict.fromkeys(equation.outputs):
            rows += 1
            row = (equation.name, symbol)
            if row in judged:
                continue
            reason = _reason_unjudged(unjudged_margins.get(row), steps.get(equation.name))
            texts.append(f"{equation.name}.{symbol}: {reason}")
    return Coverage(rows, tuple(texts))


def _reason_unjudged(margin: JudgedRow | None, step: Step | None) -> str:
    """Return why a row was not judged, from the result of its margin and the step of its equation."""
    if margin is not None:
        return f"{margin.name}: {margin.why}"
    if step is None:
        return "the source of the equation cannot be split into rows"
    if step.missing:
        return f"{step.missing} is unknown"
    return "the mechanism has no quantity to compare with this symbol"


def check_margins(judge: Judge, model: ReferenceModel, parameters: dict[str, float] | None = None) -> list[JudgedRow]:
    """Return the result for each margin; none without samples of the mechanism, or without margins.

    `parameters` are values in SI units that replace those of the formula.
    """
    formula = judge.formula
    samples = judge.reference.run
    if samples is None:
        return []
    if not (formula.reach or formula.measures or formula.aspects):
        return []
    kinematics = compiled_kinematics(formula, model, judge.variants, parameters)
    is_angle = {joint.name: joint.is_angle for joint in model.mechanism.joints}
    largest_error = judge.tolerance.length
    margins = Margins(kinematics, is_angle, tuple(samples.points), largest_error)
    boundary = ZeroCheck(model, margins, samples.x, largest_error)
    return boundary.judge()


def findings_on_unvalued_symbols(judge: Judge) -> list[Finding]:
    """Return a finding for every symbol without a value.

    The missing symbol may be a parameter that no equation uses, under another name. Each unused parameter is therefore
    substituted for the symbol, and the resulting rows are compared with the mechanism.
    """
    formula = judge.formula
    valued_names = set(judge.reference.symbols)
    for equation in formula.equations:
        valued_names.update(equation.outputs)
    unused_names = unread(formula, judge.variants)
    unused = [parameter for parameter in formula.parameters if parameter.name in unused_names]
    readers: dict[str, list[str]] = {}
    for step in judge.steps:
        for name in step.required:
            if name not in valued_names:
                readers.setdefault(name, []).append(step.equation.name)
    findings: list[Finding] = []
    for name, equations in readers.items():
        where = ", ".join(equations)
        message = f"{where} uses '{name}', which has no value"
        suggestion = _suggestion(judge, name, equations, unused)
        findings.append(error("formula.unvalued", where, message, suggestion=suggestion))
    return findings


def _suggestion(judge: Judge, name: str, equations: list[str], unused: Sequence[Parameter]) -> str:
    """Return what to do about a symbol without a value: the unused parameter that was meant, if the rows tell it."""
    for parameter in unused:
        if _rows_agree_with(judge, name, parameter.name, equations):
            return (
                f"replace {name} by {parameter.name} = {parameter.shown:g} {parameter.unit}: then every row of "
                f"{', '.join(equations)} that uses {parameter.name} agrees"
            )
    if unused:
        names = [parameter.name for parameter in unused]
        return f"give {name} a value, or replace it by a parameter that is not used: {', '.join(names)}"
    return f"give {name} a value among the parameters"


def _rows_agree_with(judge: Judge, name: str, parameter: str, equations: list[str]) -> bool:
    """Return whether the rows of the equations agree if a symbol has the value of a parameter."""
    symbols = judge.reference.symbols
    values: dict[str, Value] = {}
    for equation in equations:
        values |= judge.step(equation).computed
    values |= {**symbols, name: symbols[parameter]}
    reference = judge.reference.with_values(values)
    with np.errstate(all="ignore"):
        other_judge = judge.on(reference, equations)
    # Without residuals nothing was compared, so that nothing speaks for the parameter.
    return bool(other_judge.residuals) and not other_judge.failing()
