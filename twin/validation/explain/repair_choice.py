"""Choose among exact repairs: those that hold in general, and after which the fewest rows of the formula are wrong.

A repair of a group of rows is a cure: a function that makes the rows agree. Different edits that result in this
function are its readings; see `candidate.GroupResult`. A list of cures is therefore a list of lists of candidates.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from twin.validation.explain.candidate import Candidate, GroupResult
from twin.validation.explain.deadline import Deadline
from twin.validation.explain.equation_steps import RowKey
from twin.validation.explain.formula_state import FormulaStates
from twin.validation.explain.function_source import Edit
from twin.validation.explain.trials import Trials

_MOST_CHECKED_READINGS = 12
"""Number of readings of one cure that are checked on the whole formula; further ones only until one is confirmed."""

MOST_EXACT_EDITS = 60
"""Maximum number of exact edits of one group of rows that are compared with each other."""

MOST_CONFIRMED_LATE = 3
"""Maximum number of repairs that are confirmed, if the time is over."""


@dataclass(frozen=True)
class _CheckedCure:
    """A cure without the readings that do not hold in general.

    Attributes:
        confirmed: readings that hold in general, each with the number of wrong rows of the whole formula after it; None
            if that is not known.
        unchecked: readings for which there was no time.
    """

    confirmed: list[tuple[Candidate, int | None]]
    unchecked: list[Candidate]


class RepairChoice:
    """The repairs that may be proposed, and those that were found to hold only by chance."""

    def __init__(self, trials: Trials, deadline: Deadline) -> None:
        """Set up for the wrong rows of `trials`; after `deadline`, few repairs are confirmed."""
        self.trials = trials
        self.states = FormulaStates(trials.judge, trials.worst_before)
        self.deadline = deadline
        self.by_chance: list[tuple[Candidate, str]] = []
        """Edits that make rows agree only by chance, which are no repairs, and the condition; see `FormulaState`."""

    def is_rejected(self, candidate: Candidate) -> bool:
        """Return whether a candidate's edits were rejected together with the repairs of other rows."""
        return self.trials.is_rejected(candidate.edits)

    def is_general(self, candidate: Candidate) -> bool:
        """Return whether the rows agree after a candidate's edits not only by chance; also if that is not known.

        No row of the whole formula may be further off than before.
        """
        if self.is_rejected(candidate):
            return False
        after = self.states.after(candidate.edits)
        return after is None or not (after.chance_condition or after.is_worse)

    def has_repair(self, row: RowKey, candidates: list[Candidate]) -> bool:
        """Return whether one of the candidates repairs a row, and not by chance.

        Also False if the time is over and the first `MOST_CONFIRMED_LATE` exact ones do so only by chance: then it
        is not known.
        """
        exact = self.trials.exact([row], candidates)[:MOST_EXACT_EDITS]
        for n, c in enumerate(exact):
            if self.deadline.passed and n >= MOST_CONFIRMED_LATE:
                return False
            if self.is_general(c):
                return True
        return False

    def exclude(self, candidate: Candidate) -> None:
        """Set `by_chance` of a candidate whose edits do not repair rows in general, so that it is not proposed.

        If the rows agree only by chance, the candidate is also reported in `by_chance`, but only one for each row.
        """
        after = self.states.after(candidate.edits)
        candidate.by_chance = True
        repaired = self._repaired(candidate)
        for reported, _ in self.by_chance:
            if not repaired.isdisjoint(self._repaired(reported)):
                return
        if after is not None and after.chance_condition:
            self._report(candidate, after.chance_condition)

    def _report(self, candidate: Candidate, chance: str) -> None:
        """Add a candidate and the condition of its chance to `by_chance`, unless the same edits are there already."""
        for reported, condition in self.by_chance:
            if frozenset(reported.edits) == frozenset(candidate.edits) and condition == chance:
                return
        self.by_chance.append((candidate, chance))

    def _repaired(self, candidate: Candidate) -> set[RowKey]:
        """Return the failing rows that agree after a candidate's edits."""
        return {row for row in self.trials.failing if candidate.worst_residuals.get(row, np.inf) <= 1}

    def best(self, cures: list[list[Candidate]]) -> list[list[Candidate]]:
        """Keep the cures after which the fewest rows of the whole formula are wrong.

        Readings that hold only for the present values of equal or assumed parameters are left out before, also if no
        other repair is left. A cure of which no reading is confirmed is not proposed.
        """
        checked: list[_CheckedCure] = []
        wrong_rows: list[int] = []  # their number, of each reading for which it is known
        for n, cure in enumerate(cures):
            checked_cure = self._checked(cure, is_early=n < MOST_CONFIRMED_LATE)
            checked.append(checked_cure)
            for _, wrong in checked_cure.confirmed:
                if wrong is not None:
                    wrong_rows.append(wrong)
        fewest = min(wrong_rows, default=None)
        best_cures: list[list[Candidate]] = []
        for checked_cure in checked:
            readings: list[Candidate] = []
            for candidate, wrong in checked_cure.confirmed:
                if wrong is None or wrong == fewest:
                    readings.append(candidate)
            if readings:
                best_cures.append([*readings, *checked_cure.unchecked])
        return best_cures

    def _checked(self, cure: Sequence[Candidate], is_early: bool) -> _CheckedCure:
        """Check the readings of a cure on the whole formula, as far as there is time.

        The first reading of a cure with `is_early` is always checked. A reading whose state is known already is, too,
        because that takes no time: what is known of it should not be lost.
        """
        confirmed: list[tuple[Candidate, int | None]] = []
        unchecked: list[Candidate] = []
        for i, c in enumerate(cure):
            is_first = i == 0 and is_early
            in_time = (i < _MOST_CHECKED_READINGS or not confirmed) and not self.deadline.passed
            if not (is_first or in_time or self.states.is_known(c.edits)):
                unchecked.append(c)
                continue
            if not self.is_general(c):
                continue
            after = self.states.after(c.edits)
            wrong = None
            if after is not None:
                wrong = after.wrong
            confirmed.append((c, wrong))
        return _CheckedCure(confirmed, unchecked)

    def together(self, results: list[GroupResult]) -> tuple[list[GroupResult], list[RowKey]]:
        """Return (results of which the first repairs of all groups hold together, rows that are left without a repair).

        Repairs of several groups may hold together only for the present values of parameters, or one may undo another.
        Then another repair of one group is put first; if none holds, the repair with the most unusual edit is left out:
        its readings are marked `by_chance`, and their edits are added to `Trials.rejected`, so that a further search
        for these rows finds others.
        """
        if len(results) < 2 or self._hold_together(results):
            return results, []
        for n, result in enumerate(results):
            for i, cure in enumerate(result.cures):
                if i == 0:  # with the first cures, the repairs do not hold together
                    continue
                if self.deadline.passed:
                    break
                other_cures = result.cures[:i] + result.cures[i + 1 :]
                changed = list(results)
                changed[n] = replace(result, cures=[cure, *other_cures])
                if self._hold_together(changed):
                    return changed, []
        unusual = max(results, key=lambda result: result.cures[0][0].rank)
        after = self.states.after(_first_edits(results))
        if after is not None and after.chance_condition:
            self._report(unusual.cures[0][0], after.chance_condition)
        for candidate in unusual.cures[0]:
            candidate.by_chance = True
            self.trials.rejected.add(frozenset(candidate.edits))
        without_unusual = list(results)
        without_unusual[results.index(unusual)] = replace(unusual, cures=[])
        return without_unusual, list(unusual.rows)

    def _hold_together(self, results: Sequence[GroupResult]) -> bool:
        """Return whether all rows agree after the first repairs of all groups, and not only by chance.

        That is also so if it is not known.
        """
        change = _first_edits(results)
        if _overlap(change):
            return False
        after = self.states.after(change)
        if after is None:
            return True
        rows: set[RowKey] = set()
        for result in results:
            rows.update(result.rows)
        return not (after.chance_condition or rows & after.failing)


def _first_edits(results: Sequence[GroupResult]) -> list[Edit]:
    """Return the edits of the first reading of the first repair of each group."""
    first_edits: list[Edit] = []
    for result in results:
        first_edits += result.cures[0][0].edits
    return first_edits


def _overlap(change: Sequence[Edit]) -> bool:
    """Return whether two different edits replace the same text, so that one cannot be made after the other."""
    ordered = sorted(dict.fromkeys(change), key=lambda edit: (str(edit.path), edit.start, edit.end))
    touching = False
    for edit, following in pairwise(ordered):
        touching |= edit.path == following.path and following.start < edit.end
    return touching
