"""Exact forms of the numbers of a CAD: the decimals, angles and parameters of its drawing.

A number of a CAD is rounded, but was drawn: a length as a decimal in mm, as a decimal times sqrt(2), sqrt(3) or
sqrt(6), or as a sum of one with a part of a parameter of the equations; an angle as a multiple of 30 or 45 degrees, or
as a sum of one with parameters. Within a tolerance, the number is taken as this exact one: 77.9422863 mm as 45 sqrt(3)
mm.

The entries of a pose are no such numbers. A pose is therefore taken apart into five steps whose angles and lengths are
(as those of Denavit and Hartenberg): turn about z, shift, turn about x, shift along z, turn about z.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from fractions import Fraction
from functools import cache, lru_cache
from itertools import combinations
from typing import NamedTuple

import numpy as np

from twin.core.spatial import Array
from twin.proof import constants, values
from twin.proof import form as forms
from twin.proof.constants import ROOTS, ExactNumber, decimal, exact_angle
from twin.proof.form import Form
from twin.proof.near_numbers import near_length
from twin.proof.transforms import Matrix, compose, shifted, turn
from twin.proof.values import Angle, ExactValue

LENGTH_TOLERANCE = 1e-10
"""Distance in m within which a length of the CAD is taken as a decimal, or as a decimal multiplied by a root."""

ANGLE_TOLERANCE = 1e-9
"""Difference in rad within which an angle of the CAD is taken as a multiple of 30 or 45 degrees, or as a parameter."""

_STEPS_PER_METRE = {1: 10**5, 2: 2000, 3: 2000}
"""{radicand: steps in a metre}: what remains of a length after a part of a parameter is subtracted is a multiple of 10
micrometres, or of half a millimetre multiplied by a root."""

_DRAWN_MULTIPLES = (Fraction(1), Fraction(1, 2), Fraction(3, 2), Fraction(2), Fraction(1, 3))
"""Multiples of a parameter that are parts of lengths in drawings."""

_LARGEST_NUMBER_OF_PART = 6
"""Largest numerator and denominator of a part of a parameter in a formula."""


class PoseSteps(NamedTuple):
    """A pose as five steps: turn about z, shift, turn about x, shift along z, turn about z.

    Attributes:
        theta: first turn about z.
        shift: (3,) shift in m: along the common normal of the two z axes, and along the first one.
        alpha: turn about x, the angle between the two z axes.
        slide: shift in m along the second z axis.
        phi: second turn about z.
    """

    theta: Angle
    shift: list[ExactValue]
    alpha: Angle
    slide: ExactValue
    phi: Angle


class Drawing:
    """Finds exact forms, and keeps what has none.

    Attributes:
        states: number k of states.
        unrecognised_numbers: numbers without an exact form, as texts with their body.
        recognised_lengths: {length as text: its exact form}, for lengths that are no decimals.
        near_roots: {length without an exact form as text: the root of a drawing that it is, but for its last digit}.
        largest_rounding: the largest difference in m or rad so far between a number and its exact form.
    """

    def __init__(
        self, states: int, angles: Mapping[str, Angle], lengths: Mapping[str, Fraction], formulas: bool
    ) -> None:
        """Keep the parameters that the numbers may contain.

        Args:
            states: number of states.
            angles: {parameter of the equations: angle}; an angle of the CAD may be a sum with one or two of them.
            lengths: {parameter of the equations: length in m}; lengths of the CAD may contain one.
            formulas: whether lengths that are parts of a parameter are this part in formulas.
        """
        self.states = states
        self.unrecognised_numbers: list[str] = []
        self.recognised_lengths: dict[str, str] = {}
        self.near_roots: dict[str, str] = {}
        self.largest_rounding = 0.0
        self._lengths = lengths
        self._formulas = formulas
        self._angles = list(angles.values())
        self._sums = list(_sums(self._angles))

    def for_one_state(self) -> Drawing:
        """Return the same drawing for one state, without what was found."""
        first = np.array([0])
        angles = {}
        for i, angle in enumerate(self._angles):
            angles[str(i)] = values.angle(values.taken(angle, first))
        return Drawing(1, angles, self._lengths, formulas=False)

    def pose(self, T: Array, what: str) -> Matrix:
        """Return a pose (4, 4) as turn about z, shift, turn about x (common normal), shift along z, turn about z."""
        steps = self.steps(T, what)
        matrix = compose(turn(steps.theta, "z"), shifted(steps.shift))
        matrix = compose(matrix, turn(steps.alpha, "x"))
        zero = values.constant(0.0, self.states)
        matrix = compose(matrix, shifted([zero, zero, steps.slide]))
        return compose(matrix, turn(steps.phi, "z"))

    def steps(self, T: Array, what: str) -> PoseSteps:
        """Return the angles and lengths of the steps of `pose`."""
        z = T[:3, 2]
        p = T[:3, 3]
        sine_of_alpha = math.hypot(z[0], z[1])
        alpha = math.atan2(sine_of_alpha, z[2])
        theta = 0.0
        along = 0.0
        shift = p
        # parallel axes have no single common normal: then all of the shift lies before the turn about x
        if sine_of_alpha > ANGLE_TOLERANCE:
            normal = np.array([-z[1], z[0], 0.0]) / sine_of_alpha
            theta = math.atan2(normal[1], normal[0])
            # the feet of the common normal on both axes
            foot, distance, along = np.linalg.solve(np.column_stack([[0.0, 0.0, 1.0], normal, z]), p)
            shift = np.array([distance, 0.0, foot])
        normal = np.array([math.cos(theta), math.sin(theta), 0.0])
        phi = math.atan2(T[:3, 0] @ np.cross(z, normal), T[:3, 0] @ normal)
        exact_alpha = self.angle(alpha, what)
        x, y = self._in_plane(float(shift[0]), float(shift[1]), what)
        foot, slide = self._feet(float(shift[2]), float(along), alpha, exact_alpha, what)
        return PoseSteps(self.angle(theta, what), [x, y, foot], exact_alpha, slide, self.angle(phi, what))

    def point(self, p: Array, what: str) -> list[ExactValue]:
        """Return a point (3,)."""
        x, y = self._in_plane(float(p[0]), float(p[1]), what)
        return [x, y, self.length(float(p[2]), what)]

    def _in_plane(self, x: float, y: float, what: str) -> tuple[ExactValue, ExactValue]:
        """Return a point of a plane, given by its coordinates, or by its distance and direction from the origin."""
        # A drawing may give a point by radius and direction: then its coordinates are not decimals.
        if self._exact_length(x) is None or self._exact_length(y) is None:
            distance = decimal(math.hypot(x, y), LENGTH_TOLERANCE)
            direction = self._exact_angle(math.atan2(y, x))
            if distance is not None and direction is not None:
                radius = self._noted_length(distance, math.hypot(x, y))
                return values.product(radius, direction.cosine), values.product(radius, direction.sine)
        return self.length(x, what), self.length(y, what)

    def _feet(
        self, foot: float, along: float, alpha: float, exact_alpha: Angle, what: str
    ) -> tuple[ExactValue, ExactValue]:
        """Return the distances of the feet of the common normal from the origins of both frames.

        If an origin lies at decimal distances from the first axis, the feet are `height - offset / sin(alpha)` and
        `offset cos(alpha) / sin(alpha)`.
        """
        if decimal(along, LENGTH_TOLERANCE) is None and abs(math.sin(2 * alpha)) > ANGLE_TOLERANCE:
            offset = decimal(along * math.tan(alpha), LENGTH_TOLERANCE)
            height = None
            if offset is not None:
                height = decimal(foot + float(offset) / math.sin(alpha), LENGTH_TOLERANCE)
            if offset is not None and height is not None:
                slant = values.product(values.exact(offset, self.states), values.reciprocal(exact_alpha.sine))
                first_foot = values.difference(values.exact(height, self.states), slant)
                return first_foot, values.product(slant, exact_alpha.cosine)
        return self.length(foot, what), self.length(along, what)

    def length(self, value: float, what: str) -> ExactValue:
        """Return a length in m: a decimal, a decimal and a root, or a sum with a part of a parameter."""
        exact_length = self._exact_length(value)
        if exact_length is not None:
            return self._noted_length(exact_length, value)
        text = f"{value * 1e3:.9g} mm of {what}"
        self.unrecognised_numbers.append(text)
        near_root = near_length(value, self._float_lengths())
        if near_root:
            self.near_roots[text] = near_root
        return values.unknown(np.full(self.states, value))

    def _float_lengths(self) -> dict[str, float]:
        """Return {parameter: its length in m} of the parameters that are not 0."""
        lengths = {}
        for name, length in self._lengths.items():
            if length:
                lengths[name] = float(length)
        return lengths

    def _exact_length(self, value: float) -> ExactNumber | None:
        """Return the exact form of a length in m; None if there is none."""
        return _exact_length(value, tuple(self._lengths.values()))

    def angle(self, value: float, what: str) -> Angle:
        """Return an angle in rad: a multiple of 30 or 45 degrees, or a sum of one with parameters."""
        exact = self._exact_angle(value)
        if exact is not None:
            return exact
        self.unrecognised_numbers.append(f"{math.degrees(value):.9g} deg of {what}")
        real = np.full(self.states, value)
        return Angle(values.unknown(np.cos(real)), values.unknown(np.sin(real)), real)

    def _exact_angle(self, value: float) -> Angle | None:
        """Return an angle in rad as a multiple of 30 or 45 degrees, or a sum of one with parameters; None if none."""
        multiple = self._multiple_of_30_or_45_degrees(value)
        if multiple is not None:
            return multiple
        for parameters in self._sums:
            published = 0.0
            for parameter in parameters:
                published += parameter.published
            multiple = self._multiple_of_30_or_45_degrees(math.remainder(value - published, 2 * math.pi))
            if multiple is None:
                continue
            angle = multiple
            for parameter in parameters:
                angle = values.turned(angle, parameter)
            return angle
        return None

    def _multiple_of_30_or_45_degrees(self, value: float) -> Angle | None:
        """Return an angle in rad as a multiple of 30 or 45 degrees; None if it is none."""
        point = exact_angle(value, ANGLE_TOLERANCE)
        if point is None:
            return None
        cosine, sine = point
        exact_value = math.atan2(float(sine), float(cosine))
        self.largest_rounding = max(self.largest_rounding, abs(math.remainder(value - exact_value, 2 * math.pi)))
        real = np.full(self.states, exact_value)
        return Angle(values.exact(cosine, self.states), values.exact(sine, self.states), real)

    def _noted_length(self, number: ExactNumber, value: float) -> ExactValue:
        """Return a length whose exact form is `number`, and keep what must be said of it."""
        self.largest_rounding = max(self.largest_rounding, abs(float(number) - value))
        if number.decimal is None:
            self.recognised_lengths[f"{value * 1e3:.9g} mm"] = f"{number.in_mm} mm"
        length = values.exact(number, self.states)
        if self._formulas and len(number.parts) == 1:
            radicand, fraction = number.parts[0]
            part = self._part_of_parameter(radicand, fraction)
            if part:
                return replace(length, form=part)
        return length

    def _part_of_parameter(self, radicand: int, fraction: Fraction) -> Form | None:
        """Return a length as a part of a parameter; None if it is none."""
        for name, length in self._lengths.items():
            part = fraction / length
            if part.denominator <= _LARGEST_NUMBER_OF_PART and abs(part.numerator) <= _LARGEST_NUMBER_OF_PART:
                root = forms.number(constants.exact(part, radicand))
                return forms.product(root, forms.variable(name))
        return None


@lru_cache(maxsize=4096)
def _exact_length(value: float, lengths: tuple[Fraction, ...]) -> ExactNumber | None:
    """Return the exact form of a length in m, given the lengths in m of parameters that it may contain."""
    number = decimal(value, LENGTH_TOLERANCE)
    if number is not None:
        return number
    for size, part in _parts(lengths):
        remainder = _on_grid(value - size)
        if remainder is not None:
            return constants.both(part, remainder)
    return None


@cache
def _parts(lengths: tuple[Fraction, ...]) -> list[tuple[float, ExactNumber]]:
    """Return the parts of parameters that a length may contain, each with its value."""
    parts = []
    for length in lengths:
        for radicand in (1, *ROOTS):
            for signed_length in (length, -length):
                for part in _DRAWN_MULTIPLES:
                    number = constants.exact(part * signed_length, radicand)
                    parts.append((float(number), number))
    return parts


def _on_grid(value: float) -> ExactNumber | None:
    """Return a length in m as a multiple of a step of drawings, or of one multiplied by a root."""
    for radicand, steps in _STEPS_PER_METRE.items():
        root = math.sqrt(radicand)
        count = round(value / root * steps)
        if abs(count / steps * root - value) <= LENGTH_TOLERANCE:
            return constants.exact(Fraction(count, steps), radicand)
    return None


def _sums(angles: Sequence[Angle]) -> Iterator[tuple[Angle, ...]]:
    """Yield each angle, then each two of them, with all signs."""
    for angle in angles:
        yield (angle,)
        yield (values.turned_back(angle),)
    for first, second in combinations(angles, 2):
        for signed_first in (first, values.turned_back(first)):
            for signed_second in (second, values.turned_back(second)):
                yield signed_first, signed_second
