"""A value along a path, enclosed in every cell of time, and its limit."""

from __future__ import annotations

from dataclasses import dataclass

from twin.core.spatial import Array
from twin.proof.motion.value_groups import MARGINS, SPEEDS

SPEED_EXCESS = 1e-3
"""Fraction by which a speed may exceed its limit: as for the samples of a plan."""

TOUCHING = 1e-12
"""Amount in m or rad by which a margin may be below its limit: rounding of a motion that ends at a limit."""


@dataclass(frozen=True)
class Enclosure:
    """A value in every cell.

    A determinant is given as the logarithm of its ratio to the value at the start, which is 0 there.

    Attributes:
        name: of the joint, motor or pair of carriages; of an RCM, a speed of the tool, and all loops together, one of
            the names in `value_groups`.
        group: what kind of value it is, one of `value_groups`.
        unit: "m", "rad", "m/s", "rad/s" or "1".
        low, high: (M,) bounds; infinite where nothing is known.
        limit: what the value must not exceed or, if `smallest`, what it must reach.
        smallest: whether the smallest value counts; otherwise the largest.
    """

    name: str
    group: str
    unit: str
    low: Array
    high: Array
    limit: float
    smallest: bool

    def as_largest(self) -> tuple[Array, Array, float]:
        """Return (low (M,), high (M,), limit) of a value that must not exceed its limit.

        A smallest value is turned to its negative. The limit is that which counts: with the accepted excess of a speed,
        and the rounding of a margin.
        """
        limit = self.limit
        if self.group in SPEEDS:
            limit = limit * (1.0 + SPEED_EXCESS)
        if self.group in MARGINS:
            limit = limit - TOUCHING
        if self.smallest:
            return -self.high, -self.low, -limit
        return self.low, self.high, limit
