"""Rows of an explanation: what is said of each wrong row and of each wrong margin, as plain data."""

from __future__ import annotations

import ast
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from twin.core.spatial import Array
from twin.core.units import display_unit
from twin.reference.margin_zeros import JudgedRow
from twin.validation.explain.candidate import Candidate, GroupResult
from twin.validation.explain.equation_steps import RowKey, RowPlace
from twin.validation.explain.explanation_data import WrongRow
from twin.validation.explain.row_deviations import Judge
from twin.validation.explain.tokens import is_sum

_LONGEST_ROW = 400
"""Maximum length of the text of a row; a longer one ends with an ellipsis."""


def row_name(judge: Judge, row: RowKey) -> str:
    """Return the equation and the symbol of a row, as "eq1.X_S1"."""
    return f"{row[0]}.{row_symbol(judge, row)}"


def row_symbol(judge: Judge, row: RowKey) -> str:
    """Return the symbol that a row computes.

    Raises:
        LookupError: the row was not judged.
    """
    for place in judge.residuals:
        if place.key == row:
            return place.symbol
    raise LookupError(row)


def shown_path(path: Path, root: Path | None) -> str:
    """Return a file name relative to a folder, if the file is in it."""
    if root is not None and path.is_relative_to(root):
        return str(path.relative_to(root))
    return str(path)


def shortened(text: str, longest: int) -> str:
    """Return a text in one line, with an ellipsis if it is longer than `longest`."""
    line = " ".join(text.split())
    if len(line) <= longest:
        return line
    return f"{line[: longest - 1]}…"


def residual_unit(judge: Judge, symbol: str) -> tuple[str, float]:
    """Return the display unit of a symbol's residuals, and the tolerance of the symbol in this unit."""
    is_angle = judge.reference.kinds[symbol] == "angle"
    name, scale = display_unit(is_angle)
    tolerance = judge.tolerance.length
    if is_angle:
        tolerance = judge.tolerance.angle
    return name, tolerance / scale


def wrong_row(judge: Judge, place: RowPlace, results: Sequence[GroupResult], root: Path | None) -> WrongRow:
    """Return what is said of a wrong row; `results` are those of the search for its repair."""
    step = judge.step(place.equation)
    reference = judge.reference
    size = np.abs(judge.residuals[place]).max(axis=1)
    has_value = np.isfinite(size)
    statement = step.source.statements[place.statement]
    text = step.source.text(statement.start, statement.end)
    if statement.returns:
        text = text.splitlines()[0]
    unit, _ = residual_unit(judge, place.symbol)
    # Without a value, a pose counts neither as the worst nor as the best one.
    worst_pose = int(np.argmax(np.where(has_value, size, np.inf)))
    best_pose = int(np.argmin(np.where(has_value, size, np.inf)))
    return WrongRow(
        equation=place.equation,
        variant=place.variant,
        symbol=place.symbol,
        file=shown_path(step.source.path, root),
        line=place.line,
        text=shortened(text, _LONGEST_ROW),
        means=_meaning(judge, place.symbol),
        off=_largest_difference(judge, place.symbol, size),
        unit=unit,
        share=float((~(size <= 1)).mean()),  # also poses without a value
        worst_at=reference.pose_text(worst_pose),
        least_at=reference.pose_text(best_pose),
        term=_term_of_best_repair(place, results),
    )


def _largest_difference(judge: Judge, symbol: str, size: Array) -> float:
    """Return the largest difference of a row in its display unit; NaN if the row is wrong only where it has no value.

    `size` (k,) are the residuals of the row, in units of the tolerance or of what noise explains.
    """
    has_value = np.isfinite(size)
    if not (size[has_value] > 1).any():
        return float("nan")
    limit = 1.0
    if symbol in judge.limits:
        limit = judge.limits[symbol][:, 0]
    _, tolerance = residual_unit(judge, symbol)
    return float((size * limit)[has_value].max()) * tolerance


def _term_of_best_repair(place: RowPlace, results: Sequence[GroupResult]) -> str:
    """Return the summand of a row that its first repair changes; "" if it changes none, or another statement."""
    for result in results:
        if place.key in result.rows and result.cures:
            best = result.cures[0][0]
            if best.edits[0].statement != place.statement:
                return ""
            return _changed_term(best)
    return ""


def wrong_margin(judge: Judge, margin: JudgedRow, root: Path | None) -> WrongRow:
    """Return what is said of a reach, singularity measure or aspect that contradicts the mechanism."""
    kind = f"singularity measure '{margin.name}'"
    if margin.kind == "reach":
        kind = f"margin of reach '{margin.name}'"
    elif margin.kind == "aspect":
        kind = "aspect"
    size = float("nan")
    if margin.size is not None and margin.unit:
        size = margin.size
    variant = ""
    file = ""
    line = 0
    text = ""
    # An equation that cannot be split into rows has no step.
    steps = {step.equation.name: step for step in judge.steps}
    step = steps.get(margin.equation)
    if step is not None:
        source = step.source
        last = source.statements[-1]
        statement = last
        for candidate in source.statements:
            if margin.symbol in candidate.writes:
                statement = candidate
        line = statement.line
        if statement is last:  # each output may have a line of its own in the return statement
            line = step.lines[step.equation.outputs.index(margin.symbol)]
        text = shortened(source.text(statement.start, statement.end), _LONGEST_ROW)
        variant = step.variant
        file = shown_path(source.path, root)
    return WrongRow(
        equation=margin.equation,
        variant=variant,
        symbol=margin.symbol,
        file=file,
        line=line,
        text=text,
        means=kind,
        off=size,
        unit=margin.unit,
        share=0.0,
        worst_at=margin.at,
        least_at="",
        why=margin.why,
    )


def _meaning(judge: Judge, symbol: str) -> str:
    """Return the meaning of a symbol: a named point, a joint or the tool pose."""
    formula = judge.formula
    for name, symbols in formula.points.items():
        if symbol == symbols:
            return f"point {name}"
        if not isinstance(symbols, str) and symbol in symbols:
            return f"{'xyz'[symbols.index(symbol)]} of point {name}"
    if symbol in judge.reference.borrowed:
        return f"point {judge.reference.borrowed[symbol]}"
    names_of_joints = [joint.name for joint in formula.joints]
    if symbol in names_of_joints:
        return f"joint {symbol}"
    if symbol in formula.passive:
        return f"passive joint {symbol}"
    if judge.reference.kinds[symbol] == "pose":
        return "tool pose"
    return symbol


def _changed_term(candidate: Candidate) -> str:
    """Return the summand that an edit changes in a row, with sign; "" if the edit changes no summand."""
    source = candidate.step.source
    edit = candidate.edits[0]
    if edit.function != source.name:
        return ""
    for node in ast.walk(source.statements[edit.statement].node):
        if not is_sum(node):
            continue
        sign_of_right = "+" if isinstance(node.op, ast.Add) else "-"
        for operand, sign in ((node.left, "+"), (node.right, sign_of_right)):
            start, end = source.span(operand)
            # A sum as an operand is split further.
            if edit.is_within((start, end)) and not is_sum(operand):
                return f"{sign} {source.text(start, end)}"
    return ""
