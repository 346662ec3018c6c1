"""The reasons why claims are not proved."""

from __future__ import annotations

from dataclasses import replace

from twin.proof.claim_evidence import ClaimEvidence
from twin.proof.draws import STEPS

FEW = ClaimEvidence(
    states_within_reach=40,
    drawn_states=40,
    exact_states=20,
    exact_zeros=0,
    undefined_states=0,
    largest=0.0,
    degree=8,
    root_count=2,
    misses_zeros=False,
)
"""What is known of a claim with roots, if no exact value is zero."""


def test_a_claim_with_few_zeros_is_not_said_to_have_none():
    assert FEW.verdict([])[0] == "unproved"
    assert FEW.verdict([])[1].startswith("the exact values are not zero")
    few_zeros = replace(FEW, exact_zeros=7)
    assert few_zeros.verdict([])[0] == "unproved"
    assert few_zeros.verdict([])[1].startswith("only 7 of 20 exact values are zero")


def test_texts_state_the_bounds():
    assert "below 1e-6, or" in FEW.verdict([])[1]
    assert "not below 1e-12;" in replace(FEW, exact_zeros=8, degree=STEPS // 20).verdict([])[1]
