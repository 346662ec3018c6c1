"""Search for states at which a condition of the equations has an answer that it has at no drawn state.

A search goes along the gradient of the condition's margin, by Newton steps from the drawn states where it is smallest.
"""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np

from twin.core.spatial import Array
from twin.proof.degree import Truths
from twin.proof.draws import CENTRE_DISTANCE
from twin.proof.equation_conditions import EquationConditions
from twin.proof.function_branches import EquationCondition

_MOST_STARTS = 24
"""Number of states nearest to the change of an answer from which a search starts."""

_NEWTON_STEPS = 6
"""Number of Newton steps of a search."""

_AIM_PARTS = tuple(10.0**-k for k in range(10))
"""How far beyond the change of an answer a search aims, as parts of the margin at its start.

A far aim finds answers that hold in a wide region; a near one those that hold in a narrow strip.
"""

_NEIGHBOURS = 4
"""Number of states beside a state at which its answer must be the same."""

_NEIGHBOUR_DISTANCES = (-0.05, 1.0)
"""Where these states are, as parts of the distance within which a state is drawn near another (`CENTRE_DISTANCE`)."""

_MOST_FOUND = 16
"""Maximum number of states that are kept of those where one condition has another answer."""

_MOST_REFUSED = 240
"""The same of those where the other answer leaves no value."""


def other_answers(
    conditions: EquationConditions, chosen: Sequence[int], state: Array, limits: Array, refused: bool = False
) -> list[Array]:
    """Return, for each chosen condition, states within reach where it has the answer that it has at no drawn state.

    Args:
        conditions: all conditions of the equations.
        chosen: indices of those with one answer.
        state: drawn states (n, k) within reach.
        limits: lowest and highest values (n, 2) of the state.
        refused: whether the other answer leaves no value: then the states that are returned have none.

    Returns:
        for each chosen condition: states (n, j); j is 0 if none was found.
    """
    if not chosen:
        return []
    margins = conditions.margins_of(chosen)(state).full()
    states = []
    for margin, i in zip(margins, chosen, strict=True):
        sizes = np.where(np.isfinite(margin), np.abs(margin), np.inf)
        nearest = np.argsort(sizes)[:_MOST_STARTS]
        answer = bool(conditions[i].has(True, margin[nearest[:1]])[0])
        states.append(_search(conditions, i, answer, state[:, nearest], limits, refused))
    return states


def _search(conditions: EquationConditions, i: int, answer: bool, starts: Array, limits: Array, refused: bool) -> Array:
    """Return states (n, j) where condition i does not have an answer that it has at `starts` (n, k).

    For the other arguments see `other_answers`.
    """
    condition = conditions[i]
    gradient = ca.Function(
        "gradient", [conditions.state], [condition.margin, ca.jacobian(condition.margin, conditions.state)]
    )
    coordinate_count, start_count = starts.shape
    # each start with each aim, side by side
    x = np.repeat(starts, len(_AIM_PARTS), axis=1)
    function = gradient.map(x.shape[1])
    # the search goes towards negative signed margins
    sign = -1.0
    if answer:
        sign = 1.0
    most_states = _MOST_FOUND
    if refused:
        most_states = _MOST_REFUSED
    found_states: list[Array] = []
    aim = np.zeros(0)
    for step in range(_NEWTON_STEPS):
        margin_row, slope_row = function(x)
        margin = margin_row.full()[0]
        has_other_answer = np.isfinite(margin) & condition.has(not answer, margin)
        margin = sign * margin
        slope = sign * slope_row.full()[0].reshape(x.shape[1], coordinate_count).T
        if step == 0:
            aim = np.tile(_AIM_PARTS, start_count) * np.abs(margin)
        if refused:
            found_states += list(x[:, has_other_answer].T)
        elif has_other_answer.any():
            has_values, within = conditions.has_values_and_reach(x)
            candidates = x[:, has_other_answer & has_values & within]
            steady = _is_steady(gradient, condition, not answer, candidates, limits)
            found_states += list(candidates[:, steady].T)
        if len(found_states) >= most_states:
            break
        with np.errstate(divide="ignore", invalid="ignore"):
            newton = -(margin + aim) / (slope**2).sum(axis=0) * slope
        newton = np.where(np.isfinite(newton), newton, 0.0)
        x = np.clip(x + newton, limits[:, :1], limits[:, 1:])
    return np.array(found_states[:most_states]).reshape(-1, coordinate_count).T


def _is_steady(
    gradient: ca.Function, condition: EquationCondition, answer: bool, state: Array, limits: Array
) -> Truths:
    """Return which states (n, k) have an answer at all states near them that may be judged in their place.

    A claim is judged at exact fractions near a state that was found, not at the state itself.
    """
    is_steady = np.ones(state.shape[1], bool)
    width = CENTRE_DISTANCE * (limits[:, 1:] - limits[:, :1])
    generator = np.random.default_rng(0)  # the same neighbours in each proof
    for _ in range(_NEIGHBOURS):
        neighbours = state + width * generator.uniform(*_NEIGHBOUR_DISTANCES, state.shape)
        margin, _ = gradient(np.clip(neighbours, limits[:, :1], limits[:, 1:]))
        is_steady &= condition.has(answer, margin.full()[0])
    return is_steady
