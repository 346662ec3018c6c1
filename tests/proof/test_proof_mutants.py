"""Mutants of the equations: no wrong one is proved; rewritten equations are; errors in small boxes do not hide.

TWIN_PROOF_MUTANTS mutants of each kind are drawn for each robot, with the seed TWIN_PROOF_SEED.
"""

from __future__ import annotations

import os
import re

import numpy as np
import pytest

import twin
from made import proof_campaign, proof_mutants
from made.proof_campaign import WRONG, Judge
from twin.kinematics.compile import compile_formula

COUNT = int(os.environ.get("TWIN_PROOF_MUTANTS", "40"))
SEED = int(os.environ.get("TWIN_PROOF_SEED", "0"))


@pytest.fixture(scope="module", params=["sils", "pa10", "hibou", "lapbot", "davinci_ecm"])
def judge(request):
    return Judge(request.param)


@pytest.mark.nightly
def test_no_wrong_mutant_is_proved(judge):
    verdicts = list(judge.some("slips", COUNT, SEED))
    assert not [found for found in verdicts if found[1] == "proved" and (found[2] > WRONG or found[3])]
    assert [verdict for _, verdict, _, _ in verdicts].count("refuted") >= 5


@pytest.mark.nightly
def test_rewritten_equations_are_proved(judge):
    verdicts = list(judge.some("rewrites", COUNT, SEED))
    judged = [verdict for _, verdict, _, _ in verdicts if verdict != "refused"]
    assert judged.count("proved") >= 0.95 * len(judged)


@pytest.mark.nightly
def test_an_error_in_a_small_box_does_not_hide(judge):
    """It is refuted, or a condition is named; so is one that only changes a margin, of which nothing is claimed."""
    assert not [what for what, verdict, _, _ in judge.some("hidden", COUNT, SEED) if verdict == "proved"]


@pytest.mark.nightly
@pytest.mark.parametrize("name", ["hibou", "lapbot"])
def test_a_guard_within_the_reach_of_the_mechanism_does_not_hide(name):
    """It is refuted or named. One that is proved refuses no state at which the reference model keeps all limits."""
    judge = Judge(name)
    verdicts = []
    for function, what, text in judge.drawn("guards", COUNT // 2, SEED):
        verdict, _, _ = judge.verdict(function, text)
        verdicts.append(verdict)
        if verdict == "proved":
            assert not _refused_within_limits(name, judge, function, what, text)
    assert verdicts.count("refuted") >= 1


def _refused_within_limits(name, judge, function, what, text):
    """Return states in the region of a guard that it refuses, and at which the reference model keeps all limits."""
    robot = twin.load(name)
    box = re.search(r"abs\((\w+) - (\S+)\) < (\S+?),", what)
    beyond = re.search(r"if_else\((\w+) > (\S+?),", what)
    generator = np.random.default_rng(3)
    low, high = np.array([r[1:] for r in judge.ranges.values()]).T
    states = generator.uniform(low, high, (400, len(low)))
    column = list(judge.ranges).index((box or beyond).group(1))
    if box:
        middle, width = float(box.group(2)), float(box.group(3))
        states[:, column] = generator.uniform(middle - width, middle + width, len(states))
    else:
        states[:, column] = generator.uniform(float(beyond.group(2)), high[column], len(states))
    right = compile_formula(robot.formula)
    known = np.isfinite(right.inverse_many(right.forward_many(states))).all(axis=1)
    with proof_mutants.with_text(function, text), np.errstate(all="ignore"):
        now = compile_formula(robot.formula)
        found = np.isfinite(now.inverse_many(now.forward_many(states))).all(axis=1)
    reached = []
    for q in states[known & ~found]:
        poses = robot.reference().solve(q).link_poses
        if all(joint.beyond(poses[joint.parent], poses[joint.child]) < 0 for joint in robot.mechanism.joints):
            reached.append(q)
    return reached


@pytest.mark.nightly
def test_a_campaign_continues_its_file(tmp_path, capsys):
    path = tmp_path / "slips.jsonl"
    proof_campaign.main("slips", "4", "1", "600", path, "pa10")
    lines = path.read_text(encoding="utf-8").splitlines()
    proof_campaign.main("slips", "6", "1", "600", path, "pa10")
    longer = path.read_text(encoding="utf-8").splitlines()
    assert longer[: len(lines)] == lines
    assert len(longer) > len(lines)
    assert "of 6 in the file" in capsys.readouterr().out
