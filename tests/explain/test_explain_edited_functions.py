"""Edited functions: which edits count as readings of one repair."""

from __future__ import annotations

import ast

import numpy as np
import pytest

from twin.validation.explain.edited_functions import _are_equivalent, _canonical_node

ROW = ("equation", 0, 0)
OTHER_ROW = ("equation", 1, 0)
RESIDUAL = np.array([[1.0], [-2.0], [0.5]])
NO_RESIDUAL = np.zeros((3, 1))


def canonical_text(expression):
    return _canonical_node(ast.parse(expression).body[0])


def test_rows_that_differ_by_a_factor_are_the_same():
    assert _are_equivalent({ROW: RESIDUAL}, {ROW: -3 * RESIDUAL})
    assert not _are_equivalent({ROW: RESIDUAL}, {ROW: RESIDUAL + 1})


def test_a_row_that_is_zero_is_only_the_same_as_another_zero_row():
    zero = {ROW: RESIDUAL, OTHER_ROW: NO_RESIDUAL}
    not_zero = {ROW: RESIDUAL, OTHER_ROW: RESIDUAL}
    assert _are_equivalent(zero, zero)
    assert _are_equivalent(zero, {ROW: RESIDUAL, OTHER_ROW: NO_RESIDUAL + 1e-7})  # rounding
    assert not _are_equivalent(zero, not_zero)
    assert not _are_equivalent(not_zero, zero)


@pytest.mark.parametrize(
    ("first", "second"),
    [("f(x=1)", "f(y=1)"), ("f(x=1)", "f(1)"), ("f(**x)", "f(x=x)"), ("lambda a: 1", "lambda b: 1"), ("a.b", "a.c")],
)
def test_names_of_arguments_and_attributes_are_in_the_canonical_text(first, second):
    assert canonical_text(first) != canonical_text(second)
    assert canonical_text(first) == canonical_text(first)


@pytest.mark.parametrize(
    ("first", "second"),
    [
        ("x[1:]", "x[:1]"),
        ("x[:1]", "x[::1]"),
        ("x[1:, 0]", "x[:1, 0]"),
        ("lambda a, b: 1", "lambda a, *b: 1"),
        ("{a: b, **c}", "{**a, b: c}"),
        ("f(x, *y)", "f(x, y)"),
    ],
)
def test_the_place_of_an_absent_part_is_in_the_canonical_text(first, second):
    assert canonical_text(first) != canonical_text(second)


def test_operands_of_sums_and_products_have_no_order():
    assert canonical_text("a*b + c - d") == canonical_text("-d + c + b*a")
