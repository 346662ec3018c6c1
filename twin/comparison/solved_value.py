"""The value of a number of a file with which the two sides agree.

From the stated value and from the usual other ones, as a lost sign or a quarter turn, Newton's method searches a value
that leaves no residual; then this value is rounded to as few decimals as agreement needs.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence

import numpy as np

from twin.comparison.dh_statements import CellStatement
from twin.comparison.edit_case import EditCase, Statement
from twin.comparison.statements import PlaceStatement
from twin.core.spatial import Array

_MAX_STEPS = 8
"""Maximum number of steps of the search for one value."""

_SOLVED_RESIDUAL = 1e-9
"""Norm of a residual in m and rad at which the search ends."""

_MAX_REMAINING_SHARE = 0.9
"""Fraction of its norm to which a step must reduce the residual."""

_CONVERGED_STEP = 1e-10
"""Step in m, rad or degrees after which the search ends."""

_DIFFERENCE_STEP = 1e-6
"""Step in m, rad or degrees for derivatives by differences."""

_SMALLEST_DERIVATIVE = 1e-9
"""Derivative of the residual by a value below which the value moves nothing."""

_RANK_RATIO = 1e-9
"""Smallest singular value, relative to the largest one, of directions in which a step may go."""

_PROBE_CHANGE = 0.1
"""Change in m, rad or degrees that shows what a value moves."""

_BETTER_STARTS = 2
"""Number of other values from which a search starts, those with the least residual."""

_HALF_TURN_EXCESS = 1e-6
"""Relative excess over half a turn that is only rounding: 180 degrees stay as they are."""

_DECIMALS = range(1, 13)
"""Numbers of decimals that are tried, fewest first, for the text of a new value."""

_ROUNDING_SHARE = 0.05
"""Largest change by rounding, relative to the tolerance.

Agreement after a change near the tolerance would be a coincidence: one more digit must not matter.
"""


def solved_values(case: EditCase, statement: Statement, columns: Sequence[int], before: Array) -> Array | None:
    """Return the values of a statement with which the sides agree, where only `columns` change; None if none do.

    Values are in the units of the file; `before` is the residual of `case` with the stated values, in m and rad.
    """
    if not case.moves_all(statement):
        return None
    # an axis along x, y or z only changes with its other components, or its sign
    if statement.role != "axis" and not _moves_whole_residual(case, statement, columns, before):
        return None
    for start, r in _starts(case, statement, columns, before):
        values = _newton_values(case, statement, columns, start, r)
        if values is not None and _agrees_with(case, statement, values):
            return _rounded(case, statement, _wrapped(statement, columns, values), columns)
    return None


def _moves_whole_residual(case: EditCase, statement: Statement, columns: Sequence[int], before: Array) -> bool:
    """Return whether all that remains depends on these numbers: what another value does not move, it cannot remove."""
    values = np.array(statement.values)
    # different changes: equal ones of two numbers could cancel each other
    values[columns] += _PROBE_CHANGE * np.arange(1, len(columns) + 1)
    side = statement.applied(case.side, values)
    if side is None:
        return False
    is_unmoved = np.abs(case.residual(side) - before) < _SMALLEST_DERIVATIVE * _PROBE_CHANGE
    return not np.any(is_unmoved & (np.abs(before) > case.problem.tolerance))


def _starts(
    case: EditCase, statement: Statement, columns: Sequence[int], before: Array
) -> Iterator[tuple[Array, Array]]:
    """Yield values to start from, with their residuals: the stated ones, then the best of the usual other ones.

    From a rotation by 180 degrees no small step leads to the right one; lost signs and quarter turns are usual errors.
    """
    values = np.array(statement.values)
    yield values, before
    better = []
    for candidate in _usual_values(statement, columns):
        side = statement.applied(case.side, candidate)
        if side is not None:
            r = case.residual(side)
            if np.linalg.norm(r) < np.linalg.norm(before):
                better.append((float(np.linalg.norm(r)), candidate, r))
    # by the norm alone: arrays have no order
    better.sort(key=lambda entry: entry[0])
    for _, candidate, r in better[:_BETTER_STARTS]:
        yield candidate, r


def _usual_values(statement: Statement, columns: Sequence[int]) -> list[Array]:
    """Return the usual other values: opposite signs, directions along x, y and z, and quarter turns."""
    values = np.array(statement.values)
    candidates = []
    if statement.role == "shift":
        return candidates
    if statement.role != "place":
        opposite = values.copy()
        opposite[columns] *= -1.0
        candidates.append(opposite)
    if statement.role == "axis":
        if len(columns) == 3:
            candidates += [*np.eye(3), *-np.eye(3)]
        return candidates
    angles = _angle_columns(statement, columns)
    if not angles:
        return candidates
    quarter = np.pi / 2 / _angle_unit(statement)
    if len(angles) == 1:
        for turns in (1, -1, 2):
            turned = values.copy()
            turned[angles] += turns * quarter
            candidates.append(turned)
        return candidates
    for turns in itertools.product((0, 1, 2, -1), (0, 1, -1), (0, 1, 2, -1)):
        if turns[1] and turns[0]:
            continue  # at a pitch of 90 degrees, roll and yaw are turns about one line
        turned = values.copy()
        turned[angles] = np.array(turns) * quarter
        candidates.append(turned)
    return candidates


def _angle_columns(statement: Statement, columns: Sequence[int]) -> list[int]:
    """Return which of some values are angles."""
    if isinstance(statement, CellStatement):
        return list(columns) if statement.is_angle else []
    if isinstance(statement, PlaceStatement):
        return [] if statement.turn.kind == "quat" else [3, 4, 5]
    if statement.role == "turn" and statement.kind != "quat":
        return list(columns)
    return []


def _angle_unit(statement: Statement) -> float:
    """Return the unit of the angles of a statement in rad."""
    if isinstance(statement, PlaceStatement):
        return statement.turn.unit
    return statement.unit


def _wrapped(statement: Statement, columns: Sequence[int], values: Array) -> Array:
    """Return values whose changed angles are at most half a turn."""
    wrapped = values.copy()
    turn = 2 * np.pi / _angle_unit(statement)
    for k in _angle_columns(statement, columns):
        if abs(wrapped[k]) > turn / 2 * (1 + _HALF_TURN_EXCESS):
            wrapped[k] -= turn * np.round(wrapped[k] / turn)
    return wrapped


def _newton_values(
    case: EditCase, statement: Statement, columns: Sequence[int], start: Array, r: Array
) -> Array | None:
    """Return the values to which Newton steps lead, or None if the residual does not decrease."""
    values = start
    for _ in range(_MAX_STEPS):
        if np.linalg.norm(r) < _SOLVED_RESIDUAL:
            break
        J = _derivatives(case, statement, values, columns, r)
        if J is None or not np.abs(J).max() > _SMALLEST_DERIVATIVE:  # true also for NaN
            return None
        step = np.linalg.lstsq(J, -r, rcond=_RANK_RATIO)[0]
        values_tried = values.copy()
        values_tried[columns] += step
        side = statement.applied(case.side, values_tried)
        if side is None:
            return None
        r_tried = case.residual(side)
        # this number alone cannot remove the rest, or no further step helps
        if np.linalg.norm(r_tried) > _MAX_REMAINING_SHARE * np.linalg.norm(r):
            if np.linalg.norm(r) > case.problem.tolerance:
                return None
            break
        values = values_tried
        r = r_tried
        if np.abs(step).max() < _CONVERGED_STEP:
            break
    return values


def _derivatives(case: EditCase, statement: Statement, values: Array, columns: Sequence[int], r: Array) -> Array | None:
    """Return the derivatives (rows, columns) of the residual by the values."""
    derivatives = []
    for k in columns:
        stepped = values.copy()
        stepped[k] += _DIFFERENCE_STEP
        side = statement.applied(case.side, stepped)
        if side is None:
            return None
        derivatives.append((case.residual(side) - r) / _DIFFERENCE_STEP)
    return np.array(derivatives).T


def _agrees_with(case: EditCase, statement: Statement, values: Array) -> bool:
    """Return whether the sides agree with other values of a statement."""
    side = statement.applied(case.side, values.tolist())
    return side is not None and case.agrees(side)


def _rounded(case: EditCase, statement: Statement, values: Array, columns: Sequence[int]) -> Array:
    """Return the values with as few decimals as are needed for agreement."""
    for digits in _DECIMALS:
        rounded = values.copy()
        rounded[columns] = np.round(values[columns], digits)
        if np.abs(rounded - values).max() >= _ROUNDING_SHARE * case.problem.tolerance:
            continue
        if _agrees_with(case, statement, rounded):
            return rounded + 0.0  # 0.0 instead of -0.0
    return values
