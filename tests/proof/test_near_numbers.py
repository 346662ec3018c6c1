"""Rounded roots are said: of lengths in mm, of parts of a parameter, and of numbers without a unit."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

import twin
from twin.proof.near_numbers import near_length, near_number


@pytest.mark.parametrize(
    ("millimetres", "lengths", "text"),
    [
        (38.971143, {"l_p": 0.135}, "sqrt(3)/6 l_p = 38.97114317 mm"),
        (38.971143, {}, "22.5 sqrt(3) = 38.97114317 mm"),
        (-38.971143, {}, "-22.5 sqrt(3) = -38.97114317 mm"),
        (38.971144, {"l_p": 0.135}, ""),  # the last digit is another one
        (38.9711, {"l_p": 0.135}, ""),  # so few decimals may be chosen
        (22.5 * math.sqrt(3), {"l_p": 0.135}, ""),  # a proof takes it as a root anyway
        (0.0, {"l_p": 0.135}, ""),
    ],
)
def test_a_rounded_length_is_a_root(millimetres, lengths, text):
    assert near_length(1e-3 * millimetres, lengths) == text


@pytest.mark.parametrize(
    ("value", "text"),
    [(0.866025, "sqrt(3)/2 = 0.8660254038"), (-0.70711, "-sqrt(2)/2 = -0.7071067812"), (0.12345, ""), (1e-9, "")],
)
def test_a_rounded_number_is_a_root(value, text):
    assert near_number(value) == text


def test_random_decimals_are_rarely_near_a_root():
    drawn = np.random.default_rng(0).integers(0, 300 * 10**6, 2000)
    found = [near_length(1e-9 * int(number), {"a": 0.135, "b": 0.0812}) for number in drawn]
    assert len([text for text in found if text]) <= 2


def test_a_rounded_length_of_the_equations_is_a_finding():
    robot = twin.load("pa10")
    changed = []
    for parameter in robot.formula.parameters:
        if parameter.name == "RL3":
            parameter = replace(parameter, value=0.318198052)
        changed.append(parameter)
    other = robot.with_formula(replace(robot.formula, parameters=tuple(changed)))
    found = twin.prove(other, states=256)
    (finding,) = [finding for finding in found.findings if finding.code == "prove.near_number"]
    assert finding.message.startswith("parameter RL3, 318.198052 mm is 225 sqrt(2) = 318.1980515 mm, but for its last")
    assert not twin.prove(robot, states=256).proof.near_numbers
