"""Prove that two formulas of one robot compute the same: repairs that look different may be one function."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from twin.core.spatial import Array
from twin.formula.contract import Formula
from twin.model.mechanism import Mechanism
from twin.proof import field, formula_side, values
from twin.proof.attempt import within_reach
from twin.proof.branch_report import examined_conditions, states_one_by_one
from twin.proof.claims import JudgedClaim, judged, unclaimed
from twin.proof.combined_proof import demote_wrong_signs
from twin.proof.exact_replay import Notes, replay
from twin.proof.formula_side import Outputs
from twin.proof.prove import REPEATS_PER_STATE, STATES, even_states
from twin.proof.random_states import ProofStates, random_states
from twin.proof.values import Angle, ExactValue, Value

_EVERY_REFUSED = 8
"""Of the states at which a search found that a condition leaves no value, one in so many is judged."""


def equal_outputs(
    first: Formula,
    second: Formula,
    variants: Mapping[str, str],
    robot: Mechanism,
    seed: int = 0,
) -> tuple[JudgedClaim, ...]:
    """Return the claims that all outputs of two formulas are equal, with the published parameters.

    Args:
        first: a formula.
        second: one with the same parameters, joints and coordinates.
        variants: the chosen variant of each equation.
        robot: the mechanism, for the limits of the joints.
        seed: of the random numbers.
    """
    with field.modulo(field.PRIMES[0]):
        states = random_states(first, robot, STATES, seed)
        claims = list(_compared(states, first, second, variants))

        def judge_near(centres: Mapping[str, Array]) -> None:
            """Replace the claims that do not hold near given values (k,) of the random numbers."""
            count = len(next(iter(centres.values())))
            nearby_states = random_states(first, robot, count, seed, centres=centres)
            for i, nearby_claim in enumerate(_compared(nearby_states, first, second, variants)):
                if nearby_claim.status == "refuted" or nearby_claim.may_differ or nearby_claim.undefined_states:
                    claims[i] = nearby_claim

        judge_near(even_states(states.ranges, seed))
        rare: list[dict[str, float]] = []
        for formula in (first, second):
            report = examined_conditions(formula, variants, (), states.ranges, seed)
            if report.open:
                reason = f"a condition has one answer at all drawn states: {report.open[0]}"
                claims.append(unclaimed("conditions", "all answers of the conditions were judged", reason))
            centres = {}
            repeated = {}
            for name in states.state:
                # where one of them has no value, the other must have none
                centres[name] = np.concatenate([report.states[name], report.refused[name][::_EVERY_REFUSED]])
                repeated[name] = np.tile(centres[name], REPEATS_PER_STATE)
            states_of_report = states_one_by_one(centres)
            if states_of_report:
                judge_near(repeated)
            rare += states_of_report
    return demote_wrong_signs(claims, rare)


def _compared(
    states: ProofStates, first: Formula, second: Formula, variants: Mapping[str, str]
) -> Iterator[JudgedClaim]:
    """Yield the claims that outputs are equal at some states."""
    pair = (first, second)
    state = list(states.state.values())
    if not first.has("forward"):
        functions = [formula_side.from_pose(formula, variants, coordinates=True) for formula in pair]
        yield from _claims(states, "inverse", functions, state)
        return
    functions = [formula_side.from_joints(formula, variants) for formula in pair]
    yield from _claims(states, "forward", functions, state)
    if first.has("inverse"):
        pose = _replayed(states, functions[0], state)["pose"]
        functions = [formula_side.from_pose(formula, variants, coordinates=False) for formula in pair]
        yield from _claims(states, "inverse", functions, pose)


def _claims(
    states: ProofStates, stage: str, functions: Sequence[Outputs], state: Sequence[Value]
) -> Iterator[JudgedClaim]:
    """Yield the claims about two functions of the same inputs."""
    first = _replayed(states, functions[0], state)
    second = _replayed(states, functions[1], state)
    inside = within_reach(first, states.count) | within_reach(second, states.count)
    for name in sorted({*first, *second}):
        first_values = first.get(name, ())
        second_values = second.get(name, ())
        numbers: list[ExactValue] = []
        if len(first_values) != len(second_values):  # one of them has no such output
            numbers.append(values.unknown(np.full(states.count, np.nan)))
        else:
            for first_value, second_value in zip(first_values, second_values, strict=True):
                numbers += _differences(first_value, second_value)
        sentence = f"both give the same {name}"
        yield judged(f"{stage}: {name}", sentence, numbers, inside, states.real_values, (), states.drawn_states)


def _replayed(states: ProofStates, function: Outputs, state: Sequence[Value]) -> dict[str, list[Value]]:
    """Return the outputs of a function at some states."""
    results = replay(function.function, [list(state), list(states.parameters.values())], Notes())
    return dict(zip(function.names, results, strict=True))


def _differences(a: Value, b: Value) -> list[ExactValue]:
    """Return the numbers that are zero if two values are equal; angles are points of a circle."""
    if isinstance(a, Angle) and isinstance(b, Angle):
        return [values.difference(a.cosine, b.cosine), values.difference(a.sine, b.sine)]
    return [values.difference(values.scalar(a), values.scalar(b))]
