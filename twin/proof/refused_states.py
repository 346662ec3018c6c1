"""States at which equations say that the mechanism is out of reach: whether it can be assembled there.

Equations refuse a state by having no value there, or by a margin that is negative or not a number. That is right only
where the mechanism cannot be assembled within the limits of all joints.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from twin.core.errors import TwinError
from twin.core.spatial import Array
from twin.formula.contract import Formula
from twin.model.mechanism import Mechanism
from twin.proof import mechanism_reach
from twin.proof.claims import JudgedClaim, unclaimed
from twin.proof.draws import RandomRange
from twin.proof.equation_conditions import EquationConditions
from twin.proof.formula_side import POSE_ENTRIES

_DRAWN = 2048
"""Number of states that are drawn evenly within the ranges."""

_MOST_COMPARED = 192
"""Maximum number of them that are compared with the mechanism; the same of those that a search found."""

SENTENCE = "the equations have values wherever the mechanism can be assembled within the limits of all joints"


@dataclass(frozen=True)
class RefusedStates:
    """What the mechanism says of states that the equations refuse.

    Attributes:
        compared: number of states that were compared.
        unknown: number of those at which no assembly was found.
        reached: number of those at which the mechanism can be assembled within its limits.
        witness: {name: value} at one of these; empty if there is none.
        without_value: whether the equations have no value there; otherwise a margin is negative or not a number.
    """

    compared: int
    unknown: int
    reached: int
    witness: Mapping[str, float]
    without_value: bool

    def claim(self) -> JudgedClaim | None:
        """Return the claim that is wrong or open; None if the mechanism is at none of these states."""
        if not self.reached:
            return None
        if self.without_value:
            return replace(unclaimed("values", SENTENCE, ""), status="refuted", witness=dict(self.witness))
        reason = f"a margin of the equations is negative, or not a number, at {state_text(self.witness)}, where it can"
        return unclaimed("values", SENTENCE, reason)


def state_text(state: Mapping[str, float]) -> str:
    """Return {name: value} as text, "q1 = 0.25, q2 = -1"."""
    words = []
    for name, value in state.items():
        words.append(f"{name} = {value:.6g}")
    return ", ".join(words)


def refused_states(
    formula: Formula,
    variants: Mapping[str, str],
    robot: Mechanism,
    ranges: Mapping[str, RandomRange],
    found: Mapping[str, Array],
    seed: int,
) -> RefusedStates | None:
    """Return what the mechanism says of states that the equations refuse; None if it is unknown where it can be.

    Args:
        formula: the equations.
        variants: the chosen variant of each equation.
        robot: the mechanism.
        ranges: {random number: its range}; those of parameters do not count.
        found: {random number: values (j,)} at states at which a search found that a condition leaves no value.
        seed: of the random numbers.
    """
    conditions = EquationConditions(formula, variants, ())
    limits = []
    searched = []
    for name in conditions.names:
        limits.append([ranges[name].low, ranges[name].high])
        searched.append(found[name])
    bounds = np.array(limits)
    # a stream of random numbers of its own: the states are others than those of the claims
    generator = np.random.default_rng([seed, 3])
    drawn = generator.uniform(bounds[:, :1], bounds[:, 1:], (len(limits), _DRAWN))
    state = np.hstack([_refused(conditions, np.array(searched)), _refused(conditions, drawn)])
    if not state.shape[1]:
        return RefusedStates(0, 0, 0, {}, False)
    values, _ = conditions.values(state)
    has_values = np.isfinite(values.full()).all(axis=0)
    try:
        if formula.has("forward"):
            of_mechanism = mechanism_reach.at_joints(robot, list(conditions.names), state.T)
        else:
            T_base_tool = values.full()[:POSE_ENTRIES].T.reshape(-1, 4, 4)
            of_mechanism = mechanism_reach.at_poses(robot, T_base_tool)
    except TwinError:
        return None
    reached = of_mechanism.within
    # a state without a value tells more than one with a negative margin
    contradictions = np.flatnonzero(reached & ~has_values)
    without_value = len(contradictions) > 0
    if not without_value:
        contradictions = np.flatnonzero(reached)
    witness: dict[str, float] = {}
    if len(contradictions):
        witness = dict(zip(conditions.names, state[:, contradictions[0]].tolist(), strict=True))
    return RefusedStates(
        compared=state.shape[1],
        unknown=int((~of_mechanism.closed).sum()),
        reached=int(reached.sum()),
        witness=witness,
        without_value=without_value,
    )


def _refused(conditions: EquationConditions, state: Array) -> Array:
    """Return at most `_MOST_COMPARED` of the states (n, k) that are not within reach, or without a value there."""
    if not state.shape[1]:
        return state
    has_values, within = conditions.has_values_and_reach(state)
    refused = np.flatnonzero(~(has_values & within))
    return state[:, refused[:: 1 + len(refused) // _MOST_COMPARED]]
