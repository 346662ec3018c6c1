"""What is said of a refuted claim: its error as a formula, and a witness in fractions that can be repeated by hand.

A witness in fractions has a fraction for each length, and for each angle the tangent of its half. A published angle
such as 52 degrees has no such tangent, and no exact form: with it, no value of the claim is exact, and there is no
witness. A second proof therefore has these angles as random numbers, of which each state is exact. Its witness is moved
to fractions near the published angles, which are then part of it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

from twin.formula.contract import Formula
from twin.proof.claims import JudgedClaim
from twin.proof.proof_result import Proof
from twin.proof.random_states import angles
from twin.proof.rational_witness import rational_witness


def with_errors_and_fractions(
    proof: Proof, formula_proof: Proof, formula: Formula, prove_with_random: Callable[[Sequence[str]], Proof]
) -> Proof:
    """Return the proof whose refuted claims have their errors as formulas, and witnesses in fractions.

    Args:
        proof: the proof.
        formula_proof: the proof of an attempt whose values have formulas; only the errors of its claims are read.
        formula: the equations.
        prove_with_random: function of names of parameters that returns the proof with random values of these. It
            is called once at most, and only if an angle without an exact form, such as 52 degrees, is in the way.
    """
    errors = {claim.name: claim for claim in formula_proof.claims}
    inexact_angles = [name for name in angles(formula) if name in proof.inexact_parameters]
    random_angles_proof: Proof | None = None
    claims = []
    for claim in proof.claims:
        if claim.status != "refuted":
            claims.append(claim)
            continue
        fractions = rational_witness(claim, proof.ranges)
        if not fractions and inexact_angles:
            # fractions near the tangents of these angles are then part of the witness
            if random_angles_proof is None:
                random_angles_proof = prove_with_random(inexact_angles)
            fractions = _fractions_near_published_angles(claim.name, random_angles_proof, formula, inexact_angles)
        error = errors[claim.name]
        claims.append(replace(claim, error=error.error, error_terms=error.error_terms, fractions=fractions))
    return replace(proof, claims=tuple(claims))


def _fractions_near_published_angles(
    name: str, random_angles_proof: Proof, formula: Formula, parameters: Sequence[str]
) -> dict[str, str]:
    """Return a witness in fractions of a claim, with some angles near their published values; empty if there is none.

    Args:
        name: name of the claim.
        random_angles_proof: the proof with random values of the parameters.
        formula: the equations.
        parameters: names of the parameters, which are angles.
    """
    claim = _claim_named(name, random_angles_proof)
    if claim.status != "refuted":
        return {}
    witness = dict(claim.witness)
    for parameter in formula.parameters:
        if parameter.name in parameters:
            witness[parameter.name] = float(parameter.value)
    return rational_witness(replace(claim, witness=witness), random_angles_proof.ranges, parameters)


def _claim_named(name: str, proof: Proof) -> JudgedClaim:
    """Return the claim with a name."""
    (claim,) = [claim for claim in proof.claims if claim.name == name]
    return claim
