"""Repairs of an explanation: what is said of the edits that fix a group of rows, as plain data."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from twin.validation.explain.candidate import TOKEN_KINDS, Candidate
from twin.validation.explain.equation_steps import RowKey
from twin.validation.explain.explanation_data import Change, Reading, Repair
from twin.validation.explain.explanation_rows import residual_unit, row_name, row_symbol, shortened, shown_path
from twin.validation.explain.function_source import Edit, diff, patched
from twin.validation.explain.proved_repairs import ProvedResult
from twin.validation.explain.repair_search import RepairSearch
from twin.validation.explain.row_deviations import Judge

_LEAST_DIVISOR = 1e-6
"""Minimum divisor of a ratio of residuals, in units of the tolerance; it prevents a division by zero."""

_LONGEST_PHRASE = 70
"""Maximum length of the text of an edit; a longer one ends with an ellipsis."""


def repair(judge: Judge, search: RepairSearch, proved_result: ProvedResult, root: Path | None) -> Repair:
    """Return what is said of the repairs of one group of rows; `root`: folder to which file names are relative."""
    result = proved_result.result
    cures: list[tuple[Reading, ...]] = []
    for candidates in result.cures:
        readings: list[Reading] = []
        for candidate in _reported_readings(candidates):
            readings.append(_reading_of(candidate, root))
        cures.append(tuple(readings))
    runner_up = ""
    if result.runner_up is not None:
        phrases: list[str] = []
        for edit in result.runner_up.edits:
            phrases.append(edit_phrase(edit))
        size = _size_text(judge, result.rows, result.runner_up_residual)
        runner_up = f"with {' and '.join(phrases)}, the largest difference is {size}"
    note = ""
    margin = 0.0
    if result.cures:
        margin = result.runner_up_residual / max(result.best_residual, _LEAST_DIVISOR)
    else:
        nearest = ""
        if runner_up:
            nearest = f"; the best one: {runner_up}"
        note = f"no edit and no pair of edits among those tried makes the rows agree{nearest}"
    names: list[str] = []
    before = 0.0
    for row in result.rows:
        names.append(row_name(judge, row))
        before = max(before, search.worst_before[row])
    return Repair(
        tuple(names),
        before=before,
        after=result.best_residual,
        margin=margin,
        runner_up=runner_up,
        cures=tuple(cures),
        tie=_tie_text(cures, any(proved_result.merged)),
        tried=search.trial_count,
        complete=result.complete,
        note=note,
        seconds=round(result.seconds, 2),
        proofs=proved_result.proofs,
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


def _reported_readings(readings: list[Candidate]) -> list[Candidate]:
    """Return the candidates to report from `readings`, a list of candidates that result in the same function.

    Edits in the equation's own rows are preferred to edits in helpers, and edits of single tokens to other edits.
    """
    in_equation: list[Candidate] = []
    for candidate in readings:
        if candidate.edits[0].function == candidate.step.source.name:
            in_equation.append(candidate)
    preferred = in_equation or readings
    # An edit of a shared row would also change the default variant.
    in_variant = [candidate for candidate in preferred if _is_in_changed_rows(candidate)]
    preferred = in_variant or preferred
    of_tokens: list[Candidate] = []
    for candidate in preferred:
        kinds = [edit.kind for edit in candidate.edits]
        if set(kinds) <= set(TOKEN_KINDS):
            of_tokens.append(candidate)
    return of_tokens or preferred[:1]


def _is_in_changed_rows(candidate: Candidate) -> bool:
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


def _reading_of(candidate: Candidate, root: Path | None) -> Reading:
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
    edits_by_file: dict[Path, list[Edit]] = {}
    for edit in candidate.edits:
        edits_by_file.setdefault(edit.path, []).append(edit)
    for path in sorted(edits_by_file):
        edits_of_file = edits_by_file[path]
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
        file = shown_path(edit.path, root)
        changes.append(Change(file, edit.line, edit_phrase(edit), edit.kind, old, new))
    return Reading(tuple(changes), "\n".join(diffs), note, candidate.dropped)
