"""Find the values of expressions with which rows agree, for many choices of expressions at once.

One evaluation of an equation takes about as long at a thousand poses as at ten. Each choice of expressions therefore
has its own copy of some poses; only there, its expressions have other values. Gauss-Newton runs for all choices
together, and choices that cannot make the rows agree are left out after each step.
"""

from __future__ import annotations

import ast
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from twin.core.spatial import Array
from twin.validation.explain.candidate import residuals_with
from twin.validation.explain.deadline import Deadline
from twin.validation.explain.equation_steps import RowKey
from twin.validation.explain.expression import Site
from twin.validation.explain.function_source import Edit
from twin.validation.explain.rebuilt_functions import unguarded
from twin.validation.explain.row_deviations import Judge
from twin.validation.explain.shifts import DIFFERENCE, FEWEST, SINGULAR, STARTS, STEPS, TIGHT, Shift, cost, shifted

_SIZES = (1, 4, 16, 64)
"""Numbers of choices that one evaluation may have."""

_HALVINGS = 4
"""Maximum number of times that a step is halved."""


@dataclass(eq=False)
class Cut:
    """A largest scalar expression of a statement.

    `slopes`: derivatives (k, entries) of the residuals of each row that it moves. `value`: its values
    (k,). `several`: whether its function is
    called several times, so that an edit may change the value by another amount in each call.
    """

    site: Site
    node: ast.expr
    slopes: dict[RowKey, Array]
    value: Array = field(default_factory=lambda: np.zeros(0))
    several: bool = False

    @cached_property
    def function(self) -> tuple[Path, str]:
        """File and function of the expression."""
        return self.site.source.path, self.site.source.name

    @cached_property
    def place(self) -> tuple[Path, int, int]:
        """File, first byte and end of the expression."""
        return (self.site.source.path, *self.site.source.span(self.node))


@dataclass(frozen=True, eq=False)
class Choice:
    """Expressions whose values are unknown, the rows that must agree, and first shifts (k, expressions); None: zero."""

    cuts: tuple[Cut, ...]
    rows: tuple[RowKey, ...]
    start: Array | None = None


class Batch:
    """Evaluates the equations at copies of some poses, one copy for each choice of expressions."""

    def __init__(self, judge: Judge, poses: Sequence[int], fewest: int = FEWEST) -> None:
        """Set up evaluations at some poses of `judge`; rows must have values at the `fewest` poses."""
        self.poses = list(poses)
        self.fewest = fewest
        self._judge = judge
        self._copies: dict[int, Judge] = {}

    def solved(
        self, equation: str, fixed: Sequence[Edit], choices: Sequence[Choice], deadline: Deadline
    ) -> list[tuple[int, Array]]:
        """Return (index of a choice, shifts (poses, expressions)) of the choices with which their rows agree.

        Args:
            equation: the equation that is evaluated; the expressions are in it, or in a function that it calls.
            fixed: edits that are made in any case.
            choices: the choices of expressions.
            deadline: time limit; choices that are not decided at its end are left out.
        """
        solutions: list[tuple[int, Array]] = []
        for part in _parts([choice.cuts[0].function for choice in choices]):
            if deadline.passed:
                break
            with unguarded():
                newton = _Newton(self, equation, fixed, [choices[i] for i in part])
                found_by_newton = newton.run(deadline)
            for n, values in found_by_newton:
                solutions.append((part[n], values))
        return sorted(solutions, key=lambda solution: solution[0])

    def slopes(self, equation: str, cuts: Sequence[Cut]) -> list[dict[RowKey, Array]]:
        """Return, of each expression, the derivatives (k, entries) of the residuals of the rows that it moves."""
        rows = tuple(self.residuals)
        slopes: list[dict[RowKey, Array]] = [{} for _ in cuts]
        for part in _parts([cut.function for cut in cuts]):
            choices = [Choice((cuts[i],), rows) for i in part]
            with unguarded():
                newton = _Newton(self, equation, (), choices)
                found = newton.slopes()
            for n, i in enumerate(part):
                slopes[i] = found[n]
        return slopes

    @cached_property
    def residuals(self) -> dict[RowKey, Array]:
        """Residuals (k, entries) of the rows at the poses, without edits."""
        return {p.key: r for p, r in self.copies(1).residuals.items()}

    def copies(self, count: int) -> Judge:
        """Return a judge at the poses, repeated for at least `count` choices."""
        size = _SIZES[-1]
        for smaller in reversed(_SIZES):
            if smaller >= count:
                size = smaller
        if size not in self._copies:
            with unguarded():
                self._copies[size] = self._judge.on(self._judge.reference.repeated(self.poses, size))
        return self._copies[size]


def _parts(functions: Sequence[tuple[Path, str]]) -> list[list[int]]:
    """Return the indices of choices in parts that one evaluation can have: of one function, and not too many."""
    parts_of_choices: list[list[int]] = []
    latest: dict[tuple[Path, str], list[int]] = {}
    for i, function in enumerate(functions):
        part = latest.get(function)
        if part is None or len(part) == _SIZES[-1]:
            part = []
            latest[function] = part
            parts_of_choices.append(part)
        part.append(i)
    return parts_of_choices


class _Newton:
    """Gauss-Newton for several choices of expressions; values and residuals are (choices, poses, ...)."""

    def __init__(self, batch: Batch, equation: str, fixed: Sequence[Edit], choices: Sequence[Choice]) -> None:
        self.batch = batch
        self.equation = equation
        self.choices = list(choices)
        self.left = list(range(len(choices)))
        """Indices of the choices that are not decided yet."""
        self.free = bool(batch.copies(1).step(equation).free)
        cuts: dict[Cut, int] = {}
        for choice in choices:
            for cut in choice.cuts:
                cuts.setdefault(cut, len(cuts))
        self.names = cuts
        self.change = list(fixed)
        for cut, number in cuts.items():
            edit = shifted(cut.site.source, cut.site.statement, cut.node, f"_required_{number}_", scope=False)
            self.change.append(edit)
        self.expressions = max(len(choice.cuts) for choice in choices)
        self.rows: list[RowKey] = []
        for choice in choices:
            for row in choice.rows:
                if row not in self.rows:
                    self.rows.append(row)
        self.scale = np.zeros(0)
        """Values (choices, poses, unknowns) of the expressions before their shifts, at the latest evaluation."""

    def slopes(self) -> list[dict[RowKey, Array]]:
        """Return the derivatives of the rows that the one expression of each choice moves."""
        values = self._start()
        base = self._residuals(values)
        if base is not None:  # without a value, it would seem that an expression moves nothing
            values, base = self._with_values(values, base)
        values[:, :, 0] += DIFFERENCE
        moved = self._residuals(values)
        slopes: list[dict[RowKey, Array]] = []
        for n in range(len(self.choices)):
            found = {}
            if base is not None and moved is not None:
                at = 0
                for row in self.rows:
                    width = self.batch.residuals[row].shape[1]
                    before = base[n, :, at : at + width]
                    after = moved[n, :, at : at + width]
                    at += width
                    if not np.array_equal(before, after, equal_nan=True):
                        found[row] = (after - before) / DIFFERENCE
            slopes.append(found)
        return slopes

    def run(self, deadline: Deadline) -> list[tuple[int, Array]]:
        """Return (index, shifts) of the choices with a solution."""
        values = self._start()
        r = self._residuals(values)
        if r is None:
            return []
        values, r = self._with_values(values, r)
        known = np.asarray(np.isfinite(r).all(axis=2))
        enough = known.sum(axis=1) >= self.batch.fewest
        values, r, known = self._only(enough, values, r, known)
        solutions: list[tuple[int, Array]] = []
        for _ in range(STEPS + 1):
            if not self.left:
                break
            size = _largest(r, known)
            converged = size <= TIGHT
            for i in np.flatnonzero(converged):
                solutions.append((self.left[i], values[i][:, : len(self.choices[self.left[i]].cuts)]))
            values, r, known = self._only(~converged, values, r, known)
            if not self.left or deadline.passed:
                break
            values, r, known, moved = self._ahead(values, r, known)
            if not moved:
                break
        size = _largest(r, known)
        for n, i in enumerate(self.left):
            if size[n] <= 1:
                solutions.append((i, values[n][:, : len(self.choices[i].cuts)]))
        return sorted(solutions, key=lambda found: found[0])

    def _start(self) -> Array:
        poses = len(self.batch.poses)
        values = np.zeros((len(self.choices), poses, self.expressions + self.free))
        for i, choice in enumerate(self.choices):
            if choice.start is not None:
                values[i, :, : len(choice.cuts)] = choice.start
        if self.free:
            step = self.batch.copies(len(self.choices)).step(self.equation)
            (angle,) = step.free.values()
            values[:, :, -1] = angle[: len(self.choices) * poses].reshape(-1, poses)
        return values

    def _with_values(self, values: Array, r: Array) -> tuple[Array, Array]:
        """Return (values, residuals), where a row has no value with other first values."""
        if np.isfinite(r).all():
            return values, r
        lacks: NDArray[np.bool_] = np.logical_not(np.isfinite(r).all(axis=(1, 2)))
        for factor in STARTS:
            tried = values.copy()
            tried[:, :, : self.expressions] = factor * self.scale[:, :, : self.expressions]
            tried_residuals = self._residuals(tried)
            if tried_residuals is None:
                break
            better = (lacks[:, None] & (_costs(tried_residuals) < _costs(r)))[:, :, None]
            values = np.where(better, tried, values)
            r = np.where(better, tried_residuals, r)
        return values, r

    def _only(
        self, kept: NDArray[np.bool_], values: Array, r: Array, known: NDArray[np.bool_]
    ) -> tuple[Array, Array, NDArray[np.bool_]]:
        """Return the arrays of the choices `kept`; the others are decided."""
        self.left = [i for i, keep in zip(self.left, kept, strict=True) if keep]
        return values[kept], r[kept], known[kept]

    def _ahead(self, values: Array, r: Array, known: NDArray[np.bool_]) -> tuple[Array, Array, NDArray[np.bool_], bool]:
        """Return (values, residuals, poses with residuals, whether a step was made), of choices that may be solved.

        No step is made if the rows cannot be evaluated after it.
        """
        slopes = []
        for u in range(values.shape[2]):
            there = values.copy()
            there[:, :, u] += DIFFERENCE
            moved = self._residuals(there)
            if moved is None:
                return values, r, known, False
            slopes.append((moved - r) / DIFFERENCE)
        step, unique = _steps(np.stack(slopes, axis=3), r, self._counts(), known, self.free)
        step[~known] = 0.0
        values, r, known = self._only(unique, values, r, known)
        step = step[unique]
        if not self.left:
            return values, r, known, False
        new = self._residuals(values + step)
        if new is None:
            return values, r, known, False
        for _ in range(_HALVINGS):  # half the step where the residual grows
            worse = known & ~(_costs(new) <= _costs(r))
            if not worse.any():
                break
            step = np.where(worse[:, :, None], step / 2, step)
            new = self._residuals(values + step)
            if new is None:
                return values, r, known, False
        # Poses converge after different numbers of steps, so that the mean decides, not the largest residual.
        nearer = (_mean(new, known) <= 0.9 * _mean(r, known)) | (_largest(new, known) <= 1.0)
        return *self._only(nearer, values + step, new, known), True

    def _counts(self) -> NDArray[np.bool_]:
        """Return which unknowns (choices, unknowns) a choice has."""
        is_unknown = np.ones((len(self.left), self.expressions + self.free), bool)
        for n, i in enumerate(self.left):
            is_unknown[n, len(self.choices[i].cuts) : self.expressions] = False
        return is_unknown

    def _residuals(self, values: Array) -> Array | None:
        """Return the residuals (choices, poses, entries), zero for rows that a choice does not have; None: no value."""
        count, poses, _ = values.shape
        judge = self.batch.copies(count)
        k = judge.reference.k
        shifts = {}
        for number in self.names.values():
            shifts[number] = Shift(k)
        for n, i in enumerate(self.left):
            for u, cut in enumerate(self.choices[i].cuts):
                shifts[self.names[cut]].shift[n * poses : (n + 1) * poses, 0] = values[n, :, u]
        angle = None
        if self.free:
            angle = np.zeros(k)
            angle[: count * poses] = values[:, :, -1].ravel()
        extra: dict[str, Any] = {f"_required_{number}_": shift for number, shift in shifts.items()}
        by_row = residuals_with(judge, self.equation, self.change, extra, angle)
        if by_row is None:
            return None
        return self._gathered(judge, by_row, shifts, values.shape)

    def _gathered(
        self, judge: Judge, found: dict[RowKey, Array], shifts: dict[int, Shift], shape: tuple[int, ...]
    ) -> Array:
        count, poses, unknowns = shape
        before = {p.key: r for p, r in judge.residuals.items()}
        parts = []
        for row in self.rows:
            r = np.broadcast_to(found.get(row, before[row]), (judge.reference.k, before[row].shape[1]))
            part = r[: count * poses].reshape(count, poses, -1).copy()
            for n, i in enumerate(self.left):
                if row not in self.choices[i].rows:
                    part[n] = 0.0
            parts.append(part)
        out = np.concatenate(parts, axis=2)
        self.scale = np.zeros((count, poses, unknowns))
        for n, i in enumerate(self.left):
            block = slice(n * poses, (n + 1) * poses)
            for u, cut in enumerate(self.choices[i].cuts):
                shift = shifts[self.names[cut]]
                self.scale[n, :, u] = shift.value[block, 0]
                if shift.differs[block].any():  # no single value is required of it
                    out[n] = np.nan
        return out


def _largest(r: Array, known: NDArray[np.bool_]) -> Array:
    """Return the largest residual of each choice at its poses with residuals; infinite without a value."""
    size = np.abs(r).max(axis=2, initial=0.0)
    size = np.where(known, size, 0.0)
    return np.nan_to_num(size.max(axis=1, initial=0.0), nan=np.inf)


def _mean(r: Array, known: NDArray[np.bool_]) -> Array:
    """Return the mean residual of each choice at its poses with residuals; infinite without a value."""
    size = np.sqrt(np.where(known, np.sum(r**2, axis=2), 0.0))
    return np.nan_to_num(size.mean(axis=1), nan=np.inf)


def _costs(r: Array) -> Array:
    """Return the sum of squares of residuals (choices, poses, entries) at each pose; infinite without a value."""
    return cost(r.reshape(-1, r.shape[2])).reshape(r.shape[:2])


def _steps(
    J: Array, r: Array, counts: NDArray[np.bool_], known: NDArray[np.bool_], swivel: bool = False
) -> tuple[Array, NDArray[np.bool_]]:
    """Return (steps (choices, poses, unknowns) of Gauss-Newton, which choices have a unique finite one).

    The unknowns are eliminated one after the other (modified Gram-Schmidt), with pivots by their order. An unknown
    without effect has no step. It may be the swivel, which is then the last unknown, or the only unknown of a choice,
    at a pose where the rows agree; otherwise, the step is not unique.
    """
    alone = counts.sum(axis=1) == 1
    agrees = np.abs(r).max(axis=2, initial=0.0) <= TIGHT
    columns: list[Array] = []
    triangle = np.zeros((*J.shape[:2], J.shape[3], J.shape[3]))
    right = np.zeros((*J.shape[:2], J.shape[3]))
    unique = np.ones(len(J), bool)
    used = np.where(known[:, :, None, None], J, 0.0)
    rest = np.where(known[:, :, None], -r, 0.0)
    for u in range(J.shape[3]):
        column = used[..., u]
        size = np.sqrt(np.sum(column**2, axis=2))
        for v, other in enumerate(columns):
            part = np.sum(other * column, axis=2)
            triangle[..., v, u] = part
            column = column - part[..., None] * other
        length = np.sqrt(np.sum(column**2, axis=2))
        triangle[..., u, u] = length
        singular = ~(length > SINGULAR * size) & known  # also if a derivative has no value
        needed = ~(alone[:, None] & agrees)
        if swivel and u == J.shape[3] - 1:
            needed = np.zeros_like(needed)
        singular &= needed | (size != 0)
        unique &= ~singular.any(axis=1) | ~counts[:, u]
        unit = column / np.where(length > 0, length, 1.0)[..., None]
        right[..., u] = np.sum(unit * rest, axis=2)
        rest = rest - right[..., u, None] * unit
        columns.append(unit)
    step = np.zeros_like(right)
    for u in reversed(range(J.shape[3])):
        known_part = np.sum(triangle[..., u, u + 1 :] * step[..., u + 1 :], axis=2)
        length = triangle[..., u, u]
        has = counts[:, None, u] & (length > 0)
        step[..., u] = np.where(has, (right[..., u] - known_part) / np.where(has, length, 1.0), 0.0)
    unique &= np.isfinite(step).all(axis=(1, 2))
    return step, unique
