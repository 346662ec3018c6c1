"""Fit the free angle (swivel) of a redundant mechanism, so that the residuals of rows are minimal.

`fitted_swivel` fits it in each state by evaluations of the rows. Residuals of many trials at one pose are evaluated at
the three `SWIVEL_ANGLES` only, if they are linear in sine and cosine of the swivel:

    residual(angle) = mean + cosine part * cos(angle) + sine part * sin(angle)

The three parts follow from three angles, and `at_best_swivel` finds the best angle of each trial without evaluations.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray

from twin.core.spatial import Array
from twin.validation.explain.equation_steps import RowPlace

_START_ANGLES = 12
"""Number of start angles in a full turn."""

_MOST_NEWTON_STEPS = 6
"""Maximum number of Gauss-Newton steps from the best start angle."""

_DERIVATIVE_STEP = 1e-6
"""Difference in rad for numeric derivatives."""

_LONGEST_STEP = 0.5
"""Largest step in rad, about the distance of start angles: a longer one would leave the valley of the best of them."""

_LEAST_DIVISOR = 1e-300
"""Minimum divisor where rows may not depend on the angle."""

SWIVEL_ANGLES = (0.0, 2 * np.pi / 3, -2 * np.pi / 3)
"""Angles in rad at which rows are evaluated: they determine a row that is linear in sine and cosine."""

LINEARITY_ANGLE = 1.0
"""Another angle in rad, at which it is tested whether rows are linear in sine and cosine."""

_LINEARITY_ROUNDING = 1e-9
"""Difference from a linear row, relative to its residuals, that is rounding."""

_SMALLEST_DETERMINANT_RATIO = 1e-10
"""Relative size of a determinant below which the parts with sine and cosine are parallel."""

_LARGEST_SOUGHT_RESIDUAL = 1e3
"""Residual, in units of the tolerance, up to which an angle is sought."""

_LARGEST_CIRCLE_ERROR = 1e-3
"""Difference of cosine^2 + sine^2 from 1 up to which an angle is sought."""

_LINEAR_START_ANGLES = 16
"""Number of start angles of a linear row, of which each takes no evaluation."""


def fitted_swivel(rows: Callable[[Array], Mapping[RowPlace, Array]], states: int) -> Array:
    """Return the swivel angles (states,) in rad that minimise the residuals of `rows` in each state.

    A pose of a redundant mechanism determines the joint values only together with the swivel angle. The zero of this
    angle is a convention of the formula, not a property of the mechanism. Rows are therefore judged at the best angle.
    """

    def residuals(angle: Array) -> Array:
        """Return the residuals (states, entries) of all rows, always in the same order."""
        by_row = rows(angle)
        if not by_row:
            return np.zeros((states, 0))
        columns: list[Array] = []
        for place in sorted(by_row, key=lambda place: (place.statement, place.position)):
            columns.append(by_row[place].reshape(states, -1))
        return np.hstack(columns)

    def cost(r: Array) -> Array:
        return np.nan_to_num(np.sum(r**2, axis=1), nan=np.inf)

    best = np.zeros(states)
    r = residuals(best)
    least = cost(r)

    def keep_better(angle: Array) -> bool:
        """Take over the angles with which the cost is smaller; return whether there are any."""
        nonlocal best, least, r
        residuals_at_angle = residuals(angle)
        costs = cost(residuals_at_angle)
        is_better = costs < least
        best = np.where(is_better, angle, best)
        least = np.where(is_better, costs, least)
        if residuals_at_angle.shape == r.shape:
            r = np.where(is_better[:, None], residuals_at_angle, r)
        return bool(is_better.any())

    for angle in np.linspace(-np.pi, np.pi, _START_ANGLES, endpoint=False):
        keep_better(np.full(states, angle))
    for _ in range(_MOST_NEWTON_STEPS):
        slope = (residuals(best + _DERIVATIVE_STEP) - r) / _DERIVATIVE_STEP
        squares = np.maximum(np.sum(slope**2, axis=1), _LEAST_DIVISOR)
        step = np.nan_to_num(-np.sum(slope * r, axis=1) / squares)
        if not keep_better(best + np.clip(step, -_LONGEST_STEP, _LONGEST_STEP)):
            break
    return best


def is_linear_in_swivel(zero: Array, ahead: Array, back: Array, at_test_angle: Array) -> bool:
    """Return whether residuals at `SWIVEL_ANGLES` and at `LINEARITY_ANGLE` are those of a linear row, or not finite."""
    mean, cosine, sine = _harmonics(zero, ahead, back)
    if not np.isfinite(np.hstack([mean, cosine, sine, at_test_angle])).all():
        return True
    # Three angles determine the three parts; the fourth one shows whether there are no others.
    predicted = mean + cosine * np.cos(LINEARITY_ANGLE) + sine * np.sin(LINEARITY_ANGLE)
    size = np.abs(at_test_angle).max() + np.abs(mean).max()
    return bool(np.abs(predicted - at_test_angle).max() <= _LINEARITY_ROUNDING * size)


def _harmonics(zero: Array, ahead: Array, back: Array) -> tuple[Array, Array, Array]:
    """Return (mean, part with the cosine, part with the sine) of values that are linear in both, from three angles."""
    mean = (zero + ahead + back) / 3
    return mean, zero - mean, (ahead - back) / np.sqrt(3)


def at_best_swivel(zero: Array, ahead: Array, back: Array) -> Array:
    """Return the residuals (n, entries) at the best swivel angle of each trial, from those at `SWIVEL_ANGLES`.

    They are infinite for trials whose residuals are zero at no angle.
    """
    mean, cosine, sine = _harmonics(zero, ahead, back)
    residuals = np.full_like(zero, np.inf)
    possible = np.flatnonzero(_may_vanish(mean, cosine, sine))
    mean = mean[possible]
    cosine = cosine[possible]
    sine = sine[possible]

    def at(angle: Array) -> Array:
        """Return the residuals (n, entries) at angles (n,)."""
        return mean + cosine * np.cos(angle)[:, None] + sine * np.sin(angle)[:, None]

    best = np.zeros(len(mean))
    least = np.full(len(mean), np.inf)
    for start in np.linspace(0, 2 * np.pi, _LINEAR_START_ANGLES, endpoint=False):
        angle = np.full(len(mean), start)
        size = np.sum(at(angle) ** 2, axis=1)
        best = np.where(size < least, angle, best)
        least = np.fmin(size, least)
    for _ in range(_MOST_NEWTON_STEPS):
        slope = sine * np.cos(best)[:, None] - cosine * np.sin(best)[:, None]
        squares = np.maximum(np.sum(slope**2, axis=1), _LEAST_DIVISOR)
        step = np.sum(slope * at(best), axis=1) / squares
        best = best - np.nan_to_num(step)
    residuals[possible] = at(best)
    return residuals


def _may_vanish(mean: Array, cosine: Array, sine: Array) -> NDArray[np.bool_]:
    """Return for which trials (n,) `mean + cosine * x + sine * y` is nearly zero for some x and y, by least squares.

    If x and y are determined, they must also be nearly a cosine and a sine.
    """
    # The normal equations of least squares, for each trial:  cc x + cs y = -cm,  cs x + ss y = -sm.
    cc = np.sum(cosine * cosine, axis=1)
    cs = np.sum(cosine * sine, axis=1)
    ss = np.sum(sine * sine, axis=1)
    cm = np.sum(cosine * mean, axis=1)
    sm = np.sum(sine * mean, axis=1)
    determinant = cc * ss - cs * cs
    determined = determinant > _SMALLEST_DETERMINANT_RATIO * cc * ss
    with np.errstate(all="ignore"):  # the quotients of the other case
        # if both parts are parallel, the larger one alone
        x_alone = np.where(cc >= ss, -cm / cc, 0.0)
        y_alone = np.where(cc >= ss, 0.0, -sm / ss)
        x = np.where(determined, (cs * sm - ss * cm) / determinant, x_alone)
        y = np.where(determined, (cs * cm - cc * sm) / determinant, y_alone)
    least = np.abs(mean + cosine * x[:, None] + sine * y[:, None]).max(axis=1)
    on_circle = np.abs(x**2 + y**2 - 1) <= _LARGEST_CIRCLE_ERROR
    return (least <= _LARGEST_SOUGHT_RESIDUAL) & (~determined | on_circle)
