"""Find states of a mechanism at which a function vanishes, by many walks: sequences of Newton steps."""

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
"""Initial tangent step (rad, or units of `LENGTH_SCALE`)."""

_LONGEST_STEP = 0.5
"""Largest tangent step (rad, or units of `LENGTH_SCALE`)."""

_SINGULARITY_DISTANCE = 0.2
"""Distance from degeneracy (1 at usual states) below which the steps of a walk are turned away from a singularity."""

_SHORTEST_STEP = 1e-5
"""Tangent step (rad, or units of `LENGTH_SCALE`) below which a walk ends."""

_DIFFERENCE_STEP = 1e-5
"""Tangent step (rad, or units of `LENGTH_SCALE`) of the difference quotients."""

_ZERO_SHARE = 1e-10
"""Fraction of the usual size below which a value counts as zero."""

NEARLY = 1e-4
"""Fraction of the usual size below which a minimum counts as a zero (some measures touch 0 without a sign change)."""


@dataclass(frozen=True)
class Walks:
    """Ends of w walks.

    Attributes:
        row: (w,) index of the function that each walk follows.
        states: (w, nq) last states.
        value: (w,) values of the function at the last states.
        slope: (w,) norm of the function's gradient at the last accepted state with a computed gradient.
        ended: (w,) "zero" (at a zero), "least" (at a minimum) or "far" (stopped elsewhere).
    """

    row: Index
    states: Array
    value: Array
    slope: Array
    ended: np.ndarray


def seek(
    motions: Degeneracy,
    values: Values,
    valid: Valid,
    starts: Array,
    row: Index,
    aside: Mask,
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
        aside: (w,) bool, whether the walk avoids singularities where its function does not vanish.
        size: (rows,) usual size of each function.
        seed: seed of the random metrics.
    """
    rng = np.random.default_rng(seed)
    X = starts.copy()
    count = len(X)
    nv = motions.model.tree.model.nv
    unit = size[row]
    m = values(X)[np.arange(count), row]
    # the first walk of each function has the usual metric
    first = np.ones(count, bool)
    first[1:] = row[1:] != row[:-1]
    random_weight = 10 ** rng.uniform(-1.5, 1.5, (count, nv))
    weight = np.where(first[:, None], 1.0, random_weight)
    stride = np.full(count, _FIRST_STEP)
    slope = np.full(count, np.nan)
    ended = np.full(count, "far", dtype="<U5")
    ended[np.abs(m) <= _ZERO_SHARE * unit] = "zero"
    todo = np.flatnonzero((ended == "far") & np.isfinite(m))
    newton = np.zeros((count, nv))  # tangent step to the predicted zero of the function
    fresh = np.ones(count, bool)  # whether `newton` is missing at the state
    for _ in range(_MOST_STEPS):
        if not len(todo):
            break
        new = todo[fresh[todo]]
        if len(new):
            newton[new], slope[new] = _newton(motions, values, X[new], row[new], m[new], weight[new], aside[new])
            fresh[new] = False
        step = newton[todo].copy()
        length = np.linalg.norm(step / motions.scale, axis=1)
        shortening = np.minimum(length, stride[todo]) / np.maximum(length, 1e-300)
        step *= shortening[:, None]
        ends, closed = motions.moved(X[todo], step)
        end_values = values(ends)[np.arange(len(todo)), row[todo]]
        better = closed & (np.abs(end_values) < np.abs(m[todo]) * (1 - 1e-6))
        # near a zero, a state need not be valid: there, the function itself may be singular
        tested = better & ~(np.abs(end_values) < 1e-3 * unit[todo])
        better[tested] = valid(ends[tested])
        improved = todo[better]
        bad = todo[~better]
        X[improved] = ends[better]
        m[improved] = end_values[better]
        fresh[improved] = True
        stride[improved] = np.minimum(2 * stride[improved], _LONGEST_STEP)
        stride[bad] = np.minimum(stride[bad], length[~better]) / 3
        zero = np.abs(m[todo]) <= _ZERO_SHARE * unit[todo]
        short = stride[todo] < _SHORTEST_STEP
        ended[todo[short]] = "least"
        ended[todo[zero]] = "zero"
        todo = todo[~zero & ~short]
    ended[np.abs(m) <= NEARLY * unit] = "zero"
    return Walks(row, X, m, slope, ended)


def _newton(
    motions: Degeneracy, values: Values, X: Array, row: Index, m: Array, weight: Array, aside: Mask
) -> tuple[Array, Array]:
    """Return tangent steps (w, nv) to the predicted zeros of the functions `row`, and the slopes (w,) of the functions.

    `m` (w,) are the values of the functions at the states X (w, nq); `weight` (w, nv) is the metric of the velocities.
    """
    N = motions.motions(X)
    g = np.nan_to_num(gradient(motions, values, X, N, row))
    metric = np.swapaxes(N, 1, 2) @ (weight[:, :, None] * N)
    d = np.linalg.solve(metric, g[..., None])[..., 0]
    # along d, to where the linear function vanishes; but no farther than the longest stride
    slope = np.maximum(np.sum(g * d, axis=1), 1e-300)
    d *= (-m / slope)[:, None]
    length = np.maximum(np.linalg.norm(d, axis=1), 1e-300)
    d *= np.minimum(1, _LONGEST_STEP / length)[:, None]
    logarithmic = g[aside] / m[aside][:, None]
    d[aside] = _around(motions, X[aside], N[aside], logarithmic, d[aside])
    return np.einsum("kij,kj->ki", N, d), np.linalg.norm(g, axis=1)


def _around(motions: Degeneracy, X: Array, N: Array, slopes: Array, steps: Array) -> Array:
    """Return steps (w, freedom) modified to avoid singularities at which the function does not vanish.

    X (w, nq) are states and N (w, nv, freedom) the motions there; `slopes` (w, freedom) is the gradient of the
    logarithm of the function; `steps` (w, freedom) are the original steps.
    """
    near = np.flatnonzero(motions.of(X).min(axis=1) < _SINGULARITY_DISTANCE)
    if not len(near):
        return steps

    def distance(Y: Array) -> Array:
        smallest = motions.of(Y).min(axis=1)
        return np.log(np.maximum(smallest, 1e-12))[:, None]

    h = gradient(motions, distance, X[near], N[near], np.zeros(len(near), np.intp))
    steepness = np.linalg.norm(h, axis=1)
    away = h / np.maximum(steepness, 1e-300)[:, None]
    # if the function vanishes at the singularity, both logarithms have about the same slope
    other = steepness > 3 * np.linalg.norm(slopes[near], axis=1)
    c = steps[near]
    into = np.sum(c * away, axis=1)
    outwards = 0.2 * np.linalg.norm(c, axis=1) - np.minimum(into, 0)
    push = np.where(other, outwards, 0.0)
    modified = steps.copy()
    modified[near] = c + push[:, None] * away
    return modified


def gradient(motions: Degeneracy, values: Values, X: Array, N: Array, row: Index) -> Array:
    """Return gradients (w, freedom) of functions `row` (w,) along motions N (w, nv, freedom) at states X (w, nq)."""
    tree = motions.model.tree
    w, nv, f = N.shape
    count = w * f
    steps = np.swapaxes(N, 1, 2).reshape(count, nv) * _DIFFERENCE_STEP
    centres = np.repeat(X, f, axis=0)
    ahead = tree.integrate(centres, steps)
    behind = tree.integrate(centres, -steps)
    both = np.concatenate([ahead, behind])
    rows = np.tile(np.repeat(row, f), 2)
    both_values = values(both)[np.arange(2 * count), rows]
    slopes = (both_values[:count] - both_values[count:]) / (2 * _DIFFERENCE_STEP)
    return slopes.reshape(w, f)


def wander(motions: Degeneracy, valid: Valid, starts: Array) -> Array:
    """Return states (m, nq) reached from starts (w, nq) by random walks, which change direction when blocked.

    A walk of 10 steps visits only states that are `valid` and have closed loops.
    """
    rng = np.random.default_rng(0)
    X = starts.copy()
    nv = motions.model.tree.model.nv
    scale = motions.scale
    ahead = rng.standard_normal((len(X), nv)) * scale
    visited = []
    for _ in range(10):
        N = motions.motions(X)
        # the part of the direction that the mechanism can follow
        along = np.einsum("kij,klj,kl->ki", N, N / scale[:, None] ** 2, ahead)
        length = np.maximum(np.linalg.norm(along / scale, axis=1), 1e-300)
        along *= (_LONGEST_STEP / 2 / length)[:, None]
        ends, closed = motions.moved(X, along)
        is_valid = closed & valid(ends)
        X[is_valid] = ends[is_valid]
        ahead[is_valid] = along[is_valid]
        blocked = int(np.sum(~is_valid))
        ahead[~is_valid] = rng.standard_normal((blocked, nv)) * scale
        visited.append(ends[is_valid])
    return np.concatenate(visited)
