"""The clip of a file with its reference: keys at other times, values that are no numbers; the table of worst checks."""

from __future__ import annotations

import numpy as np
import pytest

from twin.exchange.audit.clip_comparison import compare_clips
from twin.exchange.audit.clip_references import Reference
from twin.exchange.audit.file_content import Content, FileClip
from twin.exchange.audit.ledger import Ledger
from twin.exchange.audit.report import worst

TIMES = np.arange(5.0)


def along_x(*positions: float) -> dict[str, np.ndarray]:
    """Return the poses of one link that is moved by some lengths in m."""
    T = np.tile(np.eye(4), (len(positions), 1, 1))
    T[:, 0, 3] = positions
    return {"arm": T}


def compared(clip: FileClip, reference: FileClip) -> Ledger:
    """Return the ledger of a file after comparing its only clip."""
    content = Content(Ledger("a.glb"), "glb", clips=[clip])
    compare_clips([content], {"swing": Reference(reference, "t.json")})
    return content.ledger


@pytest.mark.parametrize(
    ("times", "positions", "codes", "compared_keys"),
    [
        ((0, 2, 4, 6, 8), (0.0, 0.1, 0.2, 0.3, 0.4), ["compare.times"], 5),  # twice as long, and as many keys
        ((0, 1, 2.3, 3, 4), (0.0, 0.1, 0.2, 0.3, 0.4), ["compare.times"], 5),
        ((0, 1, 2.3, 3, 4), (0.0, 0.1, 0.21, 0.3, 0.4), ["compare.times", "compare.pose"], 5),
        ((0, 0.5, 1, 2, 4), (0.0, 0.05, 0.1, 0.2, 0.4), ["compare.times"], 4),  # one key more, and one missing
    ],
)
def test_keys_at_other_times_are_compared_with_those_that_they_are(times, positions, codes, compared_keys):
    clip = FileClip("swing", np.array(times, float), along_x(*positions))
    ledger = compared(clip, FileClip("swing", TIMES, along_x(0.0, 0.1, 0.2, 0.3, 0.4)))
    assert [finding.code for finding in ledger.found] == codes
    assert any(f"1 links x {compared_keys} keys" in check.check for check in ledger.checks)


@pytest.mark.parametrize(
    ("value", "expected", "size", "verdict"),
    [
        (float("nan"), 0.0, None, "disagree"),
        (0.0, float("inf"), None, "disagree"),
        (1000.0005, 1000.0, pytest.approx(5e-4, rel=1e-6), "agree"),
        (1000.5, 1000.0, pytest.approx(0.5), "disagree"),
    ],
)
def test_the_row_of_joint_values_has_the_verdict_of_its_findings(value, expected, size, verdict):
    still = along_x(0, 0, 0, 0, 0)
    clip = FileClip("swing", TIMES, still, {"q": np.array([0, value, 0, 0, 0])})
    ledger = compared(clip, FileClip("swing", TIMES, still, {"q": np.array([0, expected, 0, 0, 0])}))
    (row,) = [check for check in ledger.checks if "joint values" in check.check]
    assert (row.worst, row.verdict) == (size, verdict)
    assert [finding.code for finding in ledger.found] == ([] if verdict == "agree" else ["compare.joint"])


def test_the_rows_of_poses_are_those_of_the_link_whose_pose_is_not_a_number():
    right = along_x(0, 0, 0, 0, 0)["arm"]
    broken = right.copy()
    broken[2] = np.nan
    clip = FileClip("swing", TIMES, {"arm": right, "hand": broken})
    ledger = compared(clip, FileClip("swing", TIMES, {"arm": right, "hand": right}))
    assert [finding.where for finding in ledger.found] == ["a.glb: hand"]
    rows = [(check.where, check.verdict) for check in ledger.checks if "links x" in check.check]
    assert rows == [("hand", "disagree"), ("hand", "disagree")]


@pytest.mark.parametrize("beyond", [float("inf"), float("nan")])
def test_the_table_shows_a_deviation_that_is_not_finite_as_the_worst_of_its_kind(beyond):
    ledger = Ledger("a.glb")
    ledger.row("clip 'swing': position", 0.5, "m", 0.1, where="arm")
    ledger.row("clip 'reach': position", beyond, "m", 0.1, where="hand")
    ledger.row("clip 'hold': position", 0.7, "m", 0.1, where="tip")
    (row,) = worst(ledger.checks)
    assert row.where == "hand"
