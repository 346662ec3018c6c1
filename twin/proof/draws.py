"""Random states: fractions near given values, each with its exact and its real value."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from fractions import Fraction
from typing import NamedTuple

import numpy as np

from twin.core.spatial import Array
from twin.proof import field, values
from twin.proof import form as forms
from twin.proof.constants import exact_angle
from twin.proof.degree import Degree
from twin.proof.program import ProgramStep
from twin.proof.values import Angle, DrawnCondition, ExactValue, Value


class RandomRange(NamedTuple):
    """The range from which a random number is drawn.

    Attributes:
        is_angle: whether it is an angle, whose cosine and sine are exact; otherwise a length.
        low, high: its ends in rad or m.
    """

    is_angle: bool
    low: float
    high: float


STEPS = 2**49
"""Number of fractions among which a random number is drawn; the odds of a chance zero are a degree divided by this."""

_FRACTIONS_AT_CENTRE = 2**4
"""Number of fractions among which one near a given value is drawn."""

_ANGLE_PER_TANGENT = 512.0
"""Bound of an angle's step by a step of its tangent, each as a part of its range: at most 2 * 1273 / (2 pi) = 405.

The range of tangents is up to 2 tan(0.999 pi / 2) = 1273 wide, and an angle changes by at most 2 per unit of its
tangent.
"""

CENTRE_DISTANCE = _ANGLE_PER_TANGENT * _FRACTIONS_AT_CENTRE / STEPS
"""Largest distance of what is drawn near a given value from it, as a part of the range.

The fractions are above the value, but for half a step.
"""

_ANGLE_TOLERANCE = 1e-12
"""Largest distance of an angle from a multiple of 30 or of 45 degrees, as a part of 30 or of 45 degrees."""

_OPEN_SHARE = 0.999
"""Share of half a turn to each side within which angles are drawn: the tangent of half of it must exist."""

_ROOM_AT_LIMITS = 1e-12
"""Distance in rad from its limits at which an angle near a far centre is drawn: more than its fractions differ by."""


def number(
    generator: np.random.Generator,
    low: float,
    high: float,
    states: int,
    name: str,
    formulas: bool = False,
    centres: Array | None = None,
) -> ExactValue:
    """Return a random fraction from low to high at each of k states; it may be a variable of formulas.

    If values `centres` (k,) are given, the fractions are within a part of 2^-45 of the range from them.
    """
    first = Fraction(low)
    step = (Fraction(high) - first) / STEPS
    multiples = generator.integers(0, STEPS, states)
    if centres is not None:
        nearest_multiples = np.round((centres - low) / (high - low) * STEPS).astype(np.int64)
        # not the nearest fraction itself: repeated states must be others
        multiples = nearest_multiples + multiples % _FRACTIONS_AT_CENTRE
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
    centres: Array | None = None,
) -> Angle:
    """Return a random angle from low to high rad at each of k states, within half a turn of their middle.

    If angles `centres` (k,) are given, it is near them, also beyond half a turn.

    The tangent t of half its distance from a multiple of 30 degrees near the middle is a random fraction; cosine and
    sine are fractions of t: (1 - t^2) / (1 + t^2) and 2 t / (1 + t^2).
    """
    origin = _nearest_multiple_of_30_degrees((low + high) / 2)
    farthest = _OPEN_SHARE * math.pi
    first_tangent = math.tan(max(low - origin, -farthest) / 2)
    last_tangent = math.tan(min(high - origin, farthest) / 2)
    central_tangents = None
    if centres is not None:
        central_tangents = np.tan(np.clip(centres - origin, -farthest, farthest) / 2)
    t = number(generator, first_tangent, last_tangent, states, name, centres=central_tangents)
    cosine, sine = _of_half_tangent(t)
    real = 2 * np.arctan(t.real)
    from_origin = Angle(cosine, sine, real)
    angle = values.turned(fixed_angle(origin, states), from_origin)
    if centres is not None:
        angle = _with_far_centres(generator, angle, low, high, origin, centres)
    # for a certificate, cosine and sine are inputs: it does not repeat how they were drawn
    cosine = replace(angle.cosine, node=ProgramStep("cosine", text=name))
    sine = replace(angle.sine, node=ProgramStep("sine", text=name))
    if formulas:
        cosine = replace(cosine, form=forms.cosine(name))
        sine = replace(sine, form=forms.sine(name))
    return replace(angle, cosine=cosine, sine=sine)


def _with_far_centres(
    generator: np.random.Generator, angle: Angle, low: float, high: float, origin: float, centres: Array
) -> Angle:
    """Return an angle (k,) that is near its centres (k,) where those are half a turn or more from an origin, too.

    The tangent that draws the angle has no value at half a turn: there it is that of half the distance from the next
    whole number of half turns.
    """
    is_far = np.abs(centres - origin) > _OPEN_SHARE * math.pi
    if not is_far.any():
        return angle
    states = len(centres)
    inside = np.clip(centres, low + _ROOM_AT_LIMITS, high - _ROOM_AT_LIMITS)
    half_turns = np.round((inside - origin) / math.pi)
    tangents = np.tan((inside - origin - half_turns * math.pi) / 2)
    # a stream of random numbers of its own: what is drawn near other centres stays as it is
    (own_generator,) = generator.spawn(1)
    t = number(own_generator, -1.0, 1.0, states, "", centres=tangents)
    cosine, sine = _of_half_tangent(t)
    real = 2 * np.arctan(t.real) + half_turns * math.pi
    is_odd = DrawnCondition(half_turns % 2 == 1)
    cosine = values.choose(is_odd, values.minus(cosine), cosine)
    sine = values.choose(is_odd, values.minus(sine), sine)
    far = values.turned(fixed_angle(origin, states), Angle(values.scalar(cosine), values.scalar(sine), real))
    return values.angle(values.choose(DrawnCondition(is_far), far, angle))


def _of_half_tangent(t: ExactValue) -> tuple[ExactValue, ExactValue]:
    """Return cosine and sine of an angle, given the tangent of its half: (1 - t^2) / (1 + t^2), 2 t / (1 + t^2)."""
    one = values.constant(1.0, len(t.real))
    square = values.product(t, t)
    scale = values.reciprocal(values.total(one, square))
    cosine = values.product(values.difference(one, square), scale)
    sine = values.product(values.total(t, t), scale)
    return cosine, sine


def _nearest_multiple_of_30_degrees(angle: float) -> float:
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
    ranges: Mapping[str, RandomRange],
    states: int,
    formulas: bool = False,
    centres: Mapping[str, Array] | None = None,
) -> dict[str, Value]:
    """Return {random number: its values at k states}.

    Args:
        generator: of the random numbers.
        ranges: {random number: its range}.
        states: number k of states.
        formulas: whether they are variables of formulas.
        centres: {random number: values (k,) near which it is drawn}; None: anywhere in its range.
    """
    random_values: dict[str, Value] = {}
    for name, (is_angle, low, high) in ranges.items():
        centres_of_number = None
        if centres is not None:
            centres_of_number = centres[name]
        if is_angle:
            random_values[name] = turn(generator, low, high, states, name, formulas, centres_of_number)
        else:
            random_values[name] = number(generator, low, high, states, name, formulas, centres_of_number)
    return random_values
