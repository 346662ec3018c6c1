"""Search the smallest edits of the source after which the rows agree, and check whether other edits fit as well."""

from __future__ import annotations

import inspect
import time
import warnings
from collections import Counter
from collections.abc import Callable, Container, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from twin.core.atomic import Scratch
from twin.core.errors import KinematicsError
from twin.core.spatial import Array
from twin.robots import load_formula
from twin.validation.explain.batch import Batch
from twin.validation.explain.candidate import REST, TOKENS, Candidate, Found, aliases, residuals
from twin.validation.explain.canonical import canonical
from twin.validation.explain.crossed import Crossed
from twin.validation.explain.deadline import Deadline
from twin.validation.explain.dependence import Dependence
from twin.validation.explain.double import Double
from twin.validation.explain.edits import edits, pool
from twin.validation.explain.expression import Site
from twin.validation.explain.pairs import Pairs
from twin.validation.explain.required import Required
from twin.validation.explain.row_deviations import Judge, evaluate, worst
from twin.validation.explain.rows import Helper, Key, Step
from twin.validation.explain.source import Edit, Source, Statement, patched
from twin.validation.explain.suspects import available, suspects
from twin.validation.explain.undefined_names import ByteRange, undefined
from twin.validation.explain.varied import closes, coincidences, condition

_WORSE = 1.001
"""An edit is refused if the residual of a row is larger than before by this factor."""

_CALLS = ("trig", "function", "order", "transpose")
_OPERATORS = ("sign", "operator", "exponent")
_FORMS = (*_CALLS, *_OPERATORS)
"""Kinds of edits with few replacements at each position of the text, unlike names and numbers."""

_STAGES = (
    (False, tuple(k for k in TOKENS if k in _FORMS)),
    (True, _CALLS),
    (False, tuple(k for k in TOKENS if k not in _FORMS)),
    (True, _OPERATORS),
    (False, REST),
    (True, tuple(k for k in TOKENS if k not in _FORMS)),
    (True, tuple(k for k in REST if k not in _FORMS)),
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

_MOST_EXACT = 60
"""Maximum number of exact edits of one group of rows that are compared with each other."""

_WHOLE = 12
"""Maximum number of repairs checked on the whole formula, of all repairs that result in one function."""

_DOUBLE_SHARES = (0.2, 0.2, 0.2, 0.7, 0.4, 0.3, 0.5, 1.0)
"""Maximum parts of the remaining time for the kinds of such pairs, in the order of `_double`."""

_IN_ONE, _IN_TWO = 2, 3
"""Indices of the kinds of pairs in scalar expressions, which are tried first for equations that return a pose."""

_POSE, _POSE_PART = 12, 0.4
"""Number of entries of such a row, and maximum part of the time for these pairs."""

_Stage = Callable[[Double, Sequence[Key], Deadline], Iterator[tuple[Edit, Edit]]]
"""Yields the pairs of edits of one kind for an equation and its wrong rows, until a deadline."""

_APART = 0.6
"""Maximum part of this time for pairs in different statements, of the last equation; less for those before."""

_FIRST_PART = 0.6
"""Maximum part of this time for the equation whose rows have most entries; then of the rest for the next one."""

_DOUBLE_PART = 0.85
"""Maximum part of the time for pairs of edits that is used for pairs from required values of expressions."""

_REFUTE_PART = 0.25
"""Maximum part of the remaining time to find expressions in which no single edit can repair a row."""

_COARSE = 6
"""Number of poses at which most expressions are rejected."""

_CHANCE_PART = 0.2
"""Maximum part of the remaining time for the question whether edits repair rows only by chance, after each stage."""

_LATE = 3
"""Maximum number of repairs that are confirmed, if the time is over."""

_SHARED = 3
"""Number of edits of each repaired group that are also tried in pairs, to fix the remaining rows."""

_SHARED_PART = 0.2
"""Maximum fraction of the remaining time for the pairs with an edit of a repaired group (see `_SHARED`)."""

_SAME = 1e-7
"""Relative difference of residuals, also at perturbed values, below which two edited rows count as the same
function."""


@dataclass(frozen=True)
class _After:
    """State of a whole formula after edits: number of wrong rows, and whether it holds only by chance.

    By chance means: only for the present values of equal or assumed parameters; see `varied`. `chance` is the
    condition, "because a = b"; "" if the formula holds in general. `worse`: whether a row is further off than before.
    """

    wrong: int
    chance: str
    worse: bool = False


class Search:
    """Repair search over one judged formula."""

    def __init__(
        self,
        judge: Judge,
        progress: Callable[[float], None] = lambda f: None,
        deadline: Deadline | None = None,
    ) -> None:
        """Set up a search for the wrong rows of `judge`; `deadline`: limit of the whole search, None: no limit."""
        self.judge = judge
        self.progress = progress
        self.deadline = deadline or Deadline()
        self._until = self.deadline
        self.base = {p.key: worst(r) for p, r in judge.residuals.items()}
        self.raw = {p.key: r for p, r in judge.residuals.items()}
        bad = judge.failing()
        # Wrong helpers often only repeat the error of a printed equation: repair helpers only if all other rows agree.
        self.targets = [p for p in bad if judge.step(p.equation).stage != "helper"] or bad
        self.failing = [p.key for p in self.targets]
        self.tried = 0
        self.complete = True
        """Whether the deadline has not ended the search of single edits."""
        self._singles: list[Candidate] = []
        self.senseless: list[tuple[Step, Edit]] = []  # edits without a value; a second edit may change that
        self.by_chance: list[tuple[Candidate, str]] = []
        """Edits that make rows agree only by chance, which are no repairs, and the condition; see `_After`."""
        self._states: dict[tuple[Edit, ...], _After | None] = {}
        self._in_two_statements: list[Candidate] | None = None
        self._crossings: dict[str, Crossed | None] = {}
        self._rejected: set[frozenset[Edit]] = set()
        """Edits that make rows agree only by chance together with the repairs of other rows; they are no repairs."""
        self._refuted: list[tuple[Path, int, int]] = []
        self._deferred: list[tuple[list[Step], Edit]] = []
        """Edits in places where no single edit can repair a row; pairs are searched before these edits are tried."""
        self.parameters = {p.name for p in judge.formula.parameters}

    # -- one edit ------------------------------------------------------------------------------------------

    @cached_property
    def _suspects(self) -> dict[Key, dict[str, set[int]]]:
        """Statements on which each failing row depends: {row: {equation: indices}}."""
        return {place.key: suspects(self.judge, place) for place in self.targets}

    def own_sites(self, rows: Container[Key] | None = None) -> list[tuple[Step, Statement]]:
        """Return the statements on which a failing row depends; `rows`: only of these rows."""
        out: dict[tuple[str, int], tuple[Step, Statement]] = {}
        for place in self.targets:
            if rows is not None and place.key not in rows:
                continue
            for equation, indices in self._suspects[place.key].items():
                step = self.judge.step(equation)
                for i in sorted(indices):
                    out.setdefault((equation, i), (step, step.source.statements[i]))
        return list(out.values())

    def _shared_sites(self, groups: Sequence[Sequence[Key]]) -> tuple[set[tuple[str, int]], set[int]]:
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
        out: list[Candidate] = []
        sites = [x for x in self.own_sites() if only is None or (x[0].equation.name, x[1].index) in only]
        for n, (step, statement) in enumerate(sites):
            self.progress(n / len(sites))
            choice = pool(step.source, statement, available(self.judge, step), self.parameters, step.scope)
            # Other equations may call this equation's function.
            others = [s for s in self.judge.steps if s is not step and not s.missing and self._calls(s, step.source)]
            every = list(edits(step.source, statement, choice, kinds))
            likely = self._likely(step, statement, every)
            for edit in every:
                if self._is_late():
                    return out
                steps = [step, *others] if not edit.define else [step]
                if likely is not None and edit not in likely:
                    # With a swivel, one edit takes as long as ten others, so that only likely ones are evaluated.
                    if not step.free:
                        self._deferred.append((steps, edit))
                    continue
                candidate = self._everywhere(steps, [edit])
                if candidate is not None:
                    out.append(candidate)
                else:
                    self.senseless.append((step, edit))
        return out

    def _likely(self, step: Step, statement: Statement, every: Sequence[Edit]) -> set[Edit] | None:
        """Return the edits of a statement that may be repairs; None: all of them.

        With a swivel, these are the edits after which a row agrees at one pose. Otherwise, edits inside expressions
        without a right value are left out, unless a row agrees: such an edit makes another value of a scalar, a vector.
        """
        inside = {edit for edit in every if self._is_refuted(edit)}
        if not step.free and not inside:
            return None
        search = self._crossed(step)
        chosen = list(every) if step.free else list(inside)
        agreeing = None if search is None else search.alone(statement, chosen, self._until)
        if agreeing is None:
            return None if step.free else set(every) - inside
        return agreeing if step.free else (set(every) - inside) | agreeing

    def _calls(self, step: Step, source: Source) -> bool:
        return any((h.source.name, h.source.path) == (source.name, source.path) for h in self.judge.helpers(step))

    def _is_late(self) -> bool:
        late = self._until.passed
        self.complete = self.complete and not late
        return late

    def in_helpers(self, kinds: Container[str], only: Container[int] | None = None) -> list[Candidate]:
        """Evaluate single edits of the given kinds in the plain functions that the statements of `own_sites` call.

        `only`: identities of the functions to edit; None for all.
        """
        out: list[Candidate] = []
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
                        return out
                    if self._is_refuted(edit):
                        self._deferred.append((every, edit))
                        continue
                    candidate = self._everywhere(every, [edit])
                    if candidate is not None:
                        out.append(candidate)
                    else:
                        self.senseless.append((every[0], edit))
        return out

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
        for double in self._doubles:
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
        out: list[Candidate] = []
        for steps, edit in self._deferred:
            if self._is_late():
                break
            candidate = self._everywhere(steps, [edit])
            if candidate is not None:
                out.append(candidate)
            else:
                self.senseless.append((steps[0], edit))
        self._deferred = []
        return out

    def required(self, rows: Sequence[Key]) -> list[Candidate]:
        """Evaluate the edits that give an expression the value with which wrong rows agree; see `Required`."""
        out: list[Candidate] = []
        until = self.deadline.within(_REQUIRED * self.deadline.left)
        sites = [(step, step.source, s) for step, s in self.own_sites(rows)]
        steps = list({id(step): step for step, _, _ in sites}.values())
        # Rows with several entries determine an expression of a called function best.
        for step in sorted(steps, key=self._entries, reverse=True):
            sites += [(step, h.source, s) for h in self.judge.helpers(step) for s in h.source.statements]
        done: set[tuple[Path, int]] = set()
        for step, source, statement in sites:
            if (source.path, statement.start) in done:
                continue
            others = [s for s in self.judge.steps if s is not step and not s.missing and self._calls(s, source)]
            for edit in Required(self.judge, step, rows, until, refuted=self._refuted).edits(source, statement):
                done.add((source.path, statement.start))  # a statement without an edit is tried for the next equation
                candidate = self._everywhere([step, *others], [edit])
                if candidate is not None:
                    out.append(candidate)
        return out

    def _everywhere(self, steps: list[Step], change: list[Edit]) -> Candidate | None:
        """Return the candidate for edits of one function, judged in all equations that it affects; None: cannot run.

        Besides `steps`, the equation is judged that the function itself is, which others may call as well.
        """
        edited = [s for s in self.judge.steps if s not in steps and not s.missing and _is_of(s, change[0])]
        steps = [*steps, *edited]
        first: Candidate | None = None
        passed: set[str] = set()  # equations already judged; the equations after them use the edited outputs
        for step in sorted(steps, key=self.judge.steps.index):
            if step.equation.name in passed:
                continue
            c = self.attempt(step, change)
            if c is None:
                if first is not None:
                    first.broken = True
                return first
            if step.source.name != change[0].function:
                passed |= {k[0] for k in c.scores}
            if first is None:
                first = c
                continue
            first.hollow |= c.hollow
            first.dropped = tuple(sorted({*first.dropped, *c.dropped}))
            first.scores |= {k: max(v, first.scores.get(k, 0.0)) for k, v in c.scores.items()}
            first.changed |= c.changed
            first.broken |= c.broken
        if first is not None:
            first.step = steps[0]
        return first

    def attempt(self, step: Step, change: list[Edit]) -> Candidate | None:
        """Return the candidate for edits of one equation, or None if the edited formula is not valid."""
        self.tried += 1
        extra = aliases(self.judge, step, change)
        found = None if extra is None else evaluate(self.judge, step, change, extra)
        if found is None:
            return None
        changed = {p.key: r for p, r in found.items()}
        worsts = {k: worst(r) for k, r in changed.items()}
        broken = any(self._is_worse(k, s) for k, s in worsts.items())
        # A row without a residual before is that of a return statement that was not reached.
        broken |= any(off > 1 for k, off in worsts.items() if k not in self.base)
        c = Candidate(step, change, extra or {}, worsts, broken, {k: changed[k] for k in changed if k in self.raw})
        c.by_chance = self._is_rejected(c)
        if not broken:
            self.dependence.judged(c, [k for k in self.failing if worsts.get(k, np.inf) <= 1])
        return c

    def _is_worse(self, row: Key, off: float) -> bool:
        """Return whether a row with the worst residual `off` disagrees, and more than before."""
        return off > max(1.0, _WORSE * self.base.get(row, np.inf))

    @cached_property
    def shaken(self) -> Judge:
        """Judge of the formula with each number perturbed at random; rows that still agree do so by coincidence."""
        return self.judge.on(self.judge.truth.perturbed())

    @cached_property
    def first(self) -> Judge:
        """Judge of the formula at the first sample only."""
        return self.judge.on(self.judge.truth.first())

    @cached_property
    def dependence(self) -> Dependence:
        """Dependence of the rows on symbols."""
        return Dependence(self.judge, self.shaken)

    # -- groups ---------------------------------------------------------------------------------------------

    def run(self, budget: float = 8.0) -> tuple[list[Found], list[Key]]:
        """Search repairs; return (results by group of rows, rows without a repair).

        `budget` is the time limit in s of the search for pairs of edits; 0: single edits only.
        """
        found, left = self._quiet(self._run)
        if not left:
            found, left = self._quiet(lambda: self._together(found))
        if left:
            return self.pairs(found, left, budget)
        return found, left

    def pairs(self, found: list[Found], left: list[Key], budget: float) -> tuple[list[Found], list[Key]]:
        """Search pairs of edits for rows that single edits do not repair; arguments and result are those of `run`."""
        found = [f for f in found if f.cures]
        return self._quiet(lambda: self._pairs_of(found, left, budget))

    def _quiet(self, search: Callable[[], tuple[list[Found], list[Key]]]) -> tuple[list[Found], list[Key]]:
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter(
                "ignore", SyntaxWarning
            )  # Python warns about a call of a number after a moved parenthesis; such an edit fails when tried
            return search()

    def _run(self) -> tuple[list[Found], list[Key]]:
        self._singles = []
        self._groups: list[list[Key]] = []
        left = list(self.failing)
        left_out: list[int] = []
        rest_tried = False
        by_required = False
        # First one token; if this is not enough, terms, factors and parentheses; then the called functions. If several
        # edits repair the rows, one that repairs more of them is searched where they have something in common.
        for n, (in_called, kinds) in enumerate(_STAGES):
            settled = not left and len(self._groups) < 2
            # A value that must be often has several formulas: fewer of them than edits of one token make sense.
            if settled and not by_required and (in_called or kinds == REST):
                left_out.append(n)
                continue
            everywhere = self._stage(n, settled, left)
            rest_tried |= everywhere and not in_called and kinds == REST
            left = self._covered()
            if n == _REQUIRED_AFTER and left:
                self._until = self.deadline
                self._refute()  # first, because no value is required of expressions without a right one
                self._singles += self.required(left)
                left = self._covered()
                by_required = not left
        # If one token suffices, all other edits of the same statement are tried as well, as alternatives.
        looked: set[tuple[str, int]] = set()
        for group in self._groups:
            for c in self._exact(group, self._singles):
                looked.add((c.step.equation.name, c.edits[0].statement))
        if not rest_tried:
            self._until = self.deadline.within(_ALTERNATIVES * self.deadline.left)
            self._singles += self.singles(REST, looked)
        out, left = self._results(left)
        for n in left_out if left else ():  # the repair because of which these were left out holds only by chance
            self._stage(n, False, left)
        if left and left_out:
            out, left = self._results(self._covered())
        self._until = self.deadline
        return out, left

    def _stage(self, n: int, settled: bool, left: Sequence[Key]) -> bool:
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

    def _results(self, left: Sequence[Key]) -> tuple[list[Found], list[Key]]:
        """Return (results of the groups that have a repair, rows without one)."""
        out: list[Found] = []
        lost = list(left)
        for group in self._groups:
            found = self._found(group, self._singles, self._singles)
            if found.cures:
                out.append(found)
            else:  # two edits may repair these rows for all values of the parameters
                lost += group
        return out, lost

    def _pairs_of(self, out: list[Found], left: list[Key], budget: float) -> tuple[list[Found], list[Key]]:
        singles = self._singles
        late: list[Candidate] = []
        lost: list[Key] = []
        deadline = self.deadline.within(budget)
        while True:
            while left:
                k, began = left[0], time.monotonic()
                shared = [c for f in out for c in self._exact(f.rows, singles)[:_SHARED]]
                pairs: list[Candidate] = []
                complete = False
                if budget > 0:
                    pairs, complete = self._double(k, singles, shared, deadline)
                    if not self._has_repair(k, pairs):
                        evaluated = self.deferred()
                        late += evaluated
                        singles += evaluated  # each may be one of a pair
                        pairs = list(late)
                    if not self._has_repair(k, pairs):
                        pairs, complete = self._pairs(k, singles, shared, deadline)
                f, absorbed = self._widest(k, left, out, [*singles, *pairs], pairs)
                f.complete, f.seconds = f.complete and complete, time.monotonic() - began
                out = [g for g in out if not any(g is other for other in absorbed)]
                out.append(f)
                lost += [] if f.cures else [k]
                left = [x for x in left if x not in f.rows]
            if lost:
                return out, lost
            found, left = self._together(out)
            if not left or budget <= 0 or deadline.passed:
                return found, left
            out = [f for f in found if f.cures]  # what `_together` left out is refused, so that others are found now

    def _widest(
        self, k: Key, left: list[Key], out: list[Found], tried: list[Candidate], pairs: list[Candidate]
    ) -> tuple[Found, list[Found]]:
        """Return (the result of `pairs` for row `k` and as many other rows as they repair, results that it replaces).

        A pair that is no repair, because it holds only by chance, replaces no result.
        """
        # An edit that fixes this row may also fix others, and rows of which a repair is known.
        group = next((g for g in self._cover(pairs, left) if k in g), [])
        absorbed = [f for f in out if group and f.cures and self._exact([*group, *f.rows], pairs)]
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

    def _has_repair(self, k: Key, candidates: list[Candidate]) -> bool:
        """Return whether one of the candidates repairs a row, and not by chance."""
        exact = self._exact([k], candidates)[:_MOST_EXACT]
        for n, c in enumerate(exact):
            if self.deadline.passed and n >= _LATE:
                return False
            if self._is_general(c):
                return True
        return False

    def _is_general(self, c: Candidate) -> bool:
        """Return whether the rows agree after a candidate's edits not only by chance; also if that is not known.

        No row of the whole formula may be further off than before.
        """
        if self._is_rejected(c):
            return False
        after = self._after(c)
        return after is None or not (after.chance or after.worse)

    def _is_rejected(self, c: Candidate) -> bool:
        return frozenset(c.edits) in self._rejected

    def _covered(self) -> list[Key]:
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

    def _leave_out(self, group: list[Key], until: Deadline) -> bool:
        """Mark the edits that repair a group if all of them do so only by chance; return whether they do."""
        exact = self._exact(group, self._singles)[:_MOST_EXACT]
        for c in exact:
            if until.passed or self._is_general(c):
                return False
        for c in exact:
            self._mark(c)
        return bool(exact)

    def _mark(self, c: Candidate) -> None:
        """Remember that a candidate's edits make rows agree only by chance; one such is told for each row."""
        after = self._after(c)
        c.by_chance = True
        repaired = self._repaired(c)
        for known, _ in self.by_chance:
            if self._repaired(known) & repaired:
                return
        if after is not None and after.chance:
            self._tell(c, after.chance)

    def _tell(self, c: Candidate, chance: str) -> None:
        """Remember that a candidate's edits make rows agree only by chance, unless that is remembered already."""
        for known, condition_of_known in self.by_chance:
            if frozenset(known.edits) == frozenset(c.edits) and condition_of_known == chance:
                return
        self.by_chance.append((c, chance))

    def _repaired(self, c: Candidate) -> set[Key]:
        """Return the failing rows that agree after a candidate's edits."""
        return {k for k in self.failing if c.scores.get(k, np.inf) <= 1}

    def _cover(self, candidates: list[Candidate], rows: list[Key]) -> list[list[Key]]:
        """Return the rows in groups, the largest first, such that one single edit fixes all rows of a group."""
        left, groups = set(rows), []
        cures = [frozenset(k for k, s in c.scores.items() if s <= 1 and k in left) for c in candidates if c.serves]
        while left:
            best = max((c & left for c in cures), key=len, default=frozenset())
            if not best:
                break
            groups.append([k for k in rows if k in best])
            left -= best
        return groups

    def _found(self, rows: list[Key], exact_from: list[Candidate], all_: list[Candidate]) -> Found:
        exact = self._exact(rows, exact_from)[:_MOST_EXACT]
        every = self._distinct(exact, rows)
        cures = self._best(every)
        if every and not cures:
            after = self._after(every[0][0])
            if after is not None and (after.chance or after.worse):
                self._mark(every[0][0])
        mine = {id(c) for c in exact}
        rest = [(c.over(rows, self.base), c) for c in all_ if id(c) not in mine and any(k in c.scores for k in rows)]
        rest = [(s, c) for s, c in rest if s > 1 or c.broken]
        nearest = min((x for x in rest if x[0] > 1), key=lambda x: x[0], default=(float("inf"), None))
        after = min((c.over(rows, self.base) for c in exact), default=max(self.base[k] for k in rows))
        return Found(rows, cures, nearest[1], after, nearest[0], self.tried, self.complete)

    def _exact(self, rows: list[Key], candidates: list[Candidate]) -> list[Candidate]:
        touching = [c for c in candidates if c.serves and any(k in c.scores for k in rows)]
        exact = sorted((c for c in touching if c.over(rows, self.base) <= 1), key=lambda c: c.rank)
        return [c for c in exact if c.extra or self._runs(c)]

    def _runs(self, c: Candidate) -> bool:
        """Return whether a candidate also runs with a single sample; some errors occur only then.

        For example, a scalar with an index is an error, but with several samples the scalar is an array.
        """
        return residuals(self.first, c.step.equation.name, c.edits) is not None

    def _distinct(self, exact: list[Candidate], rows: list[Key]) -> list[list[Candidate]]:
        """Group exact candidates by the resulting function; keep one candidate per different canonical text."""
        cures: list[tuple[dict[Key, Array] | None, list[Candidate], set[str]]] = []
        for c in exact:
            value = self._off_the_mechanism(c, rows)
            text = self._text(c)
            home = next((w for w in cures if text in w[2]), None)
            if home is None and value is not None:
                home = next((w for w in cures if w[0] is not None and _same(w[0], value)), None)
            if home is None:
                cures.append((value, [c], {text}))
            elif text not in home[2]:
                home[1].append(c)
                home[2].add(text)
        return [w[1] for w in cures]

    def _best(self, cures: list[list[Candidate]]) -> list[list[Candidate]]:
        """Keep the repairs after which the fewest rows of the whole formula are wrong.

        Readings that hold only for the present values of equal or assumed parameters are left out before, also if no
        other repair is left. A repair of which no reading is confirmed is not proposed.
        """
        general: list[tuple[list[tuple[Candidate, int | None]], list[Candidate]]] = []
        least: int | None = None
        for n, way in enumerate(cures):
            confirmed: list[tuple[Candidate, int | None]] = []
            others: list[Candidate] = []
            for i, c in enumerate(way):
                is_first = i == 0 and n < _LATE
                in_time = (i < _WHOLE or not confirmed) and not self.deadline.passed
                if not (is_first or in_time or tuple(c.edits) in self._states):
                    others.append(c)
                    continue
                if not self._is_general(c):
                    continue
                after = self._after(c)
                wrong = None if after is None else after.wrong
                if wrong is not None and (least is None or wrong < least):
                    least = wrong
                confirmed.append((c, wrong))
            general.append((confirmed, others))
        kept = []
        for confirmed, others in general:
            readings = [c for c, wrong in confirmed if wrong is None or wrong == least]
            if readings:
                kept.append([*readings, *others])
        return kept

    def _together(self, found: list[Found]) -> tuple[list[Found], list[Key]]:
        """Return (results of which the first repairs of all groups hold together, rows that are left without a repair).

        Repairs of several groups may hold only together for the present values of parameters. Then another repair of
        one group is put first; if none holds, the repair with the most unusual edit is left out.
        """
        if len(found) < 2 or not self._by_chance_together(found):
            return found, []
        for n, f in enumerate(found):
            for cure in f.cures[1:]:
                if self.deadline.passed:
                    break
                others = [other for other in f.cures if other is not cure]
                changed = [*found[:n], replace(f, cures=[cure, *others]), *found[n + 1 :]]
                if not self._by_chance_together(changed):
                    return changed, []
        unusual = max(found, key=lambda f: f.cures[0][0].rank)
        together = self._state([e for f in found for e in f.cures[0][0].edits])
        if together is not None:
            self._tell(unusual.cures[0][0], together.chance)
        for c in unusual.cures[0]:
            c.by_chance = True
            self._rejected.add(frozenset(c.edits))
        n = found.index(unusual)
        return [*found[:n], replace(unusual, cures=[]), *found[n + 1 :]], list(unusual.rows)

    def _by_chance_together(self, found: Sequence[Found]) -> bool:
        edits = [e for f in found for e in f.cures[0][0].edits]
        after = self._state(edits)
        return after is not None and after.chance != ""

    def _after(self, c: Candidate) -> _After | None:
        """Return the state of the whole formula file after a candidate's edits; None if it cannot be evaluated."""
        return self._state(c.edits)

    def _state(self, change: Sequence[Edit]) -> _After | None:
        """Return the state of the whole formula file after edits; a state that was computed before is kept."""
        key = tuple(change)
        if key not in self._states:
            self._states[key] = self._state_after(key)
        return self._states[key]

    def _state_after(self, change: Sequence[Edit]) -> _After | None:
        formula = self.judge.formula
        home = formula.equations[0]
        path = Path(inspect.unwrap(home.variants[home.default]).__code__.co_filename)  # type: ignore[attr-defined]
        joints = [(j.name, j.kind == "revolute") for j in formula.joints]
        if any(e.path != path or e.kind == "left side" for e in change):
            return None
        with Scratch() as folder:
            file = Path(folder) / "formula.py"
            file.write_text(patched(change), encoding="utf-8")
            try:
                formula = load_formula(file, formula.name, lambda: (joints, np.eye(4), None), trial=True)
            except KinematicsError:
                return None
            judge = Judge(formula, self.judge.variants, self.judge.truth, self.judge.tolerance, self.judge.limits)
            wrong = len(judge.failing())
            worse = any(self._is_worse(p.key, worst(r)) for p, r in judge.residuals.items())
            chance = " and ".join(condition(group) for group in coincidences(judge))
            free = self.judge.truth.free
            if not wrong and not chance and free and closes(judge, {}) is False:
                # The rows were judged at the best value of the free parameter, which need not be the formula's value.
                chance = f"for another {free} than that of the equations"
            return _After(wrong, chance, worse)

    def _text(self, c: Candidate) -> str:
        parts = []
        for path, name, i in sorted({(e.path, e.function, e.statement) for e in c.edits}):
            source = self._source(c, path, name)
            mine = [e for e in c.edits if (e.path, e.function) == (path, name)]
            parts.append(f"{name}:{i}:{canonical(source, source.statements[i], mine)}")
        return "; ".join(parts)

    def _source(self, c: Candidate, path: Path, name: str) -> Source:
        if (path, name) == (c.step.source.path, c.step.source.name):
            return c.step.source
        return next(h.source for h in self.judge.helpers(c.step) if (h.source.path, h.source.name) == (path, name))

    def _off_the_mechanism(self, c: Candidate, rows: list[Key]) -> dict[Key, Array] | None:
        """Return a candidate's residuals at perturbed values, to compare functions; None if a row has only NaN."""
        found = residuals(self.shaken, c.step.equation.name, c.edits)
        if not found:
            return None
        out = {k: r for k, r in found.items() if k in rows}
        return out if all(np.isfinite(r).any() for r in out.values()) else None

    # -- two edits --------------------------------------------------------------------------------------------

    def _double(
        self, k: Key, singles: list[Candidate], shared: list[Candidate], deadline: Deadline
    ) -> tuple[list[Candidate], bool]:
        """Return (pairs of edits found from required values of expressions, whether the search ended); see `Double`.

        The pairs must repair all failing rows that the expressions move, or row `k` alone. `shared` are repairs of
        other rows; one of them may be the first edit.
        """
        until = deadline.within(_DOUBLE_PART * deadline.left)
        out: list[Candidate] = []
        firsts = [c.edits[0] for c in singles if k in c.scores and c.edits[0].define is None]
        firsts.sort(key=lambda e: (e.kind not in _FORMS, e.kind not in TOKENS))  # few replacements come first
        searches = []
        for rows in dict.fromkeys((tuple(self.failing), (k,))):
            for double in self._doubles:
                searches.append((double, rows))
        known = [c.edits[0] for c in shared]
        parts: dict[int, tuple[list[Edit], list[Edit]]] = {}

        def parted(double: Double) -> tuple[list[Edit], list[Edit]]:
            if id(double) not in parts:
                parts[id(double)] = double.outside(firsts, until)
            return parts[id(double)]

        stages: list[_Stage] = [
            lambda double, rows, end: double.beside(known, rows, end, composed=True),
            lambda double, rows, end: double.required(known, rows, end),
            lambda double, rows, end: double.in_one(rows, end),
            lambda double, rows, end: double.in_two(rows, end),
            self._in_one_statement,
            lambda double, rows, end: double.beside(parted(double)[0], rows, end),
            lambda double, rows, end: double.beside(parted(double)[1], rows, end),
            lambda double, rows, end: double.required(firsts, rows, end),
        ]
        for stage in (stages[_IN_ONE], stages[_IN_TWO]):
            # A pose rejects nearly all wrong pairs of expressions, so that this takes little time.
            end = until.within(_POSE_PART * until.left)
            out += self._tried_pairs(stage, [search for search in searches if self._has_pose(*search)], end)
            if self._has_repair(k, out):
                return out, True
        out += self._of_two_statements(until)
        if self._has_repair(k, out):
            return out, True
        for share, stage in zip(_DOUBLE_SHARES, stages, strict=True):
            of_stage = until.within(share * until.left)
            for m, (double, rows) in enumerate(searches):
                if until.passed:
                    break
                part = _FIRST_PART
                if m == len(searches) - 1:
                    part = 1.0
                end = of_stage.within(part * of_stage.left)
                out += self._tried_pairs(stage, [(double, rows)], end)
                if self._has_repair(k, out):
                    return out, True
        return out, not until.passed

    def _tried_pairs(
        self, stage: _Stage, searches: Sequence[tuple[Double, Sequence[Key]]], end: Deadline
    ) -> list[Candidate]:
        """Return the candidates for the pairs of edits that a stage of `_double` finds in some equations."""
        out: list[Candidate] = []
        for double, rows in searches:
            if end.passed:
                break
            for first, second in stage(double, rows, end):
                candidate = self._pair(double, first, second)
                if candidate is not None:
                    out.append(candidate)
        return out

    def _has_pose(self, double: Double, rows: Sequence[Key]) -> bool:
        """Return whether one of `rows` is a pose that an equation returns."""
        own = [row for row in rows if row[0] == double.step.equation.name]
        return any(self.raw[row].shape[1] >= _POSE for row in own)

    def _crossed(self, step: Step) -> Crossed | None:
        """Return the search for edits in the statements of an equation itself; None for a plain function."""
        name = step.equation.name
        if name not in self._crossings:
            own: list[Site] = []
            for other, sites in self._sites():
                if other is step:
                    own = [site for site in sites if site.source is step.source]
            search = None
            if step.plain is None and own:
                search = Crossed(self.judge, name, own, self.failing)
            self._crossings[name] = search
        return self._crossings[name]

    def _of_two_statements(self, until: Deadline) -> list[Candidate]:
        """Return pairs of edits in different statements of an equation; they are searched once, for all rows."""
        if self._in_two_statements is None:
            self._in_two_statements = []
            doubles = self._doubles
            # One entry of a row does not determine two scalars, so that their edits are tried as well.
            single = max(self.raw[key].shape[1] for key in self.failing) == 1
            for n, double in enumerate(doubles):
                search = self._crossed(double.step)
                if search is None:
                    continue
                part = _APART / (len(doubles) - n) ** 0.5
                end = until.within(part * until.left)
                scalars = [] if single else double.cuts(self.failing, end)
                for first, second in search.apart(end, [cut.place for cut in scalars]):
                    candidate = self._pair(double, first, second)
                    if candidate is not None:
                        self._in_two_statements.append(candidate)
        return list(self._in_two_statements)

    def _in_one_statement(self, double: Double, rows: Sequence[Key], end: Deadline) -> Iterator[tuple[Edit, Edit]]:
        search = self._crossed(double.step)
        if search is not None and len(rows) == len(self.failing):
            yield from search.together(end)

    def _pair(self, double: Double, first: Edit, second: Edit) -> Candidate | None:
        """Return the candidate for two edits of one function, judged in all equations that call it."""
        source = next(site.source for site in double.sites if site.source.name == first.function)
        others = [s for s in self.judge.steps if s is not double.step and not s.missing and self._calls(s, source)]
        return self._everywhere([double.step, *others], [first, second])

    @cached_property
    def _doubles(self) -> list[Double]:
        """The searches for two edits, one for each equation on which failing rows depend."""
        k = self.judge.truth.k
        few = np.linspace(0, k - 1, min(_COARSE, k)).astype(int)
        coarse = Batch(self.judge, [int(i) for i in few], _COARSE // 2)
        full = Batch(self.judge, range(k))
        out = []
        for step, sites in self._sites():
            out.append(Double(coarse, full, step, sites, self.failing))
        # Rows with several entries reject nearly all wrong expressions, so that they are tried first.
        return sorted(out, key=lambda double: self._entries(double.step), reverse=True)

    def _entries(self, step: Step) -> int:
        """Return the largest number of entries of a failing row of an equation."""
        entries = 0
        for key in self.failing:
            if key[0] == step.equation.name:
                entries = max(entries, self.raw[key].shape[1])
        return entries

    def _sites(self) -> list[tuple[Step, list[Site]]]:
        """Return, for each equation on which rows depend, its statements and those of the functions that it calls."""
        out: dict[str, tuple[Step, list[Site]]] = {}
        for step, statement in self.own_sites():
            choice = pool(step.source, statement, available(self.judge, step), self.parameters, step.scope)
            sites = out.setdefault(step.equation.name, (step, []))[1]
            sites.append(Site(step.source, statement, choice))
        for step, sites in out.values():
            for h in self.judge.helpers(step):
                for statement in h.source.statements:
                    arguments = set(h.source.arguments)
                    choice = pool(h.source, statement, arguments, self.parameters, h.function.__globals__)
                    sites.append(Site(h.source, statement, choice))
        return list(out.values())

    def _pairs(
        self, k: Key, singles: list[Candidate], shared: list[Candidate], deadline: Deadline
    ) -> tuple[list[Candidate], bool]:
        """Return (pairs of edits with which row k agrees or nearly agrees, whether all pairs were tried).

        First, pairs of edits of any kind are tried if the effects of both edits add up to the residual; then, all pairs
        of one-token edits are tried.
        """
        mine = [c for c in singles if k in c.changed and c.changed[k].shape == self.raw[k].shape]
        mine = [c for c in mine if np.isfinite(c.changed[k]).all()]
        out: list[Candidate] = []
        done: set[tuple[int, int]] = set()

        def add(a: Candidate, b: Candidate) -> None:
            pair = (min(id(a), id(b)), max(id(a), id(b)))
            e, f = a.edits[0], b.edits[0]
            if pair in done or a.step is not b.step or e.function != f.function or e.path != f.path:
                return
            if e.start <= f.end and f.start <= e.end:
                return
            done.add(pair)
            c = self.attempt(a.step, [e, f])
            if c is not None:
                out.append(c)

        if mine and np.isfinite(self.raw[k]).all():
            weights = np.random.default_rng(3).standard_normal(self.raw[k].size)
            weights /= np.linalg.norm(weights)
            target = -float(weights @ self.raw[k].ravel())
            effect = np.array([weights @ (c.changed[k] - self.raw[k]).ravel() for c in mine])
            order = np.argsort(effect)
            for i, c in enumerate(mine):
                lo, hi = np.searchsorted(effect[order], [target - effect[i] - 20, target - effect[i] + 20])
                for j in order[lo : min(hi, lo + 50)]:
                    if deadline.passed:
                        break
                    add(c, mine[j])
        part = deadline.within(_SHARED_PART * deadline.left)
        for a in shared:  # an edit that fixes other rows may also be one of the two edits that fix this row
            for b in singles:
                if k in b.scores and not part.passed:
                    add(a, b)
        if any(c.serves and c.over([k], self.base) <= 1 for c in out):
            return out, True
        complete = True
        for step, some in self._moving(k, singles):
            pairs = Pairs(self.judge, self.shaken, step, k, some, deadline, self._undefined(step))
            for e, f in pairs.found():
                c = self.attempt(step, [e, f])
                if c is not None:
                    out.append(c)
            self.tried += pairs.evaluated
            complete &= pairs.complete
        return out, complete

    def _undefined(self, step: Step) -> list[ByteRange]:
        """Return where names without a value stand in the statements of an equation on which failing rows depend."""
        out: list[ByteRange] = []
        for other, sites in self._sites():
            if other is step:
                for site in sites:
                    out += undefined(site)
        return out

    def _moving(self, k: Key, singles: list[Candidate]) -> list[tuple[Step, list[Edit]]]:
        """Return the one-token edits that change row `k`, grouped by the equation in which they are tried."""
        mine = self.judge.step(k[0])
        called = {(h.source.path, h.source.name) for h in self.judge.helpers(mine)}
        blind = not np.isfinite(self.raw[k]).all()  # without a value, the effect of a single edit may be invisible
        some = [(c.step, c.edits[0]) for c in singles if blind or _moves(c, k, self.raw[k])]
        out: dict[str, tuple[Step, list[Edit]]] = {}
        for first, e in [*some, *(self.senseless if mine.stuck else ())]:
            if e.kind in TOKENS and e.kind != "left side":
                step = mine if (e.path, e.function) in called else first
                out.setdefault(step.equation.name, (step, []))[1].append(e)
        return sorted(out.values(), key=lambda x: x[0] is not mine)


def _is_of(step: Step, edit: Edit) -> bool:
    """Return whether an edit is in the text of an equation itself, not in that of a function that it calls."""
    return (step.source.path, step.source.name) == (edit.path, edit.function)


def _moves(c: Candidate, k: Key, raw: Array) -> bool:
    after = c.changed.get(k)
    return after is not None and not np.array_equal(after, raw)


def _same(a: dict[Key, Array], b: dict[Key, Array]) -> bool:
    """Return whether two edited equations are equivalent: their residuals differ by a constant factor only."""
    if a.keys() != b.keys():
        return False
    for k in a:
        if a[k].shape != b[k].shape or not np.array_equal(np.isfinite(a[k]), np.isfinite(b[k])):
            return False
        x, y = a[k][np.isfinite(a[k])], b[k][np.isfinite(b[k])]
        size = float(np.abs(x).max(initial=0.0))
        if size == 0:
            continue
        i = int(np.argmax(np.abs(x)))
        if np.abs(y - x * (y[i] / x[i])).max() > _SAME * float(np.abs(y).max(initial=0.0)):
            return False
    return True
