"""Search the smallest edits of the source after which the rows agree, and check whether other edits fit as well."""

from __future__ import annotations

import time
import warnings
from collections import Counter
from collections.abc import Callable, Container, Sequence
from functools import cached_property
from pathlib import Path

import numpy as np

from twin.validation.explain.candidate import CALLS, FORMS, OPERATORS, REST, TOKENS, Candidate, GroupResult
from twin.validation.explain.counterparts import counterpart_edits
from twin.validation.explain.deadline import Deadline
from twin.validation.explain.edited_functions import EditedFunctions
from twin.validation.explain.equation_steps import Helper, RowKey, Step
from twin.validation.explain.function_source import Edit, Statement
from twin.validation.explain.pair_search import PairSearch
from twin.validation.explain.position_pairs import PositionPairs
from twin.validation.explain.repair_choice import MOST_EXACT, RepairChoice
from twin.validation.explain.required_values import RequiredValues
from twin.validation.explain.row_deviations import Judge
from twin.validation.explain.statement_edits import edits, pool
from twin.validation.explain.suspects import available
from twin.validation.explain.trials import Trials

_STAGES = (
    (False, tuple(k for k in TOKENS if k in FORMS)),
    (True, CALLS),
    (False, tuple(k for k in TOKENS if k not in FORMS)),
    (True, OPERATORS),
    (False, REST),
    (True, tuple(k for k in TOKENS if k not in FORMS)),
    (True, tuple(k for k in REST if k not in FORMS)),
)
"""Stages of the search for one edit: (whether called functions are edited, kinds of edits).

Kinds with few replacements come first, because a slow equation leaves time for some hundred edits only.
"""

_PARTS = (0.3, 0.3, 0.5, 0.3, 0.3, 0.5, 0.6)
"""Maximum part of the remaining time for each of these stages, so that slow equations leave time for the next."""

_ALTERNATIVES = 0.3
"""Maximum part of the remaining time for other edits with the same result, after an edit that repairs all rows."""

_REQUIRED_AFTER, _REQUIRED = 1, 0.4
"""Index of the stage after which edits are found from required values, and the maximum part of the remaining time.

They come before the kinds with many replacements, which may need all the time.
"""

_REFUTE_PART = 0.25
"""Maximum part of the remaining time to find expressions in which no single edit can repair a row."""

_CHANCE_PART = 0.2
"""Maximum part of the remaining time for the question whether edits repair rows only by chance, after each stage."""

_CHANCES, _CHANCE_PAIRS = 3, 0.4
"""Number of edits that repair a row only by chance beside which a second one is tried, and the part of the time."""

_SHARED = 3
"""Number of edits of each repaired group that are also tried in pairs, to fix the remaining rows."""


class RepairSearch(Trials):
    """Repair search over one judged formula."""

    def __init__(
        self,
        judge: Judge,
        progress: Callable[[float], None] = lambda f: None,
        deadline: Deadline | None = None,
    ) -> None:
        """Set up a search for the wrong rows of `judge`; `deadline`: limit of the whole search, None: no limit."""
        super().__init__(judge)
        self.progress = progress
        self.deadline = deadline or Deadline()
        self._until = self.deadline
        self.complete = True
        """Whether the deadline has not ended the search of single edits."""
        self._singles: list[Candidate] = []
        self._refuted: list[tuple[Path, int, int]] = []
        self._deferred: list[tuple[list[Step], Edit]] = []
        """Edits in places where no single edit can repair a row; pairs are searched before these edits are tried."""
        self.choice = RepairChoice(self, self.deadline)
        self.pair_search = PairSearch(self, self.choice)
        self.position_pairs = PositionPairs(self)

    @property
    def by_chance(self) -> list[tuple[Candidate, str]]:
        """Edits that make rows agree only by chance, which are no repairs, and the condition: "because a = b"."""
        return self.choice.by_chance

    @cached_property
    def functions(self) -> EditedFunctions:
        """Comparison of the functions that result from edits."""
        return EditedFunctions(self.judge, self.shaken)

    # -- one edit ------------------------------------------------------------------------------------------

    def _shared_sites(self, groups: Sequence[Sequence[RowKey]]) -> tuple[set[tuple[str, int]], set[int]]:
        """Return (statements, called functions) on which rows of several groups depend.

        One edit can repair several groups only there. Statements are (equation, index), functions are identities.
        """
        statements: Counter[tuple[str, int]] = Counter()
        functions: Counter[int] = Counter()
        for group in groups:
            sites = self.own_sites(group)
            statements.update({(step.equation.name, s.index) for step, s in sites})
            steps = {id(step): step for step, _ in sites}.values()
            functions.update({id(h.function) for step in steps for h in self.judge.helpers(step)})
        several = {site for site, count in statements.items() if count > 1}
        return several, {function for function, count in functions.items() if count > 1}

    def singles(self, kinds: Container[str], only: Container[tuple[str, int]] | None = None) -> list[Candidate]:
        """Evaluate single edits of the given kinds in the statements of `own_sites`, until the deadline.

        `only`: (equation, index) of the statements to edit; None for all.
        """
        candidates: list[Candidate] = []
        sites = [x for x in self.own_sites() if only is None or (x[0].equation.name, x[1].index) in only]
        for n, (step, statement) in enumerate(sites):
            self.progress(n / len(sites))
            choice = pool(step.source, statement, available(self.judge, step), self.parameters, step.scope)
            # Other equations may call this equation's function.
            others = self.callers(step.source, step)
            every = list(edits(step.source, statement, choice, kinds))
            likely = self._likely(step, statement, every)
            for edit in every:
                if self._is_late():
                    return candidates
                steps = [step, *others] if not edit.define else [step]
                if likely is not None and edit not in likely:
                    # With a swivel, one edit takes as long as ten others, so that only likely ones are evaluated.
                    if not step.free:
                        self._deferred.append((steps, edit))
                    continue
                candidate = self.everywhere(steps, [edit])
                if candidate is not None:
                    candidates.append(candidate)
                else:
                    self.senseless.append((step, edit))
        return candidates

    def _likely(self, step: Step, statement: Statement, every: Sequence[Edit]) -> set[Edit] | None:
        """Return the edits of a statement that may be repairs; None: all of them.

        With a swivel, these are the edits after which a row agrees at one pose. Otherwise, edits inside expressions
        without a right value are left out, unless a row agrees: such an edit makes another value of a scalar, a vector.
        """
        inside = {edit for edit in every if self._is_refuted(edit)}
        if not step.free and not inside:
            return None
        search = self.pair_search.crossed(step)
        chosen = list(every) if step.free else list(inside)
        agreeing = None if search is None else search.alone(statement, chosen, self._until)
        if agreeing is None:
            return None if step.free else set(every) - inside
        return agreeing if step.free else (set(every) - inside) | agreeing

    def _is_late(self) -> bool:
        late = self._until.passed
        self.complete = self.complete and not late
        return late

    def in_helpers(self, kinds: Container[str], only: Container[int] | None = None) -> list[Candidate]:
        """Evaluate single edits of the given kinds in the plain functions that the statements of `own_sites` call.

        `only`: identities of the functions to edit; None for all.
        """
        candidates: list[Candidate] = []
        reached: dict[int, tuple[Helper, list[Step]]] = {}
        for step in {id(s): s for s, _ in self.own_sites()}.values():
            for h in self.judge.helpers(step):
                if only is not None and id(h.function) not in only:
                    continue
                reached.setdefault(id(h.function), (h, []))[1].append(step)
        for n, (helper, steps) in enumerate(reached.values()):
            self.progress(n / len(reached))
            source = helper.source
            # An edited helper affects every equation that calls it, also rows that agree.
            others = [s for s in self.judge.steps if any(h.function is helper.function for h in self.judge.helpers(s))]
            every = [*steps, *(s for s in others if s not in steps and not s.missing)]
            for statement in source.statements:
                choice = pool(source, statement, set(source.arguments), self.parameters, helper.function.__globals__)
                for edit in edits(source, statement, choice, kinds):
                    if self._is_late():
                        return candidates
                    if self._is_refuted(edit):
                        self._deferred.append((every, edit))
                        continue
                    candidate = self.everywhere(every, [edit])
                    if candidate is not None:
                        candidates.append(candidate)
                    else:
                        self.senseless.append((every[0], edit))
        return candidates

    def _is_refuted(self, edit: Edit) -> bool:
        inside = False
        for path, start, end in self._refuted:
            inside |= start <= edit.start and edit.end <= end and path == edit.path
        return inside

    def _refute(self) -> None:
        """Find the expressions in which no single edit can repair a failing row, also one with another repair."""
        until = self.deadline.within(_REFUTE_PART * self.deadline.left)
        refuted: set[tuple[Path, int, int]] = set()
        open_: set[tuple[Path, int, int]] = set()
        for double in self.pair_search.doubles:
            closed = double.refuted(self.failing, until)
            refuted |= set(closed)
            open_ |= {cut.place for cut in double.cuts(self.failing, until)} - set(closed)
            open_ |= set(double.unsure)
            if until.passed:  # other equations might use the same expressions; these edits are tried after the pairs
                break
        self._refuted = []
        for path, start, end in refuted:
            if not any(p == path and a <= start and end <= b for p, a, b in open_):
                self._refuted.append((path, start, end))

    def deferred(self) -> list[Candidate]:
        """Evaluate the single edits that were left out because Gauss-Newton found no value for their expressions."""
        candidates: list[Candidate] = []
        for steps, edit in self._deferred:
            if self._is_late():
                break
            candidate = self.everywhere(steps, [edit])
            if candidate is not None:
                candidates.append(candidate)
            else:
                self.senseless.append((steps[0], edit))
        self._deferred = []
        return candidates

    def required(self, rows: Sequence[RowKey]) -> list[Candidate]:
        """Evaluate the edits that give an expression the value with which wrong rows agree; see `RequiredValues`."""
        candidates: list[Candidate] = []
        until = self.deadline.within(_REQUIRED * self.deadline.left)
        sites = [(step, step.source, s) for step, s in self.own_sites(rows)]
        steps = list({id(step): step for step, _, _ in sites}.values())
        # Rows with several entries determine an expression of a called function best.
        for step in sorted(steps, key=self.entries, reverse=True):
            sites += [(step, h.source, s) for h in self.judge.helpers(step) for s in h.source.statements]
        tried_statements: set[tuple[Path, int]] = set()
        for step, source, statement in sites:
            if (source.path, statement.start) in tried_statements:
                continue
            others = self.callers(source, step)
            for edit in RequiredValues(self.judge, step, rows, until, refuted=self._refuted).edits(source, statement):
                tried_statements.add(
                    (source.path, statement.start)
                )  # a statement without an edit is tried for the next equation
                candidate = self.everywhere([step, *others], [edit])
                if candidate is not None:
                    candidates.append(candidate)
        return candidates

    def counterparts(self, rows: Sequence[RowKey]) -> list[Candidate]:
        """Evaluate the edits that put back what similar expressions of the file have more."""
        candidates: list[Candidate] = []
        tried: set[Edit] = set()
        for step, statement in self.own_sites(rows):
            places = [(step.source, statement)]
            for helper in self.judge.helpers(step):
                places += [(helper.source, inner) for inner in helper.source.statements]
            for source, place in places:
                for edit in counterpart_edits(source, place):
                    if edit in tried:
                        continue
                    if self.deadline.passed:
                        return candidates
                    tried.add(edit)
                    candidate = self.everywhere([step, *self.callers(source, step)], [edit])
                    if candidate is not None:
                        candidates.append(candidate)
        return candidates

    # -- groups ---------------------------------------------------------------------------------------------

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
        self, found: list[GroupResult], left: list[RowKey], budget: float
    ) -> tuple[list[GroupResult], list[RowKey]]:
        """Search pairs of edits for rows that single edits do not repair; arguments and result are those of `run`."""
        found = [f for f in found if f.cures]
        return self._quiet(lambda: self._pairs_of(found, left, budget))

    def _quiet(
        self, search: Callable[[], tuple[list[GroupResult], list[RowKey]]]
    ) -> tuple[list[GroupResult], list[RowKey]]:
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter(
                "ignore", SyntaxWarning
            )  # Python warns about a call of a number after a moved parenthesis; such an edit fails when tried
            return search()

    def _run(self) -> tuple[list[GroupResult], list[RowKey]]:
        self._singles = []
        self._groups: list[list[RowKey]] = []
        unrepaired = list(self.failing)
        left_out: list[int] = []
        rest_tried = False
        by_required = False
        # First one token; if this is not enough, terms, factors and parentheses; then the called functions. If several
        # edits repair the rows, one that repairs more of them is searched where they have something in common.
        for n, (in_called, kinds) in enumerate(_STAGES):
            settled = not unrepaired and len(self._groups) < 2
            # A value that must be often has several formulas: fewer of them than edits of one token make sense.
            if settled and not by_required and (in_called or kinds == REST):
                left_out.append(n)
                continue
            everywhere = self._stage(n, settled, unrepaired)
            rest_tried |= everywhere and not in_called and kinds == REST
            unrepaired = self._covered()
            if n == _REQUIRED_AFTER and unrepaired:
                self._until = self.deadline
                self._refute()  # first, because no value is required of expressions without a right one
                self._singles += self.counterparts(unrepaired)
                self._singles += self.required(unrepaired)
                unrepaired = self._covered()
                by_required = not unrepaired
        # If one token suffices, all other edits of the same statement are tried as well, as alternatives.
        looked: set[tuple[str, int]] = set()
        for group in self._groups:
            for c in self.exact(group, self._singles):
                looked.add((c.step.equation.name, c.edits[0].statement))
        if not rest_tried:
            self._until = self.deadline.within(_ALTERNATIVES * self.deadline.left)
            self._singles += self.singles(REST, looked)
        results, unrepaired = self._results(unrepaired)
        for n in left_out if unrepaired else ():  # the repair because of which these were left out holds only by chance
            self._stage(n, False, unrepaired)
        if unrepaired and left_out:
            results, unrepaired = self._results(self._covered())
        self._until = self.deadline
        return results, unrepaired

    def _stage(self, n: int, settled: bool, left: Sequence[RowKey]) -> bool:
        """Try the edits of one stage; return whether they were tried everywhere, and not only where groups meet.

        `settled`: whether one edit repairs all rows; `left`: rows without a repair.
        """
        in_called, kinds = _STAGES[n]
        part = _PARTS[n]
        if settled:
            part = _ALTERNATIVES
        self._until = self.deadline.within(part * self.deadline.left)
        statements, functions = None, None
        of_rows = not in_called and kinds != REST  # all are tried, to find every tie
        if not left and not of_rows:
            statements, functions = self._shared_sites(self._groups)
        if in_called:
            self._singles += self.in_helpers(kinds, functions)
        else:
            self._singles += self.singles(kinds, statements)
        return statements is None

    def _results(self, left: Sequence[RowKey]) -> tuple[list[GroupResult], list[RowKey]]:
        """Return (results of the groups that have a repair, rows without one)."""
        results: list[GroupResult] = []
        unrepaired = list(left)
        for group in self._groups:
            result = self._found(group, self._singles, self._singles)
            if result.cures:
                results.append(result)
            else:  # two edits may repair these rows for all values of the parameters
                unrepaired += group
        return results, unrepaired

    def _pairs_of(
        self, out: list[GroupResult], left: list[RowKey], budget: float
    ) -> tuple[list[GroupResult], list[RowKey]]:
        singles = self._singles
        late: list[Candidate] = []
        lost: list[RowKey] = []
        deadline = self.deadline.within(budget)
        while True:
            while left:
                k, began = left[0], time.monotonic()
                shared = [c for f in out for c in self.exact(f.rows, singles)[:_SHARED]]
                pairs: list[Candidate] = []
                complete = False
                if budget > 0:
                    pairs = self._beside_chance(k, singles, deadline.within(_CHANCE_PAIRS * deadline.left))
                    if not self.choice.has_repair(k, pairs):
                        pairs, complete = self.pair_search.found(k, singles, shared, deadline)
                    if not self.choice.has_repair(k, pairs):
                        evaluated = self.deferred()
                        late += evaluated
                        singles += evaluated  # each may be one of a pair
                        pairs = list(late)
                    if not self.choice.has_repair(k, pairs):
                        pairs, complete = self.position_pairs.found(k, singles, shared, deadline)
                f, absorbed = self._widest(k, left, out, [*singles, *pairs], pairs)
                f.complete, f.seconds = f.complete and complete, time.monotonic() - began
                out = [g for g in out if not any(g is other for other in absorbed)]
                out.append(f)
                lost += [] if f.cures else [k]
                left = [x for x in left if x not in f.rows]
            if lost:
                return out, lost
            found, left = self.choice.together(out)
            if not left or budget <= 0 or deadline.passed:
                return found, left
            out = [f for f in found if f.cures]  # what `together` left out is refused, so that others are found now

    def _beside_chance(self, k: RowKey, singles: list[Candidate], deadline: Deadline) -> list[Candidate]:
        """Return pairs of an edit that repairs a row only by chance, and one that shows only for other values.

        The values of parameters may hide another error of the same function: no row disagrees because of it.
        """
        pairs: list[Candidate] = []
        firsts = [c for c in singles if c.by_chance and c.scores.get(k, np.inf) <= 1 and not (c.broken or c.hollow)]
        firsts.sort(key=lambda c: c.rank)
        for c in firsts[:_CHANCES]:
            (first,) = c.edits
            sources = [c.step.source, *(helper.source for helper in self.judge.helpers(c.step))]
            source = next(s for s in sources if (s.path, s.name) == (first.path, first.function))
            steps = [c.step, *self.callers(source, c.step)]
            for statement in source.statements:
                choice = pool(source, statement, set(source.arguments), self.parameters, c.step.scope)
                for second in edits(source, statement, choice, FORMS):
                    if deadline.passed:
                        return pairs
                    if not (second.end < first.start or first.end < second.start):
                        continue
                    pair = self.everywhere(steps, [first, second])
                    if pair is None or not self.exact([k], [pair]):
                        continue
                    if self.choice.is_general(pair) and self.choice.states.after(pair.edits) is not None:
                        pairs.append(pair)
        return pairs

    def _widest(
        self, k: RowKey, left: list[RowKey], out: list[GroupResult], tried: list[Candidate], pairs: list[Candidate]
    ) -> tuple[GroupResult, list[GroupResult]]:
        """Return (the result of `pairs` for row `k` and as many other rows as they repair, results that it replaces).

        A pair that is no repair, because it holds only by chance, replaces no result.
        """
        # An edit that fixes this row may also fix others, and rows of which a repair is known.
        group = next((g for g in self._cover(pairs, left) if k in g), [])
        absorbed = [f for f in out if group and f.cures and self.exact([*group, *f.rows], pairs)]
        attempts = []
        if absorbed:
            attempts.append(([*group, *(row for f in absorbed for row in f.rows)], absorbed))
        if len(group) > 1:
            attempts.append((group, []))
        for rows, replaced in attempts:
            found = self._found(rows, pairs, tried)
            if found.cures:
                return found, replaced
        return self._found([k], pairs, tried), []

    def _covered(self) -> list[RowKey]:
        """Put the failing rows in groups as in `_cover`; return those in no group.

        Edits that make a group agree only by chance are no repairs.
        """
        until = self.deadline.within(_CHANCE_PART * self.deadline.left)
        while True:
            self._groups = self._cover(self._singles, self.failing)
            left_out = False
            for group in self._groups:
                left_out |= self._leave_out(group, until)
            if not left_out:
                break
        grouped = {key for group in self._groups for key in group}
        return [k for k in self.failing if k not in grouped]

    def _leave_out(self, group: list[RowKey], until: Deadline) -> bool:
        """Mark the edits that repair a group if all of them do so only by chance; return whether they do."""
        exact = self.exact(group, self._singles)[:MOST_EXACT]
        for c in exact:
            if until.passed or self.choice.is_general(c):
                return False
        for c in exact:
            self.choice.mark(c)
        return bool(exact)

    def _cover(self, candidates: list[Candidate], rows: list[RowKey]) -> list[list[RowKey]]:
        """Return the rows in groups, the largest first, such that one single edit fixes all rows of a group."""
        unrepaired = set(rows)
        repaired: list[frozenset[RowKey]] = []
        for c in candidates:
            if c.serves:
                repaired.append(frozenset(row for row, off in c.scores.items() if off <= 1 and row in unrepaired))
        groups: list[list[RowKey]] = []
        while unrepaired:
            largest: frozenset[RowKey] = frozenset()
            for some in repaired:
                if len(some & unrepaired) > len(largest):
                    largest = some & unrepaired
            if not largest:
                break
            groups.append([row for row in rows if row in largest])
            unrepaired -= largest
        return groups

    def _found(self, rows: list[RowKey], exact_from: list[Candidate], all_: list[Candidate]) -> GroupResult:
        """Return the result for a group of rows: `exact_from` may have their repairs, `all_` the next best edit."""
        exact = self.exact(rows, exact_from)[:MOST_EXACT]
        every = self.functions.distinct(exact, rows)
        cures = self.choice.best(every)
        if every and not cures:
            state = self.choice.states.after(every[0][0].edits)
            if state is not None and (state.chance or state.worse):
                self.choice.mark(every[0][0])
        repairs = {id(c) for c in exact}
        runner_up: Candidate | None = None
        least = float("inf")
        for c in all_:
            if id(c) in repairs or not any(row in c.scores for row in rows):
                continue
            off = c.over(rows, self.base)
            if off > 1 and (off < least or runner_up is None):
                least = off
                runner_up = c
        after = max(self.base[row] for row in rows)
        if exact:
            after = min(c.over(rows, self.base) for c in exact)
        return GroupResult(rows, cures, runner_up, after, least, self.tried, self.complete)
