"""Search two edits that together repair a row: from required values of expressions, then by pairs of positions."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import cached_property

import numpy as np

from twin.core.spatial import Array
from twin.validation.explain.batch import Batch
from twin.validation.explain.candidate import FORMS, TOKENS, Candidate
from twin.validation.explain.crossed import Crossed
from twin.validation.explain.deadline import Deadline
from twin.validation.explain.double import Double
from twin.validation.explain.expression import Site
from twin.validation.explain.pairs import Pairs
from twin.validation.explain.repair_choice import RepairChoice
from twin.validation.explain.rows import Key, Step
from twin.validation.explain.source import Edit
from twin.validation.explain.trials import Trials
from twin.validation.explain.undefined_names import ByteRange, undefined

_DOUBLE_SHARES = (0.2, 0.2, 0.2, 0.7, 0.4, 0.3, 0.5, 1.0)
"""Maximum parts of the remaining time for the kinds of such pairs, in the order of `by_value`."""

_IN_ONE, _IN_TWO = 2, 3
"""Indices of the kinds of pairs in scalar expressions, which are tried first for equations that return a pose."""

_POSE, _POSE_PART = 12, 0.4
"""Number of entries of such a row, and maximum part of the time for these pairs."""

_APART = 0.6
"""Maximum part of this time for pairs in different statements, of the last equation; less for those before."""

_FIRST_PART = 0.6
"""Maximum part of this time for the equation whose rows have most entries; then of the rest for the next one."""

_DOUBLE_PART = 0.85
"""Maximum part of the time for pairs of edits that is used for pairs from required values of expressions."""

_COARSE = 6
"""Number of poses at which most expressions are rejected."""

_SHARED_PART = 0.2
"""Maximum fraction of the remaining time for the pairs with an edit of a repaired group."""

_Stage = Callable[[Double, Sequence[Key], Deadline], Iterator[tuple[Edit, Edit]]]
"""Yields the pairs of edits of one kind for an equation and its wrong rows, until a deadline."""


class PairSearch:
    """Search for pairs of edits of one judged formula."""

    def __init__(self, trials: Trials, choice: RepairChoice) -> None:
        """Set up the search: `trials` evaluates pairs, `choice` tells whether a pair is a repair."""
        self.trials = trials
        self.choice = choice
        self._in_two_statements: list[Candidate] | None = None
        self._crossings: dict[str, Crossed | None] = {}

    def by_value(
        self, k: Key, singles: list[Candidate], shared: list[Candidate], deadline: Deadline
    ) -> tuple[list[Candidate], bool]:
        """Return (pairs of edits found from required values of expressions, whether the search ended); see `Double`.

        The pairs must repair all failing rows that the expressions move, or row `k` alone. `shared` are repairs of
        other rows; one of them may be the first edit.
        """
        until = deadline.within(_DOUBLE_PART * deadline.left)
        out: list[Candidate] = []
        firsts = [c.edits[0] for c in singles if k in c.scores and c.edits[0].define is None]
        firsts.sort(key=lambda e: (e.kind not in FORMS, e.kind not in TOKENS))  # few replacements come first
        searches = []
        for rows in dict.fromkeys((tuple(self.trials.failing), (k,))):
            for double in self.doubles:
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
            if self.choice.has_repair(k, out):
                return out, True
        out += self._of_two_statements(until)
        if self.choice.has_repair(k, out):
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
                if self.choice.has_repair(k, out):
                    return out, True
        return out, not until.passed

    def _tried_pairs(
        self, stage: _Stage, searches: Sequence[tuple[Double, Sequence[Key]]], end: Deadline
    ) -> list[Candidate]:
        """Return the candidates for the pairs of edits that a stage of `by_value` finds in some equations."""
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
        return any(self.trials.raw[row].shape[1] >= _POSE for row in own)

    def crossed(self, step: Step) -> Crossed | None:
        """Return the search for edits in the statements of an equation itself; None for a plain function."""
        name = step.equation.name
        if name not in self._crossings:
            own: list[Site] = []
            for other, sites in self.trials.sites():
                if other is step:
                    own = [site for site in sites if site.source is step.source]
            search = None
            if step.plain is None and own:
                search = Crossed(self.trials.judge, name, own, self.trials.failing)
            self._crossings[name] = search
        return self._crossings[name]

    def _of_two_statements(self, until: Deadline) -> list[Candidate]:
        """Return pairs of edits in different statements of an equation; they are searched once, for all rows."""
        if self._in_two_statements is None:
            self._in_two_statements = []
            doubles = self.doubles
            # One entry of a row does not determine two scalars, so that their edits are tried as well.
            single = max(self.trials.raw[key].shape[1] for key in self.trials.failing) == 1
            for n, double in enumerate(doubles):
                search = self.crossed(double.step)
                if search is None:
                    continue
                part = _APART / (len(doubles) - n) ** 0.5
                end = until.within(part * until.left)
                scalars = [] if single else double.cuts(self.trials.failing, end)
                for first, second in search.apart(end, [cut.place for cut in scalars]):
                    candidate = self._pair(double, first, second)
                    if candidate is not None:
                        self._in_two_statements.append(candidate)
        return list(self._in_two_statements)

    def _in_one_statement(self, double: Double, rows: Sequence[Key], end: Deadline) -> Iterator[tuple[Edit, Edit]]:
        search = self.crossed(double.step)
        if search is not None and len(rows) == len(self.trials.failing):
            yield from search.together(end)

    def _pair(self, double: Double, first: Edit, second: Edit) -> Candidate | None:
        """Return the candidate for two edits of one function, judged in all equations that call it."""
        source = next(site.source for site in double.sites if site.source.name == first.function)
        others = self.trials.callers(source, double.step)
        return self.trials.everywhere([double.step, *others], [first, second])

    @cached_property
    def doubles(self) -> list[Double]:
        """The searches for two edits, one for each equation on which failing rows depend."""
        k = self.trials.judge.truth.k
        few = np.linspace(0, k - 1, min(_COARSE, k)).astype(int)
        coarse = Batch(self.trials.judge, [int(i) for i in few], _COARSE // 2)
        full = Batch(self.trials.judge, range(k))
        out = []
        for step, sites in self.trials.sites():
            out.append(Double(coarse, full, step, sites, self.trials.failing))
        # Rows with several entries reject nearly all wrong expressions, so that they are tried first.
        return sorted(out, key=lambda double: self.trials.entries(double.step), reverse=True)

    def by_position(
        self, k: Key, singles: list[Candidate], shared: list[Candidate], deadline: Deadline
    ) -> tuple[list[Candidate], bool]:
        """Return (pairs of edits with which row k agrees or nearly agrees, whether all pairs were tried).

        First, pairs of edits of any kind are tried if the effects of both edits add up to the residual; then, all pairs
        of one-token edits are tried.
        """
        mine = [c for c in singles if k in c.changed and c.changed[k].shape == self.trials.raw[k].shape]
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
            c = self.trials.attempt(a.step, [e, f])
            if c is not None:
                out.append(c)

        if mine and np.isfinite(self.trials.raw[k]).all():
            weights = np.random.default_rng(3).standard_normal(self.trials.raw[k].size)
            weights /= np.linalg.norm(weights)
            target = -float(weights @ self.trials.raw[k].ravel())
            effect = np.array([weights @ (c.changed[k] - self.trials.raw[k]).ravel() for c in mine])
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
        if any(c.serves and c.over([k], self.trials.base) <= 1 for c in out):
            return out, True
        complete = True
        for step, some in self._moving(k, singles):
            pairs = Pairs(self.trials.judge, self.trials.shaken, step, k, some, deadline, self._undefined(step))
            for e, f in pairs.found():
                c = self.trials.attempt(step, [e, f])
                if c is not None:
                    out.append(c)
            self.trials.tried += pairs.evaluated
            complete &= pairs.complete
        return out, complete

    def _undefined(self, step: Step) -> list[ByteRange]:
        """Return where names without a value stand in the statements of an equation on which failing rows depend."""
        out: list[ByteRange] = []
        for other, sites in self.trials.sites():
            if other is step:
                for site in sites:
                    out += undefined(site)
        return out

    def _moving(self, k: Key, singles: list[Candidate]) -> list[tuple[Step, list[Edit]]]:
        """Return the one-token edits that change row `k`, grouped by the equation in which they are tried."""
        mine = self.trials.judge.step(k[0])
        called = {(h.source.path, h.source.name) for h in self.trials.judge.helpers(mine)}
        blind = not np.isfinite(
            self.trials.raw[k]
        ).all()  # without a value, the effect of a single edit may be invisible
        some = [(c.step, c.edits[0]) for c in singles if blind or _moves(c, k, self.trials.raw[k])]
        out: dict[str, tuple[Step, list[Edit]]] = {}
        for first, e in [*some, *(self.trials.senseless if mine.stuck else ())]:
            if e.kind in TOKENS and e.kind != "left side":
                step = mine if (e.path, e.function) in called else first
                out.setdefault(step.equation.name, (step, []))[1].append(e)
        return sorted(out.values(), key=lambda x: x[0] is not mine)


def _moves(c: Candidate, k: Key, raw: Array) -> bool:
    after = c.changed.get(k)
    return after is not None and not np.array_equal(after, raw)
