"""One judgement of all claims about a robot, at given states."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from twin.core.errors import KinematicsError
from twin.model.body import Point
from twin.proof import formula_side, mechanism, values
from twin.proof.claims import JudgedClaim, judged, unclaimed
from twin.proof.formula_side import Outputs
from twin.proof.mechanism import ExactMechanism
from twin.proof.program import ProgramStep
from twin.proof.random_states import ProofStates
from twin.proof.replay import Notes, RootedStates, replay
from twin.proof.transforms import Matrix
from twin.proof.values import ExactValue, RootMark, Truths, Value

_ROOTED_STATES = 256
"""Largest number of states with all roots that are kept for a claim."""

_REASONS = 3
"""Number of numbers without an exact form that a claim names."""

_POINT = "point "
"""What precedes the name of a point among the outputs of the equations."""

Found = Mapping[str, list[Value]]
"""{output of the equations: its entries}."""

RootGroup = tuple[frozenset[int], frozenset[int]]
"""Instructions with roots in the first and in the second function of the equations."""


@dataclass
class Attempt:
    """The claims about a robot, judged at given states.

    Attributes:
        states: the states.
        variants: the chosen variant of each equation.
        zero_shares: {claim: share of its exact values that are zero at other states}.
        claims: the claims.
        uncovered: bodies that no claim covers.
        uncovered_points: points of the equations that no claim covers.
        shares: share of the states within reach, of each of the functions of the equations.
        roots: (0 or 1 for the first or the second function of the equations, root, its instruction).
        rootless: whether a constant has no root modulo the prime in use.
        notes: of the function that was repeated last; its operations without an exact form are those of both.
        reach: the margins of the equations.
        sides: the states with each answer of each condition.
    """

    states: ProofStates
    variants: Mapping[str, str]
    zero_shares: Mapping[str, float] = field(default_factory=dict)
    claims: list[JudgedClaim] = field(default_factory=list)
    uncovered: set[str] = field(default_factory=set)
    uncovered_points: list[str] = field(default_factory=list)
    shares: list[float] = field(default_factory=list)
    roots: list[tuple[int, RootMark, int]] = field(default_factory=list)
    rootless: bool = False
    notes: Notes = field(default_factory=Notes)
    reach: list[ProgramStep] = field(default_factory=list)
    sides: list[Truths] = field(default_factory=list)


def attempted(
    states: ProofStates, variants: Mapping[str, str], zero_shares: Mapping[str, float], only_refute: bool = False
) -> Attempt:
    """Return all claims, judged at some states; for the arguments see `Attempt`.

    If `only_refute`, the equations are computed with double precision alone, so that nothing is proved; the claims
    about the inverse are left out if one about the forward equations is refuted.
    """
    work = Attempt(states, variants, zero_shares, uncovered_points=list(states.formula.points))
    computed = _evaluated if only_refute else _replayed
    formula = states.formula
    if formula.has("forward"):
        found = computed(work, formula_side.from_joints(formula, variants), list(states.state.values()))
        inside = _inside(work, found)
        _claim_mechanism(work, "forward", found, states.state, inside)
        if only_refute and any(claim.status == "refuted" for claim in work.claims):
            return work
        if formula.has("inverse"):
            outputs = formula_side.from_pose(formula, variants, coordinates=False)
            again = computed(work, outputs, found["pose"])
            _claim_inverse(work, again, inside & _inside(work, again))
    else:
        outputs = formula_side.from_pose(formula, variants, coordinates=True)
        found = computed(work, outputs, list(states.state.values()))
        _claim_inverse(work, found, _inside(work, found))
    return work


def with_roots(states: ProofStates, variants: Mapping[str, str], groups: Sequence[RootGroup]) -> ProofStates:
    """Return the states where all roots of one of some groups exist in the field."""
    kept = np.zeros(states.count, bool)
    for group in groups:
        kept[_rooted(states, variants, group)[:_ROOTED_STATES]] = True
    return states.at(np.flatnonzero(kept))


def _rooted(states: ProofStates, variants: Mapping[str, str], group: RootGroup) -> NDArray[np.integer]:
    """Return the places of the states where the roots of a group exist."""
    first, second = group
    formula = states.formula
    if formula.has("forward"):
        outputs = formula_side.from_joints(formula, variants)
    else:
        outputs = formula_side.from_pose(formula, variants, coordinates=True)
    pose = outputs.names.index("pose")
    inputs = [list(states.state.values()), list(states.parameters.values())]
    results = [pose] if second else []
    rooted = RootedStates(first, results, np.arange(states.count))
    found = replay(outputs.function, inputs, Notes(), rooted)
    if not second:
        return rooted.places
    parameters = [values.taken(value, rooted.places) for value in states.parameters.values()]
    again = RootedStates(second, [], np.arange(len(rooted.places)))
    outputs = formula_side.from_pose(formula, variants, coordinates=False)
    replay(outputs.function, [found[pose], parameters], Notes(), again)
    return rooted.places[again.places]


def _replayed(work: Attempt, outputs: Outputs, state: Sequence[Value]) -> dict[str, list[Value]]:
    """Return the outputs of the equations at a state."""
    inputs = [list(state), list(work.states.parameters.values())]
    # what has no exact form in the first function is a reason in the second one too
    work.notes = Notes(inexact=list(work.notes.inexact))
    found = replay(outputs.function, inputs, work.notes)
    work.rootless |= work.notes.rootless
    second = int(bool(work.shares))  # the share of the first function is known when the second one is repeated
    work.roots += [(second, mark, instruction) for mark, instruction in work.notes.roots]
    return dict(zip(outputs.names, found, strict=True))


def _evaluated(work: Attempt, outputs: Outputs, state: Sequence[Value]) -> dict[str, list[Value]]:
    """Return the outputs of the equations at a state, with real values alone."""
    numbers = np.array([values.real_of(value) for value in state])
    parameters = np.array([values.real_of(value) for value in work.states.parameters.values()])
    results = outputs.function.call([numbers, parameters.reshape(-1, work.states.count)])
    found: dict[str, list[Value]] = {}
    for name, result in zip(outputs.names, results, strict=True):
        found[name] = [values.unknown(row) for row in result.full()]
    return found


def _inside(work: Attempt, found: Found) -> Truths:
    """Return the states within reach: all values are defined, and no margin is negative."""
    inside = np.ones(work.states.count, bool)
    for name in ("pose", "joints", "reach"):
        for value in found.get(name, ()):
            inside &= np.isfinite(values.real_of(value))
    for margin in found.get("reach", ()):
        inside &= values.real_of(margin) >= 0
        node = values.scalar(margin).node
        if node is not None:
            work.reach.append(node)
    work.shares.append(float(inside.mean()))
    work.sides += [answers & inside for answers in work.notes.conditions]
    work.sides += [~answers & inside for answers in work.notes.conditions]
    return inside


def _matrix(entries: Sequence[Value]) -> Matrix:
    """Return a pose (16,), row by row, as rows."""
    return [[values.scalar(entries[4 * i + j]) for j in range(4)] for i in range(4)]


def _claim_mechanism(
    work: Attempt,
    stage: str,
    found: Found,
    joints: Mapping[str, Value],
    inside: Truths,
) -> mechanism.PlacedBodies:
    """Claim that all joints fit where the equations put tool and joints; return the placed bodies."""
    exact = work.states.exact
    known = dict(joints)
    if "passive" in found:
        known |= zip(work.states.formula.passive, found["passive"], strict=True)
    placed = mechanism.place(exact, known, _matrix(found["pose"]))
    uncovered = set(placed.missing)
    for joint in placed.closing:
        numbers = mechanism.conditions(exact, placed, joint, known.get(joint.name))
        sentence = f"joint {joint.name} ({joint.type}) between {joint.parent} and {joint.child} fits"
        _claim(work, f"{stage}: joint {joint.name}", sentence, numbers, inside)
    for body, sentence, numbers in mechanism.slides(exact, placed):
        _claim(work, f"{stage}: {body}", sentence, numbers, inside)
        uncovered.remove(body)
    work.uncovered |= uncovered
    for name in joints:
        joint = work.states.robot.joint(name)
        unplaced = {joint.parent, joint.child} & uncovered
        if unplaced:
            body = min(unplaced)
            reason = f"no joint with a known value places {body}; give the passive joints in the formula"
            sentence = f"joint {name} between {joint.parent} and {joint.child} fits"
            work.claims.append(unclaimed(f"{stage}: joint {name}", sentence, reason))
    return placed


def _claim_inverse(work: Attempt, found: Found, inside: Truths) -> None:
    """Claim that the joints of the inverse equations put the tool and the named points where the equations say."""
    exact = work.states.exact
    names = [joint.name for joint in work.states.formula.joints]
    joints = dict(zip(names, found["joints"], strict=True))
    placed = _claim_mechanism(work, "inverse", found, joints, inside)
    claimed: set[str] = set()
    for point in work.states.robot.points:
        entries = found.get(f"point {point.name}")
        p = mechanism.point_in_base(exact, placed, point)
        if entries is None or p is None:
            continue
        claimed.add(point.name)
        if len(entries) != len(p):
            raise KinematicsError(
                f"formula '{work.states.formula.name}': point '{point.name}' has {len(entries)} entries, not 3: "
                "return (3,)"
            )
        numbers = [values.difference(a, values.scalar(b)) for a, b in zip(p, entries, strict=True)]
        sentence = f"point {point.name} of the equations is that of {point.body}"
        _claim(work, f"inverse: point {point.name}", sentence, numbers, inside)
    for first, second in combinations(work.states.robot.points, 2):
        ends = [found.get(f"point {point.name}") for point in (first, second)]
        if first.body != second.body or None in ends:
            continue
        claimed |= {first.name, second.name}
        square = _square(found, first.name, second.name)
        own_square = _own_square(exact, first, second)
        distance = values.difference(square, own_square)
        distance = replace(distance, real=np.sqrt(square.real) - np.sqrt(own_square.real))
        sentence = f"points {first.name} and {second.name} of the equations keep their distance on {first.body}"
        _claim(work, f"inverse: {first.name} to {second.name}", sentence, [distance], inside)
        claim = work.claims[-1]
        if claim.error:
            work.claims[-1] = replace(claim, error=f"{claim.error} of the square")
    work.uncovered_points = [name for name in work.states.formula.points if name not in claimed]
    if "again" in found:
        numbers = list(mechanism.deviations(_matrix(found["again"]), _matrix(found["pose"])))
        sentence = "forward equations of the joints of the inverse equations give the pose"
        _claim(work, "forward of inverse", sentence, numbers, inside)


def _square(found: Found, first: str, second: str) -> ExactValue:
    """Return the square of the distance of two points of the equations, in m2."""
    pairs = zip(found[f"point {first}"], found[f"point {second}"], strict=True)
    return _length_squared([values.difference(values.scalar(a), values.scalar(b)) for a, b in pairs])


def _own_square(exact: ExactMechanism, first: Point, second: Point) -> ExactValue:
    """Return the square of the distance of two points of a body, in m2."""
    p = exact.point(first.body, first.p_body, first.name)
    q = exact.point(second.body, second.p_body, second.name)
    return _length_squared([values.difference(a, b) for a, b in zip(p, q, strict=True)])


def _length_squared(vector: Sequence[ExactValue]) -> ExactValue:
    square = values.product(vector[0], vector[0])
    for x in vector[1:]:
        square = values.total(square, values.product(x, x))
    return square


def _claim(
    work: Attempt,
    name: str,
    sentence: str,
    numbers: Iterator[ExactValue] | list[ExactValue],
    inside: Truths,
) -> None:
    """Judge a claim and keep it."""
    states = work.states
    numbers = list(numbers)
    reasons = [f"parameter {key}" for key in states.inexact]
    reasons += dict.fromkeys(states.exact.drawing.unrecognised)
    reasons += dict.fromkeys(work.notes.inexact)
    reasons = reasons[:_REASONS]
    share = work.zero_shares.get(name)
    claim = judged(name, sentence, numbers, inside, states.real, reasons, states.drawn_states, work.sides, share)
    work.claims.append(replace(claim, reach=tuple(work.reach)))
