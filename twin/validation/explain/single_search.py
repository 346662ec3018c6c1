"""Search single edits stage by stage, and put the rows that one edit repairs together in groups."""

from __future__ import annotations

from collections.abc import Container, Iterable, Sequence
from typing import NamedTuple

from twin.validation.explain.candidate import (
    CALL_KINDS,
    FORM_KINDS,
    MULTI_TOKEN_KINDS,
    OPERATOR_KINDS,
    TOKEN_KINDS,
    Candidate,
)
from twin.validation.explain.deadline import Deadline
from twin.validation.explain.equation_steps import RowKey
from twin.validation.explain.repair_choice import MOST_EXACT_EDITS, RepairChoice
from twin.validation.explain.single_edits import SingleEdits
from twin.validation.explain.trials import Trials


class _SearchStage(NamedTuple):
    """One stage of the search for one edit.

    Attributes:
        in_called: whether the called functions are edited; otherwise, the equations themselves are.
        kinds: kinds of edits.
        part: maximum part of the remaining time, so that a slow equation leaves time for the next stages.
    """

    in_called: bool
    kinds: tuple[str, ...]
    part: float

    @property
    def is_always_tried(self) -> bool:
        """Whether all its edits are tried to find every tie, also after one that repairs all rows."""
        return not self.in_called and self.kinds != MULTI_TOKEN_KINDS


_FORM_TOKENS = tuple(kind for kind in TOKEN_KINDS if kind in FORM_KINDS)
_NAME_TOKENS = tuple(kind for kind in TOKEN_KINDS if kind not in FORM_KINDS)
_MULTI_TOKEN_BUT_CALLS = tuple(kind for kind in MULTI_TOKEN_KINDS if kind not in FORM_KINDS)

_SEVERAL_TOKENS = _SearchStage(False, MULTI_TOKEN_KINDS, 0.3)
"""The stage of terms, factors and parentheses of the equations."""

_STAGES_BEFORE_VALUES = (
    _SearchStage(False, _FORM_TOKENS, 0.3),
    _SearchStage(True, CALL_KINDS, 0.3),
)
"""Kinds with few replacements come first, because a slow equation has time for few hundred edits."""

_STAGES_AFTER_VALUES = (
    _SearchStage(False, _NAME_TOKENS, 0.5),
    _SearchStage(True, OPERATOR_KINDS, 0.3),
    _SEVERAL_TOKENS,
    _SearchStage(True, _NAME_TOKENS, 0.5),
    _SearchStage(True, _MULTI_TOKEN_BUT_CALLS, 0.6),
)
"""Names and kinds with many replacements may need all the time; they have larger parts."""

_ALTERNATIVES_PART = 0.3
"""Maximum part of the remaining time for other edits with the same result, after an edit that repairs all rows."""

_CHANCE_PART = 0.2
"""Maximum part of the remaining time for the question whether edits repair rows only by chance, after each stage."""


class SingleSearch:
    """Search for single edits of one judged formula.

    The order is: kinds with few replacements, of the equations and then of the functions that they call; edits that
    follow from required values; names and numbers; terms, factors and parentheses. A stage that is not always tried is
    skipped once one edit repairs all rows. If several edits repair them, one that repairs more is searched where the
    rows have something in common.

    Attributes:
        candidates: the candidates for all single edits that were evaluated.
        groups: the rows that one of these edits repairs together.
        skipped: the stages that were skipped.
    """

    def __init__(self, trials: Trials, choice: RepairChoice, singles: SingleEdits, deadline: Deadline) -> None:
        """Set up the search.

        Args:
            trials: the wrong rows.
            choice: tells which edits repair rows only by chance.
            singles: evaluates the edits.
            deadline: limit of the whole search.
        """
        self.trials = trials
        self.choice = choice
        self.singles = singles
        self.deadline = deadline
        self.candidates: list[Candidate] = []
        self.groups: list[list[RowKey]] = []
        self.skipped: list[_SearchStage] = []
        self._skips_stages = True
        self._tried_several_tokens = False

    def run(self) -> list[RowKey]:
        """Try the stages in their order; return the rows in no group."""
        self.candidates = []
        self.groups = []
        self.skipped = []
        self._skips_stages = True
        self._tried_several_tokens = False
        unrepaired = list(self.trials.failing)
        for stage in _STAGES_BEFORE_VALUES:
            unrepaired = self._after_stage(stage, unrepaired)
        if unrepaired:
            unrepaired = self._from_values(unrepaired)
            # A value that must be often has several formulas: fewer of them than of the other edits make sense.
            self._skips_stages = bool(unrepaired)
        for stage in _STAGES_AFTER_VALUES:
            unrepaired = self._after_stage(stage, unrepaired)
        if not self._tried_several_tokens:
            self._try_alternatives()
        return unrepaired

    def run_skipped(self, unrepaired: Sequence[RowKey]) -> list[RowKey]:
        """Try the stages that were skipped, for rows that turned out to have no repair; return the rows in no group."""
        for stage in self.skipped:
            self._try_stage(stage, False, unrepaired)
        return self._group_rows()

    def _after_stage(self, stage: _SearchStage, unrepaired: list[RowKey]) -> list[RowKey]:
        """Try or skip a stage for rows without a repair; return those that are left."""
        settled = not unrepaired and len(self.groups) < 2
        if settled and self._skips_stages and not stage.is_always_tried:
            self.skipped.append(stage)
            return unrepaired
        self._try_stage(stage, settled, unrepaired)
        return self._group_rows()

    def _try_stage(self, stage: _SearchStage, settled: bool, unrepaired: Sequence[RowKey]) -> None:
        """Try the edits of one stage; `settled`: whether one edit repairs all rows.

        With no row `unrepaired`, only places are edited on which rows of several groups depend.
        """
        part = stage.part
        if settled:
            part = _ALTERNATIVES_PART
        self.singles.until = self.deadline.within(part * self.deadline.left)
        statements: set[tuple[str, int]] | None = None
        functions: set[int] | None = None
        if not unrepaired and not stage.is_always_tried:
            statements, functions = self.singles.shared_sites(self.groups)
        if stage.in_called:
            self.candidates += self.singles.in_helpers(stage.kinds, functions)
        else:
            self.candidates += self.singles.in_statements(stage.kinds, statements)
        if stage is _SEVERAL_TOKENS and statements is None:
            self._tried_several_tokens = True

    def _from_values(self, unrepaired: list[RowKey]) -> list[RowKey]:
        """Try the edits that follow from similar expressions and from required values; return the rows in no group."""
        self.singles.until = self.deadline
        self.singles.find_refuted()  # first, because no value is required of expressions without a right one
        self.candidates += self.singles.counterparts(unrepaired)
        self.candidates += self.singles.required(unrepaired)
        return self._group_rows()

    def _try_alternatives(self) -> None:
        """Try all other edits of the statements in which one edit suffices."""
        statements: set[tuple[str, int]] = set()
        for group in self.groups:
            for candidate in self.trials.exact(group, self.candidates):
                statements.add((candidate.step.equation.name, candidate.edits[0].statement))
        self.singles.until = self.deadline.within(_ALTERNATIVES_PART * self.deadline.left)
        self.candidates += self.singles.in_statements(MULTI_TOKEN_KINDS, statements)

    def _group_rows(self) -> list[RowKey]:
        """Put the failing rows in groups as in `groups_of`; return those in no group.

        Edits that make a group agree only by chance are no repairs.
        """
        until = self.deadline.within(_CHANCE_PART * self.deadline.left)
        while True:
            self.groups = groups_of(self.candidates, self.trials.failing)
            has_excluded = False
            for group in self.groups:
                has_excluded |= self._exclude_by_chance(group, until)
            if not has_excluded:
                break
        grouped: set[RowKey] = set()
        for group in self.groups:
            grouped.update(group)
        return without_rows(self.trials.failing, grouped)

    def _exclude_by_chance(self, group: list[RowKey], until: Deadline) -> bool:
        """Exclude the edits that repair a group if all of them do so only by chance; return whether they do."""
        exact = self.trials.exact(group, self.candidates)[:MOST_EXACT_EDITS]
        for candidate in exact:
            if until.passed or self.choice.is_general(candidate):
                return False
        for candidate in exact:
            self.choice.exclude(candidate)
        return bool(exact)


def groups_of(candidates: Iterable[Candidate], rows: Sequence[RowKey]) -> list[list[RowKey]]:
    """Return the rows in groups, the largest first, such that one candidate fixes all rows of a group.

    That is the greedy cover of the rows: the smallest one takes far longer, and has seldom fewer groups.
    """
    unrepaired = set(rows)
    repaired: list[set[RowKey]] = []
    for candidate in candidates:
        if not candidate.may_be_proposed:
            continue
        repaired_rows: set[RowKey] = set()
        for row, residual in candidate.worst_residuals.items():
            if residual <= 1 and row in unrepaired:
                repaired_rows.add(row)
        repaired.append(repaired_rows)
    groups: list[list[RowKey]] = []
    while unrepaired:
        largest: set[RowKey] = set()
        for repaired_rows in repaired:
            remaining = repaired_rows & unrepaired
            if len(remaining) > len(largest):
                largest = remaining
        if not largest:
            break
        groups.append([row for row in rows if row in largest])
        unrepaired -= largest
    return groups


def without_rows(rows: Sequence[RowKey], repaired: Container[RowKey]) -> list[RowKey]:
    """Return the rows that are not among `repaired`, in their order."""
    return [row for row in rows if row not in repaired]
