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
from twin.proof.values import ExactValue, RootMark, Truths

Status = Literal["proved", "refuted", "unproved"]

ROUNDING = 1e-6
"""Largest real value in m that can be a rounding error: near a singularity, an error of 1e-16 becomes its root."""

ENOUGH = 8
"""Number of states with an exact zero that a proof needs."""


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
        luckless: whether the claim is unproved because few states have all roots in the field.
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
    luckless: bool = False
    roots: frozenset[RootMark] = frozenset()
    different: bool = False
    undefined: int = 0
    doubtful: tuple[Mapping[str, float], ...] = ()
    fractions: Mapping[str, str] = field(default_factory=dict)

    @property
    def share(self) -> float:
        """Share of the exact values that are zero; it is not all of them if roots have other signs."""
        return self.zeros / self.known if self.known else 0.0


def judged(
    name: str,
    sentence: str,
    numbers: Iterable[ExactValue],
    inside: Truths,
    state: Mapping[str, Array],
    reasons: Sequence[str],
    drawn: int,
    sides: Sequence[Truths] = (),
    share: float | None = None,
) -> JudgedClaim:
    """Return the verdict on a claim.

    Args:
        name: identifier.
        sentence: what is claimed.
        numbers: the numbers that must be zero.
        inside: the states (k,) within reach.
        state: {name of a random number: its real values (k,)}.
        reasons: texts of what has no exact form, for a claim that is not proved.
        drawn: number of states that were drawn; those without roots may have been left out.
        sides: the states (k,) with each answer of each condition: with roots, zeros must be among them as often.
        share: share of the exact values that are zero at other states, if it is known; None: that at these.
    """
    found = _together(numbers, inside)
    known, zero, largest, roots = found.known, found.zero, found.largest, found.roots
    zeros = int((known & zero).sum())
    exact = int(known.sum())
    largest[~inside] = 0
    undefined = int(np.isnan(largest).sum())
    largest[np.isnan(largest)] = 0
    worst = int(largest.argmax())
    missed = bool(roots) and _missed(known & zero, known, sides, share)
    unclear = bool(roots) and bool(largest[worst] > _ROUNDING_OF_ROOTS)
    log_odds = _log_odds(zeros, drawn, found.degree)
    status: Status = "unproved"
    witness: dict[str, float] = {}
    reason = ""
    if not inside.any():
        reason = "no drawn state is within reach"
    elif largest[worst] > ROUNDING:
        status = "refuted"
        witness = _at(state, worst)
    elif undefined:
        reason = f"a value is undefined, or has no real form, at {undefined} of {int(inside.sum())} states within reach"
    elif not roots and zeros < exact:
        reason = (
            f"{exact - zeros} of {exact} exact values are not zero: a difference below 1e-6, at some states at least"
        )
    elif unclear:
        reason = f"a value is {largest[worst]:.1g}: rounding, or roots with other signs; the exact values do not tell"
    elif missed:
        reason = "the exact values are not zero where a condition has one of its answers: a difference below 1e-6"
    elif zeros >= ENOUGH and log_odds < _SURE:
        status = "proved"
    else:
        reason = _shortage(found, zeros, int(inside.sum()), drawn, log_odds, reasons)
    kept: tuple[ProgramStep, ...] = ()
    if status != "unproved" and None not in found.nodes:
        kept = tuple(node for node in found.nodes if node is not None)
    open_claim = status == "unproved" and bool(inside.any()) and not undefined
    # where many exact values are known and none is zero, luck is no reason
    few = zeros < ENOUGH or _SURE <= log_odds < 0
    luckless = open_claim and bool(roots) and few and (zeros > 0 or exact < _MANY)
    different = open_claim and (missed or unclear if roots else zeros < exact)
    doubtful = ()
    if roots and status == "proved":
        doubtful = tuple(_at(state, int(place)) for place in np.flatnonzero(known & ~zero)[:_DOUBTFUL])
    numbers_of = (zeros, exact, log_odds, float(largest[worst]), witness)
    verdict = (name, sentence, status, *numbers_of, reason, *found.error, kept)
    more = {"luckless": luckless, "different": different, "undefined": undefined}
    return JudgedClaim(*verdict, roots=roots, doubtful=doubtful, **more)


def _shortage(found: _Together, zeros: int, inside: int, drawn: int, log_odds: float, reasons: Sequence[str]) -> str:
    """Return why too few exact values are zero for a proof, of those that are known at some states within reach."""
    exact = int(found.known.sum())
    if zeros >= ENOUGH and log_odds < 0:
        return "the odds of chance are not below 1e-12; draw more states"
    if zeros >= ENOUGH:
        chance = min(1.0, found.degree / STEPS)
        return (
            f"{zeros} of {exact} exact values are zero, but the odds of chance have no bound: with {len(found.roots)} "
            f"roots, each of which doubles it, the probability of a zero by chance is only known to be below "
            f"{chance:.2g}, and all roots exist at {exact} of {drawn} drawn states"
        )
    if not exact and reasons:
        return "no exact form: " + ", ".join(reasons)
    if exact < ENOUGH:
        return f"only {exact} of {inside} states have roots in the field; draw more states"
    return "the exact values are not zero: a difference below 1e-6, or roots with other signs"


def _at(state: Mapping[str, Array], place: int) -> dict[str, float]:
    """Return the real values of the random numbers at a state."""
    return {name: float(values[place]) for name, values in state.items()}


@dataclass(frozen=True)
class _Together:
    """The numbers of a claim: where all are known and zero, the largest of them, and what they have in common.

    `error` is the shortest polynomial that is not zero, and its number of terms; ("", 0) if there is none.
    """

    known: Truths
    zero: Truths
    largest: Array
    degree: int
    roots: frozenset[RootMark]
    error: tuple[str, int]
    nodes: list[ProgramStep | None]


def _together(numbers: Iterable[ExactValue], inside: Truths) -> _Together:
    """Return what the numbers of a claim are at all states."""
    known = inside.copy()
    zero = np.ones(len(inside), bool)
    largest = np.zeros(len(inside))
    degree = 1
    roots: frozenset[RootMark] = frozenset()
    errors = []
    nodes = []
    for number in numbers:
        nodes.append(number.node)
        # a difference of a parameter and a length of the CAD is a polynomial that is zero at the published value; the
        # few states of formulas need not be within reach
        wrong = bool((np.abs(number.real) > ROUNDING).any())
        if number.form and wrong:
            errors.append((str(number.form), len(number.form.terms)))
        known &= number.known
        zero &= number.residue == 0
        largest = np.maximum(largest, np.abs(number.real))
        degree = max(degree, number.degree.zeros)
        roots |= number.degree.roots
    error = min(errors, key=lambda text: len(text[0]), default=("", 0))
    return _Together(known, zero, largest, degree, roots, error, nodes)


def _missed(zero: Truths, known: Truths, sides: Sequence[Truths], share: float | None) -> bool:
    """Return whether no zeros are on one side of a condition, although chance would have put one there."""
    if share is None:
        if not zero.any():
            return False
        share = float(zero.sum() / known.sum())
    for side in (known, *sides):
        there = int((known & side).sum())
        if not (zero & side).any() and (1 - share) ** there < _CHANCE:
            return True
    return False


_SURE = -12.0
"""Largest decimal logarithm of the odds of chance with which a claim is proved."""

_ROUNDING_OF_ROOTS = 1e-9
"""The same as `ROUNDING`, for a claim with roots: a wrong sign may be as small as that."""

_DOUBTFUL = 16
"""Maximum number of states that are kept to look at the signs of roots with more digits."""

_MANY = 64
"""Number of exact values of which one would be zero by chance if a claim is true, but for roots with other signs."""

_CHANCE = 1e-6
"""Largest probability that roots with other signs are the reason why no zero is on one side of a condition."""


def unclaimed(name: str, sentence: str, reason: str) -> JudgedClaim:
    """Return a claim that nothing decides."""
    return JudgedClaim(name, sentence, "unproved", 0, 0, 0.0, 0.0, {}, reason)


def _log_odds(zeros: int, states: int, degree: int) -> float:
    """Return the decimal logarithm of a bound for the probability of this number of zeros by chance; 0: no bound.

    A number that is not identically zero is zero at a random state with a probability of at most p = degree / STEPS;
    with `zeros` of `states` independent ones, that of at least as many is at most (states over zeros) p^zeros.
    """
    if not zeros or degree >= STEPS:
        return 0.0
    choices = math.lgamma(states + 1) - math.lgamma(zeros + 1) - math.lgamma(states - zeros + 1)
    return min(0.0, choices / math.log(10) + zeros * math.log10(degree / STEPS))
