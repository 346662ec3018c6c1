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
from twin.core.format import count
from twin.core.json_types import JsonObject
from twin.core.result import Line, Part, Result, TextTable

_SHOWN_PER_RULE = 5
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
        findings = []
        for finding in self.found:
            if not finding.known and finding.level != "note":
                findings.append(finding.as_finding())
        return findings

    @property
    def failing(self) -> list[CheckFinding]:
        """The findings that fail."""
        return [finding for finding in self.found if fails(finding, self.fail_on)]

    @property
    def verdict(self) -> Verdict:
        """Whether findings fail ("disagree"); "unchecked" if a file could not be judged, or there is none."""
        failing_rules = [finding.rule for finding in self.failing]
        unjudged_count = failing_rules.count("file/unjudged")
        if len(failing_rules) > unjudged_count:
            return "disagree"
        statuses = [file.status for file in self.robots]
        # a folder in which nothing was judged does not pass
        if unjudged_count or "judged" not in statuses:
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
        return [file for file in self.judged if file.status not in ("no robot", "part")]

    @property
    def skipped(self) -> int:
        """Number of pairs that could not be compared."""
        rules = [finding.rule for finding in self.found]
        return rules.count("compare/skipped")

    @property
    def known_count(self) -> int:
        """Number of findings that are in the baseline."""
        flags = [finding.known for finding in self.found]
        return flags.count(True)

    def count(self, level: Level) -> int:
        """Return the number of new findings of a level."""
        count = 0
        for finding in self.found:
            if finding.level == level and not finding.known:
                count += 1
        return count

    def content(self) -> JsonObject:
        """Return files and findings as plain data."""
        files: list[JsonObject] = []
        for file in self.judged:
            description = file.description
            files.append(
                {"file": description.name, "format": description.kind, "status": file.status, "robot": file.robot}
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
            "known": self.known_count,
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
        shown_counts: Counter[tuple[str, str]] = Counter()
        hidden_counts: Counter[tuple[str, str]] = Counter()
        for finding in self.found:
            if finding.known or (finding.level == "note" and not notes):
                continue
            key = (finding.file, finding.rule)
            if shown_counts[key] >= _SHOWN_PER_RULE and not notes:
                hidden_counts[key] += 1
                continue
            shown_counts[key] += 1
            yield f"{_MARKS[finding.level]} {finding.place}: {finding.message} [{finding.rule}]"
            if shown_counts[key] == 1:  # the advice is that of the rule: once for a file is enough
                yield f"    {finding.advice}"
        for (file, rule), number in hidden_counts.items():
            yield f"  and {number} more of {rule} in {file} (--all shows them)"
        yield from self._summary()

    def _summary(self) -> Iterator[Part]:
        """Yield the numbers of files, pairs and findings, and the verdict."""
        statuses: Counter[str] = Counter()
        formats: Counter[str] = Counter()
        for file in self.robots:
            statuses[file.status] += 1
            formats[file.description.kind] += 1
        texts = []
        for kind, number in sorted(formats.items()):
            texts.append(f"{number} {kind}")
        formats_text = ""
        if texts:
            formats_text = f" ({', '.join(texts)})"
        descriptions = count(len(self.robots), "description")
        yield f"\n{descriptions}{formats_text}, {count(self.compared, 'pair')} compared"
        if self.skipped:
            yield f"  {count(self.skipped, 'pair')} not compared: --all tells why"
        for status in ("incomplete", "unsupported", "unjudged"):
            if statuses[status]:
                yield f"  {statuses[status]} {status}: --all tells why"
        counts: dict[tuple[str, str], int] = {}  # by rule and its level, in the order of the findings
        for finding in self.found:
            if not finding.known and finding.level != "note":
                key = (finding.rule, finding.level)
                counts[key] = counts.get(key, 0) + 1
        rows = []
        for (rule, level), number in counts.items():
            rows.append((rule, level, str(number)))
        if rows:
            yield TextTable(("rule", "level", "findings"), rows)
        if self.baseline:
            yield f"  {self.known_count} known from {self.baseline}, {self.forgotten} of it not found again"
        if not self.robots:
            yield "  no robot description was found: give a folder with URDF, xacro, MJCF, SDF, USD or a DH table"
        styles = {"agree": "bold green", "disagree": "bold red", "unchecked": "bold yellow"}
        yield Line(
            f"{self.word}: {self.count('error')} errors, {self.count('warning')} warnings.", styles[self.verdict]
        )
