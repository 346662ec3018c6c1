"""What to tighten at least cost, against a general optimiser and against errors computed anew."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import minimize

from twin.analysis.tightening import least_cost


def spread_of(covariance):
    return float(np.sqrt(np.trace(covariance)))


@pytest.mark.parametrize("seed", range(4))
def test_no_other_factors_are_cheaper(seed):
    rng = np.random.default_rng(seed)
    S = rng.normal(size=(6, 3, 3)) * 10.0 ** rng.uniform(-2, 1, size=(6, 1, 1))
    parts = S @ np.swapaxes(S, 1, 2)
    required = 0.3 * spread_of(parts.sum(axis=0))
    names = [f"j{k}" for k in range(6)]
    found = least_cost(names, parts[None], required, spread_of)
    assert found is not None
    assert found.reached == pytest.approx(required, rel=1e-6)
    s = np.ones(6)
    for name, factor in found.factors:
        s[names.index(name)] = factor
    assert found.cost == pytest.approx(np.mean(1 / s))
    variances = np.trace(parts, axis1=1, axis2=2)
    # an optimiser that knows nothing of the solution; x = log s
    best = minimize(
        lambda x: np.mean(np.exp(-x)),
        np.full(6, np.log(0.3)),
        bounds=[(-12, 0)] * 6,
        constraints={"type": "ineq", "fun": lambda x: 1 - np.exp(2 * x) @ variances / required**2},
        options={"ftol": 1e-10, "maxiter": 1000},
    )
    assert np.exp(2 * best.x) @ variances <= required**2 * (1 + 1e-6)
    assert found.cost == pytest.approx(best.fun, rel=1e-3)
    assert found.cost <= best.fun * (1 + 1e-5)
    assert found.cost <= found.uniform_cost


def test_every_state_keeps_the_requirement():
    rng = np.random.default_rng(7)
    S = rng.normal(size=(3, 5, 3, 3))
    parts = S @ np.swapaxes(S, 2, 3)
    order = np.argsort([-spread_of(state.sum(axis=0)) for state in parts])
    parts = parts[order]
    names = [f"j{k}" for k in range(5)]
    found = least_cost(names, parts, 0.1, spread_of)
    assert found is not None
    s = np.ones(5)
    for name, factor in found.factors:
        s[names.index(name)] = factor
    for state in parts:
        assert spread_of(np.einsum("k,kij->ij", s**2, state)) <= 0.1 * (1 + 1e-9)


def test_nothing_is_tightened_that_is_good_enough():
    assert least_cost(["a"], np.eye(3)[None, None], 2.0, spread_of) is None
