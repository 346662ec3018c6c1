"""Evaluate edits of the source: residuals of the rows in all equations that the edits affect."""

from __future__ import annotations

from collections.abc import Container, Sequence
from functools import cached_property

import numpy as np

from twin.core.spatial import Array
from twin.validation.explain.candidate import Candidate, aliases, edited_residuals
from twin.validation.explain.dependence import Dependence
from twin.validation.explain.equation_steps import RowKey, Step
from twin.validation.explain.expression import Site
from twin.validation.explain.formula_state import is_worse
from twin.validation.explain.function_source import Edit, Source, Statement
from twin.validation.explain.name_pool import pool
from twin.validation.explain.row_deviations import Judge, trial_residuals, worst
from twin.validation.explain.suspects import available, suspects, unread


class Trials:
    """Trials of edits of one judged formula."""

    def __init__(self, judge: Judge) -> None:
        """Set up trials for the wrong rows of `judge`."""
        self.judge = judge
        self.base = {place.key: worst(residual) for place, residual in judge.residuals.items()}
        self.raw = {place.key: residual for place, residual in judge.residuals.items()}
        bad = judge.failing()
        # Wrong helpers often only repeat the error of a printed equation: repair helpers only if all other rows agree.
        self.targets = [place for place in bad if judge.step(place.equation).stage != "helper"] or bad
        self.failing = [place.key for place in self.targets]
        self.tried = 0
        self.senseless: list[tuple[Step, Edit]] = []  # edits without a value; a second edit may change that
        self.rejected: set[frozenset[Edit]] = set()
        """Edits that make rows agree only by chance together with the repairs of other rows; they are no repairs."""
        self.parameters = {parameter.name for parameter in judge.formula.parameters}

    @cached_property
    def _suspects(self) -> dict[RowKey, dict[str, set[int]]]:
        """Statements on which each failing row depends, or would depend with another name: {row: {equation: indices}}.

        The latter are the statements whose results nobody reads.
        """
        statements_of_row: dict[RowKey, dict[str, set[int]]] = {}
        for place in self.targets:
            statements = suspects(self.judge, place)
            for equation, indices in statements.items():
                last = max(indices)
                indices.update(i for i in unread(self.judge.step(equation)) if i < last)
            statements_of_row[place.key] = statements
        return statements_of_row

    def own_sites(self, rows: Container[RowKey] | None = None) -> list[tuple[Step, Statement]]:
        """Return the statements on which a failing row depends; `rows`: only of these rows."""
        sites: dict[tuple[str, int], tuple[Step, Statement]] = {}
        for place in self.targets:
            if rows is not None and place.key not in rows:
                continue
            for equation, indices in self._suspects[place.key].items():
                step = self.judge.step(equation)
                for i in sorted(indices):
                    sites.setdefault((equation, i), (step, step.source.statements[i]))
        return list(sites.values())

    def sites(self) -> list[tuple[Step, list[Site]]]:
        """Return, for each equation on which rows depend, its statements and those of the functions that it calls."""
        sites_of_equation: dict[str, tuple[Step, list[Site]]] = {}
        for step, statement in self.own_sites():
            choice = pool(step.source, statement, available(self.judge, step), self.parameters, step.scope)
            sites = sites_of_equation.setdefault(step.equation.name, (step, []))[1]
            sites.append(Site(step.source, statement, choice))
        for step, sites in sites_of_equation.values():
            for h in self.judge.helpers(step):
                for statement in h.source.statements:
                    arguments = set(h.source.arguments)
                    choice = pool(h.source, statement, arguments, self.parameters, h.function.__globals__)
                    sites.append(Site(h.source, statement, choice))
        return list(sites_of_equation.values())

    def calls(self, step: Step, source: Source) -> bool:
        """Return whether an equation calls a function."""
        for helper in self.judge.helpers(step):
            if (helper.source.name, helper.source.path) == (source.name, source.path):
                return True
        return False

    def callers(self, source: Source, besides: Step) -> list[Step]:
        """Return the equations, without `besides`, that call a function."""
        callers = []
        for step in self.judge.steps:
            if step is not besides and not step.missing and self.calls(step, source):
                callers.append(step)
        return callers

    def everywhere(self, steps: list[Step], change: list[Edit]) -> Candidate | None:
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
        residuals = None if extra is None else trial_residuals(self.judge, step, change, extra)
        if residuals is None:
            return None
        worsts: dict[RowKey, float] = {}
        changed: dict[RowKey, Array] = {}
        broken = False
        for place, residual in residuals.items():
            row = place.key
            worsts[row] = worst(residual)
            broken |= is_worse(self.base, row, worsts[row])
            if row in self.raw:
                changed[row] = residual
            if row not in self.base and worsts[row] > 1:  # a return statement that was not reached before
                broken = True
        c = Candidate(step, change, extra or {}, worsts, broken, changed)
        c.by_chance = self.is_rejected(c.edits)
        if not broken:
            self.dependence.judged(c, [row for row in self.failing if worsts.get(row, np.inf) <= 1])
        return c

    def is_rejected(self, change: Sequence[Edit]) -> bool:
        """Return whether edits contain some that were rejected: what is right only by chance stays so beside others."""
        return any(some.issubset(change) for some in self.rejected)

    @cached_property
    def shaken(self) -> Judge:
        """Judge of the formula with each number perturbed at random; rows that still agree do so by coincidence."""
        return self.judge.on(self.judge.reference.perturbed())

    @cached_property
    def first(self) -> Judge:
        """Judge of the formula at the first sample only."""
        return self.judge.on(self.judge.reference.first())

    @cached_property
    def dependence(self) -> Dependence:
        """Dependence of the rows on symbols."""
        return Dependence(self.judge, self.shaken)

    def entries(self, step: Step) -> int:
        """Return the largest number of entries of a failing row of an equation."""
        entries = 0
        for key in self.failing:
            if key[0] == step.equation.name:
                entries = max(entries, self.raw[key].shape[1])
        return entries

    def exact(self, rows: list[RowKey], candidates: list[Candidate]) -> list[Candidate]:
        """Return the candidates after which all given rows agree, the most usual edits first."""
        exact = []
        for c in candidates:
            touches = any(row in c.scores for row in rows)
            if c.serves and touches and c.over(rows, self.base) <= 1:
                exact.append(c)
        exact.sort(key=lambda c: c.rank)
        return [c for c in exact if c.extra or self._runs(c)]

    def _runs(self, c: Candidate) -> bool:
        """Return whether a candidate also runs with a single sample; some errors occur only then.

        For example, a scalar with an index is an error, but with several samples the scalar is an array.
        """
        return edited_residuals(self.first, c.step.equation.name, c.edits) is not None


def _is_of(step: Step, edit: Edit) -> bool:
    """Return whether an edit is in the text of an equation itself, not in that of a function that it calls."""
    return (step.source.path, step.source.name) == (edit.path, edit.function)
