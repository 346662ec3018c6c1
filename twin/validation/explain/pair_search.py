"""Search two edits that together repair a row, from the values that expressions must have.

`PairSearch.pairs_for` tries these in order, and ends as soon as a pair repairs the row:

1. equations that return a pose: both edits in one expression, then one edit in each of two expressions;
2. all equations: an edit in each of two statements (`StatementPairs`);
3. all equations: the stages of `_StagesOfRow`, from the kinds with few pairs to those with many.

"Expression" is a largest scalar expression, see `required_pairs`. The time is shared from outside to inside: each step
takes at most its part of what is left of the time of the step around it, so that what a step leaves goes to the next.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import cached_property
from typing import NamedTuple

import numpy as np

from twin.validation.explain.batched_solutions import Batch
from twin.validation.explain.candidate import FORM_KINDS, TOKEN_KINDS, Candidate
from twin.validation.explain.deadline import Deadline
from twin.validation.explain.equation_steps import RowKey, Step
from twin.validation.explain.expression import Site
from twin.validation.explain.function_source import Edit, TextPlace
from twin.validation.explain.repair_choice import RepairChoice
from twin.validation.explain.required_pairs import RequiredPairs
from twin.validation.explain.statement_pairs import StatementPairs
from twin.validation.explain.trials import Trials

_POSE_ENTRIES = 12
"""Minimum number of entries of the row of a pose."""

_REQUIRED_PART = 0.85
"""Maximum part of the time for pairs of edits that is used for pairs from required values of expressions."""

_POSE_PART = 0.4
"""Maximum part of this time for equations that return a pose, which are searched before the others."""

_TWO_STATEMENTS_PART = 0.6
"""Maximum part of this time for pairs in different statements, of the last equation; less for those before."""

_EQUATION_PART = 0.6
"""Maximum part of a stage for the equation whose rows have most entries; then of the rest for the next one."""

_COARSE_POSES = 6
"""Number of poses at which most expressions are rejected."""

_PairIterator = Iterator[tuple[Edit, Edit]]

_Pairs = Callable[[RequiredPairs, Sequence[RowKey], Deadline], _PairIterator]
"""Yields the pairs of edits of one kind for an equation and its wrong rows, until a deadline."""


class _Stage(NamedTuple):
    """One kind of pairs of edits, and the largest part of the time left that it may take."""

    part: float
    pairs: _Pairs


class _StagesOfRow:
    """The kinds of pairs that are tried for one row, and the single edits of which one is the first of a pair."""

    def __init__(
        self, shared: Sequence[Edit], singles: Sequence[Edit], in_one_statement: _Pairs, until: Deadline
    ) -> None:
        """Store the edits.

        Args:
            shared: repairs of other rows.
            singles: edits that change the row; those with few replacements at each position first.
            in_one_statement: yields the pairs in one statement.
            until: time limit of all stages.
        """
        self.shared = shared
        self.singles = singles
        self.in_one_statement = in_one_statement
        self.until = until
        self._split_singles: dict[int, tuple[list[Edit], list[Edit]]] = {}

    def in_order(self) -> list[_Stage]:
        """Return the stages in the order in which they are tried: those with few pairs first.

        The parts leave time for the later stages. Two expressions without a first edit have most, because they find
        most pairs of rows with several entries; the last stage takes all that is left.
        """
        return [
            _Stage(0.2, self._shared_and_formula),
            _Stage(0.2, self._counterpart_and_expression),
            _Stage(0.2, self._shared_and_required),
            _Stage(0.2, RequiredPairs.in_one_expression),
            _Stage(0.7, RequiredPairs.in_two_expressions),
            _Stage(0.3, RequiredPairs.in_one_expression_with_term),
            _Stage(0.2, self._counterpart_and_required),
            _Stage(0.4, self.in_one_statement),
            _Stage(0.3, self._outside_and_expression),
            _Stage(0.5, self._inside_and_expression),
            _Stage(1.0, self._single_and_required),
        ]

    def _shared_and_formula(self, search: RequiredPairs, rows: Sequence[RowKey], end: Deadline) -> _PairIterator:
        """Yield a repair of another row, with an edit or a short formula in an expression beside it."""
        return search.with_edit_beside(self.shared, rows, end, composed=True)

    def _shared_and_required(self, search: RequiredPairs, rows: Sequence[RowKey], end: Deadline) -> _PairIterator:
        """Yield a repair of another row, with any edit from the value that an expression must then have."""
        return search.with_required_value(self.shared, rows, end)

    def _counterpart_and_expression(
        self, search: RequiredPairs, rows: Sequence[RowKey], end: Deadline
    ) -> _PairIterator:
        """Yield what a similar expression has more, with an edit in an expression beside it."""
        return search.with_edit_beside(search.counterparts, rows, end)

    def _counterpart_and_required(self, search: RequiredPairs, rows: Sequence[RowKey], end: Deadline) -> _PairIterator:
        """Yield what a similar expression has more, with any edit from the value that an expression must then have."""
        return search.with_required_value(search.counterparts, rows, end)

    def _outside_and_expression(self, search: RequiredPairs, rows: Sequence[RowKey], end: Deadline) -> _PairIterator:
        """Yield single edits outside scalar expressions, each with an edit in an expression beside it."""
        outside, _ = self._outside_and_inside(search)
        return search.with_edit_beside(outside, rows, end)

    def _inside_and_expression(self, search: RequiredPairs, rows: Sequence[RowKey], end: Deadline) -> _PairIterator:
        """Yield single edits inside scalar expressions, each with an edit in another expression."""
        _, inside = self._outside_and_inside(search)
        return search.with_edit_beside(inside, rows, end)

    def _single_and_required(self, search: RequiredPairs, rows: Sequence[RowKey], end: Deadline) -> _PairIterator:
        """Yield all single edits, each with any edit from the value that an expression must then have."""
        return search.with_required_value(self.singles, rows, end)

    def _outside_and_inside(self, search: RequiredPairs) -> tuple[list[Edit], list[Edit]]:
        """Return the single edits outside and inside the scalar expressions of a search."""
        if id(search) not in self._split_singles:  # it takes long, and two stages need it
            self._split_singles[id(search)] = search.outside(self.singles, self.until)
        return self._split_singles[id(search)]


class PairSearch:
    """Search for pairs of edits of one judged formula."""

    def __init__(self, trials: Trials, choice: RepairChoice) -> None:
        """Set up the search: `trials` evaluates pairs, `choice` tells whether a pair is a repair."""
        self.trials = trials
        self.choice = choice
        self._in_two_statements: list[Candidate] | None = None
        self._statement_pairs: dict[str, StatementPairs | None] = {}

    def pairs_for(
        self, row: RowKey, singles: list[Candidate], shared: list[Candidate], deadline: Deadline
    ) -> tuple[list[Candidate], bool]:
        """Return (pairs of edits found from required values of expressions, whether the search ended).

        See `RequiredPairs`. The pairs must repair all failing rows that the expressions move, or `row` alone.
        `shared` are repairs of other rows; one of them may be the first edit.
        """
        until = deadline.within(_REQUIRED_PART * deadline.left)
        pairs: list[Candidate] = []
        searches: list[tuple[RequiredPairs, tuple[RowKey, ...]]] = []
        searches_of_poses: list[tuple[RequiredPairs, tuple[RowKey, ...]]] = []
        for rows in dict.fromkeys((tuple(self.trials.failing), (row,))):
            for search in self.required_pairs:
                searches.append((search, rows))
                if self._has_pose(search, rows):
                    searches_of_poses.append((search, rows))
        for kind in (RequiredPairs.in_one_expression, RequiredPairs.in_two_expressions):
            # A pose rejects nearly all wrong pairs of expressions, so that this takes little time.
            end = until.within(_POSE_PART * until.left)
            pairs += self._tried_pairs(kind, searches_of_poses, end)
            if self.choice.has_repair(row, pairs):
                return pairs, True
        pairs += self._of_two_statements(until)
        if self.choice.has_repair(row, pairs):
            return pairs, True
        shared_edits = [candidate.edits[0] for candidate in shared]
        single_edits = _edits_of_row(singles, row)
        stages = _StagesOfRow(shared_edits, single_edits, self._in_one_statement, until)
        for stage in stages.in_order():
            of_stage = until.within(stage.part * until.left)
            for m, (search, rows) in enumerate(searches):
                if until.passed:
                    break
                part = _EQUATION_PART
                if m == len(searches) - 1:
                    part = 1.0
                end = of_stage.within(part * of_stage.left)
                pairs += self._tried_pairs(stage.pairs, [(search, rows)], end)
                if self.choice.has_repair(row, pairs):
                    return pairs, True
        return pairs, not until.passed

    def _tried_pairs(
        self, kind: _Pairs, searches: Sequence[tuple[RequiredPairs, Sequence[RowKey]]], end: Deadline
    ) -> list[Candidate]:
        """Return the candidates for the pairs of edits of one kind in some equations."""
        candidates: list[Candidate] = []
        for search, rows in searches:
            if end.passed:
                break
            for first, second in kind(search, rows, end):
                candidate = self._pair(search, first, second)
                if candidate is not None:
                    candidates.append(candidate)
        return candidates

    def _has_pose(self, search: RequiredPairs, rows: Sequence[RowKey]) -> bool:
        """Return whether one of `rows` is a pose that an equation returns."""
        for row in rows:
            entries = self.trials.residuals_before[row].shape[1]
            if row[0] == search.step.equation.name and entries >= _POSE_ENTRIES:
                return True
        return False

    def statement_pairs(self, step: Step) -> StatementPairs | None:
        """Return the search for edits in the statements of an equation itself; None for a plain function."""
        name = step.equation.name
        if name not in self._statement_pairs:
            own_sites: list[Site] = []
            for step_of_sites, sites in self.trials.sites():
                if step_of_sites is step:
                    own_sites = [site for site in sites if site.source is step.source]
            self._statement_pairs[name] = None
            if step.plain_function is None and own_sites:
                self._statement_pairs[name] = StatementPairs(self.trials.judge, name, own_sites, self.trials.failing)
        return self._statement_pairs[name]

    def _of_two_statements(self, until: Deadline) -> list[Candidate]:
        """Return pairs of edits in different statements of an equation; they are searched once, for all rows."""
        if self._in_two_statements is None:
            self._in_two_statements = []
            searches = self.required_pairs
            most_entries = 0
            for row in self.trials.failing:
                most_entries = max(most_entries, self.trials.residuals_before[row].shape[1])
            for n, search in enumerate(searches):
                statement_pairs = self.statement_pairs(search.step)
                if statement_pairs is None:
                    continue
                # The equations that are left share the time, but an early one may need more than its share.
                part = _TWO_STATEMENTS_PART / (len(searches) - n) ** 0.5
                end = until.within(part * until.left)
                places: list[TextPlace] = []
                # One entry of a row does not determine two scalars, so that their edits are tried as well.
                if most_entries > 1:
                    places = [scalar.place for scalar in search.scalars(self.trials.failing, end)]
                for first, second in statement_pairs.in_two_statements(end, places):
                    candidate = self._pair(search, first, second)
                    if candidate is not None:
                        self._in_two_statements.append(candidate)
        return list(self._in_two_statements)

    def _in_one_statement(
        self, search: RequiredPairs, rows: Sequence[RowKey], end: Deadline
    ) -> Iterator[tuple[Edit, Edit]]:
        """Yield pairs of edits in one statement; they are searched for all failing rows at once, not for one."""
        statement_pairs = self.statement_pairs(search.step)
        if statement_pairs is not None and len(rows) == len(self.trials.failing):
            yield from statement_pairs.in_one_statement(end)

    def _pair(self, search: RequiredPairs, first: Edit, second: Edit) -> Candidate | None:
        """Return the candidate for two edits of one function, judged in all equations that call it."""
        steps = [search.step]
        for site in search.sites:
            if site.source.name == first.function:
                steps += self.trials.callers(site.source, search.step)
                break
        return self.trials.candidate_for(steps, [first, second])

    @cached_property
    def required_pairs(self) -> list[RequiredPairs]:
        """The searches for two edits, one for each equation on which failing rows depend."""
        k = self.trials.judge.reference.k
        few = np.linspace(0, k - 1, min(_COARSE_POSES, k)).astype(int)
        coarse = Batch(self.trials.judge, few.tolist(), _COARSE_POSES // 2)
        full = Batch(self.trials.judge, range(k))
        searches: list[RequiredPairs] = []
        for step, sites in self.trials.sites():
            searches.append(RequiredPairs(coarse, full, step, sites, self.trials.failing))
        # Rows with several entries reject nearly all wrong expressions, so that they are tried first.
        return sorted(searches, key=lambda search: self.trials.entries(search.step), reverse=True)


def _edits_of_row(singles: Sequence[Candidate], row: RowKey) -> list[Edit]:
    """Return the edits that change a row and need no new name, those with few replacements at each position first."""
    edits: list[Edit] = []
    for candidate in singles:
        edit = candidate.edits[0]
        if row in candidate.worst_residuals and edit.define is None:
            edits.append(edit)
    edits.sort(key=lambda edit: (edit.kind not in FORM_KINDS, edit.kind not in TOKEN_KINDS))
    return edits
