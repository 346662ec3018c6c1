"""Count the judged rows of a formula, and say why the other rows were not judged.

A row counts as judged in three cases: the value of the row is compared; a judged row uses this value; or the row is a
margin (reach, singularity measure, aspect) that was tested at states where the margin is zero.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from twin.reference.boundary import Judged
from twin.validation.explain.equation_steps import Step
from twin.validation.explain.row_deviations import Judge
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
