"""Whether what remains of rows of poses is noise: of what the rows state, or else of what no change removes.

Sums of squares in units of the noise follow a chi-square distribution; ratios of two of them, where the noise is
estimated from the same rows, an F distribution. A remainder is noise unless its probability is very small.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.special import chdtr, chdtrc, fdtrc

from twin.comparison.fit_problem import ANGLE_PER_LENGTH
from twin.comparison.row_fit import RowFit, RowState
from twin.comparison.tool_motion import ChainMotion, JointChange
from twin.core.spatial import Array

_SIGNIFICANCE = 1e-4
"""Probability of the remainder under noise alone below which it is no noise."""

_LARGEST_NOISE = 2e-3
"""Standard deviation of a coordinate in m above which an estimate is no noise: no few changes explain the rows."""

_FEWEST_FREEDOMS = 6
"""Fewest numbers of the rows beyond the unknowns with which noise is estimated."""

_RANK_RATIO = 1e-9
"""Size of a singular value of the normal matrix, relative to its trace, below which a direction is open."""

_SUM_TOLERANCE = 1e-9
"""Relative difference of two sums of squares that is only rounding."""

_MUCH_SMALLER_RATIO = 0.5
"""Ratio of two standard deviations from which the smaller one belongs to other signs, not to chance."""


class Saturation(NamedTuple):
    """What a fit with every joint free says about the noise of rows.

    Attributes:
        noise: the noise, with a fit whose lever is that of both states.
        state: the fit without the further unknowns.
        saturated: the fit with every joint free.
    """

    noise: RowNoise
    state: RowState
    saturated: RowState


class RowNoise:
    """The noise of rows of poses, and what is more than noise.

    Attributes:
        fit: the rows and their fit.
        tolerance: largest distance in m that is no difference.
        stated: whether the table states the noise; else it is estimated from the rows.
    """

    def __init__(self, fit: RowFit, tolerance: float) -> None:
        self.fit = fit
        self.tolerance = tolerance
        self.stated = fit.rows.noise[0] is not None

    def is_within_tolerance(self, state: RowState) -> bool:
        """Return whether the largest remainder is within the tolerance, and its angle."""
        shifts, turns = self.fit.shifts_and_turns(state.x, state.signs, state.changes)
        distance = float(np.linalg.norm(shifts, axis=1).max())
        angle = float(np.linalg.norm(turns, axis=1).max())
        return distance <= self.tolerance and angle <= ANGLE_PER_LENGTH * self.tolerance

    def agrees(self, frames_alone: RowState, saturated: RowState | None) -> bool:
        """Return whether the remainder of the two frames alone is within the tolerance or the noise."""
        if self.is_within_tolerance(frames_alone):
            return True
        if self.stated:
            return self._is_stated_noise(frames_alone, saturated)
        if saturated is None or self.fit.rows.computed:
            return False
        return self._is_noise(frames_alone, saturated)

    def accepts(self, state: RowState, saturated: RowState) -> bool:
        """Return whether the remainder of a fit is within the tolerance or the noise."""
        return self.is_within_tolerance(state) or self._is_noise(state, saturated)

    # -- estimate -------------------------------------------------------------------------------------

    def saturated(self, state: RowState) -> Saturation | None:
        """Return the fit with every joint free, with each kind of remainder in units of its own noise.

        None without a chain, or with too few rows. If the rows show their noise, the lever is the ratio of its two
        kinds, and `state` is fitted once more with it.
        """
        motion = self.fit.motion
        if not isinstance(motion, ChainMotion):
            return None
        # with every place free, only noise is left of the residual
        changes = []
        for joint in range(motion.count):
            changes.append(JointChange("place", joint))
        x = np.concatenate([state.x, np.zeros(6 * motion.count)])
        saturated = self.fit.refined(state.signs, tuple(changes), x)
        if self.freedoms(saturated) < _FEWEST_FREEDOMS:
            return None
        if self.stated or self.fit.rows.computed or not self.fit.rows.rotations:
            return Saturation(self, state, saturated)
        sigma, sigma_angle = self._remaining_deviations(saturated)
        if sigma == 0 or sigma_angle == 0:
            return Saturation(self, state, saturated)
        fit = RowFit(self.fit.rows, motion, sigma / sigma_angle)
        saturated = fit.refined(saturated.signs, saturated.changes, saturated.x)
        refitted = fit.refined(state.signs, state.changes, state.x)
        return Saturation(RowNoise(fit, self.tolerance), refitted, saturated)

    def least_noisy(self, states: Sequence[RowState], saturated: RowState) -> tuple[RowNoise, RowState]:
        """Return (noise, fit with every joint free) of the least noise, among signs that leave less than the first.

        `states` are fits of the frames alone, one for each set of signs; `saturated` belongs to the first. With a wrong
        sign, no places of joints leave only noise: it would be estimated far too large.
        """
        first = states[0]
        best_noise = self
        best = saturated
        least, _ = self._remaining_deviations(saturated)
        for state in states[1:]:
            if state.sse >= first.sse:
                continue
            candidate = best_noise.saturated(state)
            if candidate is None:
                continue
            deviation, _ = self._remaining_deviations(candidate.saturated)
            if deviation < _MUCH_SMALLER_RATIO * least:
                best_noise = candidate.noise
                best = candidate.saturated
                least = deviation
        return best_noise, best

    def standard_deviations(self, saturated: RowState | None) -> tuple[float, float] | None:
        """Return the noise in m and rad that the table states, or else that the rows show; None without an estimate."""
        if self.stated:
            return self.fit.scale, self.fit.scale / self.fit.lever
        if saturated is None or self.fit.rows.computed:
            return None
        return self._remaining_deviations(saturated)

    def _remaining_deviations(self, saturated: RowState) -> tuple[float, float]:
        """Return the standard deviations of a coordinate in m and of an angle in rad that a fit leaves."""
        shifts, turns = self.fit.shifts_and_turns(saturated.x, saturated.signs, saturated.changes)
        share = self.freedoms(saturated) / len(saturated.r)
        sigma = float(np.sqrt((shifts**2).mean() / share))
        sigma_angle = float(np.sqrt((turns**2).mean() / share))
        return sigma, sigma_angle

    def uncertainties(self, state: RowState, saturated: RowState) -> Array:
        """Return the standard deviations (unknowns,) of the fitted values in m and rad; 0 for those that are held."""
        variance = 1.0
        if not self.stated or self._is_overstated(saturated):
            variance = saturated.sse / max(self.freedoms(saturated), 1)
        covariance = np.linalg.pinv(state.J.T @ state.J, rcond=1e-12) * variance
        uncertainties = np.zeros(len(state.x))
        uncertainties[state.free] = np.sqrt(np.maximum(np.diag(covariance), 0.0))
        return uncertainties

    # -- tests ----------------------------------------------------------------------------------------

    def freedoms(self, state: RowState) -> int:
        """Return by how much the rows have more numbers than the fit has unknowns that they determine."""
        return len(state.r) - self._rank(state)

    @staticmethod
    def _rank(state: RowState) -> int:
        """Return the number of unknowns that the rows determine."""
        normal = state.J.T @ state.J
        return int(np.linalg.matrix_rank(normal, tol=_RANK_RATIO * float((state.J**2).sum())))

    def _is_noise(self, state: RowState, saturated: RowState) -> bool:
        """Return whether the remainder is not significantly larger than with every joint free."""
        if self.stated:
            return self._is_stated_noise(state, saturated)
        if self._remaining_deviations(saturated)[0] > _LARGEST_NOISE:
            return False
        return self._is_estimated_noise(state, saturated)

    def _is_estimated_noise(self, state: RowState, saturated: RowState) -> bool:
        """Return whether the remainder is not significantly larger than with every joint free: that is noise.

        An F test of nested models: what the further unknowns remove, against what they leave.
        """
        if state is saturated:  # it is what the noise was estimated from
            return True
        further_unknowns = self._rank(saturated) - self._rank(state)
        freedoms = self.freedoms(saturated)
        if further_unknowns <= 0 or saturated.sse <= 0:
            return state.sse <= saturated.sse * (1 + _SUM_TOLERANCE)
        removed = max(state.sse - saturated.sse, 0.0) / further_unknowns
        F = removed / (saturated.sse / freedoms)
        return float(fdtrc(further_unknowns, freedoms, F)) > _SIGNIFICANCE

    def _is_stated_noise(self, state: RowState, saturated: RowState | None) -> bool:
        """Return whether the stated noise explains the remainder, and all that free joints would take from it.

        The whole remainder of many rows hides an error of one number, which only few of its freedoms show.
        """
        if float(chdtrc(self.freedoms(state), state.sse)) <= _SIGNIFICANCE:
            return False
        if saturated is None or state is saturated:
            return True
        if self._is_overstated(saturated):
            return self._is_estimated_noise(state, saturated)
        further_unknowns = self._rank(saturated) - self._rank(state)
        if further_unknowns <= 0:
            return True
        removed = max(state.sse - saturated.sse, 0.0)
        return float(chdtrc(further_unknowns, removed)) > _SIGNIFICANCE

    def _is_overstated(self, saturated: RowState) -> bool:
        """Return whether the rows have far less noise than the table states."""
        return float(chdtr(self.freedoms(saturated), saturated.sse)) < _SIGNIFICANCE
