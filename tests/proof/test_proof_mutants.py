"""Mutants of the equations: no wrong one is proved; rewritten equations are; errors in small boxes do not hide.

TWIN_PROOF_MUTANTS mutants of each kind are drawn for each robot, with the seed TWIN_PROOF_SEED.
"""

from __future__ import annotations

import os

import pytest

from made import proof_campaign
from made.proof_campaign import WRONG, Judge

COUNT = int(os.environ.get("TWIN_PROOF_MUTANTS", "40"))
SEED = int(os.environ.get("TWIN_PROOF_SEED", "0"))


@pytest.fixture(scope="module", params=["sils", "pa10", "hibou", "davinci_ecm"])
def judge(request):
    return Judge(request.param)


@pytest.mark.nightly
def test_no_wrong_mutant_is_proved(judge):
    verdicts = list(judge.some("slips", COUNT, SEED))
    assert not [found for found in verdicts if found[1] == "proved" and found[2] > WRONG]
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
def test_a_campaign_continues_its_file(tmp_path, capsys):
    path = tmp_path / "slips.jsonl"
    proof_campaign.main("slips", "4", "1", "600", path, "pa10")
    lines = path.read_text(encoding="utf-8").splitlines()
    proof_campaign.main("slips", "6", "1", "600", path, "pa10")
    longer = path.read_text(encoding="utf-8").splitlines()
    assert longer[: len(lines)] == lines
    assert len(longer) > len(lines)
    assert "of 6 in the file" in capsys.readouterr().out
