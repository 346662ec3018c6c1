"""Mutants of the equations: no wrong one is proved; rewritten equations are; errors in small boxes do not hide.

TWIN_PROOF_MUTANTS mutants of each kind are drawn for each robot, with the seed TWIN_PROOF_SEED.
"""

from __future__ import annotations

import os

import numpy as np
import pytest

import twin
from made import proof_mutants as mutants
from twin.core.errors import TwinError
from twin.formula import flow
from twin.proof.prove import prove

COUNT = int(os.environ.get("TWIN_PROOF_MUTANTS", "40"))
SEED = int(os.environ.get("TWIN_PROOF_SEED", "0"))
FIRST = 256
"""States at which most wrong equations are refuted already."""


class Judge:
    """A robot, its claims, and the verdicts on its mutants."""

    def __init__(self, name):
        self.robot = twin.load(name)
        self.variants = flow.choose(self.robot.formula, None)
        self.right = self.proof(4096)
        drawn = self.right.drawn
        self.ranges = {key: limits for key, limits in self.right.ranges.items() if key not in drawn}
        self.oracle = mutants.Oracle(self.robot, self.ranges)
        assert self.oracle.wrong() < 1e-9

    def proof(self, states):
        return prove(self.robot.formula, self.variants, self.robot.mechanism, states)

    def verdict(self, function, text):
        """Return "proved", "refuted", "unproved" or "refused", and the error that doubles see."""
        with mutants.with_text(function, text):
            try:
                proof = self.proof(FIRST)
                if not proof.count("refuted"):
                    proof = self.proof(4096)
                error = self.oracle.wrong()
            except (TwinError, ValueError):
                return "refused", 0.0
        if proof.count("refuted"):
            return "refuted", error
        return "unproved" if proof.count("unproved") > self.right.count("unproved") else "proved", error

    def some(self, make, generator):
        """Yield (what, verdict, error) of some mutants."""
        found = []
        for function in mutants.functions(self.robot.formula):
            found += [(function, what, text) for what, text in make(function)]
        for i in generator.permutation(len(found))[:COUNT]:
            function, what, text = found[i]
            yield f"{function.__name__}: {what}", *self.verdict(function, text)


@pytest.fixture(scope="module", params=["sils", "pa10", "hibou", "davinci_ecm"])
def judge(request):
    return Judge(request.param)


@pytest.mark.nightly
def test_no_wrong_mutant_is_proved(judge):
    generator = np.random.default_rng([SEED, 1])
    verdicts = list(judge.some(mutants.slips, generator))
    assert not [found for found in verdicts if found[1] == "proved" and found[2] > 1e-9]
    wrong = [verdict for _, verdict, error in verdicts if error > 1e-9]
    assert wrong.count("refuted") >= 5


@pytest.mark.nightly
def test_rewritten_equations_are_proved(judge):
    verdicts = list(judge.some(mutants.rewrites, np.random.default_rng([SEED, 2])))
    judged = [verdict for _, verdict, error in verdicts if verdict != "refused" and error < 1e-9]
    assert judged.count("proved") >= 0.95 * len(judged)


@pytest.mark.nightly
def test_an_error_in_a_small_box_does_not_hide(judge):
    """It is refuted, or a condition is named, or only a margin of the reach has it, of which nothing is claimed."""
    generator = np.random.default_rng([SEED, 3])
    verdicts = list(judge.some(lambda function: mutants.hidden(function, generator, judge.ranges), generator))
    hidden = [what for what, verdict, _ in verdicts if verdict == "proved"]
    assert not [what for what in hidden if not what.startswith(("margins:", "type2:", "type1:"))]
