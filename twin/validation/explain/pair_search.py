"""Search two edits that together repair a row, from the values that expressions must have."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import cached_property
from pathlib import Path

import numpy as np

from twin.validation.explain.batched_solutions import Batch
from twin.validation.explain.candidate import FORMS, TOKENS, Candidate
from twin.validation.explain.deadline import Deadline
from twin.validation.explain.equation_steps import RowKey, Step
from twin.validation.explain.expression import Site
from twin.validation.explain.function_source import Edit
from twin.validation.explain.repair_choice import RepairChoice
from twin.validation.explain.required_pairs import RequiredPairs
from twin.validation.explain.statement_pairs import StatementPairs
from twin.validation.explain.trials import Trials

_DOUBLE_SHARES = (0.2, 0.2, 0.2, 0.2, 0.7, 0.3, 0.2, 0.4, 0.3, 0.5, 1.0)
"""Maximum parts of the remaining time for the kinds of such pairs, in the order of `found`."""

_IN_ONE = 3
_IN_TWO = 4
"""Indices of the kinds of pairs in scalar expressions, which are tried first for equations that return a pose."""

_POSE = 12
"""Minimum number of entries of the row of a pose."""

_POSE_PART = 0.4
"""Maximum part of the time for these pairs."""

_APART = 0.6
"""Maximum part of this time for pairs in different statements, of the last equation; less for those before."""

_FIRST_PART = 0.6
"""Maximum part of this time for the equation whose rows have most entries; then of the rest for the next one."""

_DOUBLE_PART = 0.85
"""Maximum part of the time for pairs of edits that is used for pairs from required values of expressions."""

_COARSE = 6
"""Number of poses at which most expressions are rejected."""

_Stage = Callable[[RequiredPairs, Sequence[RowKey], Deadline], Iterator[tuple[Edit, Edit]]]
"""Yields the pairs of edits of one kind for an equation and its wrong rows, until a deadline."""


class PairSearch:
    """Search for pairs of edits of one judged formula."""

    def __init__(self, trials: Trials, choice: RepairChoice) -> None:
        """Set up the search: `trials` evaluates pairs, `choice` tells whether a pair is a repair."""
        self.trials = trials
        self.choice = choice
        self._in_two_statements: list[Candidate] | None = None
        self._crossings: dict[str, StatementPairs | None] = {}

    def found(
        self, row: RowKey, singles: list[Candidate], shared: list[Candidate], deadline: Deadline
    ) -> tuple[list[Candidate], bool]:
        """Return (pairs of edits found from required values of expressions, whether the search ended).

        See `RequiredPairs`. The pairs must repair all failing rows that the expressions move, or `row` alone.
        `shared` are repairs of other rows; one of them may be the first edit.
        """
        until = deadline.within(_DOUBLE_PART * deadline.left)
        pairs: list[Candidate] = []
        firsts: list[Edit] = []
        for candidate in singles:
            edit = candidate.edits[0]
            if row in candidate.scores and edit.define is None:
                firsts.append(edit)
        # Edits with few replacements at each position come first.
        firsts.sort(key=lambda edit: (edit.kind not in FORMS, edit.kind not in TOKENS))
        searches: list[tuple[RequiredPairs, tuple[RowKey, ...]]] = []
        for rows in dict.fromkeys((tuple(self.trials.failing), (row,))):
            for double in self.doubles:
                searches.append((double, rows))
        known = [candidate.edits[0] for candidate in shared]
        parts: dict[int, tuple[list[Edit], list[Edit]]] = {}

        def parted(double: RequiredPairs) -> tuple[list[Edit], list[Edit]]:
            if id(double) not in parts:
                parts[id(double)] = double.outside(firsts, until)
            return parts[id(double)]

        stages: list[_Stage] = [
            lambda double, rows, end: double.beside(known, rows, end, composed=True),
            lambda double, rows, end: double.beside(double.counterparts, rows, end),
            lambda double, rows, end: double.required(known, rows, end),
            lambda double, rows, end: double.in_one(rows, end),
            lambda double, rows, end: double.in_two(rows, end),
            lambda double, rows, end: double.in_one_with_term(rows, end),
            lambda double, rows, end: double.required(double.counterparts, rows, end),
            self._in_one_statement,
            lambda double, rows, end: double.beside(parted(double)[0], rows, end),
            lambda double, rows, end: double.beside(parted(double)[1], rows, end),
            lambda double, rows, end: double.required(firsts, rows, end),
        ]
        for stage in (stages[_IN_ONE], stages[_IN_TWO]):
            # A pose rejects nearly all wrong pairs of expressions, so that this takes little time.
            end = until.within(_POSE_PART * until.left)
            of_poses = [(double, rows) for double, rows in searches if self._has_pose(double, rows)]
            pairs += self._tried_pairs(stage, of_poses, end)
            if self.choice.has_repair(row, pairs):
                return pairs, True
        pairs += self._of_two_statements(until)
        if self.choice.has_repair(row, pairs):
            return pairs, True
        for share, stage in zip(_DOUBLE_SHARES, stages, strict=True):
            of_stage = until.within(share * until.left)
            for m, (double, rows) in enumerate(searches):
                if until.passed:
                    break
                part = _FIRST_PART
                if m == len(searches) - 1:
                    part = 1.0
                end = of_stage.within(part * of_stage.left)
                pairs += self._tried_pairs(stage, [(double, rows)], end)
                if self.choice.has_repair(row, pairs):
                    return pairs, True
        return pairs, not until.passed

    def _tried_pairs(
        self, stage: _Stage, searches: Sequence[tuple[RequiredPairs, Sequence[RowKey]]], end: Deadline
    ) -> list[Candidate]:
        """Return the candidates for the pairs of edits that a stage of `found` finds in some equations."""
        candidates: list[Candidate] = []
        for double, rows in searches:
            if end.passed:
                break
            for first, second in stage(double, rows, end):
                candidate = self._pair(double, first, second)
                if candidate is not None:
                    candidates.append(candidate)
        return candidates

    def _has_pose(self, double: RequiredPairs, rows: Sequence[RowKey]) -> bool:
        """Return whether one of `rows` is a pose that an equation returns."""
        rows_of_equation = [row for row in rows if row[0] == double.step.equation.name]
        entries = [self.trials.raw[row].shape[1] for row in rows_of_equation]
        return max(entries, default=0) >= _POSE

    def crossed(self, step: Step) -> StatementPairs | None:
        """Return the search for edits in the statements of an equation itself; None for a plain function."""
        name = step.equation.name
        if name not in self._crossings:
            own: list[Site] = []
            for other, sites in self.trials.sites():
                if other is step:
                    own = [site for site in sites if site.source is step.source]
            search = None
            if step.plain is None and own:
                search = StatementPairs(self.trials.judge, name, own, self.trials.failing)
            self._crossings[name] = search
        return self._crossings[name]

    def _of_two_statements(self, until: Deadline) -> list[Candidate]:
        """Return pairs of edits in different statements of an equation; they are searched once, for all rows."""
        if self._in_two_statements is None:
            self._in_two_statements = []
            doubles = self.doubles
            # One entry of a row does not determine two scalars, so that their edits are tried as well.
            most_entries = max(self.trials.raw[row].shape[1] for row in self.trials.failing)
            for n, double in enumerate(doubles):
                search = self.crossed(double.step)
                if search is None:
                    continue
                part = _APART / (len(doubles) - n) ** 0.5
                end = until.within(part * until.left)
                places: list[tuple[Path, int, int]] = []
                if most_entries > 1:
                    places = [cut.place for cut in double.cuts(self.trials.failing, end)]
                for first, second in search.apart(end, places):
                    candidate = self._pair(double, first, second)
                    if candidate is not None:
                        self._in_two_statements.append(candidate)
        return list(self._in_two_statements)

    def _in_one_statement(
        self, double: RequiredPairs, rows: Sequence[RowKey], end: Deadline
    ) -> Iterator[tuple[Edit, Edit]]:
        search = self.crossed(double.step)
        if search is not None and len(rows) == len(self.trials.failing):
            yield from search.together(end)

    def _pair(self, double: RequiredPairs, first: Edit, second: Edit) -> Candidate | None:
        """Return the candidate for two edits of one function, judged in all equations that call it."""
        source = next(site.source for site in double.sites if site.source.name == first.function)
        others = self.trials.callers(source, double.step)
        return self.trials.everywhere([double.step, *others], [first, second])

    @cached_property
    def doubles(self) -> list[RequiredPairs]:
        """The searches for two edits, one for each equation on which failing rows depend."""
        k = self.trials.judge.reference.k
        few = np.linspace(0, k - 1, min(_COARSE, k)).astype(int)
        coarse = Batch(self.trials.judge, few.tolist(), _COARSE // 2)
        full = Batch(self.trials.judge, range(k))
        searches: list[RequiredPairs] = []
        for step, sites in self.trials.sites():
            searches.append(RequiredPairs(coarse, full, step, sites, self.trials.failing))
        # Rows with several entries reject nearly all wrong expressions, so that they are tried first.
        return sorted(searches, key=lambda double: self.trials.entries(double.step), reverse=True)
