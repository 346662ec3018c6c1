"""What is known of all conditions in the equations: whether both answers of each were judged, and how that is known."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from twin.core.spatial import Array
from twin.formula.contract import Formula
from twin.proof import draws, values
from twin.proof.branch_bounds import bounded_conditions
from twin.proof.branch_search import other_answers
from twin.proof.draws import RandomRange
from twin.proof.equation_conditions import EquationConditions

_RARE = 64
"""Number of states with an answer below which they are judged besides."""

_KEPT_RARE = 16
"""Maximum number of states that are kept of those where one condition has a rare answer."""

_CONDITION_STATES = 2048
"""Number of states at which conditions have their answers, before others are searched."""


@dataclass(frozen=True)
class BranchReport:
    """The conditions of the equations, and how it is known that all their answers were judged.

    Attributes:
        count: number of conditions.
        drawn: those with both answers at drawn states.
        undefined: those with one answer, because the equations have no value at the other.
        bounded: those with one answer at all states within the limits, by intervals.
        found: those whose other answer was found by a search, at states that were judged then.
        open: texts of those with one answer at all drawn states, and their smallest margin; nothing else is known.
        unfound: those with one answer at all drawn states whose other answer no search found, on which nothing depends
            of which anything is claimed: they are among the silent ones.
        silent: texts of those with an answer that few drawn states have, or none, on which nothing depends of which
            anything is claimed; those of them that are not among the unfound are among the drawn or found.
        states: {name: values (j,)} at the states that were found, and at those with rare answers.
        refused: {name: values (j,)} at states that a search found, where a condition leaves no value.
        without_value: {name: value} at a state within reach where the equations have no value; empty if there is none.
    """

    count: int
    drawn: int
    undefined: int
    bounded: int
    found: int
    unfound: int
    open: tuple[str, ...]
    silent: tuple[str, ...]
    states: Mapping[str, Array]
    refused: Mapping[str, Array]
    without_value: Mapping[str, float]

    @property
    def unjudged(self) -> int:
        """Number of conditions in no category, because no drawn state is within reach."""
        return self.count - self.drawn - self.undefined - self.bounded - self.found - self.unfound - len(self.open)


def examined_conditions(
    formula: Formula,
    variants: Mapping[str, str],
    drawn_parameters: Collection[str],
    ranges: Mapping[str, RandomRange],
    seed: int,
    unclaimed: Collection[str] = (),
) -> BranchReport:
    """Return what is known of the conditions in the equations.

    Args:
        formula: the equations.
        variants: the chosen variant of each equation.
        drawn_parameters: parameters with random values.
        ranges: {random number: its range}.
        seed: of the random numbers.
        unclaimed: results of which nothing is claimed, for `examined`; if there are none, conditions that only
            measures and aspects depend on are left out.
    """
    conditions = EquationConditions(formula, variants, drawn_parameters, measures=bool(unclaimed))
    ranges_of_state = {}
    limits = []
    for name in conditions.names:
        ranges_of_state[name] = ranges[name]
        limits.append([ranges[name].low, ranges[name].high])
    # a stream of random numbers of its own: the states are others than those of the claims
    state = draws.named(np.random.default_rng([seed, 1]), ranges_of_state, _CONDITION_STATES)
    drawn_values = values.stacked_reals(state.values(), _CONDITION_STATES)
    published = drawn_values.copy()
    for parameter in formula.parameters:
        if parameter.name in drawn_parameters:
            published[conditions.names.index(parameter.name)] = float(parameter.value)
    return examined(conditions, drawn_values, published, np.array(limits), unclaimed)


def examined(
    conditions: EquationConditions, state: Array, published: Array, limits: Array, unclaimed: Collection[str]
) -> BranchReport:
    """Return what is known of all conditions, from drawn states (n, k) within limits (n, 2).

    `unclaimed` are the results of which nothing is claimed; for their names see `EquationCondition.effects`.

    `published` (n, k) are the same states with the published parameters. Only there, a state without a value is a fault
    of the equations: with other lengths, the mechanism itself may not reach it, and no margin may say so.
    """
    without_value = _state_without_value(conditions, published)
    has_values, within = conditions.has_values_and_reach(state)
    state = state[:, has_values & within]
    count = len(conditions)
    if not len(conditions) or not state.shape[1]:
        empty = dict.fromkeys(conditions.names, np.zeros(0))
        return BranchReport(
            count=count,
            drawn=0,
            undefined=0,
            bounded=0,
            found=0,
            unfound=0,
            open=(),
            silent=(),
            states=empty,
            refused=empty,
            without_value=without_value,
        )
    answers = _answers_at(conditions, state, unclaimed)
    bounded = bounded_conditions(conditions, answers.single, limits)
    searched = [index for index in answers.single if index not in bounded]
    other_states = other_answers(conditions, searched, state, limits)
    silent = list(answers.silent)
    open_texts = []
    unfound = []  # the conditions whose other answer no search found
    unfound_and_silent = 0
    margins = conditions.margins(state).full()
    for i, states in zip(searched, other_states, strict=True):
        is_found = states.shape[1] > 0
        if not is_found:
            unfound.append(i)
        if conditions[i].only_affects(unclaimed):
            silent.append(conditions.effect(i))
            unfound_and_silent += not is_found
        elif not is_found:
            smallest = np.abs(margins[i]).min()
            open_texts.append(f"{conditions.text(i)} (margin {smallest:.2g} or more)")
    # a condition without another answer within reach may leave no value, in a way that is not seen in the operations
    suspects = answers.undefined + unfound
    refused_states = _joined(other_answers(conditions, suspects, state, limits, refused=True), len(limits))
    if refused_states.shape[1]:
        has_values, within = conditions.has_values_and_reach(refused_states)
        refused_states = refused_states[:, ~(has_values & within)]
    judged_states = _joined([*answers.rare, *other_states], len(limits))
    return BranchReport(
        count=count,
        drawn=count - len(answers.undefined) - len(answers.single),
        undefined=len(answers.undefined),
        bounded=len(bounded),
        found=len(searched) - len(unfound),
        unfound=unfound_and_silent,
        open=tuple(open_texts),
        silent=tuple(silent),
        states=dict(zip(conditions.names, judged_states, strict=True)),
        refused=dict(zip(conditions.names, refused_states, strict=True)),
        without_value=without_value,
    )


@dataclass
class _DrawnAnswers:
    """The answers that conditions have at drawn states.

    Attributes:
        single: {index of a condition with one answer: the answer}, but for those of `undefined`.
        undefined: indices of those with one answer, because the other leaves no value.
        rare: some states (n, j) with a rare answer, of each condition that has one.
        silent: texts of conditions with a rare answer, or none, on which nothing depends of which anything is claimed.
    """

    single: dict[int, bool] = field(default_factory=dict)
    undefined: list[int] = field(default_factory=list)
    rare: list[Array] = field(default_factory=list)
    silent: list[str] = field(default_factory=list)


def _answers_at(conditions: EquationConditions, state: Array, unclaimed: Collection[str]) -> _DrawnAnswers:
    """Return the answers of all conditions at states (n, k) within reach, of which there is at least one."""
    answers = _DrawnAnswers()
    margins = conditions.margins(state).full()
    for i, condition in enumerate(conditions):
        is_true = condition.has(True, margins[i])
        if is_true.any() and not is_true.all():
            # the claims were judged at other states: an answer that is rare may not be among those
            has_rarer = is_true
            if is_true.sum() > (~is_true).sum():
                has_rarer = ~is_true
            if has_rarer.sum() < _RARE:
                answers.rare.append(state[:, has_rarer][:, :_KEPT_RARE])
                if condition.only_affects(unclaimed):
                    answers.silent.append(conditions.effect(i))
            continue
        answer = bool(is_true[0])
        if (not answer) in condition.undefined:
            answers.undefined.append(i)
            if condition.only_affects(unclaimed) and not condition.refuses:
                answers.silent.append(conditions.effect(i))
        else:
            answers.single[i] = answer
    return answers


def _state_without_value(conditions: EquationConditions, state: Array) -> dict[str, float]:
    """Return {name: value} at the first of states (n, k) within reach without a value; empty if all have one."""
    has_values, within = conditions.has_values_and_reach(state)
    faults = np.flatnonzero(within & ~has_values)
    if not len(faults):
        return {}
    # the values are plain numbers, which JSON can hold
    return dict(zip(conditions.names, state[:, faults[0]].tolist(), strict=True))


def states_one_by_one(values_of: Mapping[str, Array]) -> list[dict[str, float]]:
    """Return {name: value} at each of j states, given {name: values (j,)}."""
    names = list(values_of)
    states = []
    for state in zip(*values_of.values(), strict=True):
        states.append(dict(zip(names, map(float, state), strict=True)))
    return states


def _joined(states: Sequence[Array], coordinates: int) -> Array:
    """Return states (n, j), side by side; n is needed where there are none."""
    return np.hstack([np.zeros((coordinates, 0)), *states])
