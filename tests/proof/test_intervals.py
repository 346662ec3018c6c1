"""Intervals contain what balls of 200 digits give, for random operations on random numbers."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import casadi as ca
import numpy as np
import pytest

from twin.proof import intervals
from twin.proof.interval_function import IntervalFunction
from twin.proof.intervals import Intervals

flint = pytest.importorskip("flint", reason="python-flint is in the group dev")

OPERATIONS = int(os.environ.get("TWIN_ROUNDINGS", "40000"))
"""Number of random operations that are compared with balls."""

DIGITS = 200


@dataclass(frozen=True)
class Operation:
    """An operation on intervals and on balls, and the numbers that it takes."""

    of_intervals: Callable[..., Intervals]
    of_balls: Callable[..., Any]
    operands: int = 2
    low: float = -np.inf
    high: float = np.inf


def _angle(y: Any, x: Any) -> Any:
    return flint.arb.atan2(y, x)


CASES = {
    "sum": Operation(lambda a, b: a + b, lambda a, b: a + b),
    "difference": Operation(lambda a, b: a - b, lambda a, b: a - b),
    "product": Operation(lambda a, b: a * b, lambda a, b: a * b),
    "quotient": Operation(lambda a, b: a / b, lambda a, b: a / b),
    "square": Operation(intervals.square, lambda a: a * a, 1),
    "root": Operation(intervals.root, lambda a: a.sqrt(), 1, low=0.0),
    "cube": Operation(lambda a: a**3, lambda a: a**3, 1),
    "power": Operation(lambda a: a**1.5, lambda a: a**1.5, 1, low=0.0),
    "minus second power": Operation(lambda a: a**-2, lambda a: 1 / (a * a), 1),
    "sine": Operation(intervals.sine, lambda a: a.sin(), 1),
    "cosine": Operation(intervals.cosine, lambda a: a.cos(), 1),
    "tangent": Operation(intervals.tangent, lambda a: a.tan(), 1),
    "arc tangent": Operation(intervals.arctangent, lambda a: a.atan(), 1),
    "arc sine": Operation(intervals.arcsine, lambda a: a.asin(), 1, -1.0, 1.0),
    "arc cosine": Operation(intervals.arccosine, lambda a: a.acos(), 1, -1.0, 1.0),
    "direction": Operation(intervals.direction, _angle),
    "exponential": Operation(intervals.exponential, lambda a: a.exp(), 1, -700.0, 700.0),
    "logarithm": Operation(intervals.logarithm, lambda a: a.log(), 1, low=0.0),
}


def _numbers(generator: np.random.Generator, case: Operation, count: int) -> np.ndarray:
    """Return random numbers of all magnitudes: ordinary ones, tiny, huge and whole ones, and near multiples of pi/2."""
    magnitude = 10.0 ** generator.uniform(-12, 6, count)
    rare = generator.random(count)
    magnitude = np.where(rare < 0.05, 10.0 ** generator.uniform(-300, 300, count), magnitude)
    x = magnitude * generator.choice([-1.0, 1.0], count)
    x = np.where(rare > 0.9, np.round(generator.uniform(-9, 9, count)), x)
    quarter = generator.integers(-40, 40, count) * (np.pi / 2)
    x = np.where((rare > 0.8) & (rare < 0.9), quarter * (1 + generator.uniform(-1e-15, 1e-15, count)), x)
    if case.low == 0:
        return np.abs(x)
    if np.isfinite(case.low):
        inside = generator.uniform(case.low, case.high, count)
        return np.where(np.abs(x) < case.high, x, inside)
    return x


def _drawn(generator: np.random.Generator, case: Operation, count: int) -> tuple[Intervals, np.ndarray]:
    """Return random intervals, a third of them numbers, and a number in each of them."""
    x = _numbers(generator, case, count)
    spread = np.abs(x) * 10.0 ** generator.uniform(-17, 1, count)
    spread = np.where(generator.random(count) < 1 / 3, 0.0, spread)
    low = np.maximum(x - spread * generator.random(count), case.low)
    high = np.minimum(x + spread * generator.random(count), case.high)
    return intervals.between(np.minimum(low, x), np.maximum(high, x)), x


def _escapes(found: Intervals, exact: list[Any]) -> list[int]:
    """Return the numbers of the results whose ball is outside of the interval."""
    escapes = []
    for k, ball in enumerate(exact):
        low = found.low[k]
        high = found.high[k]
        if np.isnan(low) or np.isnan(high) or not ball.is_finite():
            continue
        # a ball has a radius of 1e-200 of its number: it escapes if no part of it is in the interval
        below = np.isfinite(low) and ball < flint.arb(float(low))
        above = np.isfinite(high) and ball > flint.arb(float(high))
        if below or above:
            escapes.append(k)
    return escapes


def _compare(name: str, count: int, seed: int) -> None:
    case = CASES[name]
    generator = np.random.default_rng(seed)
    operands = [_drawn(generator, case, count) for _ in range(case.operands)]
    found = case.of_intervals(*[intervals_of for intervals_of, _ in operands])
    known = found.known
    assert known.mean() > 0.4, "too few operations exist"
    exact = []
    for numbers in zip(*[x for _, x in operands], strict=True):
        exact.append(case.of_balls(*[flint.arb(float(number)) for number in numbers]))
    escapes = _escapes(found, exact)
    assert not escapes, [[float(x[k]) for _, x in operands] for k in escapes[:3]]


@pytest.fixture(autouse=True)
def _digits():
    kept = flint.ctx.dps
    flint.ctx.dps = DIGITS
    yield
    flint.ctx.dps = kept


@pytest.mark.parametrize("name", CASES)
def test_operations_contain_the_balls_of_200_digits(name):
    _compare(name, count=100, seed=1)


@pytest.mark.slow
@pytest.mark.parametrize("name", CASES)
def test_no_operation_escapes(name):
    _compare(name, count=-(-OPERATIONS // len(CASES)), seed=2)


@pytest.mark.parametrize("size", [1, 3, 12])
def test_products_of_matrices_contain_the_exact_ones(size):
    generator = np.random.default_rng(size)
    A = generator.normal(size=(size, size)) * 10.0 ** generator.integers(-9, 9, (size, size))
    B = generator.normal(size=(size, size)) * 10.0 ** generator.integers(-9, 9, (size, size))
    found = intervals.product(intervals.exactly(A), intervals.around(B, np.abs(B) * 1e-9))
    exact = flint.arb_mat(A.tolist()) * flint.arb_mat(B.tolist())
    row = Intervals(found.low.ravel(), found.high.ravel())
    assert not _escapes(row, list(exact.entries()))
    assert np.all(found.radius <= 1e-8 * np.abs(A) @ np.abs(B))


def test_subnormal_numbers_do_not_escape():
    """The radius of a subnormal number is rounded to the smallest number, which a large factor makes large."""
    generator = np.random.default_rng(0)
    least = 5e-324
    for _ in range(100):
        # products of 1e-24 that cancel but for their rounding
        counts = generator.integers(1, 9, 4)
        A = generator.normal(size=4) * 1e300
        A[3] = -float((A[:3] * counts[:3]).sum() / counts[3])
        B = counts * least
        found = intervals.product(intervals.exactly(A[None]), intervals.exactly(B[:, None]))
        exact = sum(flint.arb(float(a)) * flint.arb(float(b)) for a, b in zip(A, B, strict=True))
        assert not _escapes(Intervals(found.low.ravel(), found.high.ravel()), [exact])
    tiny = intervals.fraction(Fraction(3, 2) * Fraction(5e-324))
    assert Fraction(float(tiny.low)) <= Fraction(3, 2) * Fraction(5e-324) <= Fraction(float(tiny.high))
    for x in (-744.0, -740.3, -709.9):
        found = intervals.exponential(intervals.exactly(np.array([x])))
        assert not _escapes(found, [flint.arb(x).exp()])
        assert found.low[0] == 0.0


def test_results_are_narrow():
    x = intervals.exactly(np.linspace(0.1, 3.0, 50))
    y = intervals.sine(x) * intervals.root(x) / (x + 1.0)
    assert y.width.max() < 1e-14


def test_what_may_not_exist_is_unknown_and_never_certain():
    x = intervals.between([-1.0, 0.5], [1.0, 2.0])
    for y in (
        intervals.root(x),
        1.0 / x,
        intervals.arccosine(x * 2.0),
        intervals.arcsine(x + 0.5),
        intervals.logarithm(x),
    ):
        assert y.known.tolist() == [False, bool(y.known[1])]
        assert not ((y > -1e300) | (y < 1e300))[0]
    assert (intervals.root(x) + 1.0 > 1.0).tolist() == [False, True]


def test_a_sine_knows_its_maximum():
    y = intervals.sine(intervals.between([1.0, 4.0, -1e9], [2.0, 5.0, 1e9]))
    assert y.high[0] == 1.0
    assert y.low[1] == -1.0
    assert (y.low[2], y.high[2]) == (-1.0, 1.0)


def test_directions_beyond_half_a_turn_are_all_directions():
    y = intervals.direction(intervals.between([-0.1, -0.1, 0.1], [0.1, 0.1, 0.2]), intervals.exactly([-1.0, 1.0, -1.0]))
    assert y.high[0] > 3.14 > -3.14 > y.low[0]
    assert y.high[1] < 0.11
    assert 2.9 < y.low[2] < y.high[2] < np.pi


def test_bad_ends_are_named():
    with pytest.raises(ValueError, match=r"interval 1 from 2.0 to 1.0: low must be <= high"):
        intervals.between([0.0, 2.0], [1.0, 1.0])
    with pytest.raises(ValueError, match="nan"):
        intervals.between(np.nan, 1.0)


def test_a_compiled_function_is_enclosed_with_its_conditions():
    x, y = ca.SX.sym("x"), ca.SX.sym("y")
    chosen = ca.if_else(x > 0.3, ca.sqrt(x), ca.atan2(y, x - 2))
    rows = [chosen, ca.fmax(x, y) ** 3, ca.copysign(x, y), ca.fabs(x - y), ca.sin(x) * 0.182 + ca.pi]
    function = ca.Function("f", [ca.vertcat(x, y)], [ca.vertcat(*rows)])
    generator = np.random.default_rng(4)
    centre = generator.uniform(-1, 1, (2, 2000))
    radius = generator.uniform(0, 0.2, (2, 2000))
    found = IntervalFunction(function)([[intervals.around(centre[i], radius[i]) for i in range(2)]])[0]
    inside = centre + radius * generator.uniform(-1, 1, (2, 2000))
    exact = np.array(function(inside))
    for k in range(len(rows)):
        assert np.all(found[k].contains(exact[k])), rows[k]
        assert np.mean(np.isfinite(found[k].low)) > 0.8
