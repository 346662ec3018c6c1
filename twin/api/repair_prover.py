"""A prover of the repairs that `explain` proposes, for the equations of a robot."""

from __future__ import annotations

from collections.abc import Mapping

from twin.api.robot import Robot
from twin.core.errors import TwinError
from twin.formula import variant_choice
from twin.formula.contract import Formula
from twin.proof.claims import JudgedClaim
from twin.proof.equality import equal_outputs
from twin.proof.prove import Proof, prove
from twin.validation.explain.proved_repairs import ProofOfRepair

_NAMED_CLAIMS = 3
"""Number of claims that are named."""


class EquationsRepairProver:
    """Proves repaired equations of one robot; see `RepairProver`."""

    def __init__(self, robot: Robot, variants: Mapping[str, str] | str | None) -> None:
        """Keep the robot and the variants of its equations that are explained."""
        self.robot = robot
        self.variants = variant_choice.choose(robot.formula, variants)

    def proof(self, formula: Formula) -> ProofOfRepair:
        """Return the verdict on a repaired formula."""
        try:
            proof = prove(formula, self.variants, self.robot.mechanism)
        except TwinError as error:
            return ProofOfRepair(f"not judged by the prover: {error}", False)
        is_proved = bool(proof.claims) and proof.count("proved") == len(proof.claims)
        return ProofOfRepair(_verdict(proof), is_proved)

    def same(self, first: Formula, second: Formula) -> bool:
        """Return whether two repaired formulas have the same values at every pose, by a proof of each output."""
        claims = equal_outputs(first, second, self.variants, self.robot.mechanism)
        for claim in claims:
            if claim.status != "proved":
                return False
        return bool(claims)  # without an output to compare, nothing is known


def _verdict(proof: Proof) -> str:
    """Return the verdict on all claims as text."""
    refuted = []
    different = []
    unproved = []
    for claim in proof.claims:
        if claim.status == "refuted":
            refuted.append(claim)
        if claim.may_differ:
            different.append(claim)
        if claim.status != "proved":
            unproved.append(claim)
    if refuted:
        worst = max(refuted, key=lambda claim: claim.largest)
        if not worst.largest:  # refuted by exact numbers alone: there is no distance to state
            return f"wrong: it is not so that {worst.sentence}"
        return f"only close: {_distance(proof, worst)}; it is not so that {worst.sentence}"
    if different:
        worst = max(different, key=lambda claim: claim.largest)
        # without a root, an exact value that is not zero tells; with one, it may be that of the other sign
        closeness = "open" if worst.roots else "only close"
        return f"{closeness}: {_distance(proof, worst)}; not proved that {worst.sentence}: {worst.reason}"
    if not proof.claims:
        return "not judged by the prover: nothing can be claimed of these equations"
    if not unproved:
        return f"identity, proved: {len(proof.claims)} claims at all poses"
    return f"{len(unproved)} of {len(proof.claims)} claims are not proved, none is refuted: {_named(unproved)}"


def _distance(proof: Proof, claim: JudgedClaim) -> str:
    """Return the largest distance by which the sides of a claim differ, and where, as text."""
    names = ", ".join(proof.ranges)
    return f"{1e6 * claim.largest:.3g} um at one of {proof.states} poses within the ranges of {names}"


def _named(claims: list[JudgedClaim]) -> str:
    """Return the names of some claims, with the reason of the first."""
    names = ", ".join(claim.name for claim in claims[:_NAMED_CLAIMS])
    if len(claims) > _NAMED_CLAIMS:
        names += f" and {len(claims) - _NAMED_CLAIMS} more"
    return f"{names}; {claims[0].reason}"
