"""The results that `twin explain` keeps of functions of a formula: no caller changes them, and no edit is missed."""

from __future__ import annotations

import importlib.util

import casadi as ca
import numpy as np
import pytest

from twin.robots import _authoring
from twin.validation.explain.rebuilt_functions import Rebuilder

TEXT = """
from casadi import cos, sin, vertcat


def point(q, a):
    return vertcat(a * cos(q), a * sin(q))


def moved(q, a):
    p = point(q, a)
    v = p[0]
    v += a
    return v


def first(q, a):
    return point(q, a)[0]


def wave(x, a):
    return a * sin(x)


def called(q, a):
    return vertcat(wave(q, a), wave(2 * q, a))


def in_a_list(q, a):
    return vertcat(*[wave(x, a) for x in (q, 2 * q)])


def in_a_generator(q, a):
    return vertcat(*(wave(x, a) for x in (q, 2 * q)))


def in_a_lambda(q, a):
    at = lambda x: [wave(y, a) for y in (x, 2 * x)]
    return vertcat(*at(q))
"""

A = 0.5


@pytest.fixture
def q():
    return np.linspace(0.1, 1.0, 8)


@pytest.fixture
def module(tmp_path):
    path = tmp_path / "written.py"
    path.write_text(TEXT, encoding="utf-8")
    spec = importlib.util.spec_from_file_location("written_for_kept_results", path)
    out = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(out)
    return out


def test_a_change_in_place_is_no_change_of_a_kept_result(module, q):
    rebuilder = Rebuilder()
    moved = rebuilder.function(module.moved)
    first = rebuilder.function(module.first)
    for _ in range(2):
        np.testing.assert_array_equal(moved(q, A), A * np.cos(q) + A)
        np.testing.assert_array_equal(first(q, A), A * np.cos(q))


def test_an_entry_is_no_part_of_its_matrix(module, q):
    p = Rebuilder().function(module.point)(q, A)
    p[0][:] = 7.0
    p[0:1, 0].a[:] = 7.0
    np.testing.assert_array_equal(p[0], A * np.cos(q))


def test_results_are_kept_and_given_as_copies(module, q):
    point = Rebuilder().function(module.point)
    for _ in range(3):
        result = point(q, A)
        np.testing.assert_array_equal(result[0], A * np.cos(q))
        result.a[:] = 7.0


@pytest.mark.parametrize("name", ["called", "in_a_list", "in_a_generator", "in_a_lambda"])
def test_an_edited_function_is_called_wherever_its_name_is(module, q, name):
    f = Rebuilder().function(getattr(module, name))
    right = f(q, A)
    np.testing.assert_array_equal(right[1], A * np.sin(2 * q))
    f.__globals__["wave"] = lambda x, a: a * np.cos(x)
    np.testing.assert_array_equal(f(q, A)[1], A * np.cos(2 * q))


class Stand:
    """A function that stands in for one of the formula, but is no plain function."""

    def __call__(self, x, a):
        return a + x


def test_a_first_call_with_a_stand_in_keeps_nothing(module, q):
    f = Rebuilder().function(module.called)
    original = f.__globals__["wave"]
    f.__globals__["wave"] = Stand()
    np.testing.assert_array_equal(f(q, A)[0], A + q)
    f.__globals__["wave"] = original
    np.testing.assert_array_equal(f(q, A)[0], A * np.sin(q))


def test_rows_of_a_table_are_kept_although_vertcat_of_casadi_is_a_python_function():
    """CasADi's functions are never edited; a row of a table is evaluated thousands of times with the same values."""
    kept = Rebuilder().function(_authoring.row)
    q = np.array([0.1, 0.2])
    first = kept(-0.5, 0.3, q, 0.2)
    assert kept.__wrapped__ is not _authoring.row
    for pose, angle in zip(first.a, q, strict=True):
        np.testing.assert_allclose(pose, np.array(ca.DM(_authoring.row(-0.5, 0.3, angle, 0.2))), atol=1e-15)
    np.testing.assert_array_equal(kept(-0.5, 0.3, q, 0.2).a, first.a)
