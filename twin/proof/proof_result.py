"""The proof of one attempt: its claims, and all that they rest on."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import casadi as ca

from twin.formula.contract import Formula
from twin.proof import formula_side
from twin.proof.attempt import Attempt
from twin.proof.branch_report import BranchReport
from twin.proof.claims import JudgedClaim
from twin.proof.draws import RandomRange
from twin.proof.fit_conditions import is_judged_by_others
from twin.proof.instructions import instructions
from twin.proof.near_numbers import near_length, near_number
from twin.proof.random_states import angles
from twin.proof.refused_states import RefusedStates


@dataclass(frozen=True)
class Proof:
    """The claims about a robot, with what they rest on.

    Attributes:
        claims: all claims.
        states: number of random states.
        within_reach: smallest share of the states within reach.
        branches: the conditions in the equations; None if a claim is refuted.
        arbitrary_parameters: parameters for all of whose values the claims are proved.
        published_angles: other parameters that are angles: with other values, a claim is wrong, or none was tried.
        inexact_parameters: parameters without an exact form.
        largest_rounding: largest difference in m or rad between a number of the CAD and its exact form.
        recognised_lengths: {length of the CAD as text: its exact form}, for lengths that are no decimals.
        near_numbers: {number that is taken as it is written: the root of a drawing that it is, but for its last digit}.
        uncovered_bodies: bodies that no claim covers.
        uncovered_points: points of the equations that no claim covers.
        uncovered_values: passive joints, margins, measures and aspects of the equations of whose values nothing is
            claimed, as "margin arm". Of a margin, only the sign counts: it says where the claims are.
        ranges: {random number: its range}.
        refused_states: what the mechanism says of states that the equations refuse; None if no such state was compared.
    """

    claims: tuple[JudgedClaim, ...]
    states: int
    within_reach: float
    branches: BranchReport | None
    arbitrary_parameters: tuple[str, ...]
    published_angles: tuple[str, ...]
    inexact_parameters: tuple[str, ...]
    largest_rounding: float
    recognised_lengths: Mapping[str, str]
    near_numbers: Mapping[str, str]
    uncovered_bodies: tuple[str, ...]
    uncovered_points: tuple[str, ...]
    uncovered_values: tuple[str, ...]
    ranges: Mapping[str, RandomRange]
    refused_states: RefusedStates | None = None

    def count(self, status: str) -> int:
        """Return the number of claims with a status."""
        return [claim.status for claim in self.claims].count(status)


def proof_of(attempt: Attempt, states: int) -> Proof:
    """Return the proof of one attempt, with a number of drawn states."""
    proof_states = attempt.states
    drawing = proof_states.exact.drawing
    published_angles = []
    for name in angles(proof_states.formula):
        if name not in proof_states.drawn_parameters:
            published_angles.append(name)
    return Proof(
        claims=tuple(attempt.claims),
        states=states,
        within_reach=min(attempt.shares_within_reach),
        branches=None,
        arbitrary_parameters=tuple(proof_states.drawn_parameters),
        published_angles=tuple(published_angles),
        inexact_parameters=tuple(proof_states.inexact_parameters),
        largest_rounding=drawing.largest_rounding,
        recognised_lengths=dict(drawing.recognised_lengths),
        near_numbers=dict(drawing.near_roots),
        uncovered_bodies=tuple(sorted(attempt.uncovered_bodies)),
        uncovered_points=tuple(attempt.uncovered_points),
        uncovered_values=tuple(_uncovered_values(attempt)),
        ranges=proof_states.ranges,
    )


def near_numbers_in_equations(formula: Formula, variants: Mapping[str, str]) -> dict[str, str]:
    """Return {parameter or number of the equations: the root that it is, but for its last digit}."""
    root_of: dict[str, str] = {}  # "" for a number that is near none
    lengths = {}
    for parameter in formula.parameters:
        if parameter.unit in ("mm", "m") and parameter.value:
            lengths[parameter.name] = float(parameter.value)
    for name, length in lengths.items():
        other_lengths = dict(lengths)
        # Each parameter is a part of itself, which would say nothing.
        del other_lengths[name]
        root_of[f"parameter {name}, {1e3 * length:.12g} mm"] = near_length(length, other_lengths)
    if formula.has("inverse"):
        outputs = formula_side.from_pose(formula, variants, coordinates=not formula.has("forward"))
    else:
        outputs = formula_side.from_joints(formula, variants)
    for step in instructions(outputs.function):
        if step.operation == ca.OP_CONST and math.isfinite(step.constant):
            root = near_number(step.constant) or near_length(step.constant, lengths)
            root_of[f"{step.constant:.12g} in the equations"] = root
    return {text: root for text, root in root_of.items() if root}


def _uncovered_values(attempt: Attempt) -> list[str]:
    """Return the passive joints, margins, measures and aspects of the equations of whose values nothing is claimed."""
    formula = attempt.states.formula
    robot = attempt.states.robot
    names = []
    for joint in formula.passive:
        if not is_judged_by_others(robot, joint, attempt.uncovered_bodies):
            names.append(f"passive joint {joint}")
    for margin in formula.reach:
        names.append(f"margin {margin}")
    for measure in formula.measures:
        names.append(f"measure {measure.name}")
    for aspect in formula.aspects:
        names.append(f"aspect {aspect.symbol}")
    return names
