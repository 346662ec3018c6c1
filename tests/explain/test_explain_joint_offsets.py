"""Offsets that a Denavit-Hartenberg table lacks are named from the mechanism alone, and nothing is named for chance."""

from __future__ import annotations

import numpy as np
import pytest
from casadi import pi

from made.formulas import replaced
from twin import api
from twin.robots import load_formula
from twin.robots._authoring import row
from twin.validation.explain.judged_states import sampled_values
from twin.validation.explain.pose_conventions import axes_text, joint_offsets
from twin.validation.explain.row_deviations import Judge


@pytest.fixture(scope="module")
def pa10():
    formula = load_formula("pa10")
    return formula, sampled_values(formula, api.load("pa10").reference())


@pytest.fixture(scope="module")
def psm():
    formula = load_formula("davinci_psm")
    return formula, sampled_values(formula, api.load("davinci_psm").reference())


def chain(q1, q2, q3, q4, q5, q6, q7, RL3, RL5, RL7, RL8):
    T = row(0, 0, q1, 0) @ row(-pi / 2, 0, q2, 0) @ row(pi / 2, 0, q3, RL3)
    T = T @ row(-pi / 2, 0, q4, 0) @ row(pi / 2, 0, q5, RL5)
    return T @ row(-pi / 2, 0, q6, 0) @ row(pi / 2, 0, q7, RL7 + RL8)


def two_off(q1, q2, q3, q4, q5, q6, q7, RL3, RL5, RL7, RL8):
    return chain(q1, q2 - pi / 2, q3, q4, q5 + pi / 2, q6, q7, RL3, RL5, RL7, RL8)


def turned_too(q1, q2, q3, q4, q5, q6, q7, RL3, RL5, RL7, RL8):
    return row(-pi / 2, 0, 0, 0) @ chain(q1, q2, q3, q4 - pi, q5, q6, q7, RL3, RL5, RL7, RL8)


def other_twist(q1, q2, q3, q4, q5, q6, q7, RL3, RL5, RL7, RL8):
    T = row(0, 0, q1, 0) @ row(-pi / 3, 0, q2, 0) @ row(pi / 2, 0, q3, RL3)
    T = T @ row(-pi / 2, 0, q4, 0) @ row(pi / 2, 0, q5, RL5)
    return T @ row(-pi / 2, 0, q6, 0) @ row(pi / 2, 0, q7, RL7 + RL8)


def messages(formula, reference, variants=None, **functions):
    for name, function in functions.items():
        formula = replaced(formula, name, function)
    with np.errstate(all="ignore"):
        return [c.message for c in joint_offsets(Judge(formula, variants, reference))]


def test_the_printed_table_of_the_psm_lacks_three_offsets(psm):
    (text,) = messages(*psm, {"table1": "printed"})
    assert "with q2 + 90°, q5 + 90°, q3 - 15.6 mm;" in text
    assert "base axes x = -y, y = -z, z = x" in text


@pytest.mark.parametrize(
    ("wrong", "said"), [(two_off, "q2 + 90°, q5 - 90°"), (turned_too, "q4 + 180°; base axes x = x, y = -z, z = y")]
)
def test_quarter_turns_are_named(pa10, wrong, said):
    (text,) = messages(*pa10, table1=wrong)
    assert text.endswith(f"with {said}")


@pytest.mark.slow
def test_nothing_is_named_where_nothing_is_off_or_no_offset_cures_it(pa10, psm):
    assert messages(*pa10) == messages(*psm) == []
    assert messages(*pa10, table1=other_twist) == []


def test_axes_are_told_by_name_or_by_angle():
    assert axes_text(np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1.0]])) == "x = -y, y = x, z = z"
    c, s = np.cos(0.1), np.sin(0.1)
    assert axes_text(np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])) == "turned by 5.7296°"
