"""States at which all roots of a claim exist in the prime field, for claims with many roots.

Half of all residues are squares: of states drawn at random, one in 2^n has all of n roots. Among many more states than
a claim is judged at, those with all roots are found fast, because only what the roots depend on is computed, and a
state is dropped at the first root that it lacks.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from twin.proof import formula_side, values
from twin.proof.attempt import Attempt
from twin.proof.claims import JudgedClaim
from twin.proof.exact_replay import Notes, replay
from twin.proof.narrowed_states import NarrowedStates
from twin.proof.random_states import ProofStates

_MOST_STATES_OF_GROUP = 256
"""Largest number of states with all roots that are kept for a claim."""

RootGroup = tuple[frozenset[int], frozenset[int]]
"""Instructions with roots in the first and in the second function of the equations (`Attempt.roots`)."""


def root_groups(claims: Iterable[JudgedClaim], attempt: Attempt) -> list[RootGroup]:
    """Return the roots of each claim that needs more states where they exist.

    Args:
        claims: the claims.
        attempt: an attempt with the same claims, in the same order; it knows the instructions of their roots.
    """
    groups: list[RootGroup] = []
    for claim, attempted_claim in zip(claims, attempt.claims, strict=True):
        if not claim.needs_more_states:
            continue
        first_roots: set[int] = set()
        second_roots: set[int] = set()
        for root in attempt.roots:
            if root.signature not in attempted_claim.roots:
                continue
            if root.function == 0:
                first_roots.add(root.instruction)
            else:
                second_roots.add(root.instruction)
        group = (frozenset(first_roots), frozenset(second_roots))
        if group not in groups:
            groups.append(group)
    return groups


def with_roots(states: ProofStates, variants: Mapping[str, str], groups: Sequence[RootGroup]) -> ProofStates:
    """Return the states where all roots of one of some groups exist in the field."""
    rooted_mask = np.zeros(states.count, bool)
    for group in groups:
        places = _rooted_places(states, variants, group)
        rooted_mask[places[:_MOST_STATES_OF_GROUP]] = True
    return states.at(np.flatnonzero(rooted_mask))


def _rooted_places(states: ProofStates, variants: Mapping[str, str], group: RootGroup) -> NDArray[np.integer]:
    """Return the places of the states where the roots of a group exist."""
    first_roots, second_roots = group
    formula = states.formula
    if formula.has("forward"):
        outputs = formula_side.from_joints(formula, variants)
    else:
        outputs = formula_side.from_pose(formula, variants, coordinates=True)
    pose = outputs.names.index("pose")
    inputs = [list(states.state.values()), list(states.parameters.values())]
    needed_outputs = []
    if second_roots:
        needed_outputs = [pose]  # the second function is one of the pose
    in_first = NarrowedStates(first_roots, needed_outputs, np.arange(states.count))
    results = replay(outputs.function, inputs, Notes(), in_first)
    if not second_roots:
        return in_first.places
    parameters = [values.taken(value, in_first.places) for value in states.parameters.values()]
    # numbered among the states that the first function has left
    in_second = NarrowedStates(second_roots, [], np.arange(len(in_first.places)))
    outputs = formula_side.from_pose(formula, variants, coordinates=False)
    replay(outputs.function, [results[pose], parameters], Notes(), in_second)
    return in_first.places[in_second.places]
