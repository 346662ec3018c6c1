"""Search the smallest edits of the source after which the rows agree, and check whether other edits fit as well."""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable, Container, Sequence
from functools import cached_property
from typing import NamedTuple

import numpy as np

from twin.core.progress import StepProgress, silent_step
from twin.validation.explain.candidate import (
    CALL_KINDS,
    FORM_KINDS,
    MULTI_TOKEN_KINDS,
    OPERATOR_KINDS,
    TOKEN_KINDS,
    Candidate,
    GroupResult,
)
from twin.validation.explain.deadline import Deadline
from twin.validation.explain.edited_functions import EditedFunctions
from twin.validation.explain.equation_steps import RowKey
from twin.validation.explain.name_pool import name_pool
from twin.validation.explain.pair_search import PairSearch
from twin.validation.explain.position_pairs import PositionPairs
from twin.validation.explain.repair_choice import MOST_EXACT_EDITS, RepairChoice
from twin.validation.explain.row_deviations import Judge
from twin.validation.explain.single_edits import SingleEdits
from twin.validation.explain.statement_edits import statement_edits
from twin.validation.explain.trials import Trials

_FORM_TOKENS = tuple(kind for kind in TOKEN_KINDS if kind in FORM_KINDS)
_NAME_TOKENS = tuple(kind for kind in TOKEN_KINDS if kind not in FORM_KINDS)
_MULTI_TOKEN_BUT_CALLS = tuple(kind for kind in MULTI_TOKEN_KINDS if kind not in FORM_KINDS)


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


_STAGES = (
    _SearchStage(False, _FORM_TOKENS, 0.3),
    _SearchStage(True, CALL_KINDS, 0.3),
    _SearchStage(False, _NAME_TOKENS, 0.5),
    _SearchStage(True, OPERATOR_KINDS, 0.3),
    _SearchStage(False, MULTI_TOKEN_KINDS, 0.3),
    _SearchStage(True, _NAME_TOKENS, 0.5),
    _SearchStage(True, _MULTI_TOKEN_BUT_CALLS, 0.6),
)
"""The stages in their order: kinds with few replacements first, because a slow equation has time for few hundred edits.

Names and kinds with many replacements have larger parts.
"""

_ALTERNATIVES_PART = 0.3
"""Maximum part of the remaining time for other edits with the same result, after an edit that repairs all rows."""

_STAGE_BEFORE_VALUES = 1
"""Index of the stage after which edits are found from required values.

They come before the kinds with many replacements, which may need all the time.
"""

_CHANCE_PART = 0.2
"""Maximum part of the remaining time for the question whether edits repair rows only by chance, after each stage."""

_MOST_CHANCE_EDITS = 3
"""Number of edits that repair a row only by chance beside which a second one is tried."""

_CHANCE_PAIRS_PART = 0.4
"""Maximum part of the remaining time for such pairs."""

_MOST_SHARED_EDITS = 3
"""Number of edits of each repaired group that are also tried in pairs, to fix the remaining rows."""


class RepairSearch(Trials):
    """Repair search over one judged formula.

    Rows that one edit repairs together are a group. Single edits are searched first; for rows that they do not repair,
    pairs of edits.
    """

    def __init__(
        self,
        judge: Judge,
        progress: StepProgress = silent_step,
        deadline: Deadline | None = None,
    ) -> None:
        """Set up a search for the wrong rows of `judge`; `deadline`: limit of the whole search, None: no limit."""
        super().__init__(judge)
        self.deadline = deadline or Deadline()
        self._candidates: list[Candidate] = []
        """Candidates for all single edits that were evaluated."""
        self._groups: list[list[RowKey]] = []
        self.choice = RepairChoice(self, self.deadline)
        self.pair_search = PairSearch(self, self.choice)
        self.position_pairs = PositionPairs(self)
        self.singles = SingleEdits(self, self.pair_search, self.deadline, progress)

    @property
    def by_chance(self) -> list[tuple[Candidate, str]]:
        """Edits that make rows agree only by chance, which are no repairs, and the condition: "because a = b"."""
        return self.choice.by_chance

    @cached_property
    def functions(self) -> EditedFunctions:
        """Comparison of the functions that result from edits."""
        return EditedFunctions(self.judge, self.perturbed_judge)

    def run(self, budget: float = 8.0) -> tuple[list[GroupResult], list[RowKey]]:
        """Search repairs; return (results by group of rows, rows without a repair).

        `budget` is the time limit in s of the search for pairs of edits; 0: single edits only.
        """
        results, unrepaired = self._quiet(self._run)
        if not unrepaired:
            results, unrepaired = self._quiet(lambda: self.choice.together(results))
        if unrepaired:
            return self.pairs(results, unrepaired, budget)
        return results, unrepaired

    def pairs(
        self, results: list[GroupResult], unrepaired: list[RowKey], budget: float
    ) -> tuple[list[GroupResult], list[RowKey]]:
        """Search pairs of edits for rows that single edits do not repair; arguments and result are those of `run`."""
        with_repair = [result for result in results if result.cures]
        return self._quiet(lambda: self._pairs_of(with_repair, unrepaired, budget))

    def _quiet(
        self, search: Callable[[], tuple[list[GroupResult], list[RowKey]]]
    ) -> tuple[list[GroupResult], list[RowKey]]:
        """Run a search without the warnings of edited text: a fault in it shows when it is evaluated."""
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            # Python warns about a call of a number after a moved parenthesis; such an edit fails when tried.
            warnings.simplefilter("ignore", SyntaxWarning)
            return search()

    # -- one edit -----------------------------------------------------------------------------------------------

    def _run(self) -> tuple[list[GroupResult], list[RowKey]]:
        """Search single edits, stage by stage; return (results by group of rows, rows without a repair)."""
        self._candidates = []
        self._groups = []
        unrepaired = list(self.failing)
        skipped_stages: list[int] = []
        all_kinds_tried = False
        is_from_values = False
        # First one token; if this is not enough, terms, factors and parentheses; then the called functions. If several
        # edits repair the rows, one that repairs more of them is searched where they have something in common.
        for n, (in_called, kinds, _) in enumerate(_STAGES):
            settled = not unrepaired and len(self._groups) < 2
            # A value that must be often has several formulas: fewer of them than edits of one token make sense.
            if settled and not is_from_values and (in_called or kinds == MULTI_TOKEN_KINDS):
                skipped_stages.append(n)
                continue
            tried_everywhere = self._stage(n, settled, unrepaired)
            if tried_everywhere and not in_called and kinds == MULTI_TOKEN_KINDS:
                all_kinds_tried = True
            unrepaired = self._group_rows()
            if n == _STAGE_BEFORE_VALUES and unrepaired:
                unrepaired = self._from_values(unrepaired)
                is_from_values = not unrepaired
        if not all_kinds_tried:
            self._try_alternatives()
        results, unrepaired = self._results(unrepaired)
        if unrepaired and skipped_stages:
            # The repair because of which these stages were skipped holds only by chance.
            for n in skipped_stages:
                self._stage(n, False, unrepaired)
            results, unrepaired = self._results(self._group_rows())
        self.singles.until = self.deadline
        return results, unrepaired

    def _stage(self, n: int, settled: bool, unrepaired: Sequence[RowKey]) -> bool:
        """Try the edits of one stage; return whether they were tried everywhere, and not only where groups meet.

        `settled`: whether one edit repairs all rows; `unrepaired`: rows without a repair.
        """
        in_called, kinds, part = _STAGES[n]
        if settled:
            part = _ALTERNATIVES_PART
        self.singles.until = self.deadline.within(part * self.deadline.left)
        statements: set[tuple[str, int]] | None = None
        functions: set[int] | None = None
        of_rows = not in_called and kinds != MULTI_TOKEN_KINDS  # all are tried, to find every tie
        if not unrepaired and not of_rows:
            statements, functions = self.singles.shared_sites(self._groups)
        if in_called:
            self._candidates += self.singles.in_helpers(kinds, functions)
        else:
            self._candidates += self.singles.in_statements(kinds, statements)
        return statements is None

    def _from_values(self, unrepaired: list[RowKey]) -> list[RowKey]:
        """Try the edits that follow from similar expressions and from required values; return rows without a repair."""
        self.singles.until = self.deadline
        self.singles.find_refuted()  # first, because no value is required of expressions without a right one
        self._candidates += self.singles.counterparts(unrepaired)
        self._candidates += self.singles.required(unrepaired)
        return self._group_rows()

    def _try_alternatives(self) -> None:
        """Try all other edits of the statements in which one token suffices."""
        statements: set[tuple[str, int]] = set()
        for group in self._groups:
            for candidate in self.exact(group, self._candidates):
                statements.add((candidate.step.equation.name, candidate.edits[0].statement))
        self.singles.until = self.deadline.within(_ALTERNATIVES_PART * self.deadline.left)
        self._candidates += self.singles.in_statements(MULTI_TOKEN_KINDS, statements)

    def _results(self, unrepaired: Sequence[RowKey]) -> tuple[list[GroupResult], list[RowKey]]:
        """Return (results of the groups that have a repair, rows without one)."""
        results: list[GroupResult] = []
        rows_left = list(unrepaired)
        for group in self._groups:
            result = self._result(group, self._candidates, self._candidates)
            if result.cures:
                results.append(result)
            else:  # two edits may repair these rows for all values of the parameters
                rows_left += group
        return results, rows_left

    # -- two edits ----------------------------------------------------------------------------------------------

    def _pairs_of(
        self, results: list[GroupResult], unrepaired: list[RowKey], budget: float
    ) -> tuple[list[GroupResult], list[RowKey]]:
        """Search pairs of edits row by row, and again for rows whose repairs do not hold with those of other rows."""
        late: list[Candidate] = []
        without_repair: list[RowKey] = []
        deadline = self.deadline.within(budget)
        while True:
            while unrepaired:
                row = unrepaired[0]
                result, replaced = self._pair_result(row, unrepaired, results, late, deadline, budget)
                identities = set(map(id, replaced))  # results of arrays cannot be compared by ==
                results = [earlier for earlier in results if id(earlier) not in identities]
                results.append(result)
                if not result.cures:
                    without_repair.append(row)
                unrepaired = _without(unrepaired, result.rows)
            if without_repair:
                return results, without_repair
            compatible, unrepaired = self.choice.together(results)
            if not unrepaired or budget <= 0 or deadline.passed:
                return compatible, unrepaired
            # What `together` left out is refused, so that others are found now.
            results = [result for result in compatible if result.cures]

    def _pair_result(
        self,
        row: RowKey,
        unrepaired: list[RowKey],
        results: list[GroupResult],
        late: list[Candidate],
        deadline: Deadline,
        budget: float,
    ) -> tuple[GroupResult, list[GroupResult]]:
        """Return (the result of a search for pairs of edits that repair a row, results that it replaces).

        `late` are single edits that were evaluated after pairs; further ones are added. Without a `budget`, nothing is
        searched.
        """
        began = time.monotonic()
        singles = self._candidates
        shared: list[Candidate] = []
        for result in results:
            shared += self.exact(result.rows, singles)[:_MOST_SHARED_EDITS]
        pairs: list[Candidate] = []
        complete = False
        if budget > 0:
            pairs = self._beside_chance(row, singles, deadline.within(_CHANCE_PAIRS_PART * deadline.left))
            if not self.choice.has_repair(row, pairs):
                pairs, complete = self.pair_search.pairs_for(row, singles, shared, deadline)
            if not self.choice.has_repair(row, pairs):
                evaluated = self.singles.evaluate_deferred()
                late += evaluated
                singles += evaluated  # each may be one of a pair
                pairs = list(late)
            if not self.choice.has_repair(row, pairs):
                pairs, complete = self.position_pairs.pairs_for(row, singles, shared, deadline)
        result, replaced = self._widest(row, unrepaired, results, [*singles, *pairs], pairs)
        result.complete = result.complete and complete
        result.seconds = time.monotonic() - began
        return result, replaced

    def _beside_chance(self, row: RowKey, singles: list[Candidate], deadline: Deadline) -> list[Candidate]:
        """Return pairs of an edit that repairs a row only by chance, and one that shows only for other values.

        The values of parameters may hide another error of the same function: no row disagrees because of it.
        """
        pairs: list[Candidate] = []
        firsts: list[Candidate] = []
        for candidate in singles:
            repairs_row = candidate.worst_residuals.get(row, np.inf) <= 1
            if candidate.by_chance and repairs_row and not (candidate.breaks_row or candidate.is_trivial):
                firsts.append(candidate)
        firsts.sort(key=lambda candidate: candidate.rank)
        for candidate in firsts[:_MOST_CHANCE_EDITS]:
            (first,) = candidate.edits
            source = self.judge.source_of(candidate.step, first)
            steps = [candidate.step, *self.callers(source, candidate.step)]
            for statement in source.statements:
                names = name_pool(source, statement, set(source.arguments), self.parameters, candidate.step.scope)
                for second in statement_edits(source, statement, names, FORM_KINDS):
                    if deadline.passed:
                        return pairs
                    if first.start <= second.end and second.start <= first.end:  # they touch each other
                        continue
                    pair = self.candidate_for(steps, [first, second])
                    if pair is None or not self.exact([row], [pair]):
                        continue
                    # `is_general` is also true if nothing is known; here, the pair must be known to hold.
                    if self.choice.is_general(pair) and self.choice.states.after(pair.edits) is not None:
                        pairs.append(pair)
        return pairs

    def _widest(
        self,
        row: RowKey,
        unrepaired: list[RowKey],
        results: list[GroupResult],
        candidates: list[Candidate],
        pairs: list[Candidate],
    ) -> tuple[GroupResult, list[GroupResult]]:
        """Return (the result of `pairs` for a row and as many other rows as they repair, results that it replaces).

        A pair that is no repair, because it holds only by chance, replaces no result.
        """
        # An edit that fixes this row may also fix others, and rows of which a repair is known.
        group: list[RowKey] = []
        for repaired_rows in self._groups_of(pairs, unrepaired):
            if row in repaired_rows:
                group = repaired_rows
        replaced: list[GroupResult] = []
        for result in results:
            if group and result.cures and self.exact([*group, *result.rows], pairs):
                replaced.append(result)
        if replaced:
            rows = list(group)
            for result in replaced:
                rows += result.rows
            widest = self._result(rows, pairs, candidates)
            if widest.cures:
                return widest, replaced
        if len(group) > 1:
            of_group = self._result(group, pairs, candidates)
            if of_group.cures:
                return of_group, []
        return self._result([row], pairs, candidates), []

    # -- groups -------------------------------------------------------------------------------------------------

    def _group_rows(self) -> list[RowKey]:
        """Put the failing rows in groups as in `_groups_of`; return those in no group.

        Edits that make a group agree only by chance are no repairs.
        """
        until = self.deadline.within(_CHANCE_PART * self.deadline.left)
        while True:
            self._groups = self._groups_of(self._candidates, self.failing)
            has_excluded = False
            for group in self._groups:
                has_excluded |= self._exclude_by_chance(group, until)
            if not has_excluded:
                break
        grouped: set[RowKey] = set()
        for group in self._groups:
            grouped.update(group)
        return _without(self.failing, grouped)

    def _exclude_by_chance(self, group: list[RowKey], until: Deadline) -> bool:
        """Exclude the edits that repair a group if all of them do so only by chance; return whether they do."""
        exact = self.exact(group, self._candidates)[:MOST_EXACT_EDITS]
        for candidate in exact:
            if until.passed or self.choice.is_general(candidate):
                return False
        for candidate in exact:
            self.choice.exclude(candidate)
        return bool(exact)

    def _groups_of(self, candidates: list[Candidate], rows: list[RowKey]) -> list[list[RowKey]]:
        """Return the rows in groups, the largest first, such that one single edit fixes all rows of a group.

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

    def _result(self, rows: list[RowKey], repairs: list[Candidate], candidates: list[Candidate]) -> GroupResult:
        """Return the result for a group of rows: `repairs` may repair them, `candidates` have the next best edit."""
        exact = self.exact(rows, repairs)[:MOST_EXACT_EDITS]
        every_cure = self.functions.grouped_by_function(exact, rows)
        cures = self.choice.best(every_cure)
        if every_cure and not cures:
            first = every_cure[0][0]
            state = self.choice.states.after(first.edits)
            if state is not None and (state.chance_condition or state.is_worse):
                self.choice.exclude(first)
        best_residual = float("inf")
        for candidate in exact:
            best_residual = min(best_residual, candidate.worst_over(rows, self.worst_before))
        if not exact:  # without a repair, the rows stay as they are
            residuals = [self.worst_before[row] for row in rows]
            best_residual = max(residuals)
        identities = set(map(id, exact))
        runner_up: Candidate | None = None
        runner_up_residual = float("inf")
        for candidate in candidates:
            changes_rows = not candidate.worst_residuals.keys().isdisjoint(rows)
            if id(candidate) in identities or not changes_rows:
                continue
            residual = candidate.worst_over(rows, self.worst_before)
            # The first one also counts if its residual is infinite.
            if residual > 1 and (residual < runner_up_residual or runner_up is None):
                runner_up_residual = residual
                runner_up = candidate
        return GroupResult(
            rows=rows,
            cures=cures,
            runner_up=runner_up,
            best_residual=best_residual,
            runner_up_residual=runner_up_residual,
            tried=self.trial_count,
            complete=self.singles.complete,
        )


def _without(rows: Sequence[RowKey], repaired: Container[RowKey]) -> list[RowKey]:
    """Return the rows that are not among `repaired`, in their order."""
    return [row for row in rows if row not in repaired]
