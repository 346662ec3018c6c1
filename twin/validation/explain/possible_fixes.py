"""Search what makes the wrong rows agree, the simplest kind first: edits, changed numbers, conventions.

The simpler explanation has fewer changes. One changed number after which every row agrees is simpler than two edits,
and as simple as one edit.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Literal

from twin.core.errors import TwinError
from twin.core.progress import Progress
from twin.reference import ReferenceModel
from twin.validation.explain.candidate import Candidate, GroupResult
from twin.validation.explain.conventions import conventions, conventions_of_all_rows
from twin.validation.explain.deadline import Deadline, LateError
from twin.validation.explain.equation_steps import RowKey
from twin.validation.explain.explanation_data import Convention, FittedParameters
from twin.validation.explain.explanation_repairs import edit_phrase
from twin.validation.explain.explanation_rows import row_name
from twin.validation.explain.judged_states import sample_states
from twin.validation.explain.reference_values import symbol_values
from twin.validation.explain.repair_search import RepairSearch
from twin.validation.explain.row_deviations import Judge, trial_residuals, worst
from twin.validation.explain.suspect_statements import have_common_source
from twin.validation.explain.wrong_parameters import identify

Lead = Literal["edits", "numbers", "edits or numbers", ""]
"""Kind of the simplest explanation; "" if there is none."""

_NUMBERS_PART = 0.3
_LEAST_NUMBERS_TIME = 2.5
"""Time limit of each of the two fits of numbers: this part of the whole limit, but at least so many seconds."""

_LEAST_EDITS_TIME = 4.0
"""Minimum time limit in s of the search for edits: single edits take about as long."""

_HELD_OUT_STATES = 12
_HELD_OUT_SEED = 101
"""Number of states, not used by the search, at which repairs are checked, and the seed with which they are drawn."""

_HELD_OUT_LIMIT = 10
"""Largest residual of a correct repair at these states, in units of the tolerance; wrong ones have far larger ones."""


@dataclass(frozen=True)
class PossibleFixes:
    """Possible fixes of the wrong rows.

    Attributes:
        search, results: the search for edits, and the results of this search.
        identified: the changed numbers; None if no change of numbers fits, or if edits are simpler.
        conventions: conventions under which rows agree; searched only after edits and numbers have failed.
        lead: see `Explanation`.
        notes: remarks.
    """

    search: RepairSearch
    results: list[GroupResult]
    identified: FittedParameters | None
    conventions: tuple[Convention, ...]
    lead: str
    notes: tuple[str, ...] = ()


def possible_fixes(
    judge: Judge, model: ReferenceModel, budget: float, progress: Progress, end_lap: Callable[[str], None]
) -> PossibleFixes:
    """Search edits, parameter values and conventions with which the wrong rows agree.

    `budget` is the time limit in s; see `_LEAST_NUMBERS_TIME` and `_LEAST_EDITS_TIME` for short ones. `end_lap` is
    called with the name of each step at its end.
    """
    return _FixSearch(judge, model, budget, progress, end_lap).run()


class _FixSearch:
    """The searches for edits, numbers and conventions of one judged formula."""

    def __init__(
        self, judge: Judge, model: ReferenceModel, budget: float, progress: Progress, end_lap: Callable[[str], None]
    ) -> None:
        self.judge = judge
        self.model = model
        self.budget = budget
        self.progress = progress
        self.end_lap = end_lap
        self.remarks: list[str] = []

    def run(self) -> PossibleFixes:
        """Return the simplest fixes that explain the wrong rows; without any, all that fix some of them."""
        identified = self._numbers(alone=True)
        deadline = Deadline(max(self.budget, _LEAST_EDITS_TIME))  # the time of the numbers is not that of the edits
        search = RepairSearch(self.judge, lambda fraction: self.progress("try edits", fraction), deadline)
        general_conventions: tuple[Convention, ...] | None = None
        results: list[GroupResult] = []
        unrepaired = search.failing
        if identified is None:
            results, unrepaired = search.run(0.0)
            self.end_lap("repair")
            if unrepaired:
                # A convention of the whole formula is simpler than pairs of edits, and is found in less time.
                self.progress("conventions", 0.0)
                general_conventions = tuple(conventions_of_all_rows(self.judge))
                self.end_lap("conventions")
                if self._all_fixed(general_conventions, search.failing):
                    return self._fixes(search, [], None, general_conventions, "conventions")
                results, unrepaired = search.pairs(results, unrepaired, self.budget)
        elif have_common_source(self.judge, search.targets):
            # One changed number explains everything: only a single edit would be equally simple.
            results, unrepaired = search.run(0.0)
        self._note_edits_by_chance(search)
        results, unrepaired = confirmed_at_new_states(self.judge, self.model, results, unrepaired)
        self.end_lap("repair")
        if identified is None and (unrepaired or not results):
            identified = self._numbers()
        lead: str = simplest_explanation(results, unrepaired, identified)
        if lead == "edits":
            return self._fixes(search, results, None, (), lead)
        if lead == "numbers":
            if not unrepaired:
                self._note_edits_beside_numbers(results)
            return self._fixes(search, [], identified, (), lead)
        if lead:
            return self._fixes(search, results, identified, (), lead)
        self.progress("conventions", 0.0)
        found_conventions = tuple(conventions(self.judge, general_conventions))
        self.end_lap("conventions")
        if self._all_fixed(found_conventions, unrepaired):
            lead = "conventions"
        return self._fixes(search, results, identified, found_conventions, lead)

    def _fixes(
        self,
        search: RepairSearch,
        results: list[GroupResult],
        identified: FittedParameters | None,
        found_conventions: tuple[Convention, ...],
        lead: str,
    ) -> PossibleFixes:
        """Return the result of all searches, with the remarks made so far."""
        return PossibleFixes(search, results, identified, found_conventions, lead, tuple(self.remarks))

    def _numbers(self, alone: bool = False) -> FittedParameters | None:
        """Fit the parameters; None if none explains a row, or if the time was over. `alone`: see `identify`."""
        self.progress("identify parameters", 0.0)
        until = Deadline(max(_NUMBERS_PART * self.budget, _LEAST_NUMBERS_TIME))
        try:
            return identify(
                self.judge,
                lambda fraction: self.progress("identify parameters", fraction),
                alone=alone,
                deadline=until,
            )
        except LateError:
            self.remarks.append("the time ended before every number was fitted; a larger --seconds gives more time")
            return None
        finally:
            self.end_lap("identify")

    def _note_edits_by_chance(self, search: RepairSearch) -> None:
        """Remark on the edits that are no fixes because rows agree after them only by chance."""
        for candidate, reason in search.by_chance:
            phrases: list[str] = []
            for edit in candidate.edits:
                phrases.append(edit_phrase(edit))
            self.remarks.append(f"`{'; '.join(phrases)}` makes rows agree only {reason}; it is no fix")

    def _note_edits_beside_numbers(self, results: Sequence[GroupResult]) -> None:
        """Remark on the edits that would also make the rows agree, but are more changes than the fitted numbers."""
        count = _edits_of_first_repairs(results)
        if count:
            self.remarks.append(f"{count} edits together would also make the rows agree; one changed number is simpler")

    def _all_fixed(self, found_conventions: Sequence[Convention], rows: Sequence[RowKey]) -> bool:
        """Return whether conventions fix all the given rows."""
        if not found_conventions:
            return False
        fixed: set[str] = set()
        for convention in found_conventions:
            fixed.update(convention.rows)
        names: set[str] = set()
        for row in rows:
            names.add(row_name(self.judge, row))
        return names <= fixed


def simplest_explanation(
    results: Sequence[GroupResult], unrepaired: Sequence[RowKey], identified: FittedParameters | None
) -> Lead:
    """Return the simplest explanation of all wrong rows: "edits", "numbers", "edits or numbers"; "" if none exists.

    `results` are those of the search for edits, `unrepaired` the rows that it does not repair.
    """
    numbers = _count_of_numbers(identified)
    edits = _count_of_edits(results, unrepaired)
    if numbers is None and edits is None:
        return ""
    if numbers is None:
        return "edits"
    if edits is None:
        return "numbers"
    if numbers == edits:
        return "edits or numbers"
    if numbers > edits:
        return "edits"
    # The value of another parameter is as likely a misprint of its name.
    assert identified is not None
    for parameter in identified.moved:
        if not parameter.note.startswith("the value of"):
            return "numbers"
    return "edits or numbers"


def _count_of_edits(results: Sequence[GroupResult], unrepaired: Sequence[RowKey]) -> int | None:
    """Return the number of edits with which every row agrees; None if there are no such edits."""
    if unrepaired or not results:
        return None
    return _edits_of_first_repairs(results)


def _edits_of_first_repairs(results: Sequence[GroupResult]) -> int:
    """Return the number of edits of the first repairs of all groups."""
    count = 0
    for result in results:
        if result.cures:
            count += len(result.cures[0][0].edits)
    return count


def _count_of_numbers(identified: FittedParameters | None) -> int | None:
    """Return the number of changed parameters with which every row agrees; None if there is no such change."""
    if identified is None or not identified.exact or not identified.moved:
        return None
    if identified.alternatives:
        return 1
    return len(identified.moved)


def confirmed_at_new_states(
    judge: Judge, model: ReferenceModel, results: list[GroupResult], unrepaired: list[RowKey]
) -> tuple[list[GroupResult], list[RowKey]]:
    """Return (search results without the repairs that fail at new states, rows for which no repair is left).

    If a repaired row agrees at all states of the search, but not at the new states, its agreement was a coincidence.
    """
    new_judge = _judge_at_new_states(judge, model)
    if new_judge is None:
        return results, unrepaired
    failing = new_judge.failing_rows()
    checked: list[GroupResult] = []
    unexplained = list(unrepaired)
    for result in results:
        cures: list[list[Candidate]] = []
        for readings in result.cures:
            holding: list[Candidate] = []
            for candidate in readings:
                if _holds(new_judge, candidate, result.rows, failing):
                    holding.append(candidate)
            if holding:
                cures.append(holding)
        if result.cures and not cures:
            for row in result.rows:
                if row not in unexplained:
                    unexplained.append(row)
        checked.append(replace(result, cures=cures))
    return checked, unexplained


def _judge_at_new_states(judge: Judge, model: ReferenceModel) -> Judge | None:
    """Return a judge of the formula at new states; None if a row that agrees in `judge` is wrong at the new states."""
    try:
        run = sample_states(model, _HELD_OUT_STATES, _HELD_OUT_SEED, regular=model.redundant)
    except TwinError:
        return None
    values: dict[str, float] = {}
    for parameter in judge.formula.parameters:
        values[parameter.name] = float(judge.reference.symbols[parameter.name])
    new_judge = judge.on(symbol_values(judge.formula, run, model, values))
    # A row that is wrong only at the new states has a fault that the search could not see.
    if not new_judge.failing_rows() <= judge.failing_rows():
        return None
    return new_judge


def _holds(new_judge: Judge, candidate: Candidate, rows: list[RowKey], failing: set[RowKey]) -> bool:
    """Return whether the rows agree at the new states after a candidate's edits."""
    if candidate.defined_values:  # names defined by the edits have values only at the states of the search
        return True
    step = new_judge.step(candidate.step.equation.name)
    residuals = trial_residuals(new_judge, step, candidate.edits)
    if residuals is None:
        return False
    for place, residual in residuals.items():
        is_judged = place.key in rows and place.key in failing
        if is_judged and worst(residual) > _HELD_OUT_LIMIT:
            return False
    return True
