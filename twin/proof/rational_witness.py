"""A pose in fractions at which a claim is wrong: everybody can repeat it by hand, or with exact arithmetic."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping
from decimal import Decimal
from fractions import Fraction

from twin.proof.claim_evidence import ROUNDING
from twin.proof.claims import JudgedClaim
from twin.proof.draws import RandomRange
from twin.proof.precise import StateOfFractions, numbers_at

_DENOMINATORS = (10, 100, 1000, 10_000, 1_000_000)
"""Largest denominators that are tried, of lengths in m and of tangents of half angles."""


def rational_witness(
    claim: JudgedClaim, ranges: Mapping[str, RandomRange], parameters: Collection[str] = ()
) -> dict[str, str]:
    """Return a state of fractions near the witness of a refuted claim, where it is wrong too; empty if none is found.

    An angle is given by the tangent of its half, as "2 atan(1/8)"; then its cosine and sine are fractions as well. The
    claim's number is evaluated there with 60 digits and a bound of its error; all numbers are in their ranges, and
    no margin of the equations can be negative.

    Args:
        claim: a refuted claim with the operations of its numbers; without them, the result is empty.
        ranges: {random number: its range}.
        parameters: numbers whose fractions are always the nearest ones.
    """
    if not claim.nodes or not ranges.keys() >= claim.witness.keys():
        return {}
    for state in _states(claim, ranges, parameters):
        if _is_inside(claim, state, ranges) and _is_wrong(claim, state):
            texts = {}
            for name, value in state.items():
                texts[name] = _text(value, ranges[name].is_angle)
            return texts
    return {}


def _is_inside(claim: JudgedClaim, state: StateOfFractions, ranges: Mapping[str, RandomRange]) -> bool:
    """Return whether all numbers of a state are in their ranges, and no margin of the equations can be negative."""
    for name, value in state.items():
        if not _in_range(value, claim.witness[name], ranges[name]):
            return False
    for margin in numbers_at(claim.reach, state):
        # Only a margin of at least its error bound is certain: a state that the loops cannot reach refutes nothing.
        if margin is None or margin.value < Decimal(margin.error):
            return False
    return True


def _is_wrong(claim: JudgedClaim, state: StateOfFractions) -> bool:
    """Return whether a number that must be zero certainly is not; not if one of them is undefined at the state."""
    is_wrong = False
    for number in numbers_at(claim.nodes, state):
        if number is None:
            return False
        is_wrong |= number.size > ROUNDING + number.error
    return is_wrong


def _states(
    claim: JudgedClaim, ranges: Mapping[str, RandomRange], parameters: Collection[str]
) -> Iterator[StateOfFractions]:
    """Yield states of fractions near the witness, the simplest ones first."""
    for denominator in _DENOMINATORS:
        state = {}
        for name, value in claim.witness.items():
            number = value
            if ranges[name].is_angle:
                # Half of the remainder is within a quarter turn, where each tangent belongs to one angle only.
                number = math.tan(math.remainder(value, math.tau) / 2)
            largest = denominator
            if name in parameters:
                largest = _DENOMINATORS[-1]
            state[name] = Fraction(number).limit_denominator(largest)
        yield state


def _in_range(value: Fraction, witness_value: float, limits: RandomRange) -> bool:
    """Return whether a length, or the angle next to `witness_value` with this tangent of its half, is in its range."""
    if not limits.is_angle:
        return limits.low <= value <= limits.high
    # Of the angles with this tangent, one turn apart, that next to the witness counts: a range may exceed a half
    # turn.
    difference = math.remainder(2 * math.atan(value) - witness_value, math.tau)
    return limits.low <= witness_value + difference <= limits.high


def _text(value: Fraction, is_angle: bool) -> str:
    """Return a length, or an angle by the tangent of its half, as text."""
    if is_angle:
        return f"2 atan({value})"
    return f"{value} m"
