"""Shift the values of expressions in the text of an equation, and find the shifts with which rows agree.

An expression is replaced by the call of a function that adds a value to it at each pose. Gauss-Newton finds the values
with which the residuals of the rows are zero.
"""

from __future__ import annotations

import ast
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from twin.core.spatial import Array
from twin.formula.scalar import Scalar, Value
from twin.validation.explain.deadline import Deadline
from twin.validation.explain.function_source import Edit, Source, Statement
from twin.validation.explain.plain_values import unwrapped
from twin.validation.explain.rebuilt_functions import Matrix, to_array

MOST_NEWTON_STEPS = 12
"""Maximum number of Gauss-Newton steps."""

DERIVATIVE_STEP = 1e-6
"""Difference with which derivatives are computed."""

CONVERGED_RESIDUAL = 1e-3
"""Residual at which Gauss-Newton ends, in units of the tolerance."""

START_FACTORS = (-2.0, -0.9, -0.6, -0.3, 0.5, 1.0, 3.0)
"""Further shifts from which Gauss-Newton starts where a row has no value, as multiples of the expression's value."""

FEWEST_POSES = 6
"""Minimum number of poses at which a row must have a value."""

_MOST_HALVINGS = 4
"""Maximum number of times that a step is halved."""

_LARGEST_REMAINING_PART = 0.9
"""Part of the largest residual that may be left after a step."""

SMALLEST_SINGULAR_RATIO = 1e-9
"""Smallest ratio of singular values with which the rows determine all unknowns."""


class Shift:
    """A function that returns its first argument plus `added`, and stores this argument and the scope.

    Where the argument has no value, such as a root of a negative number, it counts as zero: the shift is the value.

    Attributes:
        entries: number of entries of the argument, a vector; 0 for a scalar, which is stored as one entry.
        added: what is added (k, entries).
        value: the latest argument (k, entries).
        valued_poses: the poses (k,) at which the row has a value.
        scope: the names at the latest call, with their values.
        differs: the poses (k,) at which the calls since `begin` had different arguments.
        is_repeated: whether there was more than one call since `begin`.
        call_count: number of these calls.
    """

    def __init__(self, k: int, entries: int = 0) -> None:
        self.entries = entries
        self.added: Array = np.zeros((k, max(entries, 1)))
        self.value: Array = self.added
        self.valued_poses: NDArray[np.bool_] = np.ones(k, bool)
        self.scope: dict[str, Value] = {}
        self.differs: NDArray[np.bool_] = np.zeros(k, bool)
        self.is_repeated = False
        self.call_count = 0
        self._called = False
        self._latest = self.added

    @property
    def has_mixed_values(self) -> bool:
        """Whether the calls since `begin` had different arguments."""
        return bool(self.differs.any())

    @property
    def scopes(self) -> list[dict[str, Value]]:
        """The scopes of the calls in which the values are; see `ShiftOfCalls.flat`."""
        return [self.scope]

    def begin(self) -> None:
        """Forget the calls of earlier evaluations."""
        self.differs = np.zeros(len(self.added), bool)
        self.is_repeated = False
        self.call_count = 0
        self._called = False

    def __call__(self, value: Value, scope: dict[str, Value] | None = None) -> Value:
        """Return the shifted value; raise TypeError if the value has another form than the shift.

        A scalar is also shifted as a column: an edit may have removed a factor that is a vector.
        """
        k = len(self.added)
        x = unwrapped(value)
        is_scalar = not isinstance(x, Matrix) and np.shape(x) in ((), (k,))
        is_vector = isinstance(x, Matrix) and x.shape == (self.entries, 1)
        if not (is_scalar or is_vector):
            raise TypeError("not a scalar, and not a vector of this length")
        values = np.broadcast_to(to_array(x, k), self.added.shape)
        if self._called:
            both_without_value = np.isnan(values) & np.isnan(self._latest)
            same = (values == self._latest) | both_without_value
            self.differs = self.differs | ~same.all(axis=1)
            self.is_repeated = True
        self.call_count += 1
        self._called = True
        self._latest = values
        self.value = np.where(np.isnan(values), 0.0, values)  # without a value, the shift is the value
        if scope is not None:
            self.scope = scope
        shifted_value = self.value + self.added
        if self.entries:
            return Matrix(shifted_value[:, :, None])
        return _in_form_of(value, shifted_value[:, 0])


def _in_form_of(value: Value, shifted_value: Array) -> Value:
    """Return shifted values (k,) in the form of a value: in plain functions, scalars are objects."""
    if isinstance(value, Scalar):
        return type(value)(shifted_value)
    return shifted_value


class ShiftOfCalls(Shift):
    """Shifts (k, calls) of a scalar that an evaluation computes several times, such as in a loop: one for each call."""

    def __init__(self, k: int, calls: int) -> None:
        super().__init__(k)
        self.added = np.zeros((k, calls))
        self.values: Array = np.zeros((k, calls))
        self._scopes: list[dict[str, Value]] = [{} for _ in range(calls)]

    @property
    def scopes(self) -> list[dict[str, Value]]:
        """The scope of each call."""
        return self._scopes

    def __call__(self, value: Value, scope: dict[str, Value] | None = None) -> Value:
        """Return the value with the shift of this call; raise TypeError if it is no scalar, or one call too many."""
        x = unwrapped(value)
        call = self.call_count
        k, calls = self.added.shape
        is_scalar = not isinstance(x, Matrix) and np.shape(x) in ((), (k,))
        if not is_scalar or call == calls:
            raise TypeError("not a scalar, or more calls than shifts")
        self.call_count += 1
        values = to_array(x, k)[:, 0]
        self.values[:, call] = np.where(np.isnan(values), 0.0, values)  # without a value, the shift is the value
        if scope is not None:
            self._scopes[call] = scope
        return _in_form_of(value, self.values[:, call] + self.added[:, call])

    def flat(self) -> Shift:
        """Return one shift for all calls, with the values of the first call first."""
        flat = FlatShift(self.added.size, self._scopes)
        flat.added = self.added.T.reshape(-1, 1)
        flat.value = self.values.T.reshape(-1, 1)
        flat.valued_poses = np.tile(self.valued_poses, self.added.shape[1])
        return flat


class FlatShift(Shift):
    """The shifts of several calls of a scalar, one after the other; each call has its own scope."""

    def __init__(self, k: int, scopes: list[dict[str, Value]]) -> None:
        super().__init__(k)
        self.scope = scopes[0]
        self._scopes = scopes

    @property
    def scopes(self) -> list[dict[str, Value]]:
        """The scope of each call."""
        return self._scopes


def shifted(source: Source, statement: Statement, node: ast.expr, name: str, scope: bool = True) -> Edit:
    """Return the edit that passes an expression through the function `name`, a `Shift`; `scope`: also all names."""
    start, end = source.span(node)
    text = source.text(start, end)
    new = f"{name}({text})"
    if scope:
        new = f"{name}({text}, {{**globals(), **locals()}})"
    return source.edit_of(statement, (start, end), new, "required")


def newton_solution(
    residual: Callable[[Array], Array | None],
    start: Array,
    scale: Callable[[], Array],
    deadline: Deadline,
) -> tuple[Array, NDArray[np.bool_]] | None:
    """Return (values (k, unknowns) with which the residuals are zero, poses with residuals); None without a solution.

    Args:
        residual: returns the residuals (k, entries) for values (k, unknowns); None if they cannot be evaluated.
        start: first values.
        scale: returns a size (k, unknowns) of the values, after an evaluation of `residual`.
        deadline: time limit.
    """
    values: Array = start
    residuals = residual(values)
    if residuals is None:
        return None
    if not np.isfinite(residuals).all():
        # Where the wrong row has no value, Gauss-Newton starts from another shift, with which it has one.
        for factor in START_FACTORS:
            trial_values: Array = np.asarray(factor * scale(), np.float64)
            trial_residuals = residual(trial_values)
            if trial_residuals is None:
                return None
            better: NDArray[np.bool_] = (sums_of_squares(trial_residuals) < sums_of_squares(residuals))[:, None]
            values = np.where(better, trial_values, values)
            residuals = np.where(better, trial_residuals, residuals)
    has_value = np.asarray(np.isfinite(residuals).all(axis=1))
    if has_value.sum() < FEWEST_POSES:
        return None
    for _ in range(MOST_NEWTON_STEPS):
        if deadline.passed:
            return None
        if np.abs(residuals[has_value]).max() <= CONVERGED_RESIDUAL:
            break
        step = _gauss_newton_step(residual, values, residuals, has_value)
        if step is None:
            return None
        new = residual(values + step)
        for _ in range(_MOST_HALVINGS):  # half the step where the residual grows
            if new is None:
                return None
            worse = has_value & ~(sums_of_squares(new) <= sums_of_squares(residuals))
            if not worse.any():
                break
            step = np.where(worse[:, None], step / 2, step)
            new = residual(values + step)
        if new is None:
            return None
        largest = np.abs(new[has_value]).max()
        if largest > max(_LARGEST_REMAINING_PART * np.abs(residuals[has_value]).max(), 1.0):
            return None  # these expressions cannot make the rows agree
        values = values + step
        residuals = new
    if not np.abs(residuals[has_value]).max() <= 1:
        return None
    residual(values)
    return values, has_value


def _gauss_newton_step(
    residual: Callable[[Array], Array | None], values: Array, residuals: Array, has_value: np.ndarray
) -> Array | None:
    """Return a step of Gauss-Newton (k, unknowns), zero where `has_value` is false.

    None if the rows do not determine all unknowns, or have no finite derivatives.
    """
    slopes: list[Array] = []
    for i in range(values.shape[1]):
        ahead = values.copy()
        ahead[:, i] += DERIVATIVE_STEP
        residuals_ahead = residual(ahead)
        if residuals_ahead is None:
            return None
        slopes.append((residuals_ahead - residuals) / DERIVATIVE_STEP)
    J = np.stack(slopes, axis=2)[has_value]
    if not np.isfinite(J).all():
        return None
    if J.shape[2] > 1:
        singular = np.linalg.svd(J, compute_uv=False)
        if J.shape[1] < J.shape[2] or (singular[:, -1] <= SMALLEST_SINGULAR_RATIO * singular[:, 0]).any():
            return None
    step = np.zeros_like(values)
    newton = np.linalg.pinv(J) @ residuals[has_value][:, :, None]
    step[has_value] = -newton[:, :, 0]
    if not np.isfinite(step).all():
        return None
    return step


def sums_of_squares(r: Array) -> Array:
    """Return the sum of squares of residuals (k, entries) at each pose; infinite without a value."""
    return np.nan_to_num(np.sum(r**2, axis=1), nan=np.inf)
