"""Numbers with their units."""

from __future__ import annotations

import pytest

from twin.core.quantity import Quantity, si
from twin.core.units import DEG


@pytest.mark.parametrize(
    ("value", "unit", "expected"),
    [
        (0.002, "m", Quantity(2.0, "mm")),
        (0.002, "m/s2", Quantity(2.0, "mm/s2")),
        (90 * DEG, "rad", Quantity(90.0, "deg")),
        (90 * DEG, "rad/s", Quantity(90.0, "deg/s")),
        (3.0, "N", Quantity(3.0, "N")),
        (0.5, "1", Quantity(0.5, "")),
        (0.5, "", Quantity(0.5, "")),
    ],
)
def test_only_lengths_and_angles_are_converted(value, unit, expected):
    quantity = si(value, unit)
    assert quantity.unit == expected.unit
    assert quantity.value == pytest.approx(expected.value)
