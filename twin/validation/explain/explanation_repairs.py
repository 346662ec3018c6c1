"""Repairs of an explanation: what is said of the edits that fix a group of rows, as plain data."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from twin.validation.explain.candidate import TOKENS, Candidate
from twin.validation.explain.equation_steps import RowKey
from twin.validation.explain.explanation_data import Change, Reading, Repair
from twin.validation.explain.explanation_rows import residual_unit, row_name, row_symbol, shortened, shown_path
from twin.validation.explain.function_source import Edit, diff, patched
from twin.validation.explain.proved_repairs import ProvedResult
from twin.validation.explain.repair_search import RepairSearch
from twin.validation.explain.row_deviations import Judge

_LEAST_RESIDUAL = 1e-6
"""Minimum divisor of a ratio of residuals, in units of the tolerance; it prevents a division by zero."""

_LONGEST_PHRASE = 70
"""Maximum length of the text of an edit; a longer one ends with an ellipsis."""


def repair(judge: Judge, search: RepairSearch, judged: ProvedResult, root: Path | None) -> Repair:
    """Return what is said of the repairs of one group of rows; `root`: folder to which file names are relative."""
    result = judged.found
    cures: list[tuple[Reading, ...]] = []
    for readings in result.cures:
        cures.append(tuple(_reading(candidate, root) for candidate in _reported(readings)))
    runner_up = ""
    if result.runner_up is not None:
        phrases = " and ".join(edit_phrase(edit) for edit in result.runner_up.edits)
        runner_up = f"with {phrases}, the largest difference is {_size_text(judge, result.rows, result.next)}"
    note = ""
    margin = 0.0
    if result.cures:
        margin = result.next / max(result.after, _LEAST_RESIDUAL)
    else:
        nearest = ""
        if runner_up:
            nearest = f"; the best one: {runner_up}"
        note = f"no edit and no pair of edits among those tried makes the rows agree{nearest}"
    return Repair(
        tuple(row_name(judge, row) for row in result.rows),
        before=max(search.base[row] for row in result.rows),
        after=result.after,
        margin=margin,
        runner_up=runner_up,
        cures=tuple(cures),
        tie=_tie_text(cures, any(judged.merged)),
        tried=search.tried,
        complete=result.complete,
        note=note,
        seconds=round(result.seconds, 2),
        proofs=judged.proofs,
    )


def _tie_text(cures: Sequence[tuple[Reading, ...]], is_merged: bool) -> str:
    """Return why the data do not determine one repair, or ""; `is_merged`: whether proofs have merged some."""
    if len(cures) > 1:
        return (
            f"{len(cures)} different functions agree with the mechanism at every pose judged: the dimensions of "
            "the mechanism do not distinguish them"
        )
    if not cures:
        return ""
    count = len(cures[0])
    if is_merged:
        return (
            f"{count} edits give the same function with the dimensions of this mechanism, proved for all "
            "poses: the paper does not show which was intended"
        )
    if count > 1:
        return (
            f"{count} edits give the same function: no pose distinguishes them, and the paper does not show "
            "which was intended"
        )
    return ""


def _reported(readings: list[Candidate]) -> list[Candidate]:
    """Return the candidates to report from `readings`, a list of candidates that result in the same function.

    Edits in the equation's own rows are preferred to edits in helpers, and edits of single tokens to other edits.
    """
    in_equation = [c for c in readings if c.edits[0].function == c.step.source.name]
    preferred = in_equation or readings
    # An edit of a shared row would also change the default variant.
    in_variant = [c for c in preferred if _in_changed_rows(c)]
    preferred = in_variant or preferred
    of_tokens: list[Candidate] = []
    for candidate in preferred:
        if all(edit.kind in TOKENS for edit in candidate.edits):
            of_tokens.append(candidate)
    return of_tokens or preferred[:1]


def _in_changed_rows(candidate: Candidate) -> bool:
    """Return whether all edits are in the variant's own function, not in rows shared with the default variant."""
    source = candidate.step.source
    for edit in candidate.edits:
        if edit.function != source.name or source.statements[edit.statement].home is not source.node:
            return False
    return True


def _size_text(judge: Judge, rows: Sequence[RowKey], residual: float) -> str:
    """Return a residual of some rows as text, in the unit of the first one."""
    if not np.isfinite(residual):
        return "not a number"
    symbol = row_symbol(judge, rows[0])
    if symbol in judge.limits:
        return f"{residual:.3g} times as large as noise of the CAD explains"
    unit, tolerance = residual_unit(judge, symbol)
    return f"{residual * tolerance:.3g} {unit}"


def edit_phrase(edit: Edit) -> str:
    """Return an edit as a short phrase."""
    return shortened(edit.text, _LONGEST_PHRASE)


def _reading(candidate: Candidate, root: Path | None) -> Reading:
    """Return the edits of a candidate with their lines before and after, and as a diff."""
    note = ""
    for edit in candidate.edits:
        if edit.kind == "left side":
            note = (
                f"the row then determines {edit.new}; in Python, keep {edit.old} on the left side: "
                f"{edit.old} = {edit.old} - {edit.new} + ..."
            )
    diffs: list[str] = []
    lines_before: dict[Path, list[str]] = {}
    lines_after: dict[Path, list[str]] = {}
    for path in sorted({edit.path for edit in candidate.edits}):
        edits_of_file = [edit for edit in candidate.edits if edit.path == path]
        diffs.append(diff(edits_of_file, shown_path(path, root)))
        lines_before[path] = path.read_text(encoding="utf-8").splitlines()
        lines_after[path] = patched(edits_of_file).splitlines()
    changes: list[Change] = []
    for edit in candidate.edits:
        before = lines_before[edit.path]
        after = lines_after[edit.path]
        last = edit.line + edit.old.count("\n")
        last_after = last + len(after) - len(before)  # the edits may add lines, such as definitions
        old = "\n".join(before[edit.line - 1 : last]).strip()
        new = "\n".join(after[edit.line - 1 : last_after]).strip()
        changes.append(Change(shown_path(edit.path, root), edit.line, edit_phrase(edit), edit.kind, old, new))
    return Reading(tuple(changes), "\n".join(diffs), note, candidate.dropped)
