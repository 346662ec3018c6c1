"""Parameters identified against the mechanism, and what the poses cannot tell apart."""

from __future__ import annotations

import numpy as np
import pytest

from twin import api
from twin.core.units import DEG
from twin.robots import load_formula
from twin.validation.explain.explain import explain
from twin.validation.explain.judged_states import sampled_values
from twin.validation.explain.parameter_fit import ParameterFit, ParameterResiduals
from twin.validation.explain.row_deviations import Judge
from twin.validation.explain.wrong_parameters import _covariance, identify

pytestmark = pytest.mark.usefixtures("sampled_once")


@pytest.fixture(scope="module")
def sils(sils_model):
    formula = load_formula("sils")
    return formula, sampled_values(formula, sils_model)


@pytest.fixture(scope="module")
def sher():
    formula = load_formula("sher")
    return formula, sampled_values(formula, api.load("sher").reference())


def wrong(case, **by):
    """A judge of the formula with some parameters changed by so much (SI)."""
    formula, reference = case
    return Judge(formula, None, reference.with_values({n: reference.symbols[n] + d for n, d in by.items()}))


@pytest.mark.nightly
def test_a_length_that_moved_is_named_with_both_values(sils, sils_model):
    formula, reference = sils
    x = explain("sils", formula, sils_model, reference=reference.with_values({"l_p": 0.1344}))
    assert x.explained
    (moved,) = x.identified.moved
    assert (moved.name, moved.unit) == ("l_p", "mm")
    assert moved.formula == pytest.approx(134.4)
    assert moved.fitted == pytest.approx(135.0, abs=1e-6)


@pytest.mark.slow
def test_a_tenth_of_a_millimetre_is_recovered_to_one_percent(sils):
    for name in ("l_0", "l_1", "L_V"):
        found = identify(wrong(sils, **{name: 1e-4}))
        assert found.exact
        assert [m.name for m in found.moved] == [name]
        m = found.moved[0]
        assert m.fitted - m.formula == pytest.approx(-0.1, rel=0.01)
        assert 0 < m.sigma < 1e-3


def test_two_lengths_at_once(sils):
    found = identify(wrong(sils, l_1=1e-4, L_H=-1e-4))
    assert found.exact
    assert {m.name: round(m.fitted - m.formula, 4) for m in found.moved} == {"l_1": -0.1, "L_H": 0.1}


@pytest.mark.slow
def test_an_angle_is_recovered_to_one_percent(sher):
    found = identify(wrong(sher, phi3=0.05 * DEG))
    assert found.exact
    assert [m.name for m in found.moved] == ["phi3"]
    assert found.moved[0].fitted - found.moved[0].formula == pytest.approx(-0.05, rel=0.01)


@pytest.mark.slow
def test_what_cannot_be_told_apart_is_named(sher):
    found = identify(wrong(sher, r_b=1e-4))
    assert found.exact
    assert found.alternatives
    assert [m.name for m in found.moved] == ["r_b", "r_p"]  # only their difference enters
    assert "1 r_b +1 r_p" in found.blind


@pytest.mark.slow
def test_covariance_is_that_of_the_errors(sils):
    """Noise of 10 µm on the mechanism's values: the fit scatters as the covariance says."""
    noise, fits, sigmas = 1e4, [], []
    judge = wrong(sils, l_p=1e-4)
    for seed in range(12):
        residuals = ParameterResiduals(judge, noise, seed)
        fits.append(residuals.fit(("l_p",)).values[0])
    sigmas = identify(judge, noise=noise).moved[0].sigma * 1e-3
    assert np.std(fits) == pytest.approx(sigmas, rel=0.6)
    assert abs(np.mean(fits) - 0.135) < 4 * sigmas


def test_a_unit_slip_is_called_one(sils):
    formula, reference = sils
    found = identify(Judge(formula, None, reference.with_values({"l_p": 0.000135})))
    assert found.moved[0].note == "looks like metres instead of millimetres"


def test_a_wrong_form_is_not_explained_by_numbers(sils):
    formula, reference = sils
    found = identify(Judge(formula, {"eq1": "printed"}, reference))
    assert not found.exact
    assert found.moved == ()


def test_rows_without_a_value_are_not_explained_by_numbers(sils):
    """A root that has no value somewhere: the other rows do not determine it."""
    judge = wrong(sils, l_1=-0.1)
    assert not ParameterResiduals(judge).complete
    assert identify(judge, alone=True) is None


@pytest.mark.parametrize("only_row", [False, True])
def test_a_row_that_is_lost_at_other_values_leaves_no_residuals(sils, monkeypatch, only_row):
    formula, reference = sils
    residuals = ParameterResiduals(Judge(formula, None, reference))
    assert len(residuals.rows) > 1
    if only_row:
        first = residuals.rows[0]
        residuals.rows = [first]
        residuals.noise = np.zeros(residuals.judge.residuals[first].size)
    size = residuals.noise.size
    assert size > 1
    on = residuals.judge.on

    def with_a_lost_row(reference):
        judge = on(reference)
        if reference.symbols["l_1"] != residuals.start["l_1"]:
            del judge.residuals[residuals.rows[0]]
        return judge

    monkeypatch.setattr(residuals.judge, "on", with_a_lost_row)
    lost = residuals.residual({**residuals.start, "l_1": residuals.start["l_1"] + 1e-6})
    assert lost.shape == (size,)
    assert np.isnan(lost).all()
    assert "l_1" not in [p.name for p in residuals.influential_parameters()]
    assert residuals.fit(("l_1",)).values[0] == residuals.start["l_1"]


def test_no_number_is_named_where_every_row_holds(sils):
    formula, reference = sils
    judge = Judge(formula, None, reference)
    found = identify(judge, alone=True)
    assert found is None


@pytest.mark.parametrize("lost", [[], [3], [0, 5], list(range(8))])
def test_rows_without_a_derivative_do_not_count(lost, rng):
    """At the end of the reach a parameter has no derivative: one side of it has no real solution."""
    J, r = rng.normal(size=(8, 2)), rng.normal(size=8)
    kept = [i for i in range(8) if i not in lost]
    whole = _covariance(ParameterFit(("a", "b"), np.zeros(2), r[kept], J[kept]), 0.0)
    J[lost, 1] = np.nan
    some = _covariance(ParameterFit(("a", "b"), np.zeros(2), r, J), 0.0)
    np.testing.assert_array_equal(some, whole)
