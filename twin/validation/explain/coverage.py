"""Check the margins of a formula, and count its judged rows.

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
    unjudged: tuple[str, ...]


def check_margins(judge: Judge, model: ReferenceModel, parameters: dict[str, float] | None = None) -> list[Judged]:
    """Check reach, singularity measures and aspects at states where they are zero; return the results."""
    formula = judge.formula
    run = judge.truth.run
    if run is None or not (formula.reach or formula.measures or formula.aspects):
        return []
    extra_joints = model.mechanism.extra_joints(j.name for j in formula.joints)
    kin = compile_formula(formula, judge.variants, parameters, extra_joints)
    turns = {j.name: j.is_angle for j in model.mechanism.joints}
    error = judge.tolerance.length
    return Boundary(model, Margins(kin, turns, tuple(run.points), error), run.x, error).judge()


def coverage(judge: Judge, margin_results: list[Judged]) -> Coverage:
    """Return the coverage of all rows; `margin_results` are those of `check_margins`."""
    compared = {(place.equation, place.symbol) for place in judge.residuals}
    unjudged: dict[tuple[str, str], Judged] = {}  # in at least one of its uses
    margin_rows: set[tuple[str, str]] = set()
    for result in margin_results:
        row = (result.equation, result.symbol)
        margin_rows.add(row)
        if result.status == "not judged":
            unjudged[row] = result
    margin_rows -= unjudged.keys()
    used_by_these = passed(judge, compared | margin_rows)
    done = compared | margin_rows | used_by_these
    steps: dict[str, Step] = {s.equation.name: s for s in judge.steps}
    total = 0
    texts: list[str] = []
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
            texts.append(f"{equation.name}.{symbol}: {why}")
    return Coverage(total, tuple(texts))
