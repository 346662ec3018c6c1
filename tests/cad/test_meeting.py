"""The tilt of a joint: that of opposite axes too, which no cross product tells."""

from __future__ import annotations

import numpy as np
import pytest

from twin.cad.meeting import locked_gap_sizes
from twin.core import spatial


@pytest.mark.parametrize("kind", ["revolute", "cylindrical"])
@pytest.mark.parametrize("turn", [np.diag([1.0, -1.0, -1.0]), spatial.exp_so3([np.pi, 0, 0]), np.diag([-1.0, 1, -1])])
def test_opposite_axes_are_tilted_by_half_a_turn(kind, turn):
    offset, tilt = locked_gap_sizes(spatial.pose(turn), kind)
    assert offset == 0
    assert tilt == pytest.approx(np.pi)


def test_a_turn_about_the_axis_is_free():
    assert locked_gap_sizes(spatial.pose(np.diag([-1.0, -1.0, 1.0])), "revolute") == (0, 0)
