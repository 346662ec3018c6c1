"""Find two edits together, from the values that scalar expressions must have so that rows agree.

The largest scalar expressions of the statements are the unknowns. If the values of one of them, or of two of them, can
make the rows agree at every pose, Gauss-Newton finds these values. Both edits are then looked for in the text of this
one expression, or one edit in each of the two. A row with several entries, such as a pose, rejects nearly all wrong
pairs of expressions without a trial of any edit. For edits outside scalar expressions, and for rows with one entry,
one edit is tried first, and the other follows from the values of one expression.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import chain, combinations, islice, product
from pathlib import Path
from typing import Any

import numpy as np

from twin.core.spatial import Array
from twin.validation.explain.candidate import residuals
from twin.validation.explain.deadline import Deadline
from twin.validation.explain.expression import Expression, Site
from twin.validation.explain.judge import Judge, worst
from twin.validation.explain.rows import Key, Step
from twin.validation.explain.shifts import DIFFERENCE, FEWEST, Shift, shifted, solution
from twin.validation.explain.source import Edit

_NAMES = ("_required_one_", "_required_two_")
"""Names of the functions in the edited text that change the values of expressions."""

_FULL_TURNS = (0.5, -0.5, 1.0)
"""Shifts, in units of pi, of an angle whose constant is wrong; Gauss-Newton does not reach them from zero."""

_MULTIPLES = (0.0, -2.0, -1.0, 1.0, -0.5, -0.75, 3.0)
"""Shifts, as multiples of an expression's value: unchanged, other sign, zero, twice, half, a fourth, four times."""

_FEW = 4
"""Number of poses at which such shifts are tried."""

_NEAR = 0.1
"""Largest part of the residuals that may be left after such shifts, for Gauss-Newton to start there."""

_MOST_TEXTS = 6
"""Maximum number of edits of each of two expressions that are combined."""


@dataclass(frozen=True)
class _Cut:
    """A largest scalar expression of a statement.

    `slopes`: derivatives (k, entries) of the residuals of each row that it moves.
    """

    site: Site
    node: ast.expr
    slopes: dict[Key, Array]

    @property
    def function(self) -> tuple[str, str]:
        """File and function of the expression."""
        return str(self.site.source.path), self.site.source.name

    @property
    def place(self) -> tuple[Path, int, int]:
        """File, first byte and end of the expression."""
        return (self.site.source.path, *self.site.source.span(self.node))


class Double:
    """Search for two edits in the statements of one equation, or of one function that it calls."""

    def __init__(
        self, judge: Judge, step: Step, sites: Sequence[Site], rows: Sequence[Key], deadline: Deadline
    ) -> None:
        """Set up the search for the wrong rows `rows`; `sites` are the statements on which they depend."""
        self.judge = judge
        self.step = step
        self.sites = sites
        self.rows = rows
        self.deadline = deadline
        """Limit of the search; it may be set for each of the methods."""
        self.unsure: list[tuple[Path, int, int]] = []
        """Places of expressions whose values differ from call to call, so that they are no unknowns."""
        self._k = judge.truth.k
        self._base = {p.key: r for p, r in judge.residuals.items()}
        # Rows that agree must still agree, so they also determine the values.
        self._binding = [k for k, r in self._base.items() if k in rows or worst(r) <= 1]

    def in_one(self) -> Iterator[tuple[Edit, Edit]]:
        """Yield pairs of edits that both are in one expression."""
        for cut in self.cuts:
            if self.deadline.passed:
                return
            shifts = self._solved((), (cut,))
            if shifts is None:
                continue
            (shift,) = shifts
            expression = Expression(cut.site, cut.node, shift, self.deadline)
            yield from expression.two((shift.value + shift.shift)[:, 0])

    def in_two(self) -> Iterator[tuple[Edit, Edit]]:
        """Yield pairs of edits in two expressions, the expressions first that explain most of the residuals."""
        pairs = []
        for a, b in combinations(self.cuts, 2):
            if self.deadline.passed:
                return
            if a.function == b.function:
                pairs.append((self._unexplained(a, b), len(pairs), a, b))
        solved = []
        ordered = [pair[2:] for pair in sorted(pairs, key=lambda pair: pair[:2])]
        trials = [(a, b, None) for a, b in ordered]
        for a, b, start in chain(trials, self._guesses(ordered)):
            if self.deadline.passed:
                return
            shifts = self._solved((), (a, b), start)
            if shifts is None:
                continue
            known = [list(self._texts(a, shifts[0])), list(self._texts(b, shifts[1]))]
            solved.append((a, b, shifts, known))
            yield from product(known[0], known[1])
        # Short formulas take longer than edits that are tried anyway, so that they come last.
        for a, b, shifts, known in solved:
            if all(known):
                continue
            for i, cut in enumerate((a, b)):
                if all(known[:i]) and not known[i]:
                    known[i] = list(self._composed(cut, shifts[i]))
            yield from product(known[0], known[1])

    def beside(self, firsts: Sequence[Edit], composed: bool = False) -> Iterator[tuple[Edit, Edit]]:
        """Yield pairs of one of the edits `firsts` and an edit of an expression that it does not touch.

        `composed`: whether the second edit may be a short formula.
        """
        for first in firsts:
            for cut in self.cuts:
                if self.deadline.passed:
                    return
                start, end = cut.site.source.span(cut.node)
                place = (str(first.path), first.function)
                if place != cut.function or not (first.end < start or end < first.start):
                    continue
                shifts = self._solved((first,), (cut,))
                if shifts is None:
                    continue
                seconds = list(self._texts(cut, shifts[0]))
                if composed and not seconds:
                    seconds = list(self._composed(cut, shifts[0]))
                for second in seconds:
                    yield first, second

    def outside(self, edit: Edit) -> bool:
        """Return whether an edit is in no scalar expression, so that only `beside` finds a pair with it."""
        for cut in self.cuts:
            start, end = cut.site.source.span(cut.node)
            if start <= edit.start and edit.end <= end and edit.path == cut.site.source.path:
                return False
        return True

    def refuted(self) -> list[tuple[Path, int, int]]:
        """Return the places of expressions with no value of which a wrong row agrees.

        No single edit inside them can repair a row. Only rows with several entries can show this.
        """
        out = []
        for cut in self.cuts:
            rows = [k for k in self.rows if k in cut.slopes]
            if not any(self._can_repair(cut, k) for k in rows):
                out.append(cut.place)
        return out

    def _can_repair(self, cut: _Cut, row: Key) -> bool:
        r = self._base[row]
        if r.shape[1] == 1 or np.isfinite(r).all(axis=1).sum() < FEWEST:
            return True
        binding = self._binding
        self._binding = [row]
        try:
            for turn in (0.0, *_FULL_TURNS):
                start = np.full((self._k, 1), turn * np.pi)
                if self._solved((), (cut,), start) is not None:
                    return True
            return self.deadline.passed
        finally:
            self._binding = binding

    # -- expressions ------------------------------------------------------------------------------------------------

    @cached_property
    def cuts(self) -> list[_Cut]:
        """The largest scalar expressions of the statements whose values move the rows."""
        out = []
        for site in self.sites:
            todo: list[ast.AST] = [site.statement.node]
            while todo and not self.deadline.passed:
                node = todo.pop(0)
                if _may_be_scalar(node, site.parents):
                    assert isinstance(node, ast.expr)
                    slopes = self._slopes(site, node)
                    if slopes is not None:
                        moving = any(k in slopes for k in self.rows)
                        if moving:
                            out.append(_Cut(site, node, slopes))
                        continue
                if not isinstance(node, ast.Subscript):  # the names in an index are no scalars of the row
                    todo += ast.iter_child_nodes(node)
        return out

    def _slopes(self, site: Site, node: ast.expr) -> dict[Key, Array] | None:
        """Return the derivatives of the rows that an expression moves; None if it is not one scalar."""
        shift = Shift(self._k)
        change = [shifted(site.source, site.statement, node, _NAMES[0])]
        base = self._residuals(change, [shift])
        if base is None:
            return None
        if shift.mixed:
            self.unsure.append((site.source.path, *site.source.span(node)))
            return None
        shift.shift = np.full_like(shift.shift, DIFFERENCE)
        moved = self._residuals(change, [shift])
        if moved is None:
            return None
        out = {}
        for k in self._binding:
            if k in moved and k in base and not np.array_equal(base[k], moved[k], equal_nan=True):
                out[k] = (moved[k] - base[k]) / DIFFERENCE
        return out

    def _unexplained(self, a: _Cut, b: _Cut) -> float:
        """Return the part of the residuals that small changes of two expressions cannot remove, on average."""
        keys = [k for k in self.rows if k in a.slopes or k in b.slopes]
        zeros = {k: np.zeros_like(self._base[k]) for k in keys}
        r = np.hstack([self._base[k] for k in keys])
        J = np.stack([np.hstack([c.slopes.get(k, zeros[k]) for k in keys]) for c in (a, b)], axis=2)
        good = np.isfinite(J).all(axis=(1, 2)) & np.isfinite(r).all(axis=1)
        good &= (r != 0).any(axis=1)  # a pose at which the rows agree says nothing
        if not good.any():
            return 1.0
        r, J = r[good], J[good]
        rest = r - (J @ (np.linalg.pinv(J) @ r[:, :, None]))[:, :, 0]
        return float(np.mean(np.sum(rest**2, axis=1) / np.sum(r**2, axis=1)))

    # -- values -------------------------------------------------------------------------------------------------------

    def _solved(self, fixed: Sequence[Edit], cuts: Sequence[_Cut], start: Array | None = None) -> list[Shift] | None:
        """Return shifts of expressions with which, after the edits `fixed`, the rows agree; None without a solution.

        `start` are the first shifts (k, expressions); None: zero.
        """
        shifts = [Shift(self._k) for _ in cuts]
        change = list(fixed)
        for cut, name in zip(cuts, _NAMES, strict=False):
            change.append(shifted(cut.site.source, cut.site.statement, cut.node, name))
        moved = set().union(*(cut.slopes for cut in cuts))
        rows = [k for k in self._binding if k in moved]

        def residual(values: Array) -> Array | None:
            for i, shift in enumerate(shifts):
                shift.shift = values[:, i : i + 1]
            found = self._residuals(change, shifts)
            if found is None or any(k not in found for k in rows) or any(shift.mixed for shift in shifts):
                return None
            return np.hstack([found[k] for k in rows])

        def scale() -> Array:
            return np.hstack([shift.value for shift in shifts])

        first = np.zeros((self._k, len(cuts))) if start is None else start
        solved = solution(residual, first, scale, self.deadline)
        if solved is None:
            return None
        for shift in shifts:
            shift.known = solved[1]
        return shifts

    def _guesses(self, pairs: Sequence[tuple[_Cut, _Cut]]) -> Iterator[tuple[_Cut, _Cut, Array]]:
        """Yield pairs of expressions with shifts (k, 2) near which the rows may agree.

        All combinations of some shifts are tried at a few poses, by one evaluation.
        """
        count = (len(_MULTIPLES) + len(_FULL_TURNS)) ** 2
        places = np.linspace(0, self._k - 1, _FEW).astype(int)
        coarse: Double | None = None
        for a, b in pairs:
            if self.deadline.passed:
                return
            if coarse is None:
                judge = self.judge.on(self.judge.truth.repeated([int(i) for i in places], count))
                step = judge.step(self.step.equation.name)
                coarse = Double(judge, step, self.sites, self.rows, self.deadline)
            guess = coarse._guess(a, b)
            if guess is not None:
                values = []
                for cut, i in zip((a, b), guess, strict=True):
                    values.append(_shifts(self._value(cut))[i])
                yield a, b, np.stack(values, axis=1)

    def _guess(self, a: _Cut, b: _Cut) -> tuple[int, int] | None:
        """Return the indices of the two shifts of `_shifts` after which least of the residuals is left, if little."""
        choices = len(_MULTIPLES) + len(_FULL_TURNS)
        shifts = [Shift(self._k), Shift(self._k)]
        change = []
        for cut, name in zip((a, b), _NAMES, strict=True):
            change.append(shifted(cut.site.source, cut.site.statement, cut.node, name))
        base = self._residuals(change, shifts)
        if base is None:
            return None
        for axis, shift in enumerate(shifts):
            every = _shifts(shift.value[:_FEW, 0])  # (choices, poses)
            shape = (choices, 1, _FEW) if axis == 0 else (1, choices, _FEW)
            mixed = np.broadcast_to(every.reshape(shape), (choices, choices, _FEW))
            shift.shift = mixed.reshape(-1, 1)
        found = self._residuals(change, shifts)
        rows = [k for k in self._binding if k in base and (k in a.slopes or k in b.slopes)]
        if found is None or any(k not in found for k in rows):
            return None
        before = np.hstack([base[k] for k in rows])[:_FEW]
        after = np.hstack([found[k] for k in rows])
        left = np.sum(after**2, axis=1).reshape(choices, choices, _FEW).sum(axis=2)
        left = np.where(np.isfinite(left), left, np.inf)
        best = int(np.argmin(left))
        least = float(left.flat[best])
        if best == 0 or not least <= _NEAR * float(np.sum(before**2)):
            return None
        return best // choices, best % choices

    def _value(self, cut: _Cut) -> Array:
        """Return the values (k,) of an expression."""
        shift = Shift(self._k)
        self._residuals([shifted(cut.site.source, cut.site.statement, cut.node, _NAMES[0])], [shift])
        return shift.value[:, 0]

    def _texts(self, cut: _Cut, shift: Shift) -> Iterator[Edit]:
        """Yield single edits of an expression that shift its values."""
        expression = Expression(cut.site, cut.node, shift, self.deadline)
        return islice(expression.one((shift.value + shift.shift)[:, 0]), _MOST_TEXTS)

    def _composed(self, cut: _Cut, shift: Shift) -> Iterator[Edit]:
        """Yield edits of an expression that shift its values by a term or factor."""
        expression = Expression(cut.site, cut.node, shift, self.deadline)
        return islice(expression.composed((shift.value + shift.shift)[:, 0]), _MOST_TEXTS)

    def _residuals(self, change: Sequence[Edit], shifts: Sequence[Shift]) -> dict[Key, Array] | None:
        """Return the residuals of the rows after edits with shifted expressions."""
        extra: dict[str, Any] = dict(zip(_NAMES, shifts, strict=False))
        for shift in shifts:
            shift.begin()
        foreign = change[0].function != self.step.source.name
        called = [h.function.__globals__ for h in self.judge.helpers(self.step)] if foreign else []
        for scope in called:
            scope.update(extra)
        try:
            return residuals(self.judge, self.step.equation.name, change, extra)
        finally:
            for scope in called:
                for name in extra:
                    scope.pop(name, None)


def _shifts(values: Array) -> Array:
    """Return the shifts (choices, k) of an expression with `values` (k,) that are tried first."""
    multiples = [m * values for m in _MULTIPLES]
    turns = [np.full_like(values, turn * np.pi) for turn in _FULL_TURNS]
    return np.array(multiples + turns)


def _may_be_scalar(node: ast.AST, parents: dict[ast.AST, ast.AST]) -> bool:
    """Return whether a syntax node may be a scalar expression that an edit can change."""
    kinds = (ast.Name, ast.Call, ast.Subscript, ast.BinOp, ast.UnaryOp, ast.Constant)
    if not isinstance(node, kinds) or isinstance(getattr(node, "ctx", None), ast.Store):
        return False
    parent = parents.get(node)
    if isinstance(parent, ast.Call) and parent.func is node:
        return False
    if isinstance(node, ast.Constant) and not (type(node.value) in (int, float) and isinstance(parent, ast.Call)):
        return False
    return not isinstance(parent, ast.Attribute | ast.keyword | ast.Starred)
