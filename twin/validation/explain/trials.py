"""Evaluate edits of the source: residuals of the rows in all equations that the edits affect."""

from __future__ import annotations

from collections.abc import Container, Sequence
from functools import cached_property

import numpy as np

from twin.core.spatial import Array
from twin.validation.explain.candidate import Candidate, alias_values, edited_residuals
from twin.validation.explain.dependence import Dependence
from twin.validation.explain.equation_steps import RowKey, Step
from twin.validation.explain.expression import Site
from twin.validation.explain.formula_state import is_worse
from twin.validation.explain.function_source import Edit, Source, Statement
from twin.validation.explain.name_pool import name_pool
from twin.validation.explain.row_deviations import Judge, trial_residuals, worst
from twin.validation.explain.suspect_statements import available_symbols, suspects, unread_statements


class Trials:
    """Trials of edits of one judged formula."""

    def __init__(self, judge: Judge) -> None:
        """Set up trials for the wrong rows of `judge`."""
        self.judge = judge
        self.residuals_before: dict[RowKey, Array] = {}
        """Residuals (k, entries) of the rows before edits."""
        self.worst_before: dict[RowKey, float] = {}
        """Worst residual of each row before edits, in units of the tolerance."""
        for place, residual in judge.residuals.items():
            self.residuals_before[place.key] = residual
            self.worst_before[place.key] = worst(residual)
        wrong = judge.failing()
        wrong_printed = [place for place in wrong if judge.step(place.equation).stage != "helper"]
        # Wrong helpers often only repeat the error of a printed equation: repair helpers only if all other rows agree.
        self.targets = wrong_printed or wrong
        self.failing = [place.key for place in self.targets]
        self.trial_count = 0
        self.edits_without_value: list[tuple[Step, Edit]] = []
        """Edits without a value; a second edit may change that."""
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
                for i in unread_statements(self.judge.step(equation)):
                    if i < last:
                        indices.add(i)
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
            names = name_pool(step.source, statement, available_symbols(self.judge, step), self.parameters, step.scope)
            _, sites = sites_of_equation.setdefault(step.equation.name, (step, []))
            sites.append(Site(step.source, statement, names))
        for step, sites in sites_of_equation.values():
            for helper in self.judge.helpers(step):
                source = helper.source
                for statement in source.statements:
                    scope = helper.function.__globals__
                    names = name_pool(source, statement, set(source.arguments), self.parameters, scope)
                    sites.append(Site(source, statement, names))
        return list(sites_of_equation.values())

    def calls(self, step: Step, source: Source) -> bool:
        """Return whether an equation calls a function."""
        for helper in self.judge.helpers(step):
            if (helper.source.name, helper.source.path) == (source.name, source.path):
                return True
        return False

    def callers(self, source: Source, besides: Step) -> list[Step]:
        """Return the equations, without `besides`, that call a function."""
        callers: list[Step] = []
        for step in self.judge.steps:
            if step is not besides and not step.missing and self.calls(step, source):
                callers.append(step)
        return callers

    def candidate_for(self, steps: list[Step], change: list[Edit]) -> Candidate | None:
        """Return the candidate for edits of one function, judged in all equations that it affects; None: cannot run.

        Besides `steps`, the equation is judged that the function itself is, which others may call as well.
        """
        every_step = list(steps)
        for step in self.judge.steps:
            if step not in steps and not step.missing and change[0].is_of(step.source):
                every_step.append(step)
        first: Candidate | None = None
        judged: set[str] = set()  # equations already judged: with an equation, those that use its outputs are
        for step in sorted(every_step, key=self.judge.steps.index):
            if step.equation.name in judged:
                continue
            candidate = self.attempt(step, change)
            if candidate is None:
                if first is not None:  # what can no longer be run in a further equation has wrong rows there
                    first.breaks_row = True
                return first
            # The trial of an equation whose helper is edited also runs the later equations, with the edited helper.
            if step.source.name != change[0].function:
                for equation, _, _ in candidate.worst_residuals:
                    judged.add(equation)
            if first is None:
                first = candidate
            else:
                first.merge(candidate)
        if first is not None:
            first.step = every_step[0]
        return first

    def attempt(self, step: Step, change: list[Edit]) -> Candidate | None:
        """Return the candidate for edits of one equation, or None if the edited formula is not valid."""
        self.trial_count += 1
        extra = alias_values(self.judge, step, change)
        if extra is None:
            return None
        residuals = trial_residuals(self.judge, step, change, extra)
        if residuals is None:
            return None
        worsts: dict[RowKey, float] = {}
        changed: dict[RowKey, Array] = {}
        breaks_row = False
        for place, residual in residuals.items():
            row = place.key
            worsts[row] = worst(residual)
            breaks_row |= is_worse(self.worst_before, row, worsts[row])
            if row in self.residuals_before:
                changed[row] = residual
            if row not in self.worst_before and worsts[row] > 1:  # a return statement that was not reached before
                breaks_row = True
        candidate = Candidate(step, change, extra, worsts, breaks_row, changed)
        candidate.by_chance = self.is_rejected(candidate.edits)
        if not breaks_row:
            repaired = [row for row in self.failing if worsts.get(row, np.inf) <= 1]
            self.dependence.judge_dependence(candidate, repaired)
        return candidate

    def is_rejected(self, change: Sequence[Edit]) -> bool:
        """Return whether edits contain some that were rejected: what is right only by chance stays so beside others."""
        return any(rejected.issubset(change) for rejected in self.rejected)

    @cached_property
    def perturbed_judge(self) -> Judge:
        """Judge of the formula with each number perturbed at random; rows that still agree do so by coincidence."""
        return self.judge.on(self.judge.reference.perturbed())

    @cached_property
    def first(self) -> Judge:
        """Judge of the formula at the first sample only."""
        return self.judge.on(self.judge.reference.first())

    @cached_property
    def dependence(self) -> Dependence:
        """Dependence of the rows on symbols."""
        return Dependence(self.judge, self.perturbed_judge)

    def entries(self, step: Step) -> int:
        """Return the largest number of entries of a failing row of an equation."""
        entries = 0
        for key in self.failing:
            if key[0] == step.equation.name:
                entries = max(entries, self.residuals_before[key].shape[1])
        return entries

    def exact(self, rows: list[RowKey], candidates: list[Candidate]) -> list[Candidate]:
        """Return the candidates after which all given rows agree, the most usual edits first."""
        exact: list[Candidate] = []
        for candidate in candidates:
            changes_rows = not candidate.worst_residuals.keys().isdisjoint(rows)
            if candidate.may_be_proposed and changes_rows and candidate.worst_over(rows, self.worst_before) <= 1:
                exact.append(candidate)
        exact.sort(key=lambda candidate: candidate.rank)
        runnable: list[Candidate] = []
        for candidate in exact:
            # Names that the edits define have values only at the samples of the search.
            if candidate.defined_values or self._runs_at_one_sample(candidate):
                runnable.append(candidate)
        return runnable

    def _runs_at_one_sample(self, candidate: Candidate) -> bool:
        """Return whether a candidate also runs with a single sample; some errors occur only then.

        For example, a scalar with an index is an error, but with several samples the scalar is an array.
        """
        return edited_residuals(self.first, candidate.step.equation.name, candidate.edits) is not None
