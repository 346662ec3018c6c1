"""A quantile of numbers that come in batches, of which only the largest are kept."""

from __future__ import annotations

import math

import numpy as np

from twin.core.spatial import Array


class UpperQuantile:
    """The quantile of a known number of values, exactly: as `numpy.quantile` returns it for all of them together.

    Only the values above the quantile are kept: for the quantile 0.95, a twentieth, and as many that are new.
    """

    def __init__(self, share: float, count: int) -> None:
        """Expect `count` values; `share` (0 to 1) of them are below the quantile.

        Raises:
            ValueError: there is no value, or `share` is not within 0 to 1.
        """
        if count < 1 or not 0 <= share <= 1:
            raise ValueError(f"a quantile {share:g} of {count} values: give at least 1 value, and 0 to 1")
        place = share * (count - 1)  # of the quantile among the sorted values
        below = math.floor(place)
        self._fraction = place - below  # of the way from the value below the quantile to that above it
        self._largest_count = count - below
        self._expected_count = count
        self._added_count = 0
        self._largest: list[Array] = []
        self._stored_count = 0  # number of values in `_largest`

    def add(self, values: Array) -> None:
        """Add values (k,).

        Raises:
            ValueError: more values are given than were expected.
        """
        self._added_count += len(values)
        if self._added_count > self._expected_count:
            raise ValueError(f"{self._added_count} values are given; {self._expected_count} were expected")
        self._largest.append(values)
        self._stored_count += len(values)
        # not after each batch: finding the largest values takes time in proportion to all that are stored
        if self._stored_count > 2 * self._largest_count + len(values):
            self._drop()

    def _drop(self) -> None:
        """Drop all values but the largest; NaN counts as larger than any number."""
        values = np.concatenate(self._largest)
        if len(values) > self._largest_count:
            values = np.partition(values, len(values) - self._largest_count)[-self._largest_count :]
        self._largest = [values]
        self._stored_count = len(values)

    @property
    def value(self) -> float:
        """The quantile; NaN if any value is NaN.

        Raises:
            ValueError: fewer values were given than were expected.
        """
        if self._added_count < self._expected_count:
            raise ValueError(f"{self._added_count} values are given; {self._expected_count} were expected")
        self._drop()
        (values,) = self._largest
        if np.isnan(values).any():
            return float("nan")
        if self._largest_count == 1:
            return float(values[0])
        first, second = np.partition(values, 1)[:2]
        return float(first + self._fraction * (second - first))
