"""Search the smallest edits of the source after which the rows agree, and check whether other edits fit as well."""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable, Sequence
from functools import cached_property

import numpy as np

from twin.core.progress import StepProgress, silent_step
from twin.validation.explain.candidate import FORM_KINDS, Candidate, GroupResult
from twin.validation.explain.deadline import Deadline
from twin.validation.explain.edited_functions import EditedFunctions
from twin.validation.explain.equation_steps import RowKey
from twin.validation.explain.name_pool import name_pool
from twin.validation.explain.pair_search import PairSearch
from twin.validation.explain.position_pairs import PositionPairs
from twin.validation.explain.repair_choice import MOST_EXACT_EDITS, RepairChoice
from twin.validation.explain.row_deviations import Judge
from twin.validation.explain.single_edits import SingleEdits
from twin.validation.explain.single_search import SingleSearch, groups_of, without_rows
from twin.validation.explain.statement_edits import statement_edits
from twin.validation.explain.trials import Trials

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
        self.choice = RepairChoice(self, self.deadline)
        self.pair_search = PairSearch(self, self.choice)
        self.position_pairs = PositionPairs(self)
        self.singles = SingleEdits(self, self.pair_search, self.deadline, progress)
        self.single_search = SingleSearch(self, self.choice, self.singles, self.deadline)

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
        results, unrepaired = self._quiet(self._of_single_edits)
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

    def _of_single_edits(self) -> tuple[list[GroupResult], list[RowKey]]:
        """Search single edits; return (results by group of rows, rows without a repair)."""
        results, unrepaired = self._results(self.single_search.run())
        if unrepaired and self.single_search.skipped:
            # The repair because of which stages were skipped holds only by chance.
            results, unrepaired = self._results(self.single_search.run_skipped(unrepaired))
        self.singles.until = self.deadline
        return results, unrepaired

    def _results(self, unrepaired: Sequence[RowKey]) -> tuple[list[GroupResult], list[RowKey]]:
        """Return (results of the groups that have a repair, rows without one)."""
        results: list[GroupResult] = []
        rows_left = list(unrepaired)
        candidates = self.single_search.candidates
        for group in self.single_search.groups:
            result = self._result(group, candidates, candidates)
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
                unrepaired = without_rows(unrepaired, result.rows)
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

        `late` are single edits that were evaluated after pairs; further ones are added, also to those of the search for
        single edits. Without a `budget`, nothing is searched.
        """
        began = time.monotonic()
        singles = list(self.single_search.candidates)
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
                self.single_search.candidates += evaluated  # each may be one of a pair, also for later rows
                singles += evaluated
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
        for repaired_rows in groups_of(pairs, unrepaired):
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

    # -- results ------------------------------------------------------------------------------------------------

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
