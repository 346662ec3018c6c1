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

import numpy as np
from numpy.typing import NDArray

from twin.core.spatial import Array
from twin.formula.scalar import Value
from twin.validation.explain.candidate import residuals_with
from twin.validation.explain.deadline import Deadline
from twin.validation.explain.equation_steps import RowKey
from twin.validation.explain.expression import Site
from twin.validation.explain.expression_shifts import (
    CONVERGED_RESIDUAL,
    DERIVATIVE_STEP,
    FEWEST_POSES,
    MOST_NEWTON_STEPS,
    SMALLEST_SINGULAR_RATIO,
    START_FACTORS,
    Shift,
    shifted,
    sums_of_squares,
)
from twin.validation.explain.function_source import Edit, TextPlace
from twin.validation.explain.rebuilt_functions import unguarded
from twin.validation.explain.row_deviations import Judge, by_row

_BATCH_SIZES = (1, 4, 16, 64)
"""Numbers of choices that one evaluation may have."""

_MOST_HALVINGS = 4
"""Maximum number of times that a step is halved."""

_LARGEST_REMAINING_PART = 0.9
"""Part of the mean residual that may be left after a step; with more, the expressions cannot make the rows agree."""


def _function_name(number: int) -> str:
    """Return the name, in the edited text, of the function that shifts an expression."""
    return f"_required_{number}_"


@dataclass(eq=False)
class LargestScalar:
    """A largest scalar expression of a statement.

    Attributes:
        site, node: the statement and the expression.
        slopes: derivatives (k, entries) of the residuals of each row that the expression moves.
        value: values (k,) of the expression.
        is_repeated: whether it is computed several times, so that an edit may change it by another amount each time.
    """

    site: Site
    node: ast.expr
    slopes: dict[RowKey, Array]
    value: Array = field(default_factory=lambda: np.zeros(0))
    is_repeated: bool = False

    @cached_property
    def function(self) -> tuple[Path, str]:
        """File and function of the expression."""
        return self.site.source.path, self.site.source.name

    @cached_property
    def place(self) -> TextPlace:
        """File, first byte and end of the expression."""
        return (self.site.source.path, *self.site.source.span(self.node))

    def moves_one_of(self, rows: Sequence[RowKey]) -> bool:
        """Return whether a row has other residuals with another value of the expression."""
        return not self.slopes.keys().isdisjoint(rows)


@dataclass(frozen=True, eq=False)
class Choice:
    """Expressions whose values are unknown, the rows that must agree, and first shifts (k, expressions); None: zero."""

    scalars: tuple[LargestScalar, ...]
    rows: tuple[RowKey, ...]
    start: Array | None = None


class Batch:
    """Evaluates the equations at copies of some poses, one copy for each choice of expressions."""

    def __init__(self, judge: Judge, poses: Sequence[int], fewest: int = FEWEST_POSES) -> None:
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
        functions: list[tuple[Path, str]] = []
        for choice in choices:
            functions.append(choice.scalars[0].function)
        for part in _evaluation_parts(functions):
            if deadline.passed:
                break
            choices_of_part = [choices[i] for i in part]
            with unguarded():
                newton = _BatchedGaussNewton(self, equation, fixed, choices_of_part)
                solutions_of_part = newton.run(deadline)
            for n, values in solutions_of_part:
                solutions.append((part[n], values))
        return sorted(solutions, key=lambda solution: solution[0])

    def slopes(self, equation: str, scalars: Sequence[LargestScalar]) -> list[dict[RowKey, Array]]:
        """Return, of each expression, the derivatives (k, entries) of the residuals of the rows that it moves."""
        rows = tuple(self.residuals)
        slopes_of_scalar: dict[int, dict[RowKey, Array]] = {}
        functions = [scalar.function for scalar in scalars]
        for part in _evaluation_parts(functions):
            choices: list[Choice] = []
            for i in part:
                choices.append(Choice((scalars[i],), rows))
            with unguarded():
                newton = _BatchedGaussNewton(self, equation, (), choices)
                slopes_of_part = newton.slopes()
            for i, slopes in zip(part, slopes_of_part, strict=True):
                slopes_of_scalar[i] = slopes
        # The parts are sorted by function, the result is in the order of `scalars`.
        return [slopes_of_scalar[i] for i in range(len(scalars))]

    @cached_property
    def residuals(self) -> dict[RowKey, Array]:
        """Residuals (k, entries) of the rows at the poses, without edits."""
        return by_row(self.copies(1).residuals)

    def copies(self, count: int) -> Judge:
        """Return a judge at the poses, repeated for at least `count` choices."""
        # A judge is made and kept for each size, so that there are few of them.
        size = _BATCH_SIZES[-1]
        for smaller in reversed(_BATCH_SIZES):
            if smaller >= count:
                size = smaller
        if size not in self._copies:
            with unguarded():
                self._copies[size] = self._judge.on(self._judge.reference.repeated(self.poses, size))
        return self._copies[size]


def _evaluation_parts(functions: Sequence[tuple[Path, str]]) -> list[list[int]]:
    """Return the indices of choices in parts that one evaluation can have: of one function, and not too many."""
    parts_of_choices: list[list[int]] = []
    latest: dict[tuple[Path, str], list[int]] = {}
    for i, function in enumerate(functions):
        part = latest.get(function)
        if part is None or len(part) == _BATCH_SIZES[-1]:
            part = []
            latest[function] = part
            parts_of_choices.append(part)
        part.append(i)
    return parts_of_choices


class _BatchedGaussNewton:
    """Gauss-Newton for several choices of expressions; values and residuals are (choices, poses, ...)."""

    def __init__(self, batch: Batch, equation: str, fixed: Sequence[Edit], choices: Sequence[Choice]) -> None:
        """Shift every expression of `choices`, all of one function, in one edited text, after the edits `fixed`."""
        self.batch = batch
        self.equation = equation
        self.choices = list(choices)
        self.undecided = list(range(len(choices)))
        """Indices of the choices that are not decided yet."""
        self.has_swivel = bool(batch.copies(1).step(equation).swivel)
        scalars: dict[LargestScalar, int] = {}
        for choice in choices:
            for scalar in choice.scalars:
                scalars.setdefault(scalar, len(scalars))
        self.function_numbers = scalars
        """A number for each expression, with which its function in the edited text is named."""
        self.edits = list(fixed)
        for scalar, number in scalars.items():
            edit = shifted(scalar.site.source, scalar.site.statement, scalar.node, _function_name(number), scope=False)
            self.edits.append(edit)
        self.expressions = 0
        """Largest number of expressions of a choice; choices with fewer have columns without effect."""
        self.rows: list[RowKey] = []
        for choice in choices:
            self.expressions = max(self.expressions, len(choice.scalars))
            for row in choice.rows:
                if row not in self.rows:
                    self.rows.append(row)
        self.present_values = np.zeros(0)
        """Values (choices, poses, unknowns) of the expressions before their shifts, at the latest evaluation."""

    def slopes(self) -> list[dict[RowKey, Array]]:
        """Return the derivatives of the rows that the one expression of each choice moves."""
        values = self._start()
        base = self._residuals(values)
        if base is not None:  # without a value, it would seem that an expression moves nothing
            values, base = self._with_valued_starts(values, base)
        values[:, :, 0] += DERIVATIVE_STEP
        residuals_ahead = self._residuals(values)
        slopes: list[dict[RowKey, Array]] = []
        for n in range(len(self.choices)):
            slopes_of_rows: dict[RowKey, Array] = {}
            if base is not None and residuals_ahead is not None:
                first = 0  # the entries of all rows are beside each other
                for row in self.rows:
                    last = first + self.batch.residuals[row].shape[1]
                    before = base[n, :, first:last]
                    after = residuals_ahead[n, :, first:last]
                    first = last
                    if not np.array_equal(before, after, equal_nan=True):
                        slopes_of_rows[row] = (after - before) / DERIVATIVE_STEP
            slopes.append(slopes_of_rows)
        return slopes

    def run(self, deadline: Deadline) -> list[tuple[int, Array]]:
        """Return (index, shifts) of the choices with a solution."""
        values = self._start()
        residuals = self._residuals(values)
        if residuals is None:
            return []
        values, residuals = self._with_valued_starts(values, residuals)
        has_value = np.asarray(np.isfinite(residuals).all(axis=2))
        enough = has_value.sum(axis=1) >= self.batch.fewest
        values, residuals, has_value = self._narrowed_to(enough, values, residuals, has_value)
        solutions: list[tuple[int, Array]] = []
        for _ in range(MOST_NEWTON_STEPS + 1):
            if not self.undecided:
                break
            size = _largest_residuals(residuals, has_value)
            converged = size <= CONVERGED_RESIDUAL
            for n in np.flatnonzero(converged).tolist():
                solutions.append(self._solution(n, values))
            values, residuals, has_value = self._narrowed_to(~converged, values, residuals, has_value)
            if not self.undecided or deadline.passed:
                break
            values, residuals, has_value, has_step = self._after_step(values, residuals, has_value)
            if not has_step:
                break
        size = _largest_residuals(residuals, has_value)
        for n in range(len(self.undecided)):
            if size[n] <= 1:
                solutions.append(self._solution(n, values))
        return sorted(solutions, key=lambda solution: solution[0])

    def _solution(self, n: int, values: Array) -> tuple[int, Array]:
        """Return (index of a choice, its shifts (poses, expressions)), for the choice `n` of those not decided."""
        choice = self.undecided[n]
        count = len(self.choices[choice].scalars)
        return choice, values[n][:, :count]

    def _start(self) -> Array:
        """Return the first values (choices, poses, unknowns): shifts, and then the swivel angle, if there is one."""
        poses = len(self.batch.poses)
        values = np.zeros((len(self.choices), poses, self.expressions + self.has_swivel))
        for i, choice in enumerate(self.choices):
            if choice.start is not None:
                values[i, :, : len(choice.scalars)] = choice.start
        if self.has_swivel:
            step = self.batch.copies(len(self.choices)).step(self.equation)
            (angle,) = step.swivel.values()
            values[:, :, -1] = angle[: len(self.choices) * poses].reshape(-1, poses)
        return values

    def _with_valued_starts(self, values: Array, r: Array) -> tuple[Array, Array]:
        """Return (values, residuals), where a row has no value with other first values."""
        if np.isfinite(r).all():
            return values, r
        lacks_value: NDArray[np.bool_] = np.logical_not(np.isfinite(r).all(axis=(1, 2)))
        for factor in START_FACTORS:
            trial_values = values.copy()
            trial_values[:, :, : self.expressions] = factor * self.present_values[:, :, : self.expressions]
            trial_residuals = self._residuals(trial_values)
            if trial_residuals is None:
                break
            lower = _sums_of_squares(trial_residuals) < _sums_of_squares(r)
            better = (lacks_value[:, None] & lower)[:, :, None]
            values = np.where(better, trial_values, values)
            r = np.where(better, trial_residuals, r)
        return values, r

    def _narrowed_to(
        self, selected: NDArray[np.bool_], values: Array, residuals: Array, has_value: NDArray[np.bool_]
    ) -> tuple[Array, Array, NDArray[np.bool_]]:
        """Return the arrays of the choices `selected` (choices,); the others are decided."""
        self.undecided = np.array(self.undecided, int)[selected].tolist()
        return values[selected], residuals[selected], has_value[selected]

    def _after_step(
        self, values: Array, residuals: Array, has_value: NDArray[np.bool_]
    ) -> tuple[Array, Array, NDArray[np.bool_], bool]:
        """Return (values, residuals, poses with residuals, whether a step was made), of choices that may be solved.

        No step is made if the rows cannot be evaluated after it.
        """
        slopes: list[Array] = []
        for u in range(values.shape[2]):
            values_ahead = values.copy()
            values_ahead[:, :, u] += DERIVATIVE_STEP
            residuals_ahead = self._residuals(values_ahead)
            if residuals_ahead is None:
                return values, residuals, has_value, False
            slopes.append((residuals_ahead - residuals) / DERIVATIVE_STEP)
        step, unique = _gauss_newton_steps(
            np.stack(slopes, axis=3), residuals, self._unknowns_of_choices(), has_value, self.has_swivel
        )
        step[~has_value] = 0.0
        values, residuals, has_value = self._narrowed_to(unique, values, residuals, has_value)
        step = step[unique]
        if not self.undecided:
            return values, residuals, has_value, False
        new_residuals = self._residuals(values + step)
        if new_residuals is None:
            return values, residuals, has_value, False
        for _ in range(_MOST_HALVINGS):  # half the step where the residual grows
            worse = has_value & ~(_sums_of_squares(new_residuals) <= _sums_of_squares(residuals))
            if not worse.any():
                break
            step = np.where(worse[:, :, None], step / 2, step)
            new_residuals = self._residuals(values + step)
            if new_residuals is None:
                return values, residuals, has_value, False
        # Poses converge after different numbers of steps, so that the mean decides, not the largest residual.
        is_nearer = _mean_residuals(new_residuals, has_value) <= _LARGEST_REMAINING_PART * _mean_residuals(
            residuals, has_value
        )
        agrees = _largest_residuals(new_residuals, has_value) <= 1.0
        return *self._narrowed_to(is_nearer | agrees, values + step, new_residuals, has_value), True

    def _unknowns_of_choices(self) -> NDArray[np.bool_]:
        """Return which unknowns (choices, unknowns) a choice has."""
        is_unknown = np.ones((len(self.undecided), self.expressions + self.has_swivel), bool)
        for n, i in enumerate(self.undecided):
            is_unknown[n, len(self.choices[i].scalars) : self.expressions] = False
        return is_unknown

    def _residuals(self, values: Array) -> Array | None:
        """Return the residuals (choices, poses, entries), zero for rows that a choice does not have; None: no value."""
        count, poses, _ = values.shape
        judge = self.batch.copies(count)
        k = judge.reference.k
        shifts = {}
        for number in self.function_numbers.values():
            shifts[number] = Shift(k)
        for n, i in enumerate(self.undecided):
            for u, scalar in enumerate(self.choices[i].scalars):
                shifts[self.function_numbers[scalar]].added[n * poses : (n + 1) * poses, 0] = values[n, :, u]
        angle = None
        if self.has_swivel:
            angle = np.zeros(k)
            angle[: count * poses] = values[:, :, -1].ravel()
        extra: dict[str, Value] = {}
        for number, shift in shifts.items():
            extra[_function_name(number)] = shift
        residuals = residuals_with(judge, self.equation, self.edits, extra, angle)
        if residuals is None:
            return None
        return self._residuals_of_choices(judge, residuals, shifts, values.shape)

    def _residuals_of_choices(
        self, judge: Judge, residuals_by_row: dict[RowKey, Array], shifts: dict[int, Shift], shape: tuple[int, ...]
    ) -> Array:
        """Return the rows' residuals as one array (choices, poses, entries), and set `present_values`.

        Rows that no expression moves keep their residuals; those that a choice does not have are zero. `shape` is that
        of the values: (choices, poses, unknowns).
        """
        count, poses, unknowns = shape
        before = by_row(judge.residuals)
        parts: list[Array] = []
        for row in self.rows:
            residual = residuals_by_row.get(row, before[row])
            of_copies = np.broadcast_to(residual, (judge.reference.k, before[row].shape[1]))
            part = of_copies[: count * poses].reshape(count, poses, -1).copy()
            for n, i in enumerate(self.undecided):
                if row not in self.choices[i].rows:
                    part[n] = 0.0
            parts.append(part)
        residuals = np.concatenate(parts, axis=2)
        self.present_values = np.zeros((count, poses, unknowns))
        for n, i in enumerate(self.undecided):
            block = slice(n * poses, (n + 1) * poses)
            for u, scalar in enumerate(self.choices[i].scalars):
                shift = shifts[self.function_numbers[scalar]]
                self.present_values[n, :, u] = shift.value[block, 0]
                if shift.differs[block].any():  # no single value is required of it
                    residuals[n] = np.nan
        return residuals


def _largest_residuals(r: Array, has_value: NDArray[np.bool_]) -> Array:
    """Return the largest residual of each choice at its poses with residuals; infinite without a value."""
    size = np.abs(r).max(axis=2, initial=0.0)
    known_size = np.where(has_value, size, 0.0)
    return np.nan_to_num(known_size.max(axis=1, initial=0.0), nan=np.inf)


def _mean_residuals(r: Array, has_value: NDArray[np.bool_]) -> Array:
    """Return the mean residual of each choice at its poses with residuals; infinite without a value."""
    squares = np.where(has_value, np.sum(r**2, axis=2), 0.0)
    size = np.sqrt(squares)
    return np.nan_to_num(size.mean(axis=1), nan=np.inf)


def _sums_of_squares(r: Array) -> Array:
    """Return the sum of squares of residuals (choices, poses, entries) at each pose; infinite without a value."""
    choices, poses, entries = r.shape
    return sums_of_squares(r.reshape(-1, entries)).reshape(choices, poses)


def _gauss_newton_steps(
    J: Array, r: Array, counts: NDArray[np.bool_], has_value: NDArray[np.bool_], swivel: bool = False
) -> tuple[Array, NDArray[np.bool_]]:
    """Return (steps (choices, poses, unknowns) of Gauss-Newton, which choices have a unique finite one).

    The unknowns are eliminated one after the other (modified Gram-Schmidt), with pivots by their order. An unknown
    without effect has no step. It may be the swivel, which is then the last unknown, or the only unknown of a choice,
    at a pose where the rows agree; otherwise, the step is not unique.
    """
    unknowns = J.shape[3]
    alone = counts.sum(axis=1) == 1
    agrees = np.abs(r).max(axis=2, initial=0.0) <= CONVERGED_RESIDUAL
    columns: list[Array] = []  # orthonormal, one for each unknown so far
    triangle = np.zeros((*J.shape[:2], unknowns, unknowns))
    right = np.zeros((*J.shape[:2], unknowns))
    unique = np.ones(len(J), bool)
    J_valued = np.where(has_value[:, :, None, None], J, 0.0)
    unexplained = np.where(has_value[:, :, None], -r, 0.0)
    for unknown in range(unknowns):
        column = J_valued[..., unknown]
        size = np.sqrt(np.sum(column**2, axis=2))
        for v, earlier_column in enumerate(columns):
            part = np.sum(earlier_column * column, axis=2)
            triangle[..., v, unknown] = part
            column = column - part[..., None] * earlier_column
        length = np.sqrt(np.sum(column**2, axis=2))
        triangle[..., unknown, unknown] = length
        singular = ~(length > SMALLEST_SINGULAR_RATIO * size) & has_value  # also if a derivative has no value
        needed = ~(alone[:, None] & agrees)
        if swivel and unknown == unknowns - 1:
            needed = np.zeros_like(needed)
        singular &= needed | (size != 0)
        unique &= ~singular.any(axis=1) | ~counts[:, unknown]
        divisor = np.where(length > 0, length, 1.0)
        unit = column / divisor[..., None]
        right[..., unknown] = np.sum(unit * unexplained, axis=2)
        unexplained = unexplained - right[..., unknown, None] * unit
        columns.append(unit)
    step = np.zeros_like(right)
    for unknown in reversed(range(unknowns)):
        of_later = np.sum(triangle[..., unknown, unknown + 1 :] * step[..., unknown + 1 :], axis=2)
        length = triangle[..., unknown, unknown]
        has_step = counts[:, None, unknown] & (length > 0)
        quotient = (right[..., unknown] - of_later) / np.where(has_step, length, 1.0)
        step[..., unknown] = np.where(has_step, quotient, 0.0)
    unique &= np.isfinite(step).all(axis=(1, 2))
    return step, unique
