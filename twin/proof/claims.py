"""Claims that follow from the structure of a mechanism, and their judgement at random states.

A claim is a list of numbers that must all be zero: the tool is where the mechanism puts it, a ball is in its socket, a
point of the equations is the point of a body, forward equations undo the inverse. Claims are proved in the prime field;
real values find what is wrong, and the signs of roots that the field leaves open.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from twin.core.spatial import Array
from twin.proof.claim_evidence import ROUNDING, ClaimEvidence, Status
from twin.proof.degree import RootSignature, Truths
from twin.proof.program import ProgramStep
from twin.proof.values import ExactValue

_MOST_DOUBTFUL = 16
"""Maximum number of states that are kept to look at the signs of roots with more digits."""

_CHANCE = 1e-6
"""Largest probability that roots with other signs are the reason why no zero is on one side of a condition."""


@dataclass(frozen=True)
class JudgedClaim:
    """A claim and its verdict.

    Attributes:
        name: identifier, as "inverse: joint s1".
        sentence: what is claimed.
        status: the verdict.
        exact_zeros: number of states where all numbers are exactly zero.
        exact_states: number of states where all numbers have an exact value.
        log10_odds: decimal logarithm of a bound for the probability that a wrong claim has these zeros by chance; 0: no
            bound.
        largest: largest real value in m; a difference of directions counts by the distance at half a metre.
        witness: {name of a random number: its real value} at the state with the largest value, if the claim is refuted.
        fractions: {name of a random number: a fraction as text} where the claim is wrong too; empty if not refuted, or
            if no such state is found.
        reason: why a claim is not proved; "" if it is.
        error: what is not zero, as a polynomial of cosines, sines and lengths in m; "" if the claim is not refuted, or
            if it is none.
        error_terms: number of terms of this polynomial.
        nodes: the operations of the numbers that must be zero, if the claim is proved or refuted, and all are known.
        reach: those of the margins that are not negative where it is claimed.
        roots: the roots in its numbers.
        may_differ: whether the claim is unproved because exact values are not zero, or may not be.
        needs_more_states: whether the claim is unproved because few states have all roots in the field.
        undefined_states: number of states within reach where a value is undefined.
        doubtful_states: {name of a random number: its real value} at states where exact values are not zero, of a claim
            with roots: a root has another sign in the field, or the claim is wrong there.
    """

    name: str
    sentence: str
    status: Status
    exact_zeros: int
    exact_states: int
    log10_odds: float
    largest: float
    witness: Mapping[str, float]
    reason: str
    error: str = ""
    error_terms: int = 0
    nodes: tuple[ProgramStep, ...] = ()
    reach: tuple[ProgramStep, ...] = ()
    needs_more_states: bool = False
    roots: frozenset[RootSignature] = frozenset()
    may_differ: bool = False
    undefined_states: int = 0
    doubtful_states: tuple[Mapping[str, float], ...] = ()
    fractions: Mapping[str, str] = field(default_factory=dict)

    @property
    def zero_share(self) -> float:
        """Share of the exact values that are zero; it is not all of them if roots have other signs."""
        if not self.exact_states:
            return 0.0
        return self.exact_zeros / self.exact_states


def judged(
    name: str,
    sentence: str,
    numbers: Iterable[ExactValue],
    inside: Truths,
    state: Mapping[str, Array],
    reasons: Sequence[str],
    drawn_states: int,
    sides: Sequence[Truths] = (),
    other_zero_share: float | None = None,
) -> JudgedClaim:
    """Return the verdict on a claim.

    Args:
        name: identifier.
        sentence: what is claimed.
        numbers: the numbers that must be zero.
        inside: the states (k,) within reach.
        state: {name of a random number: its real values (k,)}.
        reasons: texts of what has no exact form, for a claim that is not proved.
        drawn_states: number of states that were drawn; those without roots may have been left out.
        sides: the states (k,) with each answer of each condition: with roots, zeros must be among them as often.
        other_zero_share: share of the exact values that are zero at other states of the claim, for the chance of a
            zero at these; None: the share at these states.
    """
    at_states = _ClaimNumbers.of(numbers, inside)
    sizes = at_states.largest.copy()
    # nothing is claimed where the equations say that the mechanism is out of reach
    sizes[~inside] = 0
    undefined_states = int(np.isnan(sizes).sum())
    sizes[np.isnan(sizes)] = 0
    worst = int(sizes.argmax())
    is_zero = at_states.known & at_states.zero
    has_roots = bool(at_states.roots)
    evidence = ClaimEvidence(
        states_within_reach=int(inside.sum()),
        drawn_states=drawn_states,
        exact_states=int(at_states.known.sum()),
        exact_zeros=int(is_zero.sum()),
        undefined_states=undefined_states,
        largest=float(sizes[worst]),
        degree=at_states.degree,
        root_count=len(at_states.roots),
        # with roots, an exact value may be not zero only because a root has its other sign in the field
        misses_zeros=has_roots and _misses_zeros(is_zero, at_states.known, sides, other_zero_share),
    )
    status, reason = evidence.verdict(reasons)
    witness: dict[str, float] = {}
    if status == "refuted":
        witness = _real_state(state, worst)
    nodes: tuple[ProgramStep, ...] = ()
    if status != "unproved":
        nodes = at_states.all_nodes()
    doubtful_states: list[dict[str, float]] = []
    if has_roots and status == "proved":
        not_zero = np.flatnonzero(at_states.known & ~at_states.zero)
        for place in not_zero[:_MOST_DOUBTFUL]:
            doubtful_states.append(_real_state(state, int(place)))
    is_open = status == "unproved" and evidence.states_within_reach > 0 and not undefined_states
    error, error_terms = at_states.error
    return JudgedClaim(
        name=name,
        sentence=sentence,
        status=status,
        exact_zeros=evidence.exact_zeros,
        exact_states=evidence.exact_states,
        log10_odds=evidence.log10_odds,
        largest=evidence.largest,
        witness=witness,
        reason=reason,
        error=error,
        error_terms=error_terms,
        nodes=nodes,
        needs_more_states=is_open and evidence.needs_more_states,
        roots=at_states.roots,
        may_differ=is_open and evidence.may_differ,
        undefined_states=undefined_states,
        doubtful_states=tuple(doubtful_states),
    )


def _real_state(state: Mapping[str, Array], place: int) -> dict[str, float]:
    """Return {name of a random number: its real value} at the state with an index."""
    return {name: float(values[place]) for name, values in state.items()}


@dataclass(frozen=True)
class _ClaimNumbers:
    """The numbers of a claim at k states.

    Attributes:
        known: (k,) whether all of them have an exact value, within reach.
        zero: (k,) whether all exact values are zero.
        largest: (k,) the largest real value.
        degree: bound of the degree of each of them, as `Degree.zero_bound`.
        roots: the roots in them.
        error: the shortest polynomial that is not zero, and its number of terms; ("", 0) if there is none.
        nodes: the operations of each; None if they have no exact form.
    """

    known: Truths
    zero: Truths
    largest: Array
    degree: int
    roots: frozenset[RootSignature]
    error: tuple[str, int]
    nodes: list[ProgramStep | None]

    @staticmethod
    def of(numbers: Iterable[ExactValue], inside: Truths) -> _ClaimNumbers:
        """Return what some numbers are at the states (k,) that are `inside`."""
        known = inside.copy()
        zero = np.ones(len(inside), bool)
        largest = np.zeros(len(inside))
        degree = 1
        roots: frozenset[RootSignature] = frozenset()
        errors = []
        nodes = []
        for number in numbers:
            nodes.append(number.node)
            # a difference of a parameter and a length of the CAD is a polynomial that is zero at the published value;
            # the few states of formulas need not be within reach
            is_wrong = bool((np.abs(number.real) > ROUNDING).any())
            if number.form and is_wrong:
                errors.append((str(number.form), len(number.form.terms)))
            known &= number.known
            zero &= number.residue == 0
            largest = np.maximum(largest, np.abs(number.real))
            degree = max(degree, number.degree.zero_bound)
            roots |= number.degree.roots
        error = min(errors, key=lambda text_and_terms: len(text_and_terms[0]), default=("", 0))
        return _ClaimNumbers(known, zero, largest, degree, roots, error, nodes)

    def all_nodes(self) -> tuple[ProgramStep, ...]:
        """Return the operations of all numbers; none if those of one are unknown."""
        nodes = []
        for node in self.nodes:
            if node is None:
                return ()
            nodes.append(node)
        return tuple(nodes)


def _misses_zeros(zero: Truths, known: Truths, sides: Sequence[Truths], other_zero_share: float | None) -> bool:
    """Return whether no zeros are on one side of a condition, although chance would have put one there.

    Args:
        zero: the states (k,) where the exact values are zero.
        known: the states (k,) with exact values.
        sides: the states (k,) with each answer of each condition.
        other_zero_share: share of exact values that are zero by the signs of roots, as found at other states; None:
            the share of `zero` in `known`.
    """
    zero_share = other_zero_share
    if zero_share is None:
        if not zero.any():
            return False
        zero_share = float(zero.sum() / known.sum())
    for side in (known, *sides):
        count = int((known & side).sum())
        chance = (1 - zero_share) ** count  # of no zero among so many states
        if not (zero & side).any() and chance < _CHANCE:
            return True
    return False


def unclaimed(name: str, sentence: str, reason: str) -> JudgedClaim:
    """Return a claim that nothing decides."""
    return JudgedClaim(
        name=name,
        sentence=sentence,
        status="unproved",
        exact_zeros=0,
        exact_states=0,
        log10_odds=0.0,
        largest=0.0,
        witness={},
        reason=reason,
    )
