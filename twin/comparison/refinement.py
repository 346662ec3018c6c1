"""The steps that make smallest what remains between the joint lines of two sides, and what they leave undetermined."""

from __future__ import annotations

from collections.abc import Callable
from typing import cast

import numpy as np
from scipy import linalg

from twin.comparison.fit_problem import FitProblem
from twin.comparison.line_gaps import FitSolution, line_gap, line_residuals
from twin.comparison.unknowns import Unknowns, free_values, values_of, with_values
from twin.core.spatial import Array, Index

DIFFERENCE_STEP = 1e-7
"""Step of the unknowns in m and rad for derivatives by differences."""

_MAX_STEPS = 25
"""Maximum number of Gauss-Newton steps."""

_RANK_RATIO = 1e-6
"""Size of a singular value, relative to the largest, below which the lines do not determine a direction.

Derivatives by differences have errors of about 1e-8: a smaller value would let such a direction run to kilometres.
"""

_SMALLEST_STRENGTH = 1e-12
"""Derivative that stands for 0 where nothing changes the lines: rounding alone would else determine a direction."""

_STALLED_SHARE = 1e-4
"""Part of the sum of squares that a step must remove where the lines are still far apart: else they stay apart."""

_FAR_FACTOR = 10.0
"""Factor of the tolerance from which lines are far apart."""

_DAMPING_DIVISOR = 10
"""Divisor of the damping after a step that lowered the residual."""

_DAMPING_GROWTH = 100
"""Factor of the damping after a step that did not lower it."""

_SMALLEST_DAMPING = 1e-7
"""Smallest damping of a step that did not lower the residual."""

_LARGEST_DAMPING = 1e3
"""Damping above which steps no longer lead anywhere."""

_SOLVED_RESIDUAL = 1e-13
"""Largest residual in m and rad at which the steps end."""

_CONVERGED_SHARE = 1e-9
"""Part of the sum of squares that a step must remove, or the steps end."""

_ROUNDING_SUM = 1e-20
"""Sum of squares in m and rad below which a small gain of a step is only rounding, and ends nothing."""


def refine(
    problem: FitProblem,
    unknowns: Unknowns,
    free: Array | None = None,
    further_residuals: Callable[[Array, Array], Array] | None = None,
) -> FitSolution:
    """Return the unknowns after damped Gauss-Newton steps, whether or not the lines then coincide.

    Args:
        problem: the lines.
        unknowns: values to begin with.
        free: (unknowns,) which values may change. None: see `free_values`.
        further_residuals: a function of values (k, unknowns), and of the motions (k, groups, 4, 4) of the groups of
            bodies with these values, that returns (k, rows) of further residuals in m and rad.
    """

    def residuals(values: Array) -> Array:
        parents, children, groups = problem.motions(unknowns.signs, values, unknowns.deviating)
        lines = line_residuals(problem, unknowns.signs, parents, children)
        if further_residuals is None:
            return lines
        return np.concatenate([lines, further_residuals(values, groups)], axis=1)

    x = values_of(unknowns)
    if free is None:
        free = free_values(problem.count, unknowns.deviating)
    columns = np.flatnonzero(free)
    r = residuals(x[None])[0]
    damping = 0.0
    for _ in range(_MAX_STEPS):
        if not len(columns) or np.abs(r).max() < _SOLVED_RESIDUAL:
            break
        stepped = stepped_values(x, columns)[:-1]  # without the last row, which is x
        J = (residuals(stepped) - r).T / DIFFERENCE_STEP
        step = _damped_step(J, r, damping)
        x_tried = x.copy()
        x_tried[columns] += step
        r_tried = residuals(x_tried[None])[0]
        before = float(r @ r)
        after = float(r_tried @ r_tried)
        if after < before:
            x = x_tried
            r = r_tried
            # back to plain Gauss-Newton steps, which end in few
            damping = damping / _DAMPING_DIVISOR if damping > _SMALLEST_DAMPING else 0.0
            lowered = before - after
            if lowered < _CONVERGED_SHARE * before and before > _ROUNDING_SUM:
                break
            if lowered < _STALLED_SHARE * before and np.abs(r).max() > _FAR_FACTOR * problem.tolerance:
                break
        else:
            # a shorter step, more along the gradient
            damping = max(_DAMPING_GROWTH * damping, _SMALLEST_DAMPING)
            if damping > _LARGEST_DAMPING:
                break
    refined = with_values(unknowns, x)
    return FitSolution(refined, line_gap(problem, refined))


def _damped_step(J: Array, r: Array, damping: float) -> Array:
    """Return the smallest step (columns,) that lowers the residual r most; directions without effect stay at zero."""
    if damping > 0.0:
        J = np.concatenate([J, np.sqrt(damping) * np.eye(J.shape[1])])
        r = np.concatenate([r, np.zeros(J.shape[1])])
    # A pivoted QR decomposition takes a fifth of the time of singular values, whose threads also wait for each other.
    solution = linalg.lstsq(J, -r, cond=_RANK_RATIO, lapack_driver="gelsy")
    assert solution is not None
    return np.asarray(solution[0], float)


def stepped_values(x: Array, columns: Index) -> Array:
    """Return (columns + 1, unknowns): values x with one of the columns stepped in each row, and x in the last row."""
    stepped = np.repeat(x[None], len(columns) + 1, axis=0)
    stepped[np.arange(len(columns)), columns] += DIFFERENCE_STEP
    return stepped


def open_directions(J: Array) -> Array:
    """Return orthonormal directions (unknowns, k) that the derivatives J (rows, unknowns) do not determine."""
    if not J.size:
        return np.eye(J.shape[1])
    Q, R, _ = cast(tuple[Array, Array, Array], linalg.qr(J.T, pivoting=True))
    strengths = np.abs(np.diag(R))
    rank = int(np.sum(strengths > _RANK_RATIO * max(float(strengths[0]), _SMALLEST_STRENGTH)))
    return Q[:, rank:]
