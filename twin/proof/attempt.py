"""One judgement of all claims about a robot, at given states.

The equations are repeated with exact values (`replay`), and the mechanism places its bodies by the values that they
give (`placed_bodies`). In this order, claims are made that

1. forward: the joints fit where forward equations put the tool and the passive joints,
2. inverse: the joints fit where the joints of inverse equations put them, at the tool pose of step 1,
3. inverse: named points are where the equations say, and keep their distances on a body,
4. forward of inverse: forward equations of the joints of step 2 give the pose again.

Without forward equations, the states are coordinates of the pose, and steps 2 and 3 remain. Margins, conditions and
inexact operations of step 1 count in the later steps, too: the state must be within reach of both functions.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations
from typing import NamedTuple

import numpy as np

from twin.core.errors import KinematicsError
from twin.model.body import Point
from twin.proof import formula_side, values
from twin.proof.claims import JudgedClaim, judged, unclaimed
from twin.proof.degree import RootSignature, Truths
from twin.proof.exact_mechanism import ExactMechanism
from twin.proof.exact_replay import Notes, replay
from twin.proof.fit_conditions import cannula_conditions, fit_conditions, pose_differences
from twin.proof.formula_side import Outputs
from twin.proof.placed_bodies import PlacedBodies, place_bodies, point_in_base
from twin.proof.program import ProgramStep
from twin.proof.random_states import ProofStates
from twin.proof.transforms import Matrix
from twin.proof.values import ExactValue, Value

_NAMED_REASONS = 3
"""Number of parameters, lengths and operations without an exact form that a claim names."""

_POINT = "point "
"""What precedes the name of a point among the outputs of the equations."""

Results = Mapping[str, list[Value]]
"""{output of the equations: its entries}."""


class LocatedRoot(NamedTuple):
    """A root in the equations.

    Attributes:
        function: 0 or 1, the first or the second function of the equations.
        signature: the root.
        instruction: number of its instruction in this function.
    """

    function: int
    signature: RootSignature
    instruction: int


@dataclass
class Attempt:
    """The claims about a robot, judged at given states.

    Attributes:
        states: the states.
        variants: the chosen variant of each equation.
        other_zero_shares: {claim: share of its exact values that are zero at other states}; see `judged`.
        claims: the claims.
        uncovered_bodies: bodies that no claim covers.
        uncovered_points: points of the equations that no claim covers.
        shares_within_reach: share of the states within reach, of each of the functions of the equations.
        roots: the roots in the functions of the equations.
        rootless: whether a constant has no root modulo the prime in use.
        notes: of the function that was repeated last; its operations without an exact form are those of both.
        reach: the margins of the equations.
        sides: the states with each answer of each condition.
    """

    states: ProofStates
    variants: Mapping[str, str]
    other_zero_shares: Mapping[str, float] = field(default_factory=dict)
    claims: list[JudgedClaim] = field(default_factory=list)
    uncovered_bodies: set[str] = field(default_factory=set)
    uncovered_points: list[str] = field(default_factory=list)
    shares_within_reach: list[float] = field(default_factory=list)
    roots: list[LocatedRoot] = field(default_factory=list)
    rootless: bool = False
    notes: Notes = field(default_factory=Notes)
    reach: list[ProgramStep] = field(default_factory=list)
    sides: list[Truths] = field(default_factory=list)


def attempted(
    states: ProofStates, variants: Mapping[str, str], other_zero_shares: Mapping[str, float], only_refute: bool = False
) -> Attempt:
    """Return all claims, judged at some states; for the arguments see `Attempt`.

    If `only_refute`, the equations are computed with double precision alone, so that nothing is proved; the claims
    about the inverse are left out if one about the forward equations is refuted.
    """
    attempt = Attempt(states, variants, other_zero_shares, uncovered_points=list(states.formula.points))
    results_of = _evaluated if only_refute else _replayed
    formula = states.formula
    state = list(states.state.values())
    if not formula.has("forward"):
        outputs = formula_side.from_pose(formula, variants, coordinates=True)
        results = results_of(attempt, outputs, state)
        _claim_inverse(attempt, results, _inside(attempt, results))
        return attempt
    outputs = formula_side.from_joints(formula, variants)
    results = results_of(attempt, outputs, state)
    inside = _inside(attempt, results)
    _claim_joints_fit(attempt, "forward", results, states.state, inside)
    if only_refute and "refuted" in [claim.status for claim in attempt.claims]:
        return attempt
    if formula.has("inverse"):
        outputs = formula_side.from_pose(formula, variants, coordinates=False)
        inverse_results = results_of(attempt, outputs, results["pose"])
        inside = inside & _inside(attempt, inverse_results)
        _claim_inverse(attempt, inverse_results, inside)
    return attempt


def _replayed(attempt: Attempt, outputs: Outputs, state: Sequence[Value]) -> dict[str, list[Value]]:
    """Return the outputs of the equations at a state."""
    inputs = [list(state), list(attempt.states.parameters.values())]
    # what has no exact form in the first function is a reason in the second one too
    attempt.notes = Notes(inexact=list(attempt.notes.inexact))
    results = replay(outputs.function, inputs, attempt.notes)
    attempt.rootless |= attempt.notes.rootless
    function_index = 0
    if attempt.shares_within_reach:  # the share of the first function is known when the second one is repeated
        function_index = 1
    for signature, instruction in attempt.notes.roots:
        attempt.roots.append(LocatedRoot(function_index, signature, instruction))
    return dict(zip(outputs.names, results, strict=True))


def _evaluated(attempt: Attempt, outputs: Outputs, state: Sequence[Value]) -> dict[str, list[Value]]:
    """Return the outputs of the equations at a state, with real values alone."""
    count = attempt.states.count
    numbers = values.stacked_reals(state, count)
    parameters = values.stacked_reals(attempt.states.parameters.values(), count)
    matrices = outputs.function.call([numbers, parameters])
    results: dict[str, list[Value]] = {}
    for name, matrix in zip(outputs.names, matrices, strict=True):
        results[name] = [values.unknown(row) for row in matrix.full()]
    return results


def within_reach(results: Results, states: int) -> Truths:
    """Return which of k states are within reach: all values are defined, and no margin is negative."""
    inside = np.ones(states, bool)
    for name in ("pose", "joints", "reach"):
        for value in results.get(name, ()):
            inside &= np.isfinite(values.real_of(value))
    for margin in results.get("reach", ()):
        inside &= values.real_of(margin) >= 0
    return inside


def _inside(attempt: Attempt, results: Results) -> Truths:
    """Return the states within reach, and keep their share, the margins, and the answers of conditions there."""
    inside = within_reach(results, attempt.states.count)
    for margin in results.get("reach", ()):
        node = values.scalar(margin).node
        if node is not None:
            attempt.reach.append(node)
    attempt.shares_within_reach.append(float(inside.mean()))
    for answers in attempt.notes.conditions:
        attempt.sides.append(answers & inside)
        attempt.sides.append(~answers & inside)
    return inside


def _matrix(entries: Sequence[Value]) -> Matrix:
    """Return a pose (16,), row by row, as rows."""
    rows: Matrix = [[], [], [], []]
    for place, entry in enumerate(entries):
        rows[place // 4].append(values.scalar(entry))
    return rows


def _claim_joints_fit(
    attempt: Attempt,
    stage: str,
    results: Results,
    joints: Mapping[str, Value],
    inside: Truths,
) -> PlacedBodies:
    """Claim that all joints fit where the equations put tool and joints; return the placed bodies.

    Args:
        attempt: gets the claims.
        stage: "forward" or "inverse", the equations that are judged.
        results: their results.
        joints: {active joint: its value}.
        inside: the states (k,) within reach.
    """
    exact = attempt.states.exact
    joint_values = dict(joints)
    if "passive" in results:
        joint_values |= zip(attempt.states.formula.passive, results["passive"], strict=True)
    placed = place_bodies(exact, joint_values, _matrix(results["pose"]))
    uncovered = set(placed.missing)
    for joint in placed.closing:
        numbers = fit_conditions(exact, placed, joint, joint_values.get(joint.name))
        sentence = f"joint {joint.name} ({joint.type}) between {joint.parent} and {joint.child} fits"
        _claim(attempt, f"{stage}: joint {joint.name}", sentence, numbers, inside)
    for body, sentence, numbers in cannula_conditions(exact, placed):
        _claim(attempt, f"{stage}: {body}", sentence, numbers, inside)
        uncovered.remove(body)
    attempt.uncovered_bodies |= uncovered
    for name in joints:
        joint = attempt.states.robot.joint(name)
        unplaced = {joint.parent, joint.child} & uncovered
        if unplaced:
            body = min(unplaced)
            reason = f"no joint with a known value places {body}; give the passive joints in the formula"
            sentence = f"joint {name} between {joint.parent} and {joint.child} fits"
            attempt.claims.append(unclaimed(f"{stage}: joint {name}", sentence, reason))
    return placed


def _claim_inverse(attempt: Attempt, results: Results, inside: Truths) -> None:
    """Claim that the joints of the inverse equations put the tool and the named points where the equations say."""
    formula = attempt.states.formula
    names = [joint.name for joint in formula.joints]
    joints = dict(zip(names, results["joints"], strict=True))
    placed = _claim_joints_fit(attempt, "inverse", results, joints, inside)
    claimed = _claim_points(attempt, placed, results, inside)
    claimed |= _claim_distances(attempt, results, inside)
    # in the order of the formula, as they are listed
    attempt.uncovered_points = [name for name in formula.points if name not in claimed]
    if "again" in results:
        numbers = list(pose_differences(_matrix(results["again"]), _matrix(results["pose"])))
        sentence = "forward equations of the joints of the inverse equations give the pose"
        _claim(attempt, "forward of inverse", sentence, numbers, inside)


def _claim_points(attempt: Attempt, placed: PlacedBodies, results: Results, inside: Truths) -> set[str]:
    """Claim that points of the equations are where the placed bodies have them; return the names of these points."""
    claimed: set[str] = set()
    for point in attempt.states.robot.points:
        entries = results.get(_POINT + point.name)
        p_base = point_in_base(attempt.states.exact, placed, point)
        if entries is None or p_base is None:
            continue
        claimed.add(point.name)
        if len(entries) != len(p_base):
            raise KinematicsError(
                f"formula '{attempt.states.formula.name}': point '{point.name}' has {len(entries)} entries, not 3: "
                "return (3,)"
            )
        numbers = []
        for coordinate, stated_coordinate in zip(p_base, entries, strict=True):
            numbers.append(values.difference(coordinate, values.scalar(stated_coordinate)))
        sentence = f"point {point.name} of the equations is that of {point.body}"
        _claim(attempt, f"inverse: point {point.name}", sentence, numbers, inside)
    return claimed


def _claim_distances(attempt: Attempt, results: Results, inside: Truths) -> set[str]:
    """Claim that points of the equations on one body keep their distances; return the names of these points."""
    claimed: set[str] = set()
    for first, second in combinations(attempt.states.robot.points, 2):
        has_both = _POINT + first.name in results and _POINT + second.name in results
        if first.body != second.body or not has_both:
            continue
        claimed |= {first.name, second.name}
        square = _square(results, first.name, second.name)
        square_on_body = _square_on_body(attempt.states.exact, first, second)
        distance = values.difference(square, square_on_body)
        # exactly, squares are compared, because they have no root; in real values, the lengths in m
        distance = replace(distance, real=np.sqrt(square.real) - np.sqrt(square_on_body.real))
        sentence = f"points {first.name} and {second.name} of the equations keep their distance on {first.body}"
        _claim(attempt, f"inverse: {first.name} to {second.name}", sentence, [distance], inside)
        claim = attempt.claims[-1]
        if claim.error:
            attempt.claims[-1] = replace(claim, error=f"{claim.error} of the square")
    return claimed


def _square(results: Results, first: str, second: str) -> ExactValue:
    """Return the square of the distance of two points, by the results of the equations, in m2."""
    vector = []
    for first_coordinate, second_coordinate in zip(results[_POINT + first], results[_POINT + second], strict=True):
        vector.append(values.difference(values.scalar(first_coordinate), values.scalar(second_coordinate)))
    return _length_squared(vector)


def _square_on_body(exact: ExactMechanism, first: Point, second: Point) -> ExactValue:
    """Return the square of the distance of two points of a body, by the numbers of the CAD, in m2."""
    p_first = exact.point(first.body, first.p_body, first.name)
    p_second = exact.point(second.body, second.p_body, second.name)
    vector = []
    for first_coordinate, second_coordinate in zip(p_first, p_second, strict=True):
        vector.append(values.difference(first_coordinate, second_coordinate))
    return _length_squared(vector)


def _length_squared(vector: Sequence[ExactValue]) -> ExactValue:
    """Return the square of the length of a vector (3,)."""
    square = values.product(vector[0], vector[0])
    for coordinate in vector[1:]:
        square = values.total(square, values.product(coordinate, coordinate))
    return square


def _claim(
    attempt: Attempt,
    name: str,
    sentence: str,
    numbers: Iterator[ExactValue] | list[ExactValue],
    inside: Truths,
) -> None:
    """Judge that some numbers are zero at the states `inside`, and add the claim to the attempt."""
    states = attempt.states
    numbers = list(numbers)
    # after `numbers`: an iterator recognises the lengths of the CAD while it is read
    reasons = [f"parameter {name_of_parameter}" for name_of_parameter in states.inexact_parameters]
    reasons += dict.fromkeys(states.exact.drawing.unrecognised_numbers)
    reasons += dict.fromkeys(attempt.notes.inexact)
    reasons = reasons[:_NAMED_REASONS]
    claim = judged(
        name,
        sentence,
        numbers,
        inside,
        state=states.real_values,
        reasons=reasons,
        drawn_states=states.drawn_states,
        sides=attempt.sides,
        other_zero_share=attempt.other_zero_shares.get(name),
    )
    attempt.claims.append(replace(claim, reach=tuple(attempt.reach)))
