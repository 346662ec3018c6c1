"""The fewest signs, zeros and places of joints with which a robot has the tool poses of rows.

A row has joint values q and a measured tool pose T_row. The fit is T_row = X T(q) Y, with the base frame X and the tool
frame Y of whoever measured, and these changes of the robot's joints:

    sign       the joint turns or slides the other way: a flip
    zero       its value is another one at the same posture: one number in m or rad
    place      its line is elsewhere on its parent link: six numbers

The remainder is what a fit leaves of the rows. The saturated fit has the places of all joints free: what it leaves is
only noise, or a wrong sign. Numbers of changes, flips included, are tried from one upward. For each, a linear estimate
of the remainder chooses the sets of zeros and places that are fitted. The first fit that leaves only noise is the
answer.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import combinations

import numpy as np

from twin.comparison.row_fit import RowState
from twin.comparison.row_noise import RowNoise
from twin.comparison.tool_motion import FRAME_UNKNOWNS, ChainMotion, JointChange
from twin.core.spatial import Array

_MAX_FLIPS = 2
"""Maximum number of joints that turn the other way."""

_MAX_CHANGES = 3
"""Maximum number of zeros and places of joints that are changed together."""

_FITTED_SIGN_SETS = 6
"""Number of the most promising sets of signs that are fitted."""

_FITTED_SINGLE_CHANGES = 6
"""Number of the most promising single changes that are fitted for each set of signs."""

_FITTED_CHANGE_SETS = 3
"""The same for sets of several changes."""

_DAMPING = 1e-12
"""Damping of the linear estimate, relative to the sum of squares of the derivatives: frames may be open in part."""

_SMALLEST_DEVIATION = 1e-15
"""Standard deviation in m or rad that stands for 0 in a quotient."""


def fewest_changes(
    noise: RowNoise, motion: ChainMotion, frames_alone: RowState, saturated: RowState
) -> tuple[RowState | None, RowState]:
    """Return (the fit with the fewest changes or None, the saturated fit with which its remainder is compared).

    Args:
        noise: what is more than noise, with the fit of the rows.
        motion: the chain of that fit.
        frames_alone: the fit of base and tool frame without changes.
        saturated: the saturated fit without flips.
    """
    search = _FewestChanges(noise, motion)
    if noise.accepts(saturated, saturated):
        # the fits of flips take long: one change without a flip needs none of them, as nothing can be fewer
        explained = search.first_accepted([frames_alone], saturated, max_changes=1)
        if explained is not None:
            return explained, saturated
    starts = search.sign_states(frames_alone)
    noise, saturated = noise.least_noisy(starts, saturated)
    if not noise.accepts(saturated, saturated):
        return None, saturated  # what remains with every joint free is no noise: fewer changes leave more
    # the noise may have another lever than that with which the starts were fitted
    refitted = []
    for state in starts:
        refitted.append(noise.fit.refined(state.signs, (), state.x))
    search = _FewestChanges(noise, motion)
    return search.first_accepted(refitted, saturated, max_changes=_MAX_FLIPS + _MAX_CHANGES), saturated


class _FewestChanges:
    """The search with the lever of one estimate of the noise; the arguments are those of `fewest_changes`."""

    def __init__(self, noise: RowNoise, motion: ChainMotion) -> None:
        self._noise = noise
        self._fit = noise.fit
        self._motion = motion

    def first_accepted(self, starts: Sequence[RowState], saturated: RowState, *, max_changes: int) -> RowState | None:
        """Return the fit with the fewest changes, flips included, that leaves only noise; None if `max_changes` do not.

        `starts` are fits of the frames alone, one for each set of signs.
        """
        possible = self._possible_changes()
        for cost in range(1, max_changes + 1):
            for state in starts:
                flips = int((state.signs < 0).sum())
                size = cost - flips
                if not 0 <= size <= _MAX_CHANGES:
                    continue
                for candidate in self._fits_by_estimate(state, possible, size):
                    if self._noise.accepts(candidate, saturated):
                        return self._with_fewest_values(candidate, saturated)
        return None

    def _possible_changes(self) -> list[JointChange]:
        """Return the zeros of the joints of which the rows have values, then the places of all joints."""
        changes = []
        for joint in np.flatnonzero(self._motion.has_values).tolist():
            changes.append(JointChange("zero", joint))
        for joint in range(self._motion.count):
            changes.append(JointChange("place", joint))
        return changes

    def sign_states(self, frames_alone: RowState) -> list[RowState]:
        """Return fits of the frames alone with the most promising sets of signs, first that without changes."""
        count = self._motion.count
        ranked: list[tuple[float, Array, Array]] = []
        driven = np.flatnonzero(self._motion.has_values)
        for flips in range(1, _MAX_FLIPS + 1):
            for chosen in combinations(driven, flips):
                signs = np.ones(count)
                signs[list(chosen)] = -1.0
                T = self._motion.poses(signs, np.zeros(count), {})
                x = self._fit.best_start(T, signs)
                cost = float((self._fit.residual(x, signs, ()) ** 2).sum())
                ranked.append((cost, signs, x))
        ranked.sort(key=lambda entry: entry[0])
        states = [frames_alone]
        for _, signs, x in ranked[:_FITTED_SIGN_SETS]:
            states.append(self._fit.refined(signs, (), x))
        return states

    def _fits_by_estimate(self, state: RowState, possible: Sequence[JointChange], size: int) -> Iterator[RowState]:
        """Yield fits with `size` changes, those with the smallest linear estimate of their remainder first."""
        if size == 0:
            yield state
            return
        derivatives = {}
        for change in possible:
            derivatives[change] = self._derivatives(state, change)
        estimates: list[tuple[float, int, tuple[JointChange, ...]]] = []
        for chosen in combinations(possible, size):
            joints = {change.joint for change in chosen}
            if len(joints) < size:
                continue
            derivatives_of_set = []
            value_count = 0
            for change in chosen:
                derivatives_of_set.append(derivatives[change])
                value_count += change.size
            remainder = _linear_remainder(state, derivatives_of_set)
            estimates.append((remainder, value_count, chosen))
        estimates.sort(key=lambda entry: entry[0])
        most = _FITTED_SINGLE_CHANGES if size == 1 else _FITTED_CHANGE_SETS
        # a place has six values, a zero one: of similar remainders the zero is the smaller change
        for _, value_count, chosen in sorted(estimates[:most], key=lambda entry: entry[1]):
            x = np.concatenate([state.x, np.zeros(value_count)])
            yield self._fit.refined(state.signs, chosen, x)

    def _derivatives(self, state: RowState, change: JointChange) -> Array:
        """Return the derivatives (rows * 3 or 6, values) of the remainder by the values of one change."""
        x = np.concatenate([state.x, np.zeros(change.size)])
        columns = np.arange(FRAME_UNKNOWNS, FRAME_UNKNOWNS + change.size)
        return self._fit.derivatives(x, state.signs, (change,), columns, state.r)

    def _with_fewest_values(self, state: RowState, saturated: RowState) -> RowState:
        """Return the fit with as few values as the noise allows: one after another is held at zero."""
        while True:
            fewer = self._with_one_held(state, saturated)
            if fewer is None:
                return state
            state = fewer

    def _with_one_held(self, state: RowState, saturated: RowState) -> RowState | None:
        """Return the fit with one more value of the changes held at zero; None if the noise allows none."""
        uncertainties = self._noise.uncertainties(state, saturated)
        # the unknowns of base and tool frame are always fitted
        values = []
        for k in np.flatnonzero(state.free):
            if k >= FRAME_UNKNOWNS:
                values.append(k)
        # first those that are smallest for what the rows say about them
        values.sort(key=lambda k: abs(state.x[k]) / max(uncertainties[k], _SMALLEST_DEVIATION))
        for k in values:
            free = state.free.copy()
            free[k] = False
            x = state.x.copy()
            x[k] = 0.0
            fewer = self._fit.refined(state.signs, state.changes, x, free)
            if self._noise.accepts(fewer, saturated):
                return fewer
        return None


def _linear_remainder(state: RowState, derivatives: Sequence[Array]) -> float:
    """Return the sum of squares that remains if frames and changes remove what they can, to first order.

    `derivatives` are those of each change, (rows * 3 or 6, values).
    """
    J = np.hstack([state.J, *derivatives])
    damping = _DAMPING * float((J**2).sum())
    normal = J.T @ J + damping * np.eye(J.shape[1])
    step = np.linalg.lstsq(normal, J.T @ state.r, rcond=None)[0]
    remainder = state.r - J @ step
    return float(remainder @ remainder)
