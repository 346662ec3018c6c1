"""Formulas of errors: polynomials that are equal at all angles have the same text, and the text has their values."""

from __future__ import annotations

import math
import re

from hypothesis import given
from hypothesis import strategies as st

from twin.proof import form
from twin.proof.constants import exact

LEAVES = {
    "x": (form.variable("x"), 0.7),
    "l": (form.variable("l"), 1.3),
    "cos": (form.cosine("a"), math.cos(0.4)),
    "sin": (form.sine("a"), math.sin(0.4)),
    "3": (form.number(exact(3)), 3.0),
    "root 2": (form.number(exact(1, 2)), math.sqrt(2)),
    "root 3": (form.number(exact(1, 3)), math.sqrt(3)),
    "root 6": (form.number(exact(1, 6)), math.sqrt(6)),
}
trees = st.recursive(st.sampled_from(sorted(LEAVES)), lambda t: st.tuples(st.sampled_from("+-*"), t, t), max_leaves=7)


def evaluated(tree):
    """Return (form, value) of a tree of operations."""
    if isinstance(tree, str):
        return LEAVES[tree]
    sign, left, right = tree
    (a, x), (b, y) = evaluated(left), evaluated(right)
    if sign == "+":
        return form.total(a, b), x + y
    if sign == "-":
        return form.total(a, form.minus(b)), x - y
    return form.product(a, b), x * y


def read(text):
    """Return the value of a formula's text."""
    text = text.replace("sqrt(2)", "r2").replace("sqrt(3)", "r3").replace("sqrt(6)", "r6")
    text = text.replace("cos(a)", "c").replace("sin(a)", "s").replace("^", "**")
    text = re.sub(r"(?<=[\w)]) (?=[\w(])", " * ", text)
    names = {"r2": math.sqrt(2), "r3": math.sqrt(3), "r6": math.sqrt(6), "x": 0.7, "l": 1.3}
    return eval(text, {"c": math.cos(0.4), "s": math.sin(0.4), **names})


@given(trees)
def test_the_text_of_a_form_has_its_value(tree):
    found, value = evaluated(tree)
    assert abs(read(str(found)) - value) < 1e-9 * max(1.0, abs(value))


@given(trees, trees)
def test_the_order_of_operations_does_not_matter(first, second):
    a, _ = evaluated(first)
    b, _ = evaluated(second)
    assert form.product(a, b) == form.product(b, a)
    assert form.total(a, b) == form.total(b, a)
    assert not form.total(a, form.minus(a))


def test_sine_squared_and_cosine_squared_are_one():
    s, c = form.sine("a"), form.cosine("a")
    assert str(form.total(form.product(s, s), form.product(c, c))) == "1"


def test_a_long_formula_is_given_up():
    total = form.variable("x0")
    for i in range(1, form.MOST_TERMS + 1):
        total = form.total(total, form.variable(f"x{i}"))
    assert total is None
    assert form.product(None, form.variable("x")) is None
