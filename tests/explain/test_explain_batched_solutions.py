"""The values of many expressions at once: no choice depends on another, and the time of a search is kept."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from twin.validation.explain import batched_solutions
from twin.validation.explain.deadline import Deadline

POSES = 6


def steps(J, r, swivel=False):
    unknowns = np.ones((len(J), J.shape[3]), bool)
    return batched_solutions._gauss_newton_steps(J, r, unknowns, np.ones(J.shape[:2], bool), swivel)


def test_a_swivel_without_effect_leaves_an_expression_unique():
    J = np.ones((1, POSES, 1, 2))
    J[..., 1] = 0.0
    step, unique = steps(J, np.ones((1, POSES, 1)), swivel=True)
    assert unique.tolist() == [True]
    np.testing.assert_allclose(step, [[[-1.0, 0.0]] * POSES])


def test_a_swivel_with_the_effect_of_an_expression_is_not_unique():
    assert not steps(np.ones((1, POSES, 2, 2)), np.ones((1, POSES, 2)), swivel=True)[1].any()


def test_a_second_expression_without_effect_is_not_unique():
    J = np.ones((1, POSES, 1, 2))
    J[..., 1] = 0.0
    assert not steps(J, np.ones((1, POSES, 1)))[1].any()


@pytest.mark.parametrize(("residual", "unique"), [(0.0, True), (1.0, False)])
def test_one_expression_may_have_no_effect_where_the_rows_agree(residual, unique):
    J = np.ones((1, POSES, 3, 1))
    r = np.ones((1, POSES, 3))
    J[0, 0] = 0.0
    r[0, 0] = residual
    step, found = steps(J, r)
    assert found.tolist() == [unique]
    assert step[0, 0, 0] == 0.0
    np.testing.assert_allclose(step[0, 1:, 0], -1.0)


def test_an_expression_without_a_derivative_is_not_unique():
    J = np.ones((1, POSES, 3, 1))
    J[0, 0] = np.nan
    assert not steps(J, np.zeros((1, POSES, 3)))[1].any()


@pytest.mark.parametrize("count", [1, 2])
def test_first_values_do_not_depend_on_a_choice_without_a_value(count):
    newton = batched_solutions._BatchedGaussNewton.__new__(batched_solutions._BatchedGaussNewton)
    newton.expressions = 1

    def residuals(values):
        newton.present_values = np.ones(values.shape)
        r = (1 + values[:, :, :1]) ** 2 - np.array([9.0, 1.21, 9.0])[None, :, None]
        r[1:] = np.nan
        return r

    newton._residuals = residuals
    values = np.zeros((count, 3, 1))
    first, _ = newton._with_valued_starts(values, residuals(values))
    np.testing.assert_array_equal(first[0], 0.0)


def test_a_choice_without_a_value_starts_where_it_has_one():
    newton = batched_solutions._BatchedGaussNewton.__new__(batched_solutions._BatchedGaussNewton)
    newton.expressions = 1

    def residuals(values):
        newton.present_values = np.ones(values.shape)
        return np.where(values[:, :, :1] == 0, np.nan, values[:, :, :1])

    newton._residuals = residuals
    values = np.zeros((2, 3, 1))
    _, r = newton._with_valued_starts(values, residuals(values))
    assert np.isfinite(r).all()


@pytest.mark.parametrize("fails_at", [2, 3])
def test_a_choice_keeps_its_residuals_if_a_step_has_no_value(fails_at):
    """The shift of choice 0 has no effect, and choice 1 is wrong; rows cannot be evaluated after a step of choice 1."""
    newton = batched_solutions._BatchedGaussNewton.__new__(batched_solutions._BatchedGaussNewton)
    newton.expressions = 1
    newton.has_swivel = False
    newton.choices = [SimpleNamespace(scalars=(0,)), SimpleNamespace(scalars=(0,))]
    newton.undecided = [0, 1]
    newton.batch = SimpleNamespace(fewest=1)
    newton._start = lambda: np.zeros((2, 3, 1))
    calls = []

    def residuals(values):
        calls.append(values)
        newton.present_values = np.zeros(values.shape)
        if len(calls) == fails_at:
            return None
        r = np.full(values.shape, 0.5)
        r[-1] = 5 + values[-1]
        return r

    newton._residuals = residuals
    assert 1 not in [i for i, _ in newton.run(Deadline())]
