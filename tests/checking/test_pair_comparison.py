"""`twin check`: what it tells of a pair whose comparison finds no properties, crashes or takes too long."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from comparison.test_common_posture import TOLERANCE, spatial_four_bar
from twin.checking import checker, file_verdict
from twin.checking.checker import NoAnswer, Workers, check
from twin.checking.descriptions import DescriptionFile, FolderContent
from twin.checking.file_verdict import JudgedFile, JudgeJob, judge
from twin.checking.pair_comparison import compare_two
from twin.comparison.comparison_result import Comparison
from twin.comparison.mimic import LinkError, MimicError
from twin.comparison.pair import compare_pair
from twin.comparison.side_pair import SidePair
from twin.core.errors import BudgetError
from twin.exchange.xacro import Expanded, XacroSettings


def described(name: str) -> JudgedFile:
    return JudgedFile(DescriptionFile(Path("/robots") / name, name, "urdf", "robot"), "judged", (), "arm", ("a",))


def told(pair: SidePair, monkeypatch: pytest.MonkeyPatch) -> list[tuple[str, str]]:
    """Return (rule, message) of the findings on a pair."""
    result = Comparison((pair.first, pair.second), (pair,), TOLERANCE)
    monkeypatch.setattr("twin.api.comparison.compare", lambda *_, **__: result)
    found = compare_two(described("a.xml"), described("a.urdf"), XacroSettings())
    return [(finding.rule, finding.message) for finding in found]


def test_links_of_a_loop_that_differ_are_told(monkeypatch: pytest.MonkeyPatch) -> None:
    pair = compare_pair(spatial_four_bar("one", 0.5), spatial_four_bar("other", 0.5, 0.291), TOLERANCE)
    assert pair.differences
    assert pair.properties is None
    found = told(pair, monkeypatch)
    assert [rule for rule, _ in found] == ["compare/kinematics"] * len(pair.differences)
    assert pair.differences[0].text in found[0][1]


@pytest.mark.parametrize("agrees", [True, False])
def test_the_error_of_mimic_joints_is_told_if_it_disagrees(agrees: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    side = spatial_four_bar("one", 0.5)
    link = LinkError("tip", 0.012, 0.3, 0.1, 0.1)
    hinges = (("pin", 0.003),)
    mimic = MimicError(
        "a.xml", "a.urdf", "finger", (0.0, 0.8), (link,), hinges, (), (), np.eye(4), None, (None, (0.0, 0.8))
    )
    pair = SidePair(side, side, "agree" if agrees else "disagree", (), (), None, None, None, None, mimic=mimic)
    found = told(pair, monkeypatch)
    if agrees:
        assert found == []
        return
    ((rule, message),) = found
    assert rule == "compare/kinematics"
    assert "12 mm" in message
    assert "joint 'pin' is 3 mm away" in message


@pytest.mark.parametrize("late", [True, False])
def test_a_comparison_that_crashes_is_no_note(late: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    one, other = described("a.xml"), described("a.urdf")

    def answers(_: Workers, jobs: list) -> Iterator[tuple[object, NoAnswer]]:
        for job in jobs:
            yield job, NoAnswer("KeyError: 'tip'", late)

    monkeypatch.setattr(checker, "_judge_all", lambda *_, **__: ([one, other], []))
    monkeypatch.setattr(Workers, "answers", answers)
    result = check(tmp_path)
    (finding,) = result.found
    assert (finding.rule, finding.level) == (("compare/skipped", "note") if late else ("file/unjudged", "error"))
    assert finding.message == "not compared with a.xml: KeyError: 'tip'"
    assert result.compared == 0
    assert result.verdict == ("agree" if late else "unchecked")


class Ended:
    """A process that has ended with a text."""

    def poll(self) -> tuple[list[object], str]:
        """Return no pieces and the text."""
        return [], "KeyError: 'tip'"


def test_the_end_of_a_process_is_not_taken_for_a_late_answer() -> None:
    answer = Workers(file_verdict.judged_stream, 1, 1.0)._answer(Ended(), 0.0)  # pyright: ignore[reportArgumentType]
    assert answer == NoAnswer("KeyError: 'tip'")


def test_a_package_elsewhere_that_is_too_large_leaves_the_xacro_as_it_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "arm.xacro"
    text = b'<robot name="arm" xmlns:xacro="http://ros.org/wiki/xacro"><xacro:hand/></robot>'
    file.write_bytes(text)

    def expand(_: Path, settings: XacroSettings) -> Expanded:
        if settings.packages:
            raise BudgetError("the xacro makes more than 16 MB")
        return Expanded(text, ("package 'hand' is missing.",))

    monkeypatch.setattr(file_verdict, "expand", expand)
    job = JudgeJob(DescriptionFile(file, file.name, "xacro", "robot"), FolderContent(tmp_path), XacroSettings())
    one = judge(job)
    assert one.status == "incomplete"
    assert [finding.message for finding in one.findings] == ["package 'hand' is missing."]
