"""Prove that equations and mechanism agree at all poses, or find where they do not."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from twin.core.progress import Progress, silent
from twin.core.spatial import Array
from twin.formula.contract import Formula
from twin.model.mechanism import Mechanism
from twin.proof import combined_proof, field
from twin.proof.attempt import Attempt, RootGroup, attempted, with_roots
from twin.proof.branch_report import BranchReport, examined_conditions, states_one_by_one
from twin.proof.claims import JudgedClaim
from twin.proof.constants import exact_angle
from twin.proof.proof_result import Proof, near_in_equations, proof_of
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

REPEATS_PER_STATE = 16
"""How often each state that was found is judged, because roots do not exist in the field at all of them."""

_FORMULA_STATES = 16
"""Number of states at which formulas are computed; they do not depend on it."""

_MOST_CACHED = 8192
"""Maximum number of states that are kept for the next proof."""

_ANGLE_TOLERANCE = 1e-12
"""Tolerance of a parameter that is a multiple of 30 or of 45 degrees, in multiples of these."""


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
        # {(prime, number of states, drawn parameters, whether they are variables of formulas): the states}
        self._cache: dict[tuple[int, int, tuple[str, ...], bool], ProofStates] = {}

    def states(self, count: int, drawn: Collection[str] = (), formulas: bool = False) -> ProofStates:
        """Return random states; for the arguments see `random_states`."""
        key = (field.prime(), count, tuple(drawn), formulas)
        if key in self._cache:
            return self._cache[key]
        states = random_states(self.formula, self.robot, count, self.seed, drawn, formulas)
        if count <= _MOST_CACHED:
            self._cache[key] = states
        return states

    def refuted(self, variants: Mapping[str, str], count: int = FIRST_STATES) -> tuple[JudgedClaim, ...]:
        """Return the claims that are wrong at one of the first states: no proof, but a fast refutation."""
        with field.modulo(field.PRIMES[0]):
            attempt = attempted(self.states(count), variants, {}, only_refute=True)
        return tuple(claim for claim in attempt.claims if claim.status == "refuted")  # in the order of the claims

    def proof(
        self,
        variants: Mapping[str, str],
        states: int = STATES,
        progress: Progress = silent,
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
        return _ProofRun(self, variants, states, progress).proof()


def prove(
    formula: Formula,
    variants: Mapping[str, str],
    robot: Mechanism,
    states: int = STATES,
    seed: int = 0,
    progress: Progress = silent,
) -> Proof:
    """Return the claims about a robot and their verdicts; see `Prover`.

    Args:
        formula: the equations.
        variants: the chosen variant of each equation.
        robot: the mechanism of the CAD; it is independent of the equations.
        states: number of random states.
        seed: of the random numbers.
        progress: called with a label and the finished fraction.
    """
    return Prover(formula, robot, seed).proof(variants, states, progress)


@dataclass(frozen=True)
class _JudgedAttempt:
    """An attempt and its proof: their claims are the same, in the same order; only the attempt knows the roots."""

    proof: Proof
    attempt: Attempt


class _ProofRun:
    """One proof: attempts at several states, and what they say together.

    Attributes:
        prover: the robot, its equations, and the states that were drawn before.
        variants: the chosen variant of each equation.
        count: number of random states.
        progress: called with a label and the finished fraction.
        primes: the first one is in use; it is dropped, for all later attempts, if a constant has no root modulo it.
        arbitrary_angles: angles for whose other values no claim is wrong.
    """

    def __init__(self, prover: Prover, variants: Mapping[str, str], states: int, progress: Progress) -> None:
        self.prover = prover
        self.variants = variants
        self.count = states
        self.progress = progress
        self.primes = list(field.PRIMES)
        self.arbitrary_angles: list[str] = []

    def proof(self) -> Proof:
        """Return all claims and their verdicts."""
        published = self._with_published_parameters()
        proof = published.proof
        # one wrong pose is enough: the rest would only confirm it
        if proof.count("refuted"):
            return self._explained(proof)
        if not proof.inside:
            return proof  # nothing is within reach: other states and parameters prove nothing
        judged = self._for_other_parameters(published)
        proof = self._with_rooted_states(judged)
        report = self._conditions(proof)
        proof = replace(proof, refused=self._refused(proof, report))
        proof = self._with_found_states(proof, report)
        proof = self._judged_near(proof, self._even_states(proof.ranges))
        self.progress("the signs of roots", 0.98)
        rare = states_one_by_one(report.states)
        proof = replace(proof, claims=combined_proof.demote_wrong_signs(proof.claims, rare))
        return combined_proof.with_conditions(proof, report)

    def _with_published_parameters(self) -> _JudgedAttempt:
        """Return the first attempt, with the published parameters."""
        formula = self.prover.formula
        self.progress("the published parameters", 0.0)
        count = self.count
        for parameter in formula.parameters:
            if parameter.unit in ANGULAR and not exact_angle(float(parameter.value), _ANGLE_TOLERANCE):
                # with an angle without an exact form nothing is proved yet: this attempt only refutes
                count = min(self.count, STATES)
        judged = self._attempt((), count)
        near = {**judged.proof.near, **near_in_equations(formula, self.variants)}
        return replace(judged, proof=replace(judged.proof, near=near))

    def _with_rooted_states(self, judged: _JudgedAttempt) -> Proof:
        """Return the proof with the claims that need states where all of their roots exist.

        `judged` has the proof, and the attempt with the same arbitrary angles as the attempts that are made here.
        """
        proof = judged.proof
        attempt = judged.attempt
        for factor in _ROOTED_FACTORS:
            groups = _root_groups(proof, attempt)
            if groups:
                self.progress("states with roots", 0.9)
                with_all_roots = self._attempt(self.arbitrary_angles, factor * self.count, root_groups=groups)
                proof = combined_proof.with_rooted_states(proof, with_all_roots.proof)
                attempt = with_all_roots.attempt
        return proof

    def _conditions(self, proof: Proof) -> BranchReport:
        """Return what is known of the conditions in the equations."""
        prover = self.prover
        self.progress("conditions", 0.95)
        unclaimed = list(proof.uncovered_values)
        for name in proof.uncovered_points:
            unclaimed.append(f"point {name}")
        return examined_conditions(prover.formula, self.variants, proof.drawn, proof.ranges, prover.seed, unclaimed)

    def _explained(self, proof: Proof) -> Proof:
        """Return the proof whose refuted claims have their errors as formulas, and witnesses in fractions."""
        self.progress("the errors as formulas", 0.5)
        with_formulas = self._attempt((), _FORMULA_STATES, formulas=True).proof
        formulas = {claim.name: claim for claim in with_formulas.claims}
        inexact_angles = [name for name in angles(self.prover.formula) if name in proof.inexact]
        general: Proof | None = None
        claims = []
        for claim in proof.claims:
            if claim.status != "refuted":
                claims.append(claim)
                continue
            fractions = rational_witness(claim, proof.ranges)
            if not fractions and inexact_angles:
                # angles as 52 degrees have no exact form: fractions near them are part of the witness
                if general is None:
                    self.progress("witnesses in fractions", 0.8)
                    general = self._attempt(inexact_angles, _TRIAL_STATES).proof
                fractions = self._witness_near(claim.name, general, inexact_angles)
            formula = formulas[claim.name]
            claims.append(replace(claim, error=formula.error, error_terms=formula.error_terms, fractions=fractions))
        return replace(proof, claims=tuple(claims))

    def _witness_near(self, name: str, general: Proof, parameters: Sequence[str]) -> dict[str, str]:
        """Return a witness in fractions of a claim, with some parameters near their published values; or none."""
        (claim,) = [claim for claim in general.claims if claim.name == name]
        if claim.status != "refuted":
            return {}
        witness = dict(claim.witness)
        for parameter in self.prover.formula.parameters:
            if parameter.name in parameters:
                witness[parameter.name] = float(parameter.value)
        return rational_witness(replace(claim, witness=witness), general.ranges, parameters)

    def _even_states(self, ranges: Mapping[str, tuple[bool, float, float]]) -> dict[str, Array]:
        """Return {random number: values (k,)} that are spread evenly over the ranges.

        Tangents of half angles that are spread evenly, as the odds need them, belong to angles near half a turn if a
        joint makes a full turn: branches elsewhere would hardly be met.
        """
        generator = np.random.default_rng([self.prover.seed, 2])
        even_values = {}
        for name, (_, low, high) in ranges.items():
            even_values[name] = generator.uniform(low, high, _EVEN_STATES)
        return even_values

    def _attempt(
        self,
        drawn: Collection[str],
        count: int,
        formulas: bool = False,
        root_groups: Sequence[RootGroup] = (),
        near: Mapping[str, Array] | None = None,
        other_zero_shares: Mapping[str, float] = {},
    ) -> _JudgedAttempt:
        """Return one attempt and its proof, with the next prime if a constant has no root modulo the first one.

        Args:
            drawn: parameters that have random values.
            count: number of states.
            formulas: whether what is not zero is computed as a polynomial.
            root_groups: if given, only states are judged where all roots of one of these groups exist.
            near: {random number: values (k,) near which it is drawn}; None: anywhere in its range.
            other_zero_shares: {claim: share of its exact values that are zero at other states}.
        """
        prover = self.prover
        while True:
            with field.modulo(self.primes[0]):
                if near is None:
                    states = prover.states(count, drawn, formulas)
                else:
                    states = random_states(prover.formula, prover.robot, count, prover.seed, drawn, formulas, near)
                if root_groups:
                    states = with_roots(states, self.variants, root_groups)
                attempt = attempted(states, self.variants, other_zero_shares)
            if not attempt.rootless or len(self.primes) == 1:
                return _JudgedAttempt(proof_of(attempt, count), attempt)
            self.primes.pop(0)

    def _for_other_parameters(self, published: _JudgedAttempt) -> _JudgedAttempt:
        """Return the proof for all values of the parameters for which it holds, and the attempt with these values."""
        inexact_group = []
        groups = [inexact_group]
        for name in angles(self.prover.formula):
            if name in published.proof.inexact:
                # these together, because an angle of the CAD may be a sum of two
                inexact_group.append(name)
            else:
                groups.append([name])
        steps = 2 + len(groups)  # the published parameters, each group, and all of them together
        for number, group in enumerate(groups):
            self.progress(f"other values of {', '.join(group)}", (1 + number) / steps)
            if not group:
                continue
            trial = self._attempt([*self.arbitrary_angles, *group], _TRIAL_STATES).proof
            if trial.inside > 0 and not trial.count("refuted"):
                self.arbitrary_angles += group
        if not self.arbitrary_angles:
            return published
        self.progress("all of these values", (1 + len(groups)) / steps)
        general = self._attempt(self.arbitrary_angles, self.count)
        return replace(general, proof=combined_proof.for_all_parameters(published.proof, general.proof))

    def _refused(self, proof: Proof, report: BranchReport) -> RefusedStates | None:
        """Return what the mechanism says of states that the equations refuse; None without any, or if it is unknown."""
        number_found = len(next(iter(report.refused.values())))
        if proof.inside == 1 and not number_found and not report.without_value:
            return None
        prover = self.prover
        return refused_states(
            prover.formula,
            self.variants,
            prover.robot,
            ranges=proof.ranges,
            found=report.refused,
            seed=prover.seed,
        )

    def _with_found_states(self, proof: Proof, report: BranchReport) -> Proof:
        """Return the proof after its claims were judged at states with rare answers of conditions."""
        repeated = {name: np.tile(numbers, REPEATS_PER_STATE) for name, numbers in report.states.items()}
        return self._judged_near(proof, repeated)

    def _judged_near(self, proof: Proof, near: Mapping[str, Array]) -> Proof:
        """Return the proof after its claims were judged near given values (k,) of the random numbers."""
        count = len(next(iter(near.values())))
        if not count:
            return proof
        zero_shares = {}
        for claim in proof.claims:
            if claim.status == "proved" and claim.roots:
                zero_shares[claim.name] = claim.zero_share
        other_states = self._attempt(proof.drawn, count, near=near, other_zero_shares=zero_shares).proof
        return combined_proof.demote_contradicted(proof, other_states)


def _root_groups(proof: Proof, attempt: Attempt) -> list[RootGroup]:
    """Return the roots of each claim that needs more states where they exist; `attempt` has the same claims."""
    groups: list[RootGroup] = []
    for claim, attempted_claim in zip(proof.claims, attempt.claims, strict=True):
        if not claim.needs_more_states:
            continue
        first_roots: set[int] = set()
        second_roots: set[int] = set()
        for function, root_signature, instruction in attempt.roots:
            if root_signature not in attempted_claim.roots:
                continue
            if function == 0:
                first_roots.add(instruction)
            else:
                second_roots.add(instruction)
        group = (frozenset(first_roots), frozenset(second_roots))
        if group not in groups:
            groups.append(group)
    return groups
