"""Witnesses in fractions are within the ranges of the states, and certainly within reach."""

from __future__ import annotations

import pytest

from twin.proof.claims import JudgedClaim
from twin.proof.draws import RandomRange
from twin.proof.program import ProgramStep
from twin.proof.rational_witness import rational_witness

X = ProgramStep("input", text="x")
ONE = ProgramStep("number", text="1*sqrt(1)")
ABOVE = ProgramStep("add", (X, ONE))


def claim(x, reach=()):
    """The claim that x + 1 is zero, which is wrong at x."""
    return JudgedClaim("c", "x = -1", "refuted", 0, 0, 0.0, 1.0 + x, {"x": x}, "", nodes=(ABOVE,), reach=reach)


def test_a_length_is_rounded_within_its_range():
    # the nearest fraction with a denominator up to 10 is 0, which no joint reaches
    assert rational_witness(claim(0.04), {"x": RandomRange(False, 0.03, 0.05)}) == {"x": "1/25 m"}
    assert rational_witness(claim(0.04), {"x": RandomRange(False, -0.03, 0.05)}) == {"x": "0 m"}


@pytest.mark.parametrize(("low", "high", "found"), [(0.03, 0.05, False), (-0.03, 0.05, True)])
def test_the_tangent_of_half_of_an_angle_as_well(low, high, found):
    angle = ProgramStep("add", (ProgramStep("sine", text="x"), ONE))
    wrong = JudgedClaim("c", "sin(x) = -1", "refuted", 0, 0, 0.0, 1.0, {"x": 0.04}, "", nodes=(angle,))
    fractions = rational_witness(wrong, {"x": RandomRange(True, low, high)})
    assert (fractions == {"x": "2 atan(0)"}) == found
    assert fractions


def test_a_margin_that_may_be_negative_is_no_reach():
    root = ProgramStep("root", (ProgramStep("number", text="2*sqrt(1)"),))
    margin = ProgramStep("add", (root, ProgramStep("negative", (root,))))
    ranges = {"x": RandomRange(False, 0.03, 0.05)}
    assert not rational_witness(claim(0.04, reach=(margin,)), ranges)
    assert rational_witness(claim(0.04, reach=(root,)), ranges)
