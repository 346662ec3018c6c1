"""Solve a mechanism with loops at the samples of a motion: some of them, the knots, in order, then all at once.

The knots determine the assembly mode. All other samples start from guesses that are interpolated between knots, and so
accurate that one or two iterations suffice.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from twin.core import spatial
from twin.core.errors import AssemblyError
from twin.core.progress import StepProgress
from twin.core.spatial import Array, Index
from twin.reference import loop_rates
from twin.reference.states import assembly_at
from twin.reference.target_continuation import GAP_TOLERANCE, MODE_JUMP, TargetContinuation

BLOCK = 1000
"""Number of states solved at once: a compromise between speed and memory."""

_KNOT_SAMPLES = 32
"""Maximum number of samples from one knot to the next."""

_KNOT_TRAVEL = 0.1
"""Maximum motion (m, rad) of the target between knots, so that interpolation stays in the assembly mode."""

_KNOTS_AT_ONCE = 32
"""Maximum number of knots that are solved together if the motion is predictable."""

_LARGEST_PREDICTION_ERROR = 0.2
"""Prediction error, relative to the step, above which knots are solved one by one."""

_NO_STEP = 1e-9
"""Step (m, rad) below which a prediction error is not divided by the step, but by this."""

_SLOPE_STEP = 1e-3
"""Part of the motion of one sample over which the slopes of the coordinates are taken by a central difference."""


def solved_along(
    continuation: TargetContinuation, targets: Array, start: Array, progress: StepProgress | None = None
) -> Array:
    """Return the states (k, nq) of all samples of a motion.

    Args:
        continuation: moves configurations of the mechanism to targets.
        targets: of the samples: joint values (k, n), or tool poses (k, 4, 4).
        start: configuration (nq,) from which the first sample is reached.
        progress: called with the fraction done.

    Raises:
        AssemblyError: the loops cannot be closed at a sample; the message names the sample.
    """
    knot_indices = knot_samples(targets)

    def solved_from(x: Array) -> Array:
        return _knots(continuation, knot_indices, targets, x, progress)

    if targets.ndim == 2:
        knots = continuation.in_turns(start, targets[0], solved_from)
    else:
        knots = solved_from(start)
    states = _guesses(continuation, knot_indices, knots, targets)
    samples = np.arange(len(targets))
    for block in np.array_split(samples, max(1, len(targets) // BLOCK)):
        solved, converged = continuation.move(states[block], targets[block])
        if not converged.all():
            first_open = int(np.argmin(converged))
            best = assembly_at(continuation.tree, solved[first_open])
            text = f"at sample {block[first_open]}: the solver did not converge"
            raise AssemblyError(text, best, best.worst_gap)
        states[block] = solved
        if progress is not None:
            # the knots are the first half of the work
            progress(0.5 + (block[-1] + 1) / len(targets) / 2)
    return states


def knot_samples(targets: Array) -> Index:
    """Return the indices of the knots (samples that are solved in order): the first, the last, and some between."""
    if len(targets) < 2:
        return np.zeros(len(targets), np.intp)
    change = np.abs(np.diff(targets, axis=0))
    largest = change.reshape(len(targets) - 1, -1).max(axis=1, initial=0.0)
    travel = np.concatenate([[0.0], np.cumsum(largest)])
    last = len(targets) - 1
    samples = [0]
    while samples[-1] < last:
        sample = samples[-1]
        farthest = int(np.searchsorted(travel, travel[sample] + _KNOT_TRAVEL, side="right")) - 1
        # at least the next sample, even if the target jumps
        farthest = max(farthest, sample + 1)
        samples.append(min(sample + _KNOT_SAMPLES, farthest, last))
    return np.array(samples)


def _knots(
    continuation: TargetContinuation, knot_indices: Index, targets: Array, start: Array, progress: StepProgress | None
) -> Array:
    """Return the states (j, nq) of samples `knot_indices`, solved in order; predictable ones are solved together."""
    knots = np.zeros((len(knot_indices), continuation.tree.model.nq))
    most = 1
    if targets.ndim == 2:
        most = _KNOTS_AT_ONCE  # only joint values have a tangent for predictions
    x = start
    solved = 0  # number of knots
    together = 1
    while solved < len(knot_indices):
        samples = knot_indices[solved : solved + together]
        X, is_valid = _knots_at_once(continuation, x, targets[samples])
        if is_valid.all():
            count = len(samples)
            together = min(2 * together, most)
        else:
            count = int(np.argmin(is_valid))
            together = max(1, count)
        if count == 0 and len(samples) == 1:
            # not even one knot in one step: sample by sample
            first = 0
            if solved:
                first = knot_indices[solved - 1] + 1
            X = _last_of(continuation, targets, range(first, samples[0] + 1), x)[None]
            count = 1
        if count:
            knots[solved : solved + count] = X[:count]
            x = X[count - 1]
            solved += count
        if progress is not None:
            progress(solved / len(knot_indices) / 2)
    return knots


def _last_of(continuation: TargetContinuation, targets: Array, samples: range, x: Array) -> Array:
    """Return the configuration (nq,) at the last of some samples, reached from x through all of them.

    Raises:
        AssemblyError: a sample cannot be reached; the message names it.
    """
    for sample in samples:
        try:
            x = continuation.reached(x, targets[sample])
        except AssemblyError as error:
            raise AssemblyError(f"at sample {sample}: {error}", error.best, error.gap) from error
    return x


def _knots_at_once(continuation: TargetContinuation, x: Array, targets: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Return (states (k, nq) at the targets, predicted from configuration x, (k,) bool: whether each is valid)."""
    guesses = x[None]
    if len(targets) > 1:
        guesses = _predicted(continuation, x, targets)
    X, converged = continuation.move(guesses, targets)
    before = np.concatenate([x[None], X[:-1]])
    steady = continuation.jumps(before, X) <= MODE_JUMP
    if len(targets) > 1:
        is_predicted = _prediction_errors(continuation, x, guesses, X) < _LARGEST_PREDICTION_ERROR
        steady = np.logical_and(steady, is_predicted)
    closed = continuation.misfits(X, targets) <= GAP_TOLERANCE
    return X, np.logical_and.reduce([converged, steady, closed])


def _predicted(continuation: TargetContinuation, x: Array, q: Array) -> Array:
    """Return first guesses (k, nq) for active joint values q (k, n), along the tangent at configuration x."""
    tree = continuation.tree
    gain = loop_rates.gains(tree, x[None])[0]
    change = q - x[tree.active_places]
    starts = np.tile(x, (len(q), 1))
    return tree.integrate(starts, change @ gain.T)


def _prediction_errors(continuation: TargetContinuation, x: Array, guesses: Array, X: Array) -> Array:
    """Return the prediction errors (k,) of states X (k, nq): distance from the guess, divided by distance from x."""
    error = continuation.jumps(guesses, X)
    step = continuation.jumps(np.tile(x, (len(X), 1)), X)
    return error / np.maximum(step, _NO_STEP)


def _guesses(continuation: TargetContinuation, knot_indices: Index, knots: Array, targets: Array) -> Array:
    """Return first guesses (k, nq) for all samples from the solved states `knots` (j, nq) at samples `knot_indices`.

    For driven motions, the constraint Jacobian gives the slopes of all joints from the slopes of the active joints.
    Where a bang-bang acceleration switches, the interpolated active joints have an error. This error is removed, and
    the Jacobian corrects the passive joints accordingly. One iteration then suffices for nearly all samples.
    """
    tree = continuation.tree
    if targets.ndim == 3 or len(knot_indices) < 2:
        slopes = np.zeros_like(knots)
        if len(knot_indices) > 1:
            slopes = np.gradient(knots, knot_indices.astype(float), axis=0)
        states = _interpolated(knot_indices, knots, slopes, len(targets))
        return tree.normalise(states)
    gain = loop_rates.gains(tree, knots)
    driven_rate = np.gradient(targets, axis=0)[knot_indices]
    rate = np.einsum("kij,kj->ki", gain, driven_rate)
    # central difference: the slope of a quaternion is not its velocity
    ahead = tree.integrate(knots, _SLOPE_STEP * rate)
    behind = tree.integrate(knots, -_SLOPE_STEP * rate)
    slopes = (ahead - behind) / (2 * _SLOPE_STEP)
    states = _interpolated(knot_indices, knots, slopes, len(targets))
    states = tree.normalise(states)
    midway = 0.5 * (knot_indices[1:] + knot_indices[:-1])
    nearest = np.searchsorted(midway, np.arange(len(targets)))
    deviation = targets - states[:, tree.active_places]
    correction = np.einsum("kij,kj->ki", gain[nearest], deviation)
    return tree.integrate(states, correction)


def _interpolated(knot_indices: Index, knots: Array, slopes: Array, count: int) -> Array:
    """Return rows 0 to count - 1 of cubic Hermite polynomials through `knots` at rows `knot_indices` with `slopes`."""
    if len(knot_indices) < 2:
        return np.tile(knots, (count, 1))
    row = np.arange(count)
    i = np.clip(np.searchsorted(knot_indices, row, side="right") - 1, 0, len(knot_indices) - 2)
    width = (knot_indices[i + 1] - knot_indices[i])[:, None].astype(float)
    s = (row - knot_indices[i])[:, None] / width
    return spatial.cubic(s, knots[i], knots[i + 1], slopes[i] * width, slopes[i + 1] * width)
