"""Count the judged rows of a formula.

A row counts as judged in three cases: the value of the row is compared; a judged row uses this value; or the row is a
margin (reach, singularity measure, aspect) that was tested at states where the margin is zero.
"""

from __future__ import annotations

from dataclasses import dataclass

from twin.kinematics import compile_formula
from twin.kinematics.margins import Margins
from twin.reference import ReferenceModel
from twin.reference.boundary import Boundary, Judged
from twin.validation.explain.row_deviations import Judge
from twin.validation.explain.rows import Step
from twin.validation.explain.suspects import passed


@dataclass(frozen=True)
class Coverage:
    """Number of rows (outputs of equations), and one text for each row that was not judged: its name and the reason."""

    rows: int
    left: tuple[str, ...]


def margins(judge: Judge, model: ReferenceModel, parameters: dict[str, float] | None = None) -> list[Judged]:
    """Return the results of checking reach, singularity measures and aspects with the mechanism."""
    formula = judge.formula
    run = judge.truth.run
    if run is None or not (formula.reach or formula.measures or formula.aspects):
        return []
    extra_joints = model.mechanism.extra_joints(j.name for j in formula.joints)
    kin = compile_formula(formula, judge.variants, parameters, extra_joints)
    turns = {j.name: j.is_angle for j in model.mechanism.joints}
    error = judge.tolerance.length
    return Boundary(model, Margins(kin, turns, tuple(run.points), error), run.x, error).judge()


def coverage(judge: Judge, judged: list[Judged]) -> Coverage:
    """Return the coverage of all rows; `judged` are the results of `margins`."""
    done = {(p.equation, p.symbol) for p in judge.residuals}
    unjudged: dict[tuple[str, str], Judged] = {}  # in at least one of its uses
    margin_rows: set[tuple[str, str]] = set()
    for result in judged:
        row = (result.equation, result.symbol)
        margin_rows.add(row)
        if result.status == "not judged":
            unjudged[row] = result
    margin_rows -= unjudged.keys()
    done |= passed(judge, done | margin_rows) | margin_rows
    steps: dict[str, Step] = {s.equation.name: s for s in judge.steps}
    total = 0
    left: list[str] = []
    for equation in judge.formula.equations:
        for symbol in dict.fromkeys(equation.outputs):
            total += 1
            row = (equation.name, symbol)
            if row in done:
                continue
            step = steps.get(equation.name)
            if row in unjudged:
                why = f"{unjudged[row].name}: {unjudged[row].why}"
            elif step is None:
                why = "the source of the equation cannot be split into rows"
            elif step.missing:
                why = f"{step.missing} is unknown"
            else:
                why = "the mechanism has no quantity to compare with this symbol"
            left.append(f"{equation.name}.{symbol}: {why}")
    return Coverage(total, tuple(left))
