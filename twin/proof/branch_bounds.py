"""Conditions that have one answer at all states within limits, by intervals of their margins over boxes of states."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from twin.core.spatial import Array
from twin.proof import intervals
from twin.proof.equation_conditions import EquationConditions
from twin.proof.interval_function import IntervalFunction

MOST_BOXES = 4096
"""Maximum number of boxes."""

_HALVINGS = 4
"""How often each coordinate is halved at most."""


def bounded_conditions(conditions: EquationConditions, answers: Mapping[int, bool], limits: Array) -> set[int]:
    """Return those of some conditions that have their answers at all states within limits.

    The range of the state is halved along one coordinate after the other, until the margins have bounds with one sign.

    Args:
        conditions: all conditions of the equations.
        answers: {index of a condition: the answer that it may have everywhere}.
        limits: lowest and highest values (n, 2) of the state.
    """
    if not answers:
        return set()
    indices = list(answers)
    margin_function = IntervalFunction(conditions.margins_of(indices))
    coordinates = len(limits)
    # lowest and highest corners (n, boxes) of the boxes in which a condition is still open
    low = np.array(limits[:, :1])
    high = np.array(limits[:, 1:])
    open_boxes = dict.fromkeys(indices, np.ones(1, bool))
    closed: set[int] = set()
    for halving in range(_HALVINGS * coordinates):
        state = list(map(intervals.between, low, high))
        (margins,) = margin_function([state])
        for i, margin in zip(indices, margins, strict=True):
            if i in closed:
                continue
            has_answer = conditions[i].has(answers[i], margin)
            open_boxes[i] = open_boxes[i] & ~np.broadcast_to(has_answer, low.shape[1:])
            if not open_boxes[i].any():
                closed.add(i)
                del open_boxes[i]
        open_mask = np.zeros(low.shape[1], bool)
        for is_open in open_boxes.values():
            open_mask |= is_open
        # all conditions share the boxes, so that a margin that several have is computed once
        if not open_mask.any() or 2 * open_mask.sum() > MOST_BOXES:
            break
        low, high = _halved(low[:, open_mask], high[:, open_mask], halving % coordinates)
        for i, is_open in open_boxes.items():
            open_boxes[i] = np.tile(is_open[open_mask], 2)
    return closed


def _halved(low: Array, high: Array, axis: int) -> tuple[Array, Array]:
    """Return the corners (n, 2 k) of the halves of k boxes with corners (n, k): lower halves, then upper ones."""
    middle = (low[axis] + high[axis]) / 2
    top_of_lower = np.array(high)
    top_of_lower[axis] = middle
    bottom_of_upper = np.array(low)
    bottom_of_upper[axis] = middle
    return np.hstack([low, bottom_of_upper]), np.hstack([top_of_lower, high])
