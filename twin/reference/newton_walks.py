"""Find states of a mechanism at which a function vanishes, by many walks: sequences of Newton steps.

A step leads along the motions that keep the loops closed, down the gradient of the function in the metric of the walk,
to where the function would vanish if it were linear. A step that does not decrease the function, or ends in a state
that is not valid, is repeated with a third of its length; one that does is followed by steps of up to twice the length.
A walk ends at a zero, at a minimum (its steps have become too short), or after its last step.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from twin.core.spatial import Array, Index
from twin.reference.degeneracy import Degeneracy

Values = Callable[[Array], Array]
"""Functions whose zeros are searched: states (k, nq) -> values (k, rows)."""

Mask = NDArray[np.bool_]

Valid = Callable[[Array], Mask]
"""Test of states (k, nq) -> (k,) bool: whether the functions `Values` are valid in each state."""

_MOST_STEPS = 40
"""Maximum number of steps of a walk."""

_FIRST_STEP = 0.1
"""Initial tangent step (rad, or units of `loops.LENGTH_SCALE`)."""

_LONGEST_STEP = 0.5
"""Largest tangent step (rad, or units of `loops.LENGTH_SCALE`)."""

_SINGULARITY_DISTANCE = 0.2
"""Distance from degeneracy (1 at usual states) below which the steps of a walk are turned away from a singularity."""

_SHORTEST_STEP = 1e-5
"""Tangent step (rad, or units of `loops.LENGTH_SCALE`) below which a walk ends."""

_DIFFERENCE_STEP = 1e-5
"""Tangent step (rad, or units of `loops.LENGTH_SCALE`) of the difference quotients."""

_ZERO_SHARE = 1e-10
"""Fraction of the usual size below which a value counts as zero."""

_NEAR_ZERO_SHARE = 1e-3
"""Fraction of the usual size below which a state need not be valid; the function may be singular near its zero."""

_SMALLEST_DECREASE = 1e-6
"""Relative decrease of a value below which a step does not count as progress."""

_LARGEST_WEIGHT_EXPONENT = 1.5
"""Largest power of 10 of the random weights of coordinates; the smallest is its negative."""

_AWAY_SHARE = 0.2
"""Part of the length of a step that leads away from a singularity, if the walk is turned away from it."""

_STEEPNESS_RATIO = 3.0
"""Ratio of the logarithmic slopes of the distance from a singularity and of the function, above which the function does
not vanish at the singularity; where it vanishes, the two are about equal."""

_TINY = 1e-300
"""Length or rate that stands for 0 in a quotient."""

_SMALLEST_DISTANCE = 1e-12
"""Smallest distance from degeneracy of which a logarithm is taken."""

NEARLY_ZERO_SHARE = 1e-4
"""Fraction of the usual size below which a minimum counts as a zero (some measures touch 0 without a sign change)."""


@dataclass(frozen=True)
class Walks:
    """Ends of w walks.

    Attributes:
        row: (w,) index of the function that each walk follows.
        states: (w, nq) last states.
        value: (w,) values of the function at the last states.
        gradient_norm: (w,) norm of the function's gradient at the last accepted state with a computed gradient.
        ended: (w,) "zero" (at a zero), "least" (at a minimum) or "far" (stopped elsewhere).
    """

    row: Index
    states: Array
    value: Array
    gradient_norm: Array
    ended: np.ndarray


def walk_to_zeros(
    motions: Degeneracy,
    values: Values,
    valid: Valid,
    starts: Array,
    row: Index,
    avoids_singularity: Mask,
    size: Array,
    seed: int = 0,
) -> Walks:
    """Walk from w states to zeros of functions; return the ends of the walks.

    All walks that follow the same function, except the first of them, have different random metrics (weights of the
    coordinates). They therefore take different paths and do not all stop at the same state.

    Args:
        motions: motions of the mechanism.
        values: the functions.
        valid: test whether the functions are valid; walks stay in valid states, except near a zero.
        starts: (w, nq) start states.
        row: (w,) index of the function that each walk follows.
        avoids_singularity: (w,) bool, whether the walk avoids singularities where its function does not vanish.
        size: (rows,) usual size of each function.
        seed: seed of the random metrics.
    """
    states = starts.copy()
    count = len(states)
    nv = motions.model.tree.model.nv
    usual_size = size[row]
    value = values(states)[np.arange(count), row]
    weight = _weights(row, nv, seed)
    stride = np.full(count, _FIRST_STEP)
    gradient_norm = np.full(count, np.nan)
    ended = np.full(count, "far", dtype="<U5")
    ended[np.abs(value) <= _ZERO_SHARE * usual_size] = "zero"
    walking = np.flatnonzero((ended == "far") & np.isfinite(value))
    newton = np.zeros((count, nv))  # tangent step to the predicted zero of the function
    is_new = np.ones(count, bool)  # whether `newton` is missing at the state
    for _ in range(_MOST_STEPS):
        if not len(walking):
            break
        new = walking[is_new[walking]]
        if len(new):
            newton[new], gradient_norm[new] = _newton_steps(
                motions,
                values,
                states[new],
                row[new],
                value=value[new],
                weight=weight[new],
                avoids_singularity=avoids_singularity[new],
            )
            is_new[new] = False
        step = newton[walking].copy()
        length = np.linalg.norm(step / motions.scale, axis=1)
        shortening = np.minimum(length, stride[walking]) / np.maximum(length, _TINY)
        step *= shortening[:, None]
        ends, closed = motions.moved(states[walking], step)
        end_value = values(ends)[np.arange(len(walking)), row[walking]]
        better = closed & (np.abs(end_value) < np.abs(value[walking]) * (1 - _SMALLEST_DECREASE))
        tested = better & ~(np.abs(end_value) < _NEAR_ZERO_SHARE * usual_size[walking])
        better[tested] = valid(ends[tested])
        improved = walking[better]
        blocked = walking[~better]
        states[improved] = ends[better]
        value[improved] = end_value[better]
        is_new[improved] = True
        stride[improved] = np.minimum(2 * stride[improved], _LONGEST_STEP)
        stride[blocked] = np.minimum(stride[blocked], length[~better]) / 3
        is_zero = np.abs(value[walking]) <= _ZERO_SHARE * usual_size[walking]
        is_short = stride[walking] < _SHORTEST_STEP
        ended[walking[is_short]] = "least"
        ended[walking[is_zero]] = "zero"
        walking = walking[~is_zero & ~is_short]
    ended[np.abs(value) <= NEARLY_ZERO_SHARE * usual_size] = "zero"
    return Walks(row, states, value, gradient_norm, ended)


def _weights(row: Index, nv: int, seed: int) -> Array:
    """Return the metrics (w, nv): weights 1 for the first walk of each function, random weights for its other walks."""
    rng = np.random.default_rng(seed)
    is_first = np.ones(len(row), bool)
    is_first[1:] = row[1:] != row[:-1]
    random_weight = 10 ** rng.uniform(-_LARGEST_WEIGHT_EXPONENT, _LARGEST_WEIGHT_EXPONENT, (len(row), nv))
    return np.where(is_first[:, None], 1.0, random_weight)


def _newton_steps(
    motions: Degeneracy,
    values: Values,
    states: Array,
    row: Index,
    *,
    value: Array,
    weight: Array,
    avoids_singularity: Mask,
) -> tuple[Array, Array]:
    """Return tangent steps (w, nv) to predicted zeros of the functions `row`, and the norms (w,) of their gradients.

    `value` (w,) are the values of the functions at the states (w, nq); `weight` (w, nv) is the metric of the
    velocities.
    """
    N = motions.motions(states)
    gradient = np.nan_to_num(_gradients(motions, values, states, N, row))
    metric = np.swapaxes(N, 1, 2) @ (weight[:, :, None] * N)
    direction = np.linalg.solve(metric, gradient[..., None])[..., 0]
    # along the direction, to where the linear function vanishes; but no farther than the longest stride
    rate = np.maximum(np.sum(gradient * direction, axis=1), _TINY)
    step = direction * (-value / rate)[:, None]
    length = np.maximum(np.linalg.norm(step, axis=1), _TINY)
    step *= np.minimum(1, _LONGEST_STEP / length)[:, None]
    turned = np.flatnonzero(avoids_singularity)
    log_gradient = gradient[turned] / value[turned][:, None]
    step[turned] = _turn_from_singularities(motions, states[turned], N[turned], log_gradient, step[turned])
    return np.einsum("kij,kj->ki", N, step), np.linalg.norm(gradient, axis=1)


def _turn_from_singularities(motions: Degeneracy, states: Array, N: Array, log_gradient: Array, steps: Array) -> Array:
    """Return steps (w, freedom) modified to avoid singularities at which the function does not vanish.

    N (w, nv, freedom) are the motions at the states (w, nq); `log_gradient` (w, freedom) is the gradient of the
    logarithm of the function; `steps` (w, freedom) are the original steps.
    """
    near_rows = np.flatnonzero(motions.of(states).min(axis=1) < _SINGULARITY_DISTANCE)
    if not len(near_rows):
        return steps

    def log_distance(states: Array) -> Array:
        smallest = motions.of(states).min(axis=1)
        return np.log(np.maximum(smallest, _SMALLEST_DISTANCE))[:, None]

    only_row = np.zeros(len(near_rows), np.intp)
    distance_gradient = _gradients(motions, log_distance, states[near_rows], N[near_rows], only_row)
    steepness = np.linalg.norm(distance_gradient, axis=1)
    away = distance_gradient / np.maximum(steepness, _TINY)[:, None]
    does_not_vanish = steepness > _STEEPNESS_RATIO * np.linalg.norm(log_gradient[near_rows], axis=1)
    step = steps[near_rows]
    step_away = np.sum(step * away, axis=1)
    missing = _AWAY_SHARE * np.linalg.norm(step, axis=1) - np.minimum(step_away, 0)
    push = np.where(does_not_vanish, missing, 0.0)
    modified = steps.copy()
    modified[near_rows] = step + push[:, None] * away
    return modified


def _gradients(motions: Degeneracy, values: Values, states: Array, N: Array, row: Index) -> Array:
    """Return gradients (w, freedom) of functions `row` (w,) along motions N (w, nv, freedom) at states (w, nq)."""
    tree = motions.model.tree
    w, nv, freedom = N.shape
    count = w * freedom
    steps = np.swapaxes(N, 1, 2).reshape(count, nv) * _DIFFERENCE_STEP
    centres = np.repeat(states, freedom, axis=0)
    ahead = tree.integrate(centres, steps)
    behind = tree.integrate(centres, -steps)
    shifted = np.concatenate([ahead, behind])
    rows = np.tile(np.repeat(row, freedom), 2)
    shifted_values = values(shifted)[np.arange(2 * count), rows]
    quotients = (shifted_values[:count] - shifted_values[count:]) / (2 * _DIFFERENCE_STEP)
    return quotients.reshape(w, freedom)
