"""Prove that equations and mechanism agree at all poses, or find where they do not.

Words of this room: a *state* is a draw of all random numbers: joint values or coordinates of a pose, and the *drawn*
parameters, which have random values near their published ones. A state is *within reach* if the equations have values
and no negative margin there; they *refuse* the others. A value is *exact* if its residue in the prime field is known,
which needs all of its roots to exist there.

Stages of a proof (`_ProofRun.proof`), each with the reason for its place:

1. The published parameters. One wrong pose is enough: a refuted claim gets a formula of its error and a witness in
   fractions, and the proof ends. It also ends if no state is within reach.
2. Other values of the angles. What comes later must be judged with the parameters for which the result will hold.
3. More states with all roots, for claims that still lack exact zeros with these parameters.
4. The conditions in the equations: which answers no state had so far. The search for such states needs their ranges.
5. The states that the equations refuse, compared with the mechanism; some of them are found by the search of 4.
6. The claims again, at the states that 4 found, and at states that are spread evenly over the ranges of angles.
7. The signs of roots, with many digits, at states where 3 or 6 left them open and at those that 4 found.
8. Claims that say what 4 and 5 left open.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from twin.core.progress import Progress, silent
from twin.core.spatial import Array
from twin.formula.contract import Formula
from twin.model.mechanism import Mechanism
from twin.proof import combined_proof, field, refuted_claims
from twin.proof.attempt import Attempt, attempted
from twin.proof.branch_report import BranchReport, examined_conditions, states_one_by_one
from twin.proof.claims import JudgedClaim
from twin.proof.constants import exact_angle
from twin.proof.draws import RandomRange
from twin.proof.proof_result import Proof, near_numbers_in_equations, proof_of
from twin.proof.random_states import ANGULAR, ProofStates, angles, random_states
from twin.proof.refused_states import RefusedStates, refused_states
from twin.proof.rooted_states import RootGroup, root_groups, with_roots

STATES = 4096
"""Number of random states."""

FIRST_STATES = 64
"""Number of states at which a wrong equation is refuted before anything else is computed."""

_TRIAL_STATES = 256
"""Number of states at which other values of a parameter are tried."""

_EVEN_STATES = 2048
"""Number of states that are spread evenly over the ranges of angles; the others have even tangents of half angles."""

_ROOTED_STATES_FACTORS = (16, 128)
"""How many times more states than asked for are searched for those with all roots, one search after the other."""

REPEATS_PER_STATE = 16
"""How often each state that was found is judged, because roots do not exist in the field at all of them."""

_FORMULA_STATES = 16
"""Number of states at which formulas are computed; they do not depend on it."""

_MOST_CACHED_STATES = 8192
"""Maximum number of states that are kept for the next proof."""

_ANGLE_TOLERANCE = 1e-12
"""Largest distance of a parameter from a multiple of 30 or of 45 degrees, as a part of 30 or of 45 degrees."""


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
        if count <= _MOST_CACHED_STATES:
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


def even_states(ranges: Mapping[str, RandomRange], seed: int) -> dict[str, Array]:
    """Return {random number: values (k,)} that are spread evenly over the ranges.

    Tangents of half angles that are spread evenly, as the odds need them, belong to angles near half a turn if a joint
    makes a full turn: branches elsewhere would hardly be met.
    """
    generator = np.random.default_rng([seed, 2])
    even_values = {}
    for name, limits in ranges.items():
        even_values[name] = generator.uniform(limits.low, limits.high, _EVEN_STATES)
    return even_values


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
        if proof.count("refuted"):
            return self._explained(proof)
        if not proof.within_reach:
            return proof  # nothing is within reach: other states and parameters prove nothing
        judged = self._for_other_parameters(published)
        proof = self._with_rooted_states(judged)
        report = self._conditions(proof)
        proof = replace(proof, refused_states=self._refused_states(proof, report))
        proof = self._with_found_states(proof, report)
        proof = self._judged_near(proof, even_states(proof.ranges, self.prover.seed))
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
        near_numbers = {**judged.proof.near_numbers, **near_numbers_in_equations(formula, self.variants)}
        return replace(judged, proof=replace(judged.proof, near_numbers=near_numbers))

    def _with_rooted_states(self, judged: _JudgedAttempt) -> Proof:
        """Return the proof with the claims that need states where all of their roots exist.

        `judged` has the proof, and the attempt with the same arbitrary angles as the attempts that are made here.
        """
        proof = judged.proof
        attempt = judged.attempt
        for factor in _ROOTED_STATES_FACTORS:
            groups = root_groups(proof.claims, attempt)
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
        return examined_conditions(
            prover.formula, self.variants, proof.arbitrary_parameters, proof.ranges, prover.seed, unclaimed
        )

    def _explained(self, proof: Proof) -> Proof:
        """Return the proof whose refuted claims have their errors as formulas, and witnesses in fractions."""
        self.progress("the errors as formulas", 0.5)
        formula_proof = self._attempt((), _FORMULA_STATES, formulas=True).proof

        def prove_with_random(names: Sequence[str]) -> Proof:
            self.progress("witnesses in fractions", 0.8)
            return self._attempt(names, _TRIAL_STATES).proof

        formula = self.prover.formula
        return refuted_claims.with_errors_and_fractions(proof, formula_proof, formula, prove_with_random)

    def _attempt(
        self,
        drawn: Collection[str],
        count: int,
        formulas: bool = False,
        root_groups: Sequence[RootGroup] = (),
        centres: Mapping[str, Array] | None = None,
        other_zero_shares: Mapping[str, float] = {},
    ) -> _JudgedAttempt:
        """Return one attempt and its proof, with the next prime if a constant has no root modulo the first one.

        Args:
            drawn: parameters that have random values.
            count: number of states.
            formulas: whether what is not zero is computed as a polynomial.
            root_groups: if given, only states are judged where all roots of one of these groups exist.
            centres: {random number: values (k,) near which it is drawn}; None: anywhere in its range.
            other_zero_shares: {claim: share of its exact values that are zero at other states}.
        """
        prover = self.prover
        while True:
            with field.modulo(self.primes[0]):
                if centres is None:
                    states = prover.states(count, drawn, formulas)
                else:
                    states = random_states(prover.formula, prover.robot, count, prover.seed, drawn, formulas, centres)
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
            if name in published.proof.inexact_parameters:
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
            if trial.within_reach > 0 and not trial.count("refuted"):
                self.arbitrary_angles += group
        if not self.arbitrary_angles:
            return self._at_all_states(published)
        self.progress("all of these values", (1 + len(groups)) / steps)
        general = self._attempt(self.arbitrary_angles, self.count)
        return replace(general, proof=combined_proof.for_all_parameters(published.proof, general.proof))

    def _at_all_states(self, published: _JudgedAttempt) -> _JudgedAttempt:
        """Return the attempt with the published parameters, at all states that were asked for.

        The first attempt may have had fewer; see `_with_published_parameters`.
        """
        if published.proof.states == self.count:
            return published
        judged = self._attempt((), self.count)
        return replace(judged, proof=replace(judged.proof, near_numbers=published.proof.near_numbers))

    def _refused_states(self, proof: Proof, report: BranchReport) -> RefusedStates | None:
        """Return what the mechanism says of states that the equations refuse; None without any, or if it is unknown."""
        number_found = len(next(iter(report.refused.values())))
        if proof.within_reach == 1 and not number_found and not report.without_value:
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

    def _judged_near(self, proof: Proof, centres: Mapping[str, Array]) -> Proof:
        """Return the proof after its claims were judged near given values (k,) of the random numbers."""
        count = len(next(iter(centres.values())))
        if not count:
            return proof
        zero_shares = {}
        for claim in proof.claims:
            if claim.status == "proved" and claim.roots:
                zero_shares[claim.name] = claim.zero_share
        other_states = self._attempt(
            proof.arbitrary_parameters, count, centres=centres, other_zero_shares=zero_shares
        ).proof
        return combined_proof.demote_contradicted(proof, other_states)
