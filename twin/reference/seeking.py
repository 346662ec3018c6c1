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

_ITERATIONS = 40
_STRIDE, _STRIDE_LONGEST = 0.1, 0.5
"""Initial and largest tangent step (rad, or units of `LENGTH_SCALE`)."""

_NEAR = 0.2
"""Distance from degeneracy (1 at usual states) below which the steps of a walk are turned away from a singularity."""

_SHORTEST = 1e-5
"""Tangent step (rad, or units of `LENGTH_SCALE`) below which a walk ends."""

_DIFFERENCE = 1e-5
"""Tangent step (rad, or units of `LENGTH_SCALE`) of the difference quotients."""

_ZERO = 1e-10
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
    w, nv = np.arange(len(X)), motions.model.tree.model.nv
    m, unit = values(X)[w, row], size[row]
    first = np.array([i == 0 or r != row[i - 1] for i, r in enumerate(row)])
    weight = np.where(first[:, None], 1.0, 10 ** rng.uniform(-1.5, 1.5, (len(X), nv)))
    stride, slope = np.full(len(X), _STRIDE), np.full(len(X), np.nan)
    ended = np.full(len(X), "far", dtype="<U5")
    ended[np.abs(m) <= _ZERO * unit] = "zero"
    todo = np.flatnonzero((ended == "far") & np.isfinite(m))
    ways = np.zeros((len(X), nv))  # tangent step to the predicted zero of the function
    fresh = np.ones(len(X), bool)
    for _ in range(_ITERATIONS):
        if not len(todo):
            break
        new = todo[fresh[todo]]
        if len(new):
            ways[new], slope[new] = _newton(motions, values, X[new], row[new], m[new], weight[new], aside[new])
            fresh[new] = False
        step = ways[todo].copy()
        long = np.linalg.norm(step / motions.scale, axis=1)
        step *= (np.minimum(long, stride[todo]) / np.maximum(long, 1e-300))[:, None]
        there, closed = motions.moved(X[todo], step)
        found = values(there)[np.arange(len(todo)), row[todo]]
        better = closed & (np.abs(found) < np.abs(m[todo]) * (1 - 1e-6))
        asked = better & ~(np.abs(found) < 1e-3 * unit[todo])
        better[asked] = valid(there[asked])
        good, bad = todo[better], todo[~better]
        X[good], m[good], fresh[good] = there[better], found[better], True
        stride[good] = np.minimum(2 * stride[good], _STRIDE_LONGEST)
        stride[bad] = np.minimum(stride[bad], long[~better]) / 3
        zero = np.abs(m[todo]) <= _ZERO * unit[todo]
        short = stride[todo] < _SHORTEST
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
    d *= (-m / np.maximum(np.sum(g * d, axis=1), 1e-300))[:, None]
    d *= np.minimum(1, _STRIDE_LONGEST / np.maximum(np.linalg.norm(d, axis=1), 1e-300))[:, None]
    d[aside] = _around(motions, X[aside], N[aside], g[aside] / m[aside][:, None], d[aside])
    return np.einsum("kij,kj->ki", N, d), np.linalg.norm(g, axis=1)


def _around(motions: Degeneracy, X: Array, N: Array, slopes: Array, steps: Array) -> Array:
    """Return steps (w, freedom) modified to avoid singularities at which the function does not vanish.

    X (w, nq) are states and N (w, nv, freedom) the motions there; `slopes` (w, freedom) is the gradient of the
    logarithm of the function; `steps` (w, freedom) are the original steps.
    """
    near = np.flatnonzero(motions.of(X).min(axis=1) < _NEAR)
    if not len(near):
        return steps

    def least(Y: Array) -> Array:
        return np.log(np.maximum(motions.of(Y).min(axis=1), 1e-12))[:, None]

    h = gradient(motions, least, X[near], N[near], np.zeros(len(near), np.intp))
    away = h / np.maximum(np.linalg.norm(h, axis=1), 1e-300)[:, None]
    other = np.linalg.norm(h, axis=1) > 3 * np.linalg.norm(slopes[near], axis=1)
    c = steps[near]
    into = np.sum(c * away, axis=1)
    push = np.where(other, 0.2 * np.linalg.norm(c, axis=1) - np.minimum(into, 0), 0.0)
    out = steps.copy()
    out[near] = c + push[:, None] * away
    return out


def gradient(motions: Degeneracy, values: Values, X: Array, N: Array, row: Index) -> Array:
    """Return gradients (w, freedom) of functions `row` (w,) along motions N (w, nv, freedom) at states X (w, nq)."""
    tree = motions.model.tree
    w, nv, f = N.shape
    steps = np.swapaxes(N, 1, 2).reshape(w * f, nv) * _DIFFERENCE
    around = np.repeat(X, f, axis=0)
    both = np.concatenate([tree.integrate(around, steps), tree.integrate(around, -steps)])
    found = values(both)[np.arange(2 * w * f), np.tile(np.repeat(row, f), 2)]
    return ((found[: w * f] - found[w * f :]) / (2 * _DIFFERENCE)).reshape(w, f)


def wander(motions: Degeneracy, valid: Valid, starts: Array) -> Array:
    """Return states (m, nq) reached from starts (w, nq) by random walks, which change direction when blocked.

    A walk of 10 steps visits only states that are `valid` and have closed loops.
    """
    rng = np.random.default_rng(0)
    X = starts.copy()
    nv = motions.model.tree.model.nv
    ahead = rng.standard_normal((len(X), nv)) * motions.scale
    out = []
    for _ in range(10):
        N = motions.motions(X)
        along = np.einsum("kij,klj,kl->ki", N, N / motions.scale[:, None] ** 2, ahead)
        along *= (_STRIDE_LONGEST / 2 / np.maximum(np.linalg.norm(along / motions.scale, axis=1), 1e-300))[:, None]
        there, closed = motions.moved(X, along)
        good = closed & valid(there)
        X[good], ahead[good] = there[good], along[good]
        ahead[~good] = rng.standard_normal((int(np.sum(~good)), nv)) * motions.scale
        out.append(there[good])
    return np.concatenate(out)
