"""Candidate edits of the equations with their residuals, and the search result for a group of rows (assignments)."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field

import numpy as np

from twin.core.errors import KinematicsError
from twin.core.spatial import Array
from twin.formula.scalar import Value
from twin.validation.explain.equation_steps import RowKey, Step
from twin.validation.explain.function_source import Edit
from twin.validation.explain.row_deviations import Judge, by_row, trial_residuals

TOKEN_KINDS = ("trig", "index", "parameter", "name", "sign", "left side", "function", "number", "operator", "exponent")
"""Kinds of edits that change one token, like a misprint; these edits are ranked before edits of other kinds."""

MULTI_TOKEN_KINDS = ("transpose", "order", "parenthesis", "surplus", "missing")
"""Kinds of edits that change more than one token."""

CALL_KINDS = ("trig", "function", "order", "transpose")
OPERATOR_KINDS = ("sign", "operator", "exponent")
FORM_KINDS = (*CALL_KINDS, *OPERATOR_KINDS)
"""Kinds of edits with few replacements at each position of the text, unlike names and numbers."""

_KINDS_BY_RANK = (*TOKEN_KINDS, *MULTI_TOKEN_KINDS)


@dataclass
class Candidate:
    """One or two edits of one equation, with the resulting residuals.

    Attributes:
        edits: one or two edits.
        defined_values: values of names that the edits define.
        worst_residuals: worst residual of each row that the edits change, in units of the tolerance.
        breaks_row: whether a row that agreed with the mechanism before the edits disagrees after them.
        is_trivial: whether a repaired row is trivial: it agrees for any values of its symbols.
        dropped: symbols on which a repaired row no longer depends.
        changed_residuals: residuals (k, entries) of the changed rows.
        by_chance: whether the repaired rows agree only for the present values of equal or assumed parameters.
    """

    step: Step
    edits: list[Edit]
    defined_values: dict[str, Value]
    worst_residuals: dict[RowKey, float]
    breaks_row: bool
    changed_residuals: dict[RowKey, Array] = field(default_factory=dict, repr=False)
    is_trivial: bool = False
    dropped: tuple[str, ...] = ()
    by_chance: bool = False

    def merge(self, candidate: Candidate) -> None:
        """Add what the same edits change in another equation; the worse of two residuals of a row counts."""
        self.is_trivial |= candidate.is_trivial
        self.breaks_row |= candidate.breaks_row
        self.dropped = tuple(sorted({*self.dropped, *candidate.dropped}))
        for row, residual in candidate.worst_residuals.items():
            self.worst_residuals[row] = max(residual, self.worst_residuals.get(row, 0.0))
        self.changed_residuals |= candidate.changed_residuals

    def worst_over(self, rows: Iterable[RowKey], base: dict[RowKey, float]) -> float:
        """Return the worst residual over the given rows after the edits, in units of the tolerance.

        `base` is the worst residual of each row before the edits. It is used for rows that the edits do not change.
        """
        residuals: list[float] = []
        for row in rows:
            residuals.append(self.worst_residuals.get(row, base[row]))
        return max(residuals)

    @property
    def may_be_proposed(self) -> bool:
        """Whether the candidate may be proposed: no row becomes wrong or trivial, and rows agree not only by chance."""
        return not (self.breaks_row or self.is_trivial or self.by_chance)

    @property
    def rank(self) -> tuple[int, int, int, int, int]:
        """Sort key for candidates that fix the same rows; the best candidate has the smallest key."""
        length = 0
        new_arguments = 0
        foreign = 0
        last_kind = 0
        for edit in self.edits:
            length += abs(len(edit.new) - len(edit.old)) + len(edit.new) + len(edit.old)
            new_arguments += edit.define is not None and not edit.define[1]
            foreign += edit.function != self.step.source.name
            kind = _KINDS_BY_RANK.index(edit.kind) if edit.kind in _KINDS_BY_RANK else len(_KINDS_BY_RANK)
            last_kind = max(last_kind, kind)
        # The kind counts more than the length of any edit.
        return (len(self.edits), foreign, new_arguments, last_kind, length)


@dataclass
class GroupResult:
    """Search result for one group of rows: the edits that fix these rows, and the best of all other edits.

    A cure is an edited function that makes the rows agree. Different edits that result in this function are the
    readings of the cure.

    Attributes:
        rows: the rows of the group.
        cures: cures of the group; each cure is the list of its readings.
        runner_up: the best edit that does not fix the group; None if there is none.
        best_residual, runner_up_residual: worst residual after the best edit and after the runner-up, in units of the
            tolerance.
        tried: number of evaluated edits.
        complete: whether every single edit was tried and, if no single edit is exact, every pair.
        seconds: duration of the search for pairs, in s.
    """

    rows: list[RowKey]
    cures: list[list[Candidate]]
    runner_up: Candidate | None
    best_residual: float
    runner_up_residual: float
    tried: int
    complete: bool = True
    seconds: float = 0.0


def alias_values(judge: Judge, step: Step, change: Sequence[Edit]) -> dict[str, Value] | None:
    """Return {name: value} of the new names that the edits define; None if a value cannot be computed."""
    values: dict[str, Value] = {}
    for edit in change:
        if not edit.define or not edit.define[1]:
            continue
        name, expression = edit.define
        scope = dict(judge.step(step.equation.name).before[edit.statement])
        try:
            with np.errstate(all="ignore"):
                values[name] = eval(expression, scope)
        except Exception:
            return None
    return values


def edited_residuals(
    judge: Judge, equation: str, change: Sequence[Edit], extra: dict[str, Value] | None = None
) -> dict[RowKey, Array] | None:
    """Return the residuals of the rows that edits of an equation change; None if the edits cannot be evaluated.

    Without edits, the residuals of all rows are returned. `extra` contains the values of the names that the edits
    define; None: these values are computed.
    """
    if not change:
        return by_row(judge.residuals)
    try:
        step = judge.step(equation)
        if extra is None:
            extra = alias_values(judge, step, change)
        if extra is None:
            return None
        deviations = trial_residuals(judge, step, list(change), extra)
    except (KeyError, KinematicsError, IndexError):  # `judge` has not every equation, nor every statement's variables
        return None
    if not deviations:
        return None
    return by_row(deviations)


def residuals_with(
    judge: Judge, equation: str, change: Sequence[Edit], extra: Mapping[str, Value], angle: Array | None = None
) -> dict[RowKey, Array] | None:
    """Return the residuals of the rows that edits change; None if they cannot be evaluated.

    `extra` are functions in the edited text, `angle` is the swivel; see `Judge.trial`.
    """
    step = judge.step(equation)
    with names_in_helpers(judge, step, change, extra):
        deviations = trial_residuals(judge, step, list(change), extra, angle)
    if not deviations:
        return None
    return by_row(deviations)


@contextmanager
def names_in_helpers(judge: Judge, step: Step, change: Sequence[Edit], values: Mapping[str, Value]) -> Iterator[None]:
    """Put names into the globals of the functions that an equation calls, if an edit is in one of these functions.

    The edited text of such a function looks the names up there.
    """
    scopes: list[dict[str, Value]] = []
    for edit in change:
        if edit.function != step.source.name:
            scopes = [helper.function.__globals__ for helper in judge.helpers(step)]
    for scope in scopes:
        scope.update(values)
    try:
        yield
    finally:
        for scope in scopes:
            for name in values:
                scope.pop(name, None)
