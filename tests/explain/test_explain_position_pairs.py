"""Pairs of edits at two positions: those whose effects add up to a residual come first."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np

from twin.validation.explain.candidate import Candidate
from twin.validation.explain.deadline import Deadline
from twin.validation.explain.position_pairs import PositionPairs

ROW = ("equation", 0, "")


def changing(effect):
    """Return a candidate that changes the residual 30 of the row by an effect."""
    return Candidate(None, [], {}, {ROW: abs(30.0 + effect)}, False, {ROW: np.array([[30.0 + effect]])})


def test_of_many_second_edits_those_nearest_to_the_residual_are_tried():
    first = changing(0.0)
    fitting = changing(-30.0)
    others = [changing(-30.0 + sign * distance) for distance in np.linspace(1.0, 19.0, 60) for sign in (-1, 1)]
    search = PositionPairs(SimpleNamespace(residuals_before={ROW: np.array([[30.0]])}))
    seconds = [b for a, b in search._additive(ROW, [first, *others, fitting], Deadline()) if a is first]
    assert fitting in seconds
    assert len(seconds) == 50
    assert max(abs(b.changed_residuals[ROW].item()) for b in seconds) < 9.0
