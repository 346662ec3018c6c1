"""Try pairs of edits at two positions for one row: first those whose effects add up to the residual of the row."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import chain

import numpy as np

from twin.core.spatial import Array
from twin.validation.explain.candidate import TOKENS, Candidate
from twin.validation.explain.deadline import Deadline
from twin.validation.explain.equation_steps import RowKey, Step
from twin.validation.explain.function_source import ByteRange, Edit
from twin.validation.explain.replacement_pairs import ReplacementPairs
from twin.validation.explain.trials import Trials

_SHARED_PART = 0.2
"""Maximum part of the remaining time for the pairs with an edit of a repaired group."""

_NEAR = 20.0
"""Difference, in units of the tolerance, up to which two effects add up to a residual."""

_MOST_NEAR = 50
"""Maximum number of second edits whose effects are as near as this to what a first one leaves."""


class PositionPairs:
    """Search for pairs of edits that repair one row, by their positions in the text."""

    def __init__(self, trials: Trials) -> None:
        """Set up the search; `trials` evaluates pairs."""
        self.trials = trials

    def found(
        self, row: RowKey, singles: list[Candidate], shared: list[Candidate], deadline: Deadline
    ) -> tuple[list[Candidate], bool]:
        """Return (pairs of edits with which a row agrees or nearly agrees, whether all pairs were tried).

        First, pairs of edits of any kind are tried if the effects of both edits add up to the residual, then those
        with an edit of `shared`, which repairs other rows; then all pairs of one-token edits are tried.
        """
        trials = self.trials
        candidates: list[Candidate] = []
        tried: set[frozenset[int]] = set()
        likely_pairs = chain(self._additive(row, singles, deadline), self._with_shared(row, singles, shared, deadline))
        for a, b in likely_pairs:
            pair = frozenset((id(a), id(b)))
            if pair in tried or not _fit(a, b):
                continue
            tried.add(pair)
            candidate = trials.attempt(a.step, [a.edits[0], b.edits[0]])
            if candidate is not None:
                candidates.append(candidate)
        for candidate in candidates:
            if candidate.serves and candidate.over([row], trials.base) <= 1:
                return candidates, True
        complete = True
        for step, edits in self._moving(row, singles):
            search = ReplacementPairs(trials.judge, trials.shaken, step, row, edits, deadline, self._undefined(step))
            for first, second in search.found():
                candidate = trials.attempt(step, [first, second])
                if candidate is not None:
                    candidates.append(candidate)
            trials.tried += search.evaluated
            complete &= search.complete
        return candidates, complete

    def _additive(
        self, row: RowKey, singles: list[Candidate], deadline: Deadline
    ) -> Iterator[tuple[Candidate, Candidate]]:
        """Yield pairs of edits whose effects on a row add up to its residual, in one direction drawn at random."""
        raw = self.trials.raw[row]
        if not np.isfinite(raw).all():
            return
        # A random direction: effects that add up to the residual in all entries add up in it.
        weights = np.random.default_rng(3).standard_normal(raw.size)
        weights /= np.linalg.norm(weights)
        candidates: list[Candidate] = []
        effects: list[float] = []
        for c in singles:
            after = c.changed.get(row)
            if after is not None and after.shape == raw.shape and np.isfinite(after).all():
                candidates.append(c)
                effects.append(float(weights @ (after - raw).ravel()))
        order = np.argsort(effects)
        ordered = np.array(effects)[order]
        target = -float(weights @ raw.ravel())
        for first, effect in zip(candidates, effects, strict=True):
            missing = target - effect
            start, end = np.searchsorted(ordered, [missing - _NEAR, missing + _NEAR])
            for j in order[start : min(end, start + _MOST_NEAR)]:
                if deadline.passed:
                    return
                yield first, candidates[j]

    def _with_shared(
        self, row: RowKey, singles: list[Candidate], shared: list[Candidate], deadline: Deadline
    ) -> Iterator[tuple[Candidate, Candidate]]:
        """Yield pairs with an edit that repairs other rows: it may also be one of two edits that repair this row."""
        end = deadline.within(_SHARED_PART * deadline.left)
        for first in shared:
            for second in singles:
                if end.passed:
                    return
                if row in second.scores:
                    yield first, second

    def _undefined(self, step: Step) -> list[ByteRange]:
        """Return where names without a value stand in the statements of an equation on which failing rows depend."""
        ranges: list[ByteRange] = []
        for other, sites in self.trials.sites():
            if other is step:
                for site in sites:
                    ranges += site.undefined
        return ranges

    def _moving(self, row: RowKey, singles: list[Candidate]) -> list[tuple[Step, list[Edit]]]:
        """Return the one-token edits that change a row, grouped by the equation in which they are tried."""
        step_of_row = self.trials.judge.step(row[0])
        called = {(helper.source.path, helper.source.name) for helper in self.trials.judge.helpers(step_of_row)}
        raw = self.trials.raw[row]
        has_values = bool(np.isfinite(raw).all())
        moving: list[tuple[Step, Edit]] = []
        for c in singles:
            # Without a value, the effect of a single edit may be invisible.
            if not has_values or _moves(c, row, raw):
                moving.append((c.step, c.edits[0]))
        if step_of_row.stuck:
            moving += self.trials.senseless
        edits_of_step: dict[str, tuple[Step, list[Edit]]] = {}
        for step, edit in moving:
            if edit.kind not in TOKENS or edit.kind == "left side":
                continue
            tried_in = step_of_row if (edit.path, edit.function) in called else step
            _, edits = edits_of_step.setdefault(tried_in.equation.name, (tried_in, []))
            edits.append(edit)
        return sorted(edits_of_step.values(), key=lambda group: group[0] is not step_of_row)


def _fit(a: Candidate, b: Candidate) -> bool:
    """Return whether two single edits are in one function and do not touch each other."""
    one = a.edits[0]
    other = b.edits[0]
    if a.step is not b.step or one.function != other.function or one.path != other.path:
        return False
    return one.end < other.start or other.end < one.start


def _moves(c: Candidate, row: RowKey, raw: Array) -> bool:
    after = c.changed.get(row)
    return after is not None and not np.array_equal(after, raw)
