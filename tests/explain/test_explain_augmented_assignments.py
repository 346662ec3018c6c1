"""Augmented assignments of equations: they give a variable a new value, and change no value that others use."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from made import explain_seeds as seeds
from twin.validation.explain.function_source import Edit
from twin.validation.explain.rebuilt_functions import Rebuilder, unguarded
from twin.validation.explain.row_deviations import Judge, _renamed

RIGHT = "    return -(q2 + q3), atan2(-u[0], u[2]), asin(-u[1])"
SAME = "    turned = {value}\n    turned += {term}\n    return -turned, atan2(-u[0], u[2]), asin(-u[1])"

HELPERS = """
from casadi import if_else, sin


def moved(q, a):
    v = q
    v += a
    v *= 2
    return v - q


def chosen(q, a):
    v = if_else(q > 0, q, float("nan"))
    v -= a
    return v * sin(q)


def listed(q, a):
    out = [q]
    again = out
    out += (a,)
    return again[1] * q


def _scaled(by):
    def inside(q, a):
        v = q
        v *= by
        v += a
        return v - q

    return inside


inside = _scaled(3)
"""

MODULO = """
from casadi import sin


def whole(q, a):
    v = q
    v %= 0.3
    w = q
    w //= 0.3
    return v + w - q
"""

DECORATED = """
from functools import wraps

from casadi import sin


def doubled(f):
    @wraps(f)
    def decorated(q, a):
        v = q
        v += a
        v *= 2
        return v + f(q, a)

    return decorated


@doubled
def decorated(q, a):
    v = q
    v -= 1
    return -v
"""

ARRAYS = """
import numpy as np


def moved(q, a):
    p = np.array([q, a])
    end = p[1:]
    end += q
    return p[1]
"""


def lapbot(tmp_path, value, term):
    """Return Lapbot and its equations with q4 from an augmented assignment."""
    case = seeds.built_in("lapbot")
    text = case.path.read_text(encoding="utf-8")
    assert text.count(RIGHT) == 1
    path = tmp_path / "formula.py"
    path.write_text(text.replace(RIGHT, SAME.format(value=value, term=term)), encoding="utf-8")
    return case, case.load(path)


def loaded(tmp_path, text):
    path = tmp_path / "helpers.py"
    path.write_text(text, encoding="utf-8")
    spec = importlib.util.spec_from_file_location("written_for_augmented", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("value", ["q2", 'if_else(q2 < 9, q2, float("nan"))', "1 * q2"])
def test_a_row_changes_no_value_of_the_mechanism(value, tmp_path):
    case, formula = lapbot(tmp_path, value, "q3")
    before = {name: np.array(x) for name, x in case.reference.symbols.items() if isinstance(x, np.ndarray)}
    with unguarded():
        judge = Judge(formula, None, case.reference)
    assert judge.failing() == []
    for name, x in before.items():
        np.testing.assert_array_equal(case.reference.symbols[name], x)


@pytest.mark.slow
@pytest.mark.parametrize("value", ["q2", "1 * q2"])
def test_a_wrong_augmented_assignment_is_found(value, tmp_path):
    """Edits of a statement start from the values before it, which the statement itself must not have changed."""
    case, formula = lapbot(tmp_path, value, "q2")
    assert seeds.outcome(case, formula, tmp_path, 4.0) in ("rank 1", "tie")


@pytest.mark.parametrize("name", ["moved", "chosen", "listed", "inside"])
def test_a_function_runs_as_with_casadi(name, tmp_path):
    f = getattr(loaded(tmp_path, HELPERS), name)
    q = np.linspace(0.1, 1.0, 8)
    kept = q.copy()
    symbols = ca.SX.sym("q"), ca.SX.sym("a")
    wanted = ca.Function("f", symbols, [f(*symbols)])
    for block in (unguarded(), np.errstate()):
        with block:
            np.testing.assert_allclose(Rebuilder().function(f)(q, 0.5), [float(wanted(x, 0.5)) for x in kept])
        np.testing.assert_array_equal(q, kept)


def test_remainder_and_whole_quotient_change_no_argument(tmp_path):
    f = loaded(tmp_path, MODULO).whole
    q = np.linspace(0.1, 1.0, 8)
    kept = q.copy()
    np.testing.assert_allclose(Rebuilder().function(f)(q, 0.5), kept % 0.3 + kept // 0.3 - kept)
    np.testing.assert_array_equal(q, kept)


def test_a_decorated_function_runs_as_with_casadi(tmp_path):
    f = loaded(tmp_path, DECORATED).decorated
    q = np.linspace(0.1, 1.0, 8)
    kept = q.copy()
    np.testing.assert_allclose(Rebuilder().function(f)(q, 0.5), 2 * (kept + 0.5) + 1 - kept)
    np.testing.assert_array_equal(q, kept)


def test_arrays_of_numpy_are_changed_in_place(tmp_path):
    f = loaded(tmp_path, ARRAYS).moved
    assert Rebuilder().function(f)(2.0, 3.0) == f(2.0, 3.0) == 5.0


def test_two_edits_of_one_left_side_both_count():
    def side(old, new):
        return Edit(Path("formula.py"), 1, 0, 1, old, new, "left side", 0, "eq1")

    names = ("X_S1", "Y_S1", "Z_S1")
    assert _renamed(names, [side("X_S1", "X_S2"), side("Y_S1", "X_S1")]) == ("X_S2", "X_S1", "Z_S1")
    assert _renamed(names, []) == names
