"""Random states: fractions near given values, each with its exact and its real value."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from fractions import Fraction

import numpy as np

from twin.core.spatial import Array
from twin.proof import field, values
from twin.proof import form as forms
from twin.proof.constants import exact_angle
from twin.proof.program import ProgramStep
from twin.proof.values import Angle, Degree, ExactValue, Value

STEPS = 2**49
"""Number of fractions among which a random number is drawn; the odds of a chance zero are a degree divided by this."""

_NEAR_FRACTIONS = 2**4
"""Number of fractions among which one near a given value is drawn."""

NEAR_PART = 512.0 * _NEAR_FRACTIONS / STEPS
"""Largest distance of what is drawn near a given value from it, as a part of the range.

The fractions are above the value, but for half a step. Those of an angle are tangents, which are up to 1273 wide.
"""

_ANGLE_TOLERANCE = 1e-12
"""Tolerance of an angle that is a multiple of 30 or of 45 degrees, in multiples of these."""

_OPEN_SHARE = 0.999
"""Share of half a turn to each side within which angles are drawn: the tangent of half of it must exist."""


def number(
    generator: np.random.Generator,
    low: float,
    high: float,
    states: int,
    name: str,
    formulas: bool = False,
    near: Array | None = None,
) -> ExactValue:
    """Return a random fraction from low to high at each of k states; it may be a variable of formulas.

    If values `near` (k,) are given, the fractions are within a part of 2^-45 of the range from them.
    """
    first = Fraction(low)
    step = (Fraction(high) - first) / STEPS
    multiples = generator.integers(0, STEPS, states)
    if near is not None:
        nearest_multiples = np.round((near - low) / (high - low) * STEPS).astype(np.int64)
        # not the nearest fraction itself: repeated states must be others
        multiples = nearest_multiples + multiples % _NEAR_FRACTIONS
    multiples = np.clip(multiples, 0, STEPS - 1).astype(np.uint64)
    real = low + (high - low) * (multiples.astype(float) / STEPS)
    steps = np.full(states, field.residue(step), np.uint64)
    starts = np.full(states, field.residue(first), np.uint64)
    residue = field.add(field.multiply(multiples, steps), starts)
    form = None
    if formulas:
        form = forms.variable(name)
    node = ProgramStep("input", text=name)
    return ExactValue(residue, np.ones(states, bool), real, Degree(1), form=form, node=node)


def turn(
    generator: np.random.Generator,
    low: float,
    high: float,
    states: int,
    name: str,
    formulas: bool = False,
    near: Array | None = None,
) -> Angle:
    """Return a random angle from low to high rad at each of k states, within half a turn of their middle.

    If angles `near` (k,) are given, it is near them.

    The tangent t of half its distance from a multiple of 30 degrees near the middle is a random fraction; cosine and
    sine are fractions of t.
    """
    start = _nearest((low + high) / 2)
    farthest = _OPEN_SHARE * math.pi
    first = math.tan(max(low - start, -farthest) / 2)
    last = math.tan(min(high - start, farthest) / 2)
    near_tangents = None
    if near is not None:
        near_tangents = np.tan(np.clip(near - start, -farthest, farthest) / 2)
    t = number(generator, first, last, states, name, near=near_tangents)
    one = values.constant(1.0, states)
    square = values.product(t, t)
    scale = values.reciprocal(values.total(one, square))
    cosine = values.product(values.difference(one, square), scale)
    sine = values.product(values.total(t, t), scale)
    real = 2 * np.arctan(t.real)
    turned_by = fixed_angle(start, states)
    angle = values.turned(turned_by, Angle(cosine, sine, real))
    # for a certificate, cosine and sine are inputs: it does not repeat how they were drawn
    cosine = replace(angle.cosine, node=ProgramStep("cosine", text=name))
    sine = replace(angle.sine, node=ProgramStep("sine", text=name))
    if formulas:
        cosine = replace(cosine, form=forms.cosine(name))
        sine = replace(sine, form=forms.sine(name))
    return replace(angle, cosine=cosine, sine=sine)


def _nearest(angle: float) -> float:
    """Return the multiple of 30 degrees nearest to an angle in rad."""
    step = math.pi / 6
    return round(angle / step) * step


def fixed_angle(angle: float, states: int) -> Angle:
    """Return an angle in rad at k states; cosine and sine are unknown in the field if they have no exact form."""
    real = np.full(states, angle)
    point = exact_angle(angle, tolerance=_ANGLE_TOLERANCE)
    if point is None:
        return Angle(values.unknown(np.cos(real)), values.unknown(np.sin(real)), real)
    cosine, sine = point
    return Angle(values.exact(cosine, states), values.exact(sine, states), real)


def named(
    generator: np.random.Generator,
    ranges: Mapping[str, tuple[bool, float, float]],
    states: int,
    formulas: bool = False,
    near: Mapping[str, Array] | None = None,
) -> dict[str, Value]:
    """Return random values by name; a range is (whether it is an angle, low, high).

    `formulas`: whether they are variables of formulas. `near`: {name: values (k,) near which they are}.
    """
    values_of: dict[str, Value] = {}
    for name, (is_angle, low, high) in ranges.items():
        near_values = None
        if near is not None:
            near_values = near[name]
        if is_angle:
            values_of[name] = turn(generator, low, high, states, name, formulas, near_values)
        else:
            values_of[name] = number(generator, low, high, states, name, formulas, near_values)
    return values_of
