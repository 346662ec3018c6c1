"""Try pairs of edits at two positions for one row: first those whose effects add up to the residual of the row."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import chain
from pathlib import Path

import numpy as np

from twin.core.spatial import Array
from twin.validation.explain.candidate import TOKEN_KINDS, Candidate
from twin.validation.explain.deadline import Deadline
from twin.validation.explain.equation_steps import RowKey, Step
from twin.validation.explain.function_source import ByteRange, Edit
from twin.validation.explain.replacement_pairs import ReplacementPairs
from twin.validation.explain.trials import Trials

_SHARED_PART = 0.2
"""Maximum part of the remaining time for the pairs with an edit of a repaired group."""

_NEAR_DIFFERENCE = 20.0
"""Difference, in units of the tolerance, up to which two effects add up to a residual."""

_SEED = 3
"""Seed of the direction in which effects are added: every run tries the same pairs."""

_MOST_NEAR_EDITS = 50
"""Maximum number of second edits for a first one: those whose effects are nearest to the residual that it leaves."""


class PositionPairs:
    """Search for pairs of edits that repair one row, by their positions in the text.

    A position is a range of bytes in the file of the equations: a token or a longer expression. Residuals are in units
    of the tolerance of their row.
    """

    def __init__(self, trials: Trials) -> None:
        """Set up the search; `trials` evaluates pairs."""
        self.trials = trials

    def pairs_for(
        self, row: RowKey, singles: list[Candidate], shared: list[Candidate], deadline: Deadline
    ) -> tuple[list[Candidate], bool]:
        """Return (pairs of edits with which a row agrees or nearly agrees, whether the search ended before `deadline`).

        Likely pairs are tried first. If none of them may be proposed as a repair, all pairs of one-token edits are.

        Args:
            row: the row.
            singles: all single edits that were evaluated.
            shared: those of them that repair other rows.
            deadline: time limit.
        """
        candidates = self._likely(row, singles, shared, deadline)
        for candidate in candidates:
            if candidate.may_be_proposed and candidate.worst_over([row], self.trials.worst_before) <= 1:
                return candidates, True
        of_tokens, complete = self._of_tokens(row, singles, deadline)
        return candidates + of_tokens, complete

    def _likely(
        self, row: RowKey, singles: list[Candidate], shared: list[Candidate], deadline: Deadline
    ) -> list[Candidate]:
        """Try pairs of edits of any kind whose effects add up to the residual, then those with an edit of `shared`."""
        candidates: list[Candidate] = []
        seen_pairs: set[frozenset[int]] = set()
        likely_pairs = chain(self._additive(row, singles, deadline), self._with_shared(row, singles, shared, deadline))
        for a, b in likely_pairs:
            pair = frozenset((id(a), id(b)))
            if pair in seen_pairs or not _can_be_combined(a, b):
                continue
            seen_pairs.add(pair)
            candidate = self.trials.attempt(a.step, [a.edits[0], b.edits[0]])
            if candidate is not None:
                candidates.append(candidate)
        return candidates

    def _of_tokens(self, row: RowKey, singles: list[Candidate], deadline: Deadline) -> tuple[list[Candidate], bool]:
        """Try the pairs of one-token edits of each equation; return (candidates, whether all pairs were tried)."""
        trials = self.trials
        candidates: list[Candidate] = []
        complete = True
        for step, edits in self._moving(row, singles):
            search = ReplacementPairs(
                trials.judge, trials.perturbed_judge, step, row, edits, deadline, self._undefined(step)
            )
            for first, second in search.likely_pairs():
                candidate = trials.attempt(step, [first, second])
                if candidate is not None:
                    candidates.append(candidate)
            trials.trial_count += search.evaluated
            complete &= search.complete
        return candidates, complete

    def _additive(
        self, row: RowKey, singles: list[Candidate], deadline: Deadline
    ) -> Iterator[tuple[Candidate, Candidate]]:
        """Yield pairs of edits whose effects on a row add up to its residual, in one direction drawn at random."""
        before = self.trials.residuals_before[row]
        if not np.isfinite(before).all():
            return
        # Effects that add up to the residual in all entries add up in any direction; few others do in a random one.
        weights = np.random.default_rng(_SEED).standard_normal(before.size)
        weights /= np.linalg.norm(weights)
        candidates: list[Candidate] = []
        effects: list[float] = []
        for candidate in singles:
            after = candidate.changed_residuals.get(row)
            if after is not None and after.shape == before.shape and np.isfinite(after).all():
                candidates.append(candidate)
                effects.append(float(weights @ (after - before).ravel()))
        # Sorted by effect, the second edits for a first one are found by bisection.
        order = np.argsort(effects)
        sorted_effects = np.array(effects)[order]
        target = -float(weights @ before.ravel())
        for first, effect in zip(candidates, effects, strict=True):
            missing = target - effect
            start, end = np.searchsorted(sorted_effects, [missing - _NEAR_DIFFERENCE, missing + _NEAR_DIFFERENCE])
            differences = np.abs(sorted_effects[start:end] - missing)
            nearest = np.argsort(differences, kind="stable")[:_MOST_NEAR_EDITS]
            for place in np.sort(nearest):
                if deadline.passed:
                    return
                yield first, candidates[order[start + place]]

    def _with_shared(
        self, row: RowKey, singles: list[Candidate], shared: list[Candidate], deadline: Deadline
    ) -> Iterator[tuple[Candidate, Candidate]]:
        """Yield pairs with an edit that repairs other rows: it may also be one of two edits that repair this row."""
        end = deadline.within(_SHARED_PART * deadline.left)
        for first in shared:
            for second in singles:
                if end.passed:
                    return
                if row in second.worst_residuals:
                    yield first, second

    def _undefined(self, step: Step) -> list[ByteRange]:
        """Return where names without a value stand in the statements of an equation on which failing rows depend."""
        ranges: list[ByteRange] = []
        for step_of_sites, sites in self.trials.sites():
            if step_of_sites is step:
                for site in sites:
                    ranges += site.undefined
        return ranges

    def _moving(self, row: RowKey, singles: list[Candidate]) -> list[tuple[Step, list[Edit]]]:
        """Return the one-token edits that change a row, grouped by the equation in which they are tried."""
        step_of_row = self.trials.judge.step(row[0])
        called: set[tuple[Path, str]] = set()
        for helper in self.trials.judge.helpers(step_of_row):
            called.add((helper.source.path, helper.source.name))
        before = self.trials.residuals_before[row]
        has_values = bool(np.isfinite(before).all())
        moving: list[tuple[Step, Edit]] = []
        for candidate in singles:
            # Without a value, the effect of a single edit may be invisible.
            if not has_values or _moves(candidate, row, before):
                moving.append((candidate.step, candidate.edits[0]))
        if step_of_row.stuck:  # an edit without a value may have one beside the edit of the unknown name
            moving += self.trials.edits_without_value
        edits_of_step: dict[str, tuple[Step, list[Edit]]] = {}
        for step, edit in moving:
            if edit.kind not in TOKEN_KINDS or edit.kind == "left side":
                continue
            step_to_try = step
            if (edit.path, edit.function) in called:  # the row itself shows the effect, also if another equation calls
                step_to_try = step_of_row
            _, edits = edits_of_step.setdefault(step_to_try.equation.name, (step_to_try, []))
            edits.append(edit)
        return sorted(edits_of_step.values(), key=lambda group: group[0] is not step_of_row)


def _can_be_combined(a: Candidate, b: Candidate) -> bool:
    """Return whether two single edits are in one function and do not touch each other."""
    first = a.edits[0]
    second = b.edits[0]
    if a.step is not b.step or first.function != second.function or first.path != second.path:
        return False
    return first.end < second.start or second.end < first.start


def _moves(candidate: Candidate, row: RowKey, before: Array) -> bool:
    """Return whether a candidate changes the residuals `before` (k, entries) of a row."""
    after = candidate.changed_residuals.get(row)
    return after is not None and not np.array_equal(after, before)
