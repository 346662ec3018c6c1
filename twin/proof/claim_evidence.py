"""What exact and real values at random states say for a claim and against it, and the verdict that follows.

A claim is proved by exact zeros: at `ENOUGH` states at least, and so many that the odds of zeros by chance are below
1e-12. It is refuted by a real value that is no rounding error. Where roots are in its numbers, an exact value that is
not zero says nothing by itself, because a root may have its other sign in the prime field. Everything else is left
unproved, with the reason.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from twin.proof.draws import STEPS

Status = Literal["proved", "refuted", "unproved"]

ROUNDING = 1e-6
"""Largest real value in m that can be a rounding error: near a singularity, an error of 1e-16 becomes its root."""

_ROUNDING_TEXT = f"{ROUNDING:.0e}".replace("e-0", "e-")

_ROUNDING_WITH_ROOTS = 1e-9
"""The same of a claim with roots: a wrong sign may be as small as that."""

ENOUGH = 8
"""Number of states with an exact zero that a proof needs."""

_LARGEST_LOG10_ODDS = -12.0
"""Largest decimal logarithm of the odds of chance with which a claim is proved."""

_STATES_PER_EXPECTED_ZERO = 64
"""Number of exact values of which one would be zero by chance if a claim is true, but for roots with other signs."""


@dataclass(frozen=True)
class ClaimEvidence:
    """What the numbers of a claim say for it and against it.

    Attributes:
        states_within_reach: number of states within reach.
        drawn_states: number of states that were drawn.
        exact_states: number of states where all numbers have an exact value.
        exact_zeros: number of those where all of them are zero.
        undefined_states: number of states within reach where a value is undefined.
        largest: the largest real value.
        degree: bound of the degree of each number, as `Degree.zero_bound`.
        root_count: number of roots in the numbers.
        misses_zeros: whether no zeros are on one side of a condition, although chance would have put one there.
    """

    states_within_reach: int
    drawn_states: int
    exact_states: int
    exact_zeros: int
    undefined_states: int
    largest: float
    degree: int
    root_count: int
    misses_zeros: bool

    @property
    def log10_odds(self) -> float:
        """Decimal logarithm of a bound for the probability of so many zeros by chance; 0: no bound."""
        return log10_of_odds(self.exact_zeros, self.drawn_states, self.degree)

    @property
    def is_unclear(self) -> bool:
        """Whether a real value is too large for rounding, while roots leave the exact values open."""
        return self.root_count > 0 and self.largest > _ROUNDING_WITH_ROOTS

    @property
    def may_differ(self) -> bool:
        """Whether exact values are not zero, or may not be."""
        if self.root_count:
            return self.misses_zeros or self.is_unclear
        return self.exact_zeros < self.exact_states

    @property
    def needs_more_states(self) -> bool:
        """Whether few states have all roots in the field, so that others may decide."""
        has_few = self.exact_zeros < ENOUGH or _LARGEST_LOG10_ODDS <= self.log10_odds < 0
        # where many exact values are known and none is zero, luck is no reason
        may_be_luck = self.exact_zeros > 0 or self.exact_states < _STATES_PER_EXPECTED_ZERO
        return self.root_count > 0 and has_few and may_be_luck

    def verdict(self, reasons: Sequence[str]) -> tuple[Status, str]:
        """Return the status of the claim, and why it is not proved.

        `reasons` are texts of what has no exact form.
        """
        if not self.states_within_reach:
            return "unproved", "no drawn state is within reach"
        if self.largest > ROUNDING:
            return "refuted", ""
        if self.undefined_states:
            count = f"{self.undefined_states} of {self.states_within_reach} states within reach"
            return "unproved", f"a value is undefined, or has no real form, at {count}"
        if not self.root_count and self.exact_zeros < self.exact_states:
            count = f"{self.exact_states - self.exact_zeros} of {self.exact_states} exact values"
            reason = f"{count} are not zero: a difference below {_ROUNDING_TEXT}, at some states at least"
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
        if self.exact_zeros >= ENOUGH and self.log10_odds < _LARGEST_LOG10_ODDS:
            return "proved", ""
        return "unproved", self._shortage(reasons)

    def _shortage(self, reasons: Sequence[str]) -> str:
        """Return why too few exact values are zero for a proof, of those that are known at some states within reach."""
        if self.exact_zeros >= ENOUGH and self.log10_odds < 0:
            return f"the odds of chance are not below 1e{_LARGEST_LOG10_ODDS:.0f}; draw more states"
        if self.exact_zeros >= ENOUGH:
            chance = min(1.0, self.degree / STEPS)
            zeros = f"{self.exact_zeros} of {self.exact_states} exact values are zero"
            return (
                f"{zeros}, but the odds of chance have no bound: with {self.root_count} roots, each of which doubles "
                f"it, the probability of a zero by chance is only known to be below {chance:.2g}, and all roots exist "
                f"at {self.exact_states} of {self.drawn_states} drawn states"
            )
        if not self.exact_states and reasons:
            return "no exact form: " + ", ".join(reasons)
        if self.exact_states < ENOUGH:
            count = f"{self.exact_states} of {self.states_within_reach} states"
            return f"only {count} have roots in the field; draw more states"
        subject = "the exact values are not zero"
        if self.exact_zeros:
            subject = f"only {self.exact_zeros} of {self.exact_states} exact values are zero"
        return f"{subject}: a difference below {_ROUNDING_TEXT}, or roots with other signs"


def log10_of_odds(zeros: int, states: int, degree: int) -> float:
    """Return the decimal logarithm of a bound for the probability of this number of zeros by chance; 0: no bound.

    A number that is not identically zero is zero at a random state with a probability of at most p = degree / STEPS;
    with `zeros` of `states` independent ones, that of at least as many is at most (states over zeros) p^zeros.
    """
    if not zeros or degree >= STEPS:
        return 0.0
    choices = math.lgamma(states + 1) - math.lgamma(zeros + 1) - math.lgamma(states - zeros + 1)
    return min(0.0, choices / math.log(10) + zeros * math.log10(degree / STEPS))
