"""Judge mutants of the equations of a robot by `twin prove`, in one process; see `proof_mutants` for their kinds.

    python tests/made/proof_campaign.py KIND COUNT SEED SECONDS FILE ROBOT...

writes a JSON object of each mutant as a line of FILE: of COUNT mutants of each robot, those that are judged within
SECONDS; mutants that are in FILE already are left out. KIND is slips, rewrites, hidden or guards.

A slip that is not refuted, and whose values doubles do not tell from the right ones, is no wrong mutant: it is "alike",
and not proved.
"""

from __future__ import annotations

import json
import sys
import time
import warnings
from pathlib import Path

import numpy as np

import twin
from made import proof_mutants as mutants
from twin.core.errors import TwinError
from twin.formula import variant_choice
from twin.proof.prove import Prover

MANY = 4096
"""Number of states at which a mutant is refuted that was not at the first ones."""

KINDS = ("slips", "rewrites", "hidden", "guards")
"""Kinds of mutants; the place of a kind is part of the seed of its random numbers."""

WRONG = 1e-9
"""Error in m or rad above which a mutant is wrong: the rounding of doubles is below it."""


class Judge:
    """A robot, its claims, and the verdicts on its mutants."""

    def __init__(self, name):
        """Prove the right equations."""
        robot = twin.load(name)
        self.formula = robot.formula
        self.variants = variant_choice.choose(robot.formula, None)
        self.prover = Prover(robot.formula, robot.mechanism)
        self.right = self.prover.proof(self.variants)
        assert not self.right.count("refuted")
        assert not self.prover.refuted(self.variants, MANY)
        self.proved = {claim.name for claim in self.right.claims if claim.status == "proved"}
        self.ranges = {
            key: limits for key, limits in self.right.ranges.items() if key not in self.right.arbitrary_parameters
        }
        self.oracle = mutants.Oracle(robot, self.ranges, self.right.uncovered_points)
        error, missing = self.oracle.wrong()
        assert error < WRONG
        assert not missing

    def verdict(self, function, text, alike=False):
        """Return "proved", "refuted", "unproved" or "refused", the error that doubles see, and missing values.

        A mutant is proved if each claim is that is proved of the right equations, and no other is open. If `alike`, one
        without an error is "alike", without a proof. One that is refuted at once has no error: doubles do not judge it.
        """
        with mutants.with_text(function, text):
            try:
                if self.prover.refuted(self.variants):
                    return "refuted", 0.0, 0
                error, missing = self.oracle.wrong()
                if alike and error <= WRONG and not missing:
                    return "alike", error, missing
                if self.prover.refuted(self.variants, MANY):
                    return "refuted", error, missing
                proof = self.prover.proof(self.variants)
            except (TwinError, ValueError, NotImplementedError):  # doubles meet what the prover refuses by name
                return "refused", 0.0, 0
        if proof.count("refuted"):
            return "refuted", error, missing
        proved = {claim.name for claim in proof.claims if claim.status == "proved"}
        same = proved >= self.proved and proof.count("unproved") <= self.right.count("unproved")
        return "proved" if same else "unproved", error, missing

    def drawn(self, kind, count, seed):
        """Return some mutants, in random order: (function, what, changed text)."""
        generator = np.random.default_rng([seed, KINDS.index(kind)])
        found = []
        for function in mutants.functions(self.formula):
            if kind in ("hidden", "guards"):
                made = getattr(mutants, kind)(function, generator, self.ranges)
            else:
                made = getattr(mutants, kind)(function)
            found += [(function, what, text) for what, text in made]
        return [found[i] for i in generator.permutation(len(found))[:count]]

    def some(self, kind, count, seed):
        """Yield (what, verdict, error, missing values) of some mutants."""
        for function, what, text in self.drawn(kind, count, seed):
            yield f"{function.__name__}: {what}", *self.verdict(function, text)


def main(kind, count, seed, seconds, file, *robots):
    """Judge mutants of robots and append what was found to a file."""
    warnings.simplefilter("ignore", RuntimeWarning)  # most mutants have no value somewhere
    end = time.monotonic() + float(seconds)
    path = Path(file)
    lines = path.read_text(encoding="utf-8").splitlines() if path.is_file() else []
    done = {(entry["robot"], entry["what"]) for entry in map(json.loads, lines)}
    with path.open("a", encoding="utf-8") as out:
        for robot in robots:
            if time.monotonic() > end:
                break
            judge = Judge(robot)
            for function, what, text in judge.drawn(kind, int(count), int(seed)):
                name = f"{function.__name__}: {what}"
                if (robot, name) in done:
                    continue
                if time.monotonic() > end:
                    break
                done.add((robot, name))
                verdict, error, missing = judge.verdict(function, text, alike=kind == "slips")
                entry = {"robot": robot, "kind": kind, "seed": int(seed), "what": name}
                out.write(json.dumps({**entry, "verdict": verdict, "error": error, "missing": missing}) + "\n")
            finished = sum(1 for place in done if place[0] == robot)
            print(f"{robot} {kind} seed {seed}: {finished} of {count} in the file", flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
