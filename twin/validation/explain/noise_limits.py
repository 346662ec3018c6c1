"""Judge rows if the CAD is noisy: compute the differences that noise of its features causes in each row.

The features are given further random errors of the size that the gaps of the joints show. For small errors, a row
changes as much by the further errors as it differs by those in the CAD.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from twin.cad import frames
from twin.cad.build import CadModel
from twin.cad.noise import Noise, with_noise
from twin.core.spatial import Array
from twin.reference import ReferenceModel
from twin.reference.newton import minimise
from twin.validation.explain.reference_values import symbol_values
from twin.validation.explain.row_deviations import Judge, Residuals

_DRAWN_MECHANISMS = 12
"""Number of mechanisms with further random errors."""

_SEED = 1
"""Seed of these errors: the same rows are explained by noise in every run."""

_LIMIT_IN_SIGMAS = 5.0
"""Differences up to so many standard deviations are explained by noise."""


def noise_limits(noise: Noise, cad: CadModel, judge: Judge, parameters: Mapping[str, float] | None) -> dict[str, Array]:
    """Return the largest differences (k, 1) that noise of the CAD explains, by symbol, in units of the tolerance.

    `judge` has states of the mechanism of `cad`. At a state where a symbol has no value with some of the further errors
    (near the end of reach), its difference is not limited. A symbol that has a value in no draw is not in the result.
    """
    rng = np.random.default_rng(_SEED)
    draws: list[Residuals] = []
    for _ in range(_DRAWN_MECHANISMS):
        draws.append(_residuals_with_errors(noise, cad, judge, parameters, rng))
    largest: dict[str, Array] = {}
    for place, residual in judge.residuals.items():
        changes: list[Array] = []
        for residuals in draws:
            if place in residuals:
                changes.append(residuals[place] - residual)
        if not changes:
            continue
        # About the judged mechanism, not about the mean of the draws: the errors in the CAD are one more draw.
        sigma_of_entries = np.sqrt(np.square(changes).mean(axis=0))
        # Entries of one value have similar errors; the largest of them is the most certain estimate.
        sigma = sigma_of_entries.max(axis=1, keepdims=True)
        known_sigma = np.where(np.isnan(sigma), np.inf, sigma)
        limit = np.maximum(1.0, _LIMIT_IN_SIGMAS * known_sigma)
        largest[place.symbol] = np.maximum(limit, largest.get(place.symbol, 1.0))
    return largest


def _residuals_with_errors(
    noise: Noise, cad: CadModel, judge: Judge, parameters: Mapping[str, float] | None, rng: np.random.Generator
) -> Residuals:
    """Return the residuals at the driven joint values of `judge`, for a mechanism with further errors."""
    faces = with_noise(cad.measured, noise.position, noise.direction, rng)
    model = ReferenceModel(frames.moved(cad.mechanism, cad.description, faces))
    assert judge.reference.run is not None
    X, _ = minimise(model.tree, judge.reference.run.x.copy(), model.loops_only, model.tree.passive)
    return judge.on(symbol_values(judge.formula, model.collect(X), model, parameters)).residuals
