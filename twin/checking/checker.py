"""The check of a folder: all files, in other processes with a limit of time; then pairs of files."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from twin.checking.baseline import read_baseline
from twin.checking.check_finding import CheckFinding, numbered
from twin.checking.check_result import FolderCheck
from twin.checking.descriptions import DescriptionFile, FolderContent, walk
from twin.checking.file_verdict import JudgedFile, JudgeJob, judged_stream
from twin.checking.pair_comparison import PairJob, compared_stream, pairs
from twin.checking.places import repository_prefix
from twin.checking.rules import LEVELS, Level
from twin.checking.workers import NoAnswer, Workers
from twin.core.errors import CodeRefusedError, TwinError
from twin.core.foreign.consent import require_consent
from twin.core.progress import Progress, silent
from twin.exchange.xacro import XacroSettings

SECONDS = 120.0
"""Time in s that one file, or one pair of files, may take."""

_SHARE_OF_FILES = 0.8
"""Part of the progress that is that of single files; the rest is that of pairs."""


def check(
    folder: str | Path,
    *,
    exclude: Sequence[str] = (),
    xacro: XacroSettings | None = None,
    compare: bool = True,
    baseline: str | Path | None = None,
    fail_on: Level = "error",
    jobs: int = 1,
    seconds: float = SECONDS,
    progress: Progress = silent,
) -> FolderCheck:
    """Check every robot description in a folder and its subfolders, and compare those that describe one robot.

    Args:
        folder: the folder.
        exclude: patterns of files and folders that are left out, as in a .gitignore file.
        xacro: arguments for all xacros, and folders with packages.
        compare: whether descriptions of one robot are compared.
        baseline: a file with known findings, which do not fail.
        fail_on: least level of a finding that fails: "error", "warning" or "note".
        jobs: number of processes.
        seconds: time in s that one file, or one pair, may take; a slower file is not judged.
        progress: see `Progress`.

    Raises:
        TwinError: the folder or the baseline cannot be read, or an option has no meaning.

    Examples:
        >>> from pathlib import Path
        >>> import twin
        >>> text = "<robot name='r'><link name='a'/><link name='b'/><joint name='j' type='revolute'>"
        >>> text += "<parent link='a'/><child link='b'/></joint></robot>"
        >>> Path("arms").mkdir()
        >>> _ = Path("arms/r.urdf").write_text(text)
        >>> twin.check("arms").verdict
        'disagree'
    """
    if jobs < 1:
        raise TwinError(f"jobs {jobs}: give at least 1")
    if not seconds > 0:
        raise TwinError(f"seconds {seconds:g}: give a positive time")
    if fail_on not in LEVELS:
        raise TwinError(f"fail_on '{fail_on}': use one of {', '.join(LEVELS)}")
    settings = xacro or XacroSettings()
    known_fingerprints: set[str] = set()
    if baseline is not None:
        known_fingerprints = read_baseline(Path(baseline))
    progress("search", 0.0)
    tree = walk(Path(folder), exclude, settings.packages)
    judged, findings = _judge_all(tree, settings, jobs=jobs, seconds=seconds, progress=progress)
    chosen_pairs = []
    if compare:
        chosen_pairs = pairs(judged)
    pair_findings = _compare_all(chosen_pairs, settings, jobs=jobs, seconds=seconds, progress=progress)
    findings += pair_findings
    for name, reason in tree.unreadable.items():
        findings.append(CheckFinding("file/unjudged", name, "", f"cannot be read ({reason})"))
    all_findings: list[CheckFinding] = []
    for finding in numbered(findings):
        all_findings.append(replace(finding, known=finding.fingerprint in known_fingerprints))
    fingerprints = {finding.fingerprint for finding in all_findings}
    forgotten = len(known_fingerprints - fingerprints)
    baseline_path = ""
    if baseline is not None:
        baseline_path = str(baseline)
    prefix = repository_prefix(Path(folder))
    # a pair that is not compared has one finding of these rules, and no other
    rules = [finding.rule for finding in pair_findings]
    compared = len(chosen_pairs) - rules.count("compare/skipped") - rules.count("file/unjudged")
    return FolderCheck(
        str(folder),
        judged=tuple(judged),
        found=tuple(all_findings),
        compared=compared,
        fail_on=fail_on,
        baseline=baseline_path,
        forgotten=forgotten,
        prefix=prefix,
    )


def _judge_all(
    tree: FolderContent, settings: XacroSettings, jobs: int, seconds: float, progress: Progress
) -> tuple[list[JudgedFile], list[CheckFinding]]:
    """Return the results of all files, by name, and their findings; `seconds` is the time of one file."""
    findings: list[CheckFinding] = []
    refused: dict[str, JudgedFile] = {}
    work: list[JudgeJob] = []
    # each job is sent to a process with the folder's content, but a file needs no other descriptions
    without_descriptions = replace(tree, descriptions=[])
    for description in tree.descriptions:
        if description.kind == "xacro":
            try:  # stated here, where the user sees it; the processes below print nothing
                require_consent(description.path)
            except CodeRefusedError as error:
                refused[description.name] = _unjudged(description, str(error))
                continue
        work.append(JudgeJob(description, without_descriptions, settings))
    results: dict[str, JudgedFile] = dict(refused)
    for number, (job, answer) in enumerate(Workers(judged_stream, jobs, seconds).answers(work)):
        progress(f"read {job.description.name}", _SHARE_OF_FILES * (number + 1) / len(work))
        if isinstance(answer, NoAnswer):
            answer = _unjudged(job.description, answer.reason)
        results[job.description.name] = answer
    judged: list[JudgedFile] = []
    # processes finish in any order: the result has the order of the files
    for description in tree.descriptions:
        judged_file = results[description.name]
        judged.append(judged_file)
        findings += judged_file.findings
    return judged, findings


def _compare_all(
    chosen: Sequence[tuple[JudgedFile, JudgedFile]],
    settings: XacroSettings,
    jobs: int,
    seconds: float,
    progress: Progress,
) -> list[CheckFinding]:
    """Return the findings on all chosen pairs; `seconds` is the time of one pair."""
    findings: list[CheckFinding] = []
    work = []
    for first, second in chosen:
        work.append(PairJob(first, second, settings))
    for number, (job, answer) in enumerate(Workers(compared_stream, jobs, seconds).answers(work)):
        name = job.second.description.name
        progress(f"compare {name}", _SHARE_OF_FILES + (1 - _SHARE_OF_FILES) * (number + 1) / len(work))
        if isinstance(answer, NoAnswer):
            subject = f"{job.first.description.name} and {name}"
            # `compare_two` answers a pair that cannot be compared: without an answer in time, the comparison crashed
            rule = "compare/skipped" if answer.late else "file/unjudged"
            text = f"not compared with {job.first.description.name}: {answer.reason}"
            answer = (CheckFinding(rule, name, subject, text),)
        findings += answer
    return findings


def _unjudged(description: DescriptionFile, message: str) -> JudgedFile:
    """Return the result of a file that could not be judged, with the reason."""
    text = message.removeprefix(f"{description.path}: ")
    return JudgedFile(description, "unjudged", (CheckFinding("file/unjudged", description.name, "", text),))
