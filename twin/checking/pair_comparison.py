"""Which files of a folder describe one robot, and how they differ."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import PurePosixPath

from twin.checking.check_finding import CheckFinding
from twin.checking.file_verdict import JudgedFile
from twin.comparison.compared_items import ComparedItem
from twin.comparison.comparison_result import Comparison
from twin.core.errors import TwinError
from twin.exchange.read import suffixes
from twin.exchange.xacro import XacroSettings

_SHOWN_PROPERTIES = 6
"""Maximum number of properties of a pair that are told; the last finding counts the others."""


def stem(name: str) -> str:
    """Return the name of a file without its suffixes, as "arm" of "urdf/arm.urdf.xacro"."""
    known_suffixes = suffixes()
    name_without_suffix = PurePosixPath(name).name
    while PurePosixPath(name_without_suffix).suffix.lower() in known_suffixes:
        name_without_suffix = name_without_suffix[: -len(PurePosixPath(name_without_suffix).suffix)]
    return name_without_suffix.lower()


def pairs(judged: Sequence[JudgedFile]) -> list[tuple[JudgedFile, JudgedFile]]:
    """Return the pairs of files that may describe one robot.

    Both files have the same moving joints, and either the same name of the robot or the same file name without suffix.
    Each file is paired with the first of its kind, so that n files give n - 1 pairs.
    """
    found_pairs: list[tuple[JudgedFile, JudgedFile]] = []
    first: dict[tuple[str, ...], JudgedFile] = {}
    for file in judged:
        if not file.joints:
            continue
        joints = "\0".join(file.joints)  # a character that no name has
        partners: list[JudgedFile] = []
        for key in ((joints, "robot", file.robot), (joints, "stem", stem(file.description.name))):
            partner = first.setdefault(key, file)
            if partner is not file and partner not in partners:
                partners.append(partner)
        for partner in partners:
            found_pairs.append((partner, file))
    return found_pairs


def variants(first: JudgedFile, second: JudgedFile) -> bool:
    """Return whether two files may differ on purpose: the same format, and different file names."""
    if stem(first.description.name) == stem(second.description.name):
        return False
    # a xacro is expanded to a URDF
    first_format = first.description.kind.replace("xacro", "urdf")
    second_format = second.description.kind.replace("xacro", "urdf")
    return first_format == second_format


def compare_two(first: JudgedFile, second: JudgedFile, xacro: XacroSettings) -> tuple[CheckFinding, ...]:
    """Return how two descriptions differ, as findings on the second."""
    from twin.api.comparison import compare

    labels = (first.description.name, second.description.name)
    subject = f"{labels[0]} and {labels[1]}"
    try:
        result = compare(first.description.path, second.description.path, xacro=xacro)
    except TwinError as error:
        text = str(error)
        for file in (first, second):
            text = text.replace(str(file.description.path), file.description.name)
        return (CheckFinding("compare/skipped", labels[1], subject, f"not compared: {text}"),)
    findings = tuple(_differences(result, labels, subject))
    if variants(first, second):
        return tuple(replace(finding, rule="compare/variant") for finding in findings)
    return findings


def _differences(result: Comparison, labels: tuple[str, str], subject: str) -> Iterator[CheckFinding]:
    """Yield a finding for each difference of a pair; `labels` are the names of its files, `subject` names both."""
    (pair,) = result.pairs
    file = labels[1]
    if pair.kinematics == "unexplained":
        text = f"{subject}: no small number of different links explains how they differ"
        yield CheckFinding("compare/different", file, subject, text)
        return
    for item in pair.differences:
        text = f"{item.text}, compared with {labels[0]}"
        yield CheckFinding(
            "compare/kinematics",
            file,
            f"joint '{item.joint}'",
            message=text,
            line=_line(item, pair.second.label),
            suggestion=_edit(item),
        )
    if pair.mimic is not None and not pair.agrees:
        texts = [f"{pair.mimic.text()}, compared with {labels[0]}"]
        if pair.mimic.part_text():  # also a hinge in another place disagrees
            texts.append(pair.mimic.part_text())
        yield CheckFinding("compare/kinematics", file, f"joint '{pair.mimic.leader}'", "; ".join(texts))
    if pair.properties is None:  # links of loops differ
        return
    rows = [row for row in pair.properties.rows if row.stated]
    for row in rows[:_SHOWN_PROPERTIES]:
        text = f"{row.kind} of '{row.where}': {row.second} here, {row.first} in {labels[0]}"
        yield CheckFinding("compare/property", file, f"{row.kind} of '{row.where}'", text)
    if len(rows) > _SHOWN_PROPERTIES:
        text = f"{len(rows) - _SHOWN_PROPERTIES} more limits, masses or drives differ from those in {labels[0]}"
        yield CheckFinding("compare/property", file, subject, text)


def _line(item: ComparedItem, label: str) -> int:
    """Return the line of the first edit in the second side; 0 if there is none."""
    for edit in item.edits:
        if edit.side == label:
            return edit.line
    return 0


def _edit(item: ComparedItem) -> str:
    """Return the first edit of each side as the way out."""
    texts: dict[str, str] = {}
    for edit in item.edits:
        texts.setdefault(edit.side, edit.text())
    if not texts:
        return ""
    return f"Edit {'; or '.join(texts.values())}."


@dataclass(frozen=True)
class PairJob:
    """Two files to compare."""

    first: JudgedFile
    second: JudgedFile
    xacro: XacroSettings


def compared_stream(job: PairJob) -> Iterator[tuple[CheckFinding, ...]]:
    """Yield the findings on one pair, for `twin.core.jobs.Stream`."""
    yield compare_two(job.first, job.second, job.xacro)
