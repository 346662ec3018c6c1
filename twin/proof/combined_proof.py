"""What several attempts at one proof say together: which verdict of a claim counts, and what conditions leave open."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

from twin.proof.branch_bounds import MOST_BOXES
from twin.proof.branch_report import BranchReport
from twin.proof.claims import JudgedClaim, unclaimed
from twin.proof.precise import certainly_not_zero
from twin.proof.proof_result import Proof
from twin.proof.refused_states import state_text

_PRECISE_STATES = 64
"""Maximum number of states that were found at which signs of roots are judged with more digits."""

_NAMED_CONDITIONS = 3
"""Number of conditions that a claim names."""


def for_all_parameters(published: Proof, general: Proof) -> Proof:
    """Return one proof from two attempts: of each claim, the verdict for arbitrary parameters where it says more.

    The general claim counts if it is proved, or if both are unproved and it has at least as many exact zeros. Else the
    published claim counts.

    Args:
        published: the proof with the published parameters.
        general: the proof with arbitrary values of some of them.

    Returns:
        a proof that states arbitrary values of the parameters; it states the published values alone if a claim is only
        proved for these, or if no claim is proved for arbitrary ones. Its number of states is that of the attempt from
        which a claim is taken, the smaller one if claims are taken from both.
    """
    claims = []
    is_special = False  # whether a claim is only proved for the published parameters
    states = general.states
    for claim, general_claim in zip(published.claims, general.claims, strict=True):
        chosen_claim = claim
        if general_claim.status == "proved":
            chosen_claim = general_claim
        elif general_claim.status == claim.status == "unproved" and general_claim.exact_zeros >= claim.exact_zeros:
            # both are open: the one with more evidence says more about what is missing
            chosen_claim = general_claim
        if chosen_claim is claim:
            states = min(states, published.states)
        claims.append(chosen_claim)
        is_special |= chosen_claim.status == "proved" and general_claim.status != "proved"
    if is_special or not general.count("proved"):
        return replace(published, claims=tuple(claims), states=states)
    return replace(
        published,
        claims=tuple(claims),
        states=states,
        arbitrary_parameters=general.arbitrary_parameters,
        published_angles=general.published_angles,
        ranges=general.ranges,
    )


def with_rooted_states(proof: Proof, with_all_roots: Proof) -> Proof:
    """Return the proof with the claims that lack states taken from an attempt at states where all roots exist.

    The other claim counts if the claim needs more states, and the other is proved, refuted or has more exact zeros.
    """
    claims = []
    for claim, rooted_claim in zip(proof.claims, with_all_roots.claims, strict=True):
        is_better = rooted_claim.status != "unproved" or rooted_claim.exact_zeros > claim.exact_zeros
        if claim.needs_more_states and is_better:
            claims.append(rooted_claim)
        else:
            claims.append(claim)
    return replace(proof, claims=tuple(claims))


def demote_contradicted(proof: Proof, other_states: Proof) -> Proof:
    """Return the proof after its claims were judged at other states; no claim gets a better status by this.

    A claim that is refuted there is refuted, whatever its status was. A proved claim whose values there are undefined,
    or may not be exactly zero, is unproved, for the reason that the other claim states. All other claims stay.
    """
    claims = []
    for claim, other_claim in zip(proof.claims, other_states.claims, strict=True):
        if other_claim.status == "refuted":
            claims.append(other_claim)
        elif claim.status == "proved" and (other_claim.may_differ or other_claim.undefined_states):
            claims.append(replace(claim, status="unproved", reason=other_claim.reason, nodes=()))
        else:
            claims.append(claim)
    return replace(proof, claims=tuple(claims))


def demote_wrong_signs(claims: Iterable[JudgedClaim], rare: Sequence[Mapping[str, float]]) -> tuple[JudgedClaim, ...]:
    """Return the claims; a proved claim is unproved if, with the signs of its roots, a value is certainly not zero.

    In the field of the proof a root has no sign, and a rounded value hides a difference below 1e-6. The values are
    computed with more digits at the states where exact values were not zero, and at some of `rare`: states where
    conditions have rare answers, each {random number: its value}.
    """
    # at most `_PRECISE_STATES` of them, spread over all conditions: numbers of 60 digits are slow
    chosen = rare[:: 1 + len(rare) // _PRECISE_STATES]
    judged = []
    for claim in claims:
        certain_error = 0.0
        if claim.status == "proved" and claim.roots:
            certain_error = certainly_not_zero(claim.nodes, [*claim.doubtful_states, *chosen])
        if certain_error:
            reason = (
                f"with the signs of its roots, a value is {certain_error:.3g} at a state within reach: a difference "
                "below 1e-6"
            )
            claim = replace(claim, status="unproved", reason=reason, nodes=())
        judged.append(claim)
    return tuple(judged)


def with_conditions(proof: Proof, report: BranchReport) -> Proof:
    """Return the proof with the claims that all conditions were judged, and that there is a value within reach."""
    claims = list(proof.claims)
    if report.open:
        reason = (
            f"{len(report.open)} of {report.count} conditions have one answer at all drawn states, a search found "
            f"no state with the other, and intervals in {MOST_BOXES} boxes are too wide to exclude it: "
            f"{_some_of(report.open)}"
        )
        claims.append(unclaimed("conditions", "all answers of the conditions were judged", reason))
    if report.silent:
        sentence = "no result without a claim has other values at few poses"
        reason = (
            f"{len(report.silent)} conditions have an answer that few or none of the drawn states have, and only "
            f"change results of which nothing is claimed: {_some_of(report.silent)}"
        )
        claims.append(unclaimed("results without a claim", sentence, reason))
    refused_claim = None
    if proof.refused_states is not None:
        refused_claim = proof.refused_states.claim()
    if refused_claim is not None:
        claims.append(refused_claim)
    elif report.without_value:
        sentence = "the equations have a value at each pose within reach"
        state = state_text(report.without_value)
        reason = f"they have neither a value nor a negative margin at {state}: the mechanism may reach it, or may not"
        claims.append(unclaimed("values", sentence, reason))
    return replace(proof, claims=tuple(claims), branches=report)


def _some_of(conditions: Sequence[str]) -> str:
    """Return the first of some conditions as text, and how many more there are."""
    text = ", ".join(conditions[:_NAMED_CONDITIONS])
    if len(conditions) > _NAMED_CONDITIONS:
        text += f" and {len(conditions) - _NAMED_CONDITIONS} more, each in the JSON of the result"
    return text
