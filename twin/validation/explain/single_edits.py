"""Evaluate single edits: in the statements on which wrong rows depend, and in the functions that these call."""

from __future__ import annotations

from collections import Counter
from collections.abc import Container, Iterable, Sequence
from pathlib import Path

from twin.core.progress import StepProgress
from twin.validation.explain.candidate import Candidate
from twin.validation.explain.counterparts import counterpart_edits
from twin.validation.explain.deadline import Deadline
from twin.validation.explain.equation_steps import Helper, RowKey, Step
from twin.validation.explain.function_source import Edit, Source, Statement, TextPlace
from twin.validation.explain.name_pool import name_pool
from twin.validation.explain.pair_search import PairSearch
from twin.validation.explain.required_values import RequiredValues
from twin.validation.explain.statement_edits import statement_edits
from twin.validation.explain.suspect_statements import available_symbols
from twin.validation.explain.trials import Trials

_REQUIRED_PART = 0.4
"""Maximum part of the remaining time for edits from required values."""

_REFUTE_PART = 0.25
"""Maximum part of the remaining time to find expressions in which no single edit can repair a row."""


class SingleEdits:
    """Evaluates single edits until a deadline, and leaves out those that cannot repair a row.

    Attributes:
        until: deadline of the current stage of the search.
        complete: whether no deadline has ended the evaluation so far.
        refuted: places of expressions in which no single edit can repair a row.
    """

    def __init__(self, trials: Trials, pair_search: PairSearch, deadline: Deadline, progress: StepProgress) -> None:
        """Set up for the wrong rows of `trials`; `deadline`: limit of the whole search."""
        self.trials = trials
        self.judge = trials.judge
        self.pair_search = pair_search
        self.deadline = deadline
        self.progress = progress
        self.until = deadline
        self.complete = True
        self.refuted: list[TextPlace] = []
        self._deferred: list[tuple[list[Step], Edit]] = []
        """Edits in places where no single edit can repair a row; pairs are searched before these edits are tried."""

    def shared_sites(self, groups: Sequence[Sequence[RowKey]]) -> tuple[set[tuple[str, int]], set[int]]:
        """Return (statements, called functions) on which rows of several groups depend.

        One edit can repair several groups only there. Statements are (equation, index), functions are identities.
        """
        statements: Counter[tuple[str, int]] = Counter()
        functions: Counter[int] = Counter()
        for group in groups:
            statements_of_group: set[tuple[str, int]] = set()
            functions_of_group: set[int] = set()
            for step, statement in self.trials.own_sites(group):
                statements_of_group.add((step.equation.name, statement.index))
                for helper in self.judge.helpers(step):
                    functions_of_group.add(id(helper.function))
            statements.update(statements_of_group)
            functions.update(functions_of_group)
        # What is left after one of each is taken away is in more than one group.
        shared_statements = statements - Counter(statements.keys())
        shared_functions = functions - Counter(functions.keys())
        return set(shared_statements), set(shared_functions)

    # -- edits of given kinds ------------------------------------------------------------------------------------

    def in_statements(self, kinds: Container[str], only: Container[tuple[str, int]] | None = None) -> list[Candidate]:
        """Evaluate edits of the given kinds in the statements of `Trials.own_sites`.

        `only`: (equation, index) of the statements to edit; None for all.
        """
        candidates: list[Candidate] = []
        sites: list[tuple[Step, Statement]] = []
        for step, statement in self.trials.own_sites():
            if only is None or (step.equation.name, statement.index) in only:
                sites.append((step, statement))
        for n, (step, statement) in enumerate(sites):
            self.progress(n / len(sites))
            symbols = available_symbols(self.judge, step)
            names = name_pool(step.source, statement, symbols, self.trials.parameters, step.scope)
            # Other equations may call this equation's function.
            others = self.trials.callers(step.source, step)
            edits = list(statement_edits(step.source, statement, names, kinds))
            likely = self._likely(step, statement, edits)
            for edit in edits:
                if self._is_late():
                    return candidates
                steps = [step]
                if not edit.define:
                    steps += others
                if likely is not None and edit not in likely:
                    # With a swivel, one edit takes as long as ten others, so that only likely ones are evaluated.
                    if not step.swivel:
                        self._deferred.append((steps, edit))
                    continue
                self._evaluate(steps, edit, candidates)
        return candidates

    def in_helpers(self, kinds: Container[str], only: Container[int] | None = None) -> list[Candidate]:
        """Evaluate edits of the given kinds in the plain functions that the statements of `Trials.own_sites` call.

        `only`: identities of the functions to edit; None for all.
        """
        candidates: list[Candidate] = []
        reached = self._reached_helpers(only)
        for n, (helper, callers) in enumerate(reached):
            self.progress(n / len(reached))
            source = helper.source
            # An edited helper affects every equation that calls it, also rows that agree.
            steps = list(callers)
            for step in self.judge.steps:
                called = [called_helper.function for called_helper in self.judge.helpers(step)]
                if helper.function in called and step not in callers and not step.missing:
                    steps.append(step)
            for statement in source.statements:
                arguments = set(source.arguments)
                scope = helper.function.__globals__
                names = name_pool(source, statement, arguments, self.trials.parameters, scope)
                for edit in statement_edits(source, statement, names, kinds):
                    if self._is_late():
                        return candidates
                    if self._is_refuted(edit):
                        self._deferred.append((steps, edit))
                        continue
                    self._evaluate(steps, edit, candidates)
        return candidates

    def _reached_helpers(self, only: Container[int] | None) -> list[tuple[Helper, list[Step]]]:
        """Return the functions that the statements of `Trials.own_sites` call, each with the equations that call it."""
        steps = {id(step): step for step, _ in self.trials.own_sites()}
        reached: dict[int, tuple[Helper, list[Step]]] = {}
        for step in steps.values():
            for helper in self.judge.helpers(step):
                identity = id(helper.function)
                if only is not None and identity not in only:
                    continue
                _, callers = reached.setdefault(identity, (helper, []))
                callers.append(step)
        return list(reached.values())

    def _evaluate(self, steps: list[Step], edit: Edit, candidates: list[Candidate]) -> None:
        """Add the candidate for an edit to `candidates`; an edit without a value is kept, as one of a pair may have."""
        candidate = self.trials.candidate_for(steps, [edit])
        if candidate is not None:
            candidates.append(candidate)
        else:
            self.trials.edits_without_value.append((steps[0], edit))

    def _is_late(self) -> bool:
        """Return whether the time of the stage is over; then the search is not complete."""
        late = self.until.passed
        if late:
            self.complete = False
        return late

    def _likely(self, step: Step, statement: Statement, edits: Sequence[Edit]) -> set[Edit] | None:
        """Return the edits of a statement that may be repairs; None: all of them.

        With a swivel, these are the edits after which a row agrees at one pose. Otherwise, edits inside expressions
        without a right value are left out, unless a row agrees: such an edit makes another value of a scalar, a vector.
        """
        refuted: list[Edit] = []
        possible: set[Edit] = set()
        for edit in edits:
            if self._is_refuted(edit):
                refuted.append(edit)
            else:
                possible.add(edit)
        if not step.swivel and not refuted:
            return None
        search = self.pair_search.statement_pairs(step)
        if step.swivel:
            if search is None:
                return None
            return search.likely_edits(statement, edits, self.until)
        agreeing: set[Edit] | None = None
        if search is not None:
            agreeing = search.likely_edits(statement, refuted, self.until)
        if agreeing is None:
            return possible
        return possible | agreeing

    # -- expressions without a right value -----------------------------------------------------------------------

    def find_refuted(self) -> None:
        """Find the expressions in which no single edit can repair a failing row, also one with another repair."""
        until = self.deadline.within(_REFUTE_PART * self.deadline.left)
        failing = self.trials.failing
        refuted: set[TextPlace] = set()
        possible: set[TextPlace] = set()
        for pairs_of_equation in self.pair_search.required_pairs:
            refuted_in_equation = set(pairs_of_equation.refuted(failing, until))
            refuted |= refuted_in_equation
            for scalar in pairs_of_equation.scalars(failing, until):
                if scalar.place not in refuted_in_equation:
                    possible.add(scalar.place)
            possible.update(pairs_of_equation.unsure)
            if until.passed:  # other equations might use the same expressions; these edits are tried after the pairs
                break
        self.refuted = []
        for place in refuted:
            # An edit of this expression may be a repair if it is one of an expression around it.
            if not _is_within_one(place, possible):
                self.refuted.append(place)

    def _is_refuted(self, edit: Edit) -> bool:
        """Return whether an edit is in an expression without a right value."""
        return _is_within_one((edit.path, edit.start, edit.end), self.refuted)

    def evaluate_deferred(self) -> list[Candidate]:
        """Evaluate the edits that were left out because Gauss-Newton found no value for their expressions."""
        candidates: list[Candidate] = []
        for steps, edit in self._deferred:
            if self._is_late():
                break
            self._evaluate(steps, edit, candidates)
        self._deferred = []
        return candidates

    # -- edits that follow from the file or from values ----------------------------------------------------------

    def required(self, rows: Sequence[RowKey]) -> list[Candidate]:
        """Evaluate the edits that give an expression the value with which wrong rows agree; see `RequiredValues`."""
        candidates: list[Candidate] = []
        until = self.deadline.within(_REQUIRED_PART * self.deadline.left)
        with_edits: set[tuple[Path, int]] = set()
        for step, source, statement in self._sites_with_helpers(rows):
            # A statement without an edit is tried again, for the next equation that calls its function.
            if (source.path, statement.start) in with_edits:
                continue
            others = self.trials.callers(source, step)
            search = RequiredValues(self.judge, step, rows, until, refuted=self.refuted)
            for edit in search.edits(source, statement):
                with_edits.add((source.path, statement.start))
                candidate = self.trials.candidate_for([step, *others], [edit])
                if candidate is not None:
                    candidates.append(candidate)
        return candidates

    def _sites_with_helpers(self, rows: Sequence[RowKey]) -> list[tuple[Step, Source, Statement]]:
        """Return the statements on which rows depend, then those of the functions that their equations call."""
        sites: list[tuple[Step, Source, Statement]] = []
        steps: dict[int, Step] = {}
        for step, statement in self.trials.own_sites(rows):
            sites.append((step, step.source, statement))
            steps[id(step)] = step
        # Rows with several entries determine an expression of a called function best.
        for step in sorted(steps.values(), key=self.trials.entries, reverse=True):
            for helper in self.judge.helpers(step):
                for statement in helper.source.statements:
                    sites.append((step, helper.source, statement))
        return sites

    def counterparts(self, rows: Sequence[RowKey]) -> list[Candidate]:
        """Evaluate the edits that put back what similar expressions of the file have more."""
        candidates: list[Candidate] = []
        evaluated: set[Edit] = set()  # several equations may call one function
        for step, statement in self.trials.own_sites(rows):
            sites = [(step.source, statement)]
            for helper in self.judge.helpers(step):
                for statement_of_helper in helper.source.statements:
                    sites.append((helper.source, statement_of_helper))
            for source, edited_statement in sites:
                for edit in counterpart_edits(source, edited_statement):
                    if edit in evaluated:
                        continue
                    if self.deadline.passed:
                        return candidates
                    evaluated.add(edit)
                    steps = [step, *self.trials.callers(source, step)]
                    candidate = self.trials.candidate_for(steps, [edit])
                    if candidate is not None:
                        candidates.append(candidate)
        return candidates


def _is_within_one(place: TextPlace, outer_places: Iterable[TextPlace]) -> bool:
    """Return whether a part of a file is within one of others."""
    path, start, end = place
    for outer_path, first, last in outer_places:
        if path != outer_path:
            continue
        if first <= start and end <= last:
            return True
    return False
