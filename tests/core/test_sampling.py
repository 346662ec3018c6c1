"""Samples out of many: evenly spread, and never more than there are."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from twin.core.sampling import spread


@given(st.integers(1, 3000), st.integers(2, 400))
def test_ends_are_chosen_and_gaps_are_even(count, most):
    chosen = spread(count, most)
    assert len(chosen) == min(count, most)
    assert chosen[0] == 0
    assert chosen[-1] == count - 1
    gaps = np.diff(chosen)
    assert gaps.size == 0 or gaps.max() - gaps.min() <= 1


def test_nothing_is_chosen_of_nothing():
    assert spread(0, 5).size == 0


@pytest.mark.parametrize("most", [1, 0, -1])
def test_fewer_than_first_and_last_are_refused(most):
    with pytest.raises(ValueError, match=f"at most {most} indices: give at least 2"):
        spread(10, most)
