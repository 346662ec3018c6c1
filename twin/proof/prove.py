"""Prove that equations and mechanism agree at all poses, or find where they do not."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from twin.core.spatial import Array
from twin.formula.contract import Formula
from twin.model.mechanism import Mechanism
from twin.proof import draws, field, formula_side, mechanism, values
from twin.proof.attempt import Attempt, RootGroup, attempted, with_roots
from twin.proof.branches import MOST_BOXES, Branches, BranchReport, examined
from twin.proof.claims import JudgedClaim, unclaimed
from twin.proof.constants import exact_angle
from twin.proof.near_numbers import near_length, near_number
from twin.proof.precise import certainly_not_zero
from twin.proof.random_states import ANGULAR, ProofStates, angles, random_states
from twin.proof.rational_witness import rational_witness
from twin.proof.refused_states import RefusedStates, refused_states

STATES = 4096
"""Number of random states."""

FIRST_STATES = 64
"""Number of states at which a wrong equation is refuted before anything else is computed."""

_TRIAL_STATES = 256
"""Number of states at which other values of a parameter are tried."""

_EVEN_STATES = 2048
"""Number of states that are spread evenly over the ranges of angles; the others have even tangents of half angles."""

_ROOTED_FACTORS = (16, 128)
"""Numbers of states, as multiples, among which those with all roots are searched for claims with many roots."""

_CONDITION_STATES = 2048
"""Number of states at which conditions have their answers, before others are searched."""

BESIDES = 16
"""How often each state that was found is judged, because roots do not exist in the field at all of them."""

_PRECISE = 64
"""Maximum number of states that were found at which signs of roots are judged with more digits."""

_OPEN_CONDITIONS = 3
"""Number of conditions that a claim names."""

_FORMULA_STATES = 16
"""Number of states at which formulas are computed; they do not depend on it."""

_MOST_KEPT = 8192
"""Maximum number of states that are kept for the next proof."""


@dataclass(frozen=True)
class Proof:
    """The claims about a robot, with what they rest on.

    Attributes:
        claims: all claims.
        states: number of random states.
        inside: smallest share of the states within reach.
        branches: the conditions in the equations; None if a claim is refuted.
        drawn: parameters for all of whose values the claims are proved.
        fixed: other parameters that are angles: with other values, a claim is wrong, or none was tried.
        inexact: parameters without an exact form.
        largest: largest difference in m or rad between a number of the CAD and its exact form.
        unrecognised: numbers of the CAD without an exact form.
        recognised: {length of the CAD as text: its exact form}, for lengths that are no decimals.
        near: {number that is taken as it is written: the root of a drawing that it is, but for its last digit}.
        uncovered: bodies that no claim covers.
        uncovered_points: points of the equations that no claim covers.
        uncovered_values: passive joints, margins, measures and aspects of the equations of whose values nothing is
            claimed, as "margin arm". Of a margin, only the sign counts: it says where the claims are.
        ranges: {random number: (whether it is an angle, low, high)}, in m and rad.
        refused: what the mechanism says of states that the equations refuse; None if no such state was compared.
    """

    claims: tuple[JudgedClaim, ...]
    states: int
    inside: float
    branches: BranchReport | None
    drawn: tuple[str, ...]
    fixed: tuple[str, ...]
    inexact: tuple[str, ...]
    largest: float
    unrecognised: tuple[str, ...]
    recognised: Mapping[str, str]
    near: Mapping[str, str]
    uncovered: tuple[str, ...]
    uncovered_points: tuple[str, ...]
    uncovered_values: tuple[str, ...]
    ranges: Mapping[str, tuple[bool, float, float]]
    refused: RefusedStates | None = None

    def count(self, status: str) -> int:
        """Return the number of claims with a status."""
        return sum(claim.status == status for claim in self.claims)


class Prover:
    """Proves claims about one robot, as often as its equations or their variants change.

    Random states and the mechanism with exact numbers do not depend on what the equations compute: they are made once.
    """

    def __init__(self, formula: Formula, robot: Mechanism, seed: int = 0) -> None:
        """Keep the robot.

        Args:
            formula: the equations.
            robot: the mechanism of the CAD; it is independent of the equations.
            seed: of the random numbers.
        """
        self.formula = formula
        self.robot = robot
        self.seed = seed
        self._kept: dict[tuple[int, int, tuple[str, ...], bool], ProofStates] = {}

    def states(self, count: int, drawn: Collection[str] = (), formulas: bool = False) -> ProofStates:
        """Return random states; for the arguments see `random_states`."""
        key = (field.prime(), count, tuple(drawn), formulas)
        if key in self._kept:
            return self._kept[key]
        made = random_states(self.formula, self.robot, count, self.seed, drawn, formulas)
        if count <= _MOST_KEPT:
            self._kept[key] = made
        return made

    def refuted(self, variants: Mapping[str, str], count: int = FIRST_STATES) -> tuple[JudgedClaim, ...]:
        """Return the claims that are wrong at one of the first states: no proof, but a fast refutation."""
        with field.modulo(field.PRIMES[0]):
            claims = attempted(self.states(count), variants, {}, only_refute=True).claims
        return tuple(claim for claim in claims if claim.status == "refuted")

    def proof(
        self,
        variants: Mapping[str, str],
        states: int = STATES,
        progress: Callable[[str, float], None] = lambda label, fraction: None,
    ) -> Proof:
        """Return all claims and their verdicts.

        The claims are judged with the published parameters. Then each parameter that is an angle gets other values: if
        no claim is wrong with them, what is proved holds for all of its values. An angle without an exact form, such as
        52 degrees, is possible only in this way.

        Args:
            variants: the chosen variant of each equation.
            states: number of random states.
            progress: called with a label and the finished fraction.
        """
        return _Course(self, variants, states, progress).proof()


def prove(
    formula: Formula,
    variants: Mapping[str, str],
    robot: Mechanism,
    states: int = STATES,
    seed: int = 0,
    progress: Callable[[str, float], None] = lambda label, fraction: None,
) -> Proof:
    """Return the claims about a robot and their verdicts; see `Prover`, which also has the arguments."""
    return Prover(formula, robot, seed).proof(variants, states, progress)


class _Course:
    """The course of one proof: attempts at several states, and what they say together."""

    def __init__(
        self, prover: Prover, variants: Mapping[str, str], states: int, progress: Callable[[str, float], None]
    ) -> None:
        self.prover = prover
        self.variants = variants
        self.count = states
        self.progress = progress
        self.primes = list(field.PRIMES)
        self.general: list[str] = []  # angles for whose other values no claim is wrong
        self.last: Attempt

    def proof(self) -> Proof:
        """Return all claims and their verdicts."""
        formula = self.prover.formula
        self.progress("the published parameters", 0.0)
        exact = all(exact_angle(float(p.value), 1e-12) for p in formula.parameters if p.unit in ANGULAR)
        # with an angle without an exact form nothing is proved yet: this attempt only refutes
        proof = self._attempt((), self.count if exact else min(self.count, STATES))
        proof = replace(proof, near={**proof.near, **_near_in_equations(formula, self.variants)})
        if proof.count("refuted"):
            return self._explained(proof)
        if not proof.inside:
            return proof  # nothing is within reach: other states and parameters prove nothing
        proof = self._for_other_parameters(proof)
        for factor in _ROOTED_FACTORS:
            groups = _root_groups(proof, self.last)
            if groups:
                self.progress("states with roots", 0.9)
                proof = _completed(proof, self._attempt(self.general, factor * self.count, rooted=groups))
        self.progress("conditions", 0.95)
        unclaimed = [*proof.uncovered_values, *(f"point {name}" for name in proof.uncovered_points)]
        report = examined_conditions(formula, self.variants, proof.drawn, proof.ranges, self.prover.seed, unclaimed)
        proof = replace(proof, refused=self._refused(proof, report))
        proof = self._with_found_states(proof, report)
        proof = self._judged_near(proof, self._even_states(proof.ranges))
        self.progress("the signs of roots", 0.98)
        names = list(report.states)
        rare = [dict(zip(names, state, strict=True)) for state in zip(*report.states.values(), strict=True)]
        proof = replace(proof, claims=with_signs(proof.claims, rare))
        return _with_branches(proof, report)

    def _explained(self, proof: Proof) -> Proof:
        """Return the proof whose refuted claims have their errors as formulas, and witnesses in fractions."""
        self.progress("the errors as formulas", 0.5)
        formulas = {claim.name: claim for claim in self._attempt((), _FORMULA_STATES, formulas=True).claims}
        names = [name for name in angles(self.prover.formula) if name in proof.inexact]
        general: Proof | None = None
        claims = []
        for claim in proof.claims:
            if claim.status != "refuted":
                claims.append(claim)
                continue
            fractions = rational_witness(claim, proof.ranges)
            if not fractions and names:
                # angles as 52 degrees have no exact form: fractions near them are part of the witness
                if general is None:
                    self.progress("witnesses in fractions", 0.8)
                    general = self._attempt(names, _TRIAL_STATES)
                fractions = self._witness_near(claim.name, general, names)
            formula = formulas[claim.name]
            claims.append(replace(claim, error=formula.error, error_terms=formula.error_terms, fractions=fractions))
        return replace(proof, claims=tuple(claims))

    def _witness_near(self, name: str, general: Proof, parameters: Sequence[str]) -> dict[str, str]:
        """Return a witness in fractions of a claim, with some parameters near their published values; or none."""
        claim = next(claim for claim in general.claims if claim.name == name)
        if claim.status != "refuted":
            return {}
        published = {p.name: float(p.value) for p in self.prover.formula.parameters if p.name in parameters}
        return rational_witness(replace(claim, witness={**claim.witness, **published}), general.ranges, parameters)

    def _even_states(self, ranges: Mapping[str, tuple[bool, float, float]]) -> dict[str, Array]:
        """Return {random number: values (k,)} that are spread evenly over the ranges.

        Tangents of half angles that are spread evenly, as the odds need them, belong to angles near half a turn if a
        joint makes a full turn: branches elsewhere would hardly be met.
        """
        generator = np.random.default_rng([self.prover.seed, 2])
        return {name: generator.uniform(low, high, _EVEN_STATES) for name, (_, low, high) in ranges.items()}

    def _attempt(
        self,
        drawn: Collection[str],
        count: int,
        formulas: bool = False,
        rooted: Sequence[RootGroup] = (),
        near: Mapping[str, Array] | None = None,
        zero_shares: Mapping[str, float] = {},
    ) -> Proof:
        """Return a proof from one attempt, with the next prime if a constant has no root modulo the first one."""
        prover = self.prover
        while True:
            with field.modulo(self.primes[0]):
                if near is None:
                    made = prover.states(count, drawn, formulas)
                else:
                    made = random_states(prover.formula, prover.robot, count, prover.seed, drawn, formulas, near)
                if rooted:
                    made = with_roots(made, self.variants, rooted)
                work = attempted(made, self.variants, zero_shares)
            self.last = work
            if not work.rootless or len(self.primes) == 1:
                return _proof_of(work, count)
            self.primes.pop(0)

    def _for_other_parameters(self, proof: Proof) -> Proof:
        """Return the proof for all values of the parameters for which it holds."""
        names = angles(self.prover.formula)
        # the parameters without an exact form together, because an angle of the CAD may be a sum of two
        groups = [[name for name in names if name in proof.inexact]]
        groups += [[name] for name in names if name not in proof.inexact]
        for k, group in enumerate(groups):
            self.progress(f"other values of {', '.join(group)}", (1 + k) / (2 + len(groups)))
            if not group:
                continue
            trial = self._attempt([*self.general, *group], _TRIAL_STATES)
            if trial.inside > 0 and not trial.count("refuted"):
                self.general += group
        if not self.general:
            return proof
        self.progress("all of these values", (1 + len(groups)) / (2 + len(groups)))
        return _either(proof, self._attempt(self.general, self.count))

    def _refused(self, proof: Proof, report: BranchReport) -> RefusedStates | None:
        """Return what the mechanism says of states that the equations refuse; None without any, or if it is unknown."""
        found = len(next(iter(report.refused.values())))
        if proof.inside == 1 and not found and not report.without_value:
            return None
        prover = self.prover
        return refused_states(prover.formula, self.variants, prover.robot, proof.ranges, report.refused, prover.seed)

    def _with_found_states(self, proof: Proof, report: BranchReport) -> Proof:
        """Return the proof after its claims were judged at states with rare answers of conditions."""
        near = {name: np.tile(numbers, BESIDES) for name, numbers in report.states.items()}
        return self._judged_near(proof, near)

    def _judged_near(self, proof: Proof, near: Mapping[str, Array]) -> Proof:
        """Return the proof after its claims were judged near given values (k,) of the random numbers."""
        count = len(next(iter(near.values())))
        if not count:
            return proof
        shares = {claim.name: claim.share for claim in proof.claims if claim.status == "proved" and claim.roots}
        return _judged_besides(proof, self._attempt(proof.drawn, count, near=near, zero_shares=shares))


def _proof_of(work: Attempt, states: int) -> Proof:
    """Return the proof of one attempt, with a number of drawn states."""
    made = work.states
    drawing = made.exact.drawing
    return Proof(
        claims=tuple(work.claims),
        states=states,
        inside=min(work.shares),
        branches=None,
        drawn=tuple(made.drawn),
        fixed=tuple(name for name in angles(made.formula) if name not in made.drawn),
        inexact=tuple(made.inexact),
        largest=drawing.largest,
        unrecognised=tuple(dict.fromkeys(drawing.unrecognised)),
        recognised=dict(drawing.recognised),
        near=dict(drawing.near),
        uncovered=tuple(sorted(work.uncovered)),
        uncovered_points=tuple(work.uncovered_points),
        uncovered_values=tuple(_uncovered_values(work)),
        ranges=made.ranges,
    )


def _near_in_equations(formula: Formula, variants: Mapping[str, str]) -> dict[str, str]:
    """Return {parameter or number of the equations: the root that it is, but for its last digit}."""
    found: dict[str, str] = {}
    lengths = {p.name: float(p.value) for p in formula.parameters if p.unit in ("mm", "m") and p.value}
    for name, length in lengths.items():
        others = {other: value for other, value in lengths.items() if other != name}
        found[f"parameter {name}, {1e3 * length:.12g} mm"] = near_length(length, others)
    if formula.has("inverse"):
        function = formula_side.from_pose(formula, variants, coordinates=not formula.has("forward")).function
    else:
        function = formula_side.from_joints(formula, variants).function
    for k in range(function.n_instructions()):
        if function.instruction_id(k) == ca.OP_CONST:
            number = float(function.instruction_constant(k))
            if not math.isfinite(number):
                continue
            found[f"{number:.12g} in the equations"] = near_number(number) or near_length(number, lengths)
    return {text: near for text, near in found.items() if near}


def _uncovered_values(work: Attempt) -> Iterator[str]:
    """Yield the passive joints, margins, measures and aspects of the equations of whose values nothing is claimed."""
    formula = work.states.formula
    robot = work.states.robot
    for name in formula.passive:
        if not mechanism.judges(robot, name, work.uncovered):
            yield f"passive joint {name}"
    yield from (f"margin {name}" for name in formula.reach)
    yield from (f"measure {measure.name}" for measure in formula.measures)
    yield from (f"aspect {aspect.symbol}" for aspect in formula.aspects)


def examined_conditions(
    formula: Formula,
    variants: Mapping[str, str],
    drawn_parameters: Collection[str],
    limits_of: Mapping[str, tuple[bool, float, float]],
    seed: int,
    unclaimed: Collection[str] = (),
) -> BranchReport:
    """Return what is known of the conditions in the equations.

    Args:
        formula: the equations.
        variants: the chosen variant of each equation.
        drawn_parameters: parameters with random values.
        limits_of: {random number: (whether it is an angle, low, high)}.
        seed: of the random numbers.
        unclaimed: results of which nothing is claimed, for `examined`; if there are none, conditions that only
            measures and aspects depend on are left out.
    """
    conditions = Branches(formula, variants, drawn_parameters, measures=bool(unclaimed))
    ranges = {name: limits_of[name] for name in conditions.names}
    state = draws.named(np.random.default_rng([seed, 1]), ranges, _CONDITION_STATES)
    limits = np.array([[low, high] for _, low, high in ranges.values()])
    drawn = np.array([values.real_of(value) for value in state.values()])
    published = drawn.copy()
    parameters = {parameter.name: float(parameter.value) for parameter in formula.parameters}
    for place, name in enumerate(conditions.names):
        if name in drawn_parameters:
            published[place] = parameters[name]
    return examined(conditions, drawn, published, limits, unclaimed)


def _judged_besides(proof: Proof, found: Proof) -> Proof:
    """Return the proof with the claims that are wrong, or not exactly zero, at states that a search found."""
    claims = []
    for claim, other in zip(proof.claims, found.claims, strict=True):
        if other.status == "refuted":
            claims.append(other)
        elif claim.status == "proved" and (other.different or other.undefined):
            claims.append(replace(claim, status="unproved", reason=other.reason, nodes=()))
        else:
            claims.append(claim)
    return replace(proof, claims=tuple(claims))


def with_signs(claims: Iterable[JudgedClaim], rare: Sequence[Mapping[str, float]]) -> tuple[JudgedClaim, ...]:
    """Return the claims without the proofs that are wrong with the signs of their roots, by however little.

    They are judged where exact values were not zero, and at states where conditions have rare answers: some of `rare`,
    each {random number: its value}.
    """
    chosen = rare[:: 1 + len(rare) // _PRECISE]
    found = []
    for claim in claims:
        wrong = 0.0
        if claim.status == "proved" and claim.roots:
            wrong = certainly_not_zero(claim.nodes, [*claim.doubtful, *chosen])
        if wrong:
            reason = (
                f"with the signs of its roots, a value is {wrong:.3g} at a state within reach: a difference below 1e-6"
            )
            claim = replace(claim, status="unproved", reason=reason, nodes=())
        found.append(claim)
    return tuple(found)


def _with_branches(proof: Proof, report: BranchReport) -> Proof:
    """Return the proof with the claims that all conditions were judged, and that there is a value within reach."""
    claims = list(proof.claims)
    if report.open:
        reason = (
            f"{len(report.open)} of {report.count} conditions have one answer at all drawn states, a search found "
            f"no state with the other, and intervals in {MOST_BOXES} boxes are too wide to exclude it: "
            f"{', '.join(report.open[:_OPEN_CONDITIONS])}"
        )
        if len(report.open) > _OPEN_CONDITIONS:
            reason += f" and {len(report.open) - _OPEN_CONDITIONS} more, each in the JSON of the result"
        claims.append(unclaimed("conditions", "all answers of the conditions were judged", reason))
    if report.silent:
        sentence = "no result without a claim has other values at few poses"
        reason = (
            f"{len(report.silent)} conditions have an answer that few or none of the drawn states have, and only "
            f"change results of which nothing is claimed: {', '.join(report.silent[:_OPEN_CONDITIONS])}"
        )
        if len(report.silent) > _OPEN_CONDITIONS:
            reason += f" and {len(report.silent) - _OPEN_CONDITIONS} more, each in the JSON of the result"
        claims.append(unclaimed("results without a claim", sentence, reason))
    beyond = proof.refused.claim() if proof.refused is not None else None
    if beyond is not None:
        claims.append(beyond)
    elif report.without_value:
        sentence = "the equations have a value at each pose within reach"
        state = ", ".join(f"{name} = {value:.6g}" for name, value in report.without_value.items())
        reason = f"they have neither a value nor a negative margin at {state}: the mechanism may reach it, or may not"
        claims.append(unclaimed("values", sentence, reason))
    return replace(proof, claims=tuple(claims), branches=report)


def _root_groups(proof: Proof, work: Attempt) -> list[RootGroup]:
    """Return the roots of each claim that needs more states where they exist; of the last attempt `work`."""
    groups: list[RootGroup] = []
    for claim, other in zip(proof.claims, work.claims, strict=True):
        if not claim.luckless:
            continue
        found: tuple[set[int], set[int]] = set(), set()
        for function, mark, instruction in work.roots:
            if mark in other.roots:
                found[function].add(instruction)
        group = (frozenset(found[0]), frozenset(found[1]))
        if group not in groups:
            groups.append(group)
    return groups


def _completed(proof: Proof, rooted: Proof) -> Proof:
    """Return the proof with the claims that need states where all roots exist."""
    claims = []
    for claim, other in zip(proof.claims, rooted.claims, strict=True):
        better = claim.luckless and (other.status != "unproved" or other.zeros > claim.zeros)
        claims.append(other if better else claim)
    return replace(proof, claims=tuple(claims))


def _either(published: Proof, general: Proof) -> Proof:
    """Return the proof for arbitrary parameters, where a claim is only proved for published ones with that verdict."""
    claims = []
    for claim, other in zip(published.claims, general.claims, strict=True):
        better = other.status == "proved" or (claim.status == "unproved" and other.zeros >= claim.zeros)
        claims.append(other if better and other.status != "refuted" else claim)
    special = [c for c, other in zip(claims, general.claims, strict=True) if c.status == "proved" != other.status]
    if special or not any(claim.status == "proved" for claim in general.claims):
        return replace(published, claims=tuple(claims))
    drawn = general.drawn
    return replace(published, claims=tuple(claims), drawn=drawn, fixed=general.fixed, ranges=general.ranges)
