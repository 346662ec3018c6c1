"""Claims that follow from the structure of a mechanism, and their judgement at random states.

A claim is a list of numbers that must all be zero: the tool is where the mechanism puts it, a ball is in its socket, a
point of the equations is the point of a body, forward equations undo the inverse. Claims are proved in the prime field;
real values find what is wrong, and the signs of roots that the field leaves open.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from twin.core.spatial import Array
from twin.proof.draws import STEPS
from twin.proof.program import ProgramStep
from twin.proof.values import ExactValue, RootSignature, Truths

Status = Literal["proved", "refuted", "unproved"]

ROUNDING = 1e-6
"""Largest real value in m that can be a rounding error: near a singularity, an error of 1e-16 becomes its root."""

_ROUNDING_TEXT = f"{ROUNDING:.0e}".replace("e-0", "e-")

ENOUGH = 8
"""Number of states with an exact zero that a proof needs."""

_LARGEST_LOG_ODDS = -12.0
"""Largest decimal logarithm of the odds of chance with which a claim is proved."""

_ROUNDING_OF_ROOTS = 1e-9
"""The same as `ROUNDING`, for a claim with roots: a wrong sign may be as small as that."""

_MOST_DOUBTFUL = 16
"""Maximum number of states that are kept to look at the signs of roots with more digits."""

_EXPECTED_WITH_ZERO = 64
"""Number of exact values of which one would be zero by chance if a claim is true, but for roots with other signs."""

_CHANCE = 1e-6
"""Largest probability that roots with other signs are the reason why no zero is on one side of a condition."""


@dataclass(frozen=True)
class JudgedClaim:
    """A claim and its verdict.

    Attributes:
        name: identifier, as "inverse: joint s1".
        sentence: what is claimed.
        status: the verdict.
        zeros: number of states where all numbers are exactly zero.
        known: number of states where all numbers have an exact value.
        log_odds: decimal logarithm of a bound for the probability that a wrong claim has these zeros by chance; 0: no
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
        different: whether the claim is unproved because exact values are not zero, or may not be.
        needs_more_states: whether the claim is unproved because few states have all roots in the field.
        undefined: number of states within reach where a value is undefined.
        doubtful: {name of a random number: its real value} at states where exact values are not zero, of a claim with
            roots: a root has another sign in the field, or the claim is wrong there.
    """

    name: str
    sentence: str
    status: Status
    zeros: int
    known: int
    log_odds: float
    largest: float
    witness: Mapping[str, float]
    reason: str
    error: str = ""
    error_terms: int = 0
    nodes: tuple[ProgramStep, ...] = ()
    reach: tuple[ProgramStep, ...] = ()
    needs_more_states: bool = False
    roots: frozenset[RootSignature] = frozenset()
    different: bool = False
    undefined: int = 0
    doubtful: tuple[Mapping[str, float], ...] = ()
    fractions: Mapping[str, str] = field(default_factory=dict)

    @property
    def zero_share(self) -> float:
        """Share of the exact values that are zero; it is not all of them if roots have other signs."""
        if not self.known:
            return 0.0
        return self.zeros / self.known


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
    at_states = _Numbers.of(numbers, inside)
    sizes = at_states.largest.copy()
    # nothing is claimed where the equations say that the mechanism is out of reach
    sizes[~inside] = 0
    undefined = int(np.isnan(sizes).sum())
    sizes[np.isnan(sizes)] = 0
    worst = int(sizes.argmax())
    is_zero = at_states.known & at_states.zero
    has_roots = bool(at_states.roots)
    evidence = _Evidence(
        within=int(inside.sum()),
        drawn=drawn_states,
        exact=int(at_states.known.sum()),
        zeros=int(is_zero.sum()),
        undefined=undefined,
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
    doubtful: list[dict[str, float]] = []
    if has_roots and status == "proved":
        not_zero = np.flatnonzero(at_states.known & ~at_states.zero)
        for place in not_zero[:_MOST_DOUBTFUL]:
            doubtful.append(_real_state(state, int(place)))
    is_open = status == "unproved" and evidence.within > 0 and not undefined
    error, error_terms = at_states.error
    return JudgedClaim(
        name=name,
        sentence=sentence,
        status=status,
        zeros=evidence.zeros,
        known=evidence.exact,
        log_odds=evidence.log_odds,
        largest=evidence.largest,
        witness=witness,
        reason=reason,
        error=error,
        error_terms=error_terms,
        nodes=nodes,
        needs_more_states=is_open and evidence.needs_more_states,
        roots=at_states.roots,
        different=is_open and evidence.is_different,
        undefined=undefined,
        doubtful=tuple(doubtful),
    )


@dataclass(frozen=True)
class _Evidence:
    """What the numbers of a claim say for it and against it.

    Attributes:
        within: number of states within reach.
        drawn: number of states that were drawn.
        exact: number of states where all numbers have an exact value.
        zeros: number of those where all of them are zero.
        undefined: number of states within reach where a value is undefined.
        largest: the largest real value.
        degree: bound of the degree of each number, as `Degree.zeros`.
        root_count: number of roots in the numbers.
        misses_zeros: whether no zeros are on one side of a condition, although chance would have put one there.
    """

    within: int
    drawn: int
    exact: int
    zeros: int
    undefined: int
    largest: float
    degree: int
    root_count: int
    misses_zeros: bool

    @property
    def log_odds(self) -> float:
        """Decimal logarithm of a bound for the probability of so many zeros by chance; 0: no bound."""
        return _log_odds(self.zeros, self.drawn, self.degree)

    @property
    def is_unclear(self) -> bool:
        """Whether a real value is too large for rounding, while roots leave the exact values open."""
        return self.root_count > 0 and self.largest > _ROUNDING_OF_ROOTS

    @property
    def is_different(self) -> bool:
        """Whether exact values are not zero, or may not be."""
        if self.root_count:
            return self.misses_zeros or self.is_unclear
        return self.zeros < self.exact

    @property
    def needs_more_states(self) -> bool:
        """Whether few states have all roots in the field, so that others may decide."""
        has_few = self.zeros < ENOUGH or _LARGEST_LOG_ODDS <= self.log_odds < 0
        # where many exact values are known and none is zero, luck is no reason
        return self.root_count > 0 and has_few and (self.zeros > 0 or self.exact < _EXPECTED_WITH_ZERO)

    def verdict(self, reasons: Sequence[str]) -> tuple[Status, str]:
        """Return the status of the claim, and why it is not proved.

        `reasons` are texts of what has no exact form.
        """
        if not self.within:
            return "unproved", "no drawn state is within reach"
        if self.largest > ROUNDING:
            return "refuted", ""
        if self.undefined:
            reason = (
                f"a value is undefined, or has no real form, at {self.undefined} of {self.within} states within reach"
            )
            return "unproved", reason
        if not self.root_count and self.zeros < self.exact:
            reason = (
                f"{self.exact - self.zeros} of {self.exact} exact values are not zero: a difference below "
                f"{_ROUNDING_TEXT}, at some states at least"
            )
            return "unproved", reason
        if self.is_unclear:
            reason = f"a value is {self.largest:.1g}: rounding, or roots with other signs; the exact values do not tell"
            return "unproved", reason
        if self.misses_zeros:
            reason = (
                "the exact values are not zero where a condition has one of its answers: a difference below "
                f"{_ROUNDING_TEXT}"
            )
            return "unproved", reason
        if self.zeros >= ENOUGH and self.log_odds < _LARGEST_LOG_ODDS:
            return "proved", ""
        return "unproved", self._shortage(reasons)

    def _shortage(self, reasons: Sequence[str]) -> str:
        """Return why too few exact values are zero for a proof, of those that are known at some states within reach."""
        if self.zeros >= ENOUGH and self.log_odds < 0:
            return f"the odds of chance are not below 1e{_LARGEST_LOG_ODDS:.0f}; draw more states"
        if self.zeros >= ENOUGH:
            chance = min(1.0, self.degree / STEPS)
            return (
                f"{self.zeros} of {self.exact} exact values are zero, but the odds of chance have no bound: with "
                f"{self.root_count} roots, each of which doubles it, the probability of a zero by chance is only "
                f"known to be below {chance:.2g}, and all roots exist at {self.exact} of {self.drawn} drawn states"
            )
        if not self.exact and reasons:
            return "no exact form: " + ", ".join(reasons)
        if self.exact < ENOUGH:
            return f"only {self.exact} of {self.within} states have roots in the field; draw more states"
        subject = "the exact values are not zero"
        if self.zeros:
            subject = f"only {self.zeros} of {self.exact} exact values are zero"
        return f"{subject}: a difference below {_ROUNDING_TEXT}, or roots with other signs"


def _real_state(state: Mapping[str, Array], place: int) -> dict[str, float]:
    """Return {name of a random number: its real value} at the state with an index."""
    return {name: float(values[place]) for name, values in state.items()}


@dataclass(frozen=True)
class _Numbers:
    """The numbers of a claim at k states.

    Attributes:
        known: (k,) whether all of them have an exact value, within reach.
        zero: (k,) whether all exact values are zero.
        largest: (k,) the largest real value.
        degree: bound of the degree of each of them, as `Degree.zeros`.
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
    def of(numbers: Iterable[ExactValue], inside: Truths) -> _Numbers:
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
            degree = max(degree, number.degree.zeros)
            roots |= number.degree.roots
        error = min(errors, key=lambda text_and_terms: len(text_and_terms[0]), default=("", 0))
        return _Numbers(known, zero, largest, degree, roots, error, nodes)

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
        zeros=0,
        known=0,
        log_odds=0.0,
        largest=0.0,
        witness={},
        reason=reason,
    )


def _log_odds(zeros: int, states: int, degree: int) -> float:
    """Return the decimal logarithm of a bound for the probability of this number of zeros by chance; 0: no bound.

    A number that is not identically zero is zero at a random state with a probability of at most p = degree / STEPS;
    with `zeros` of `states` independent ones, that of at least as many is at most (states over zeros) p^zeros.
    """
    if not zeros or degree >= STEPS:
        return 0.0
    choices = math.lgamma(states + 1) - math.lgamma(zeros + 1) - math.lgamma(states - zeros + 1)
    return min(0.0, choices / math.log(10) + zeros * math.log10(degree / STEPS))
