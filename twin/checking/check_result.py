"""The result of `twin check`: findings, statuses of the files, verdict."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar

from twin.checking.check_finding import CheckFinding
from twin.checking.file_verdict import JudgedFile
from twin.checking.junit import fails, junit
from twin.checking.rules import LEVELS, Level
from twin.checking.sarif import sarif
from twin.core.findings import Finding, Verdict
from twin.core.json_types import JsonObject
from twin.core.result import Line, Part, Result, TextTable

_SHOWN = 5
"""Number of findings of one rule and one file that the text shows."""

_MARKS: dict[Level, str] = {"note": "·", "warning": "▲", "error": "✖"}


@dataclass(frozen=True)
class FolderCheck(Result):
    """The result of the check of a folder.

    Attributes:
        folder: the folder.
        judged: what was found in each file.
        found: all findings, by file and line.
        compared: number of pairs of files that were compared.
        fail_on: the least level with which a new finding fails.
        baseline: path of the baseline, "" without one.
        forgotten: number of findings of the baseline that were not found again.
        prefix: path of the folder in its repository, such as "robots/"; "" for the repository itself.
    """

    kind: ClassVar[str] = "check"

    folder: str
    judged: tuple[JudgedFile, ...]
    found: tuple[CheckFinding, ...]
    compared: int = 0
    fail_on: Level = "error"
    baseline: str = ""
    forgotten: int = 0
    prefix: str = ""

    @property
    def findings(self) -> list[Finding]:
        """The new warnings and errors in the form of all results."""
        return [finding.as_finding() for finding in self.found if not finding.known and finding.level != "note"]

    @property
    def failing(self) -> list[CheckFinding]:
        """The findings that fail."""
        return [finding for finding in self.found if fails(finding, self.fail_on)]

    @property
    def verdict(self) -> Verdict:
        """Whether findings fail ("disagree"); "unchecked" if a file could not be judged, or there is none."""
        unjudged = [finding for finding in self.failing if finding.rule == "file/unjudged"]
        if len(self.failing) > len(unjudged):
            return "disagree"
        judged = [one for one in self.robots if one.status == "judged"]
        if unjudged or not judged:
            return "unchecked"
        return "agree"

    @property
    def word(self) -> str:
        """The verdict as text."""
        texts = {"agree": "No findings", "disagree": "Findings", "unchecked": "Could not be checked"}
        if self.verdict == "agree" and self.count("warning"):
            return "No errors"
        return texts[self.verdict]

    @property
    def robots(self) -> list[JudgedFile]:
        """The files that describe a robot."""
        return [one for one in self.judged if one.status not in ("no robot", "part")]

    @property
    def skipped(self) -> int:
        """Number of pairs that could not be compared."""
        return sum(finding.rule == "compare/skipped" for finding in self.found)

    def count(self, level: Level) -> int:
        """Return the number of new findings of a level."""
        return sum(finding.level == level and not finding.known for finding in self.found)

    def content(self) -> JsonObject:
        """Return files and findings as plain data."""
        files: list[JsonObject] = []
        for one in self.judged:
            files.append(
                {"file": one.description.name, "format": one.description.kind, "status": one.status, "robot": one.robot}
            )
        counts: dict[str, int] = {}
        for level in LEVELS:
            counts[level] = self.count(level)
        return {
            "folder": self.folder,
            "fail_on": self.fail_on,
            "files": files,
            "compared": self.compared,
            "skipped": self.skipped,
            "counts": counts,
            "known": sum(finding.known for finding in self.found),
            "baseline": self.baseline or None,
            "forgotten": self.forgotten,
            "results": [finding.as_dict() for finding in self.found],
        }

    def sarif(self) -> JsonObject:
        """Return the findings as SARIF 2.1.0."""
        return sarif(self.found, self.prefix)

    def junit(self) -> str:
        """Return the files as test cases of JUnit XML."""
        return junit(self.robots, self.found, self.fail_on)

    def text(self) -> Iterator[Part]:
        """Yield the new warnings and errors by file, and the summary."""
        yield from self.lines(False)

    def lines(self, notes: bool) -> Iterator[Part]:
        """Yield the text, with `notes` also the notes and every finding of a rule."""
        shown: Counter[tuple[str, str]] = Counter()
        hidden: Counter[tuple[str, str]] = Counter()
        for finding in self.found:
            if finding.known or (finding.level == "note" and not notes):
                continue
            key = (finding.file, finding.rule)
            if shown[key] >= _SHOWN and not notes:
                hidden[key] += 1
                continue
            shown[key] += 1
            yield f"{_MARKS[finding.level]} {finding.place}: {finding.message} [{finding.rule}]"
            if shown[key] == 1:
                yield f"    {finding.advice}"
        for (file, rule), count in hidden.items():
            yield f"  and {count} more of {rule} in {file} (--all shows them)"
        yield from self._summary()

    def _summary(self) -> Iterator[Part]:
        statuses = Counter(one.status for one in self.robots)
        formats = Counter(one.description.kind for one in self.robots)
        texts = [f"{count} {kind}" for kind, count in sorted(formats.items())]
        listed = f" ({', '.join(texts)})" if texts else ""
        yield f"\n{len(self.robots)} descriptions{listed}, {self.compared} pairs compared"
        if self.skipped:
            yield f"  {self.skipped} pairs not compared: --all tells why"
        for status in ("incomplete", "unsupported", "unjudged"):
            if statuses[status]:
                yield f"  {statuses[status]} {status}: --all tells why"
        rows: list[tuple[str, str, str]] = []
        rules = Counter(finding.rule for finding in self.found if not finding.known and finding.level != "note")
        for finding in self.found:
            if finding.known:
                continue
            count = rules.pop(finding.rule, 0)
            if count:
                rows.append((finding.rule, finding.level, str(count)))
        if rows:
            yield TextTable(("rule", "level", "findings"), rows)
        known = sum(finding.known for finding in self.found)
        if self.baseline:
            yield f"  {known} known from {self.baseline}, {self.forgotten} of it not found again"
        if not self.robots:
            yield "  no robot description was found: give a folder with URDF, xacro, MJCF, SDF, USD or a DH table"
        styles = {"agree": "bold green", "disagree": "bold red", "unchecked": "bold yellow"}
        yield Line(
            f"{self.word}: {self.count('error')} errors, {self.count('warning')} warnings.", styles[self.verdict]
        )
