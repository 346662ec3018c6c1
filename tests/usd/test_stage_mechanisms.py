"""The small mechanisms of `made.mechanisms` close exactly."""

from __future__ import annotations

import numpy as np
import pytest

from made.mechanisms import four_bar, four_bar_state, gaps, slider, slider_state
from twin.core import spatial


@pytest.mark.parametrize("crank", np.linspace(-3, 3, 7))
def test_the_four_bar_closes_exactly(crank):
    poses, q = four_bar_state(crank)
    assert max(gaps(four_bar(), poses).values()) < 1e-15
    for joint in four_bar().joints:
        A = joint.relative(poses[joint.parent], poses[joint.child])
        assert np.allclose(A[:3, :3], spatial.rotation_z(q[joint.name]), atol=1e-14)


def test_the_slider_closes_exactly():
    assert max(gaps(slider(), slider_state(0.02, 0.4)[0]).values()) < 1e-15
