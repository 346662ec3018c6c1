"""The report of an audit: files, checks and findings of all ledgers, as tables and as JSON."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from twin.core import format
from twin.core.findings import Finding, by_severity, verdict
from twin.core.json_types import JsonMapping, JsonObject
from twin.core.result import Part, Result, TextTable
from twin.exchange.audit.ledger import Check, Ledger
from twin.exchange.audit.pose_deviation import POSITION_TOL, ROTATION_TOL
from twin.exchange.audit.value_text import quantity

_CERTIFICATE_CHECKS = ("claim", "bound", "workspace", "protocol")
"""Checks of the certificates of `twin prove`, which are compared with nothing but what they claim."""


@dataclass(frozen=True)
class AuditReport(Result):
    """The result of `audit`.

    Attributes:
        path: the audited file or folder.
        files: of each file its name "file" and "format", its "clips" ("name", "keys" and "duration_s" of each), the
            numbers of "links" (None: it marks none) and "nodes", and conventions such as "units", "up_axis" and
            "handedness".
        checks: all measurements.
        findings: all findings, the most severe first.
    """

    path: str
    files: list[JsonObject]
    checks: list[Check]
    findings: list[Finding]

    kind = "audit"

    def content(self) -> JsonObject:
        """Return the report as plain data for JSON."""
        return {"path": self.path, "files": self.files, "checks": list(map(Check.as_dict, self.checks))}

    @property
    def headline(self) -> str:
        """The verdict in one sentence; it states what could not be checked, and whether anything was compared."""
        if self.verdict == "disagree":
            return "FAIL: files are invalid or inconsistent with each other; see the findings"
        if self.verdict == "unchecked":
            causes = []
            for finding in self.findings:
                if finding.severity == "error":
                    causes.append(finding)
            text = f"UNCHECKED: {causes[0].message}"
            if len(causes) > 1:
                text += f" And {len(causes) - 1} more, see the findings."
            return text
        if any(check.against for check in self.checks):
            return "PASS: all files are valid and consistent with each other"
        names = {check.check for check in self.checks}
        if not names.isdisjoint(_CERTIFICATE_CHECKS):
            return "VALID: what the certificate claims holds wherever it was tried"
        return "VALID: the file is well formed; there is nothing to compare it with"

    def text(self, everything: bool = False) -> Iterator[Part]:
        """Yield the parts of the report: files, the worst check of each kind, all findings except notes.

        If `everything` is True, all checks and all findings are included.
        """
        yield f"{self.path}\n\n  {self.headline}\n"
        if self.files:
            titles = ("file", "units", "up", "handed", "links", "clips")
            yield TextTable(titles, list(map(_row_of_file, self.files)))
            yield ""
        checks = self.checks if everything else worst(self.checks)
        if checks:
            titles = ("check", "worst in", "worst", "tolerance", "where", "when", "")
            yield TextTable(titles, list(map(_row_of_check, checks)))
            yield ""
        shown_count = 0
        for reported in by_severity(self.findings):
            if everything or reported.severity != "info":
                shown_count += 1
                yield reported
        counts = self._counts(len(self.findings) - shown_count)
        if shown_count:
            counts = f"\n{counts}"
        yield counts

    def _counts(self, notes: int) -> str:
        """Return the last line of the text: counts of checks and findings, of which `notes` are not shown."""
        checks = format.count(len(self.checks), "check")
        findings = format.count(len(self.findings), "finding")
        if notes:
            findings += f", of which {format.count(notes, 'note')} (shown by --all)"
        position = f"{POSITION_TOL * 1e6:g} µm"
        rotation = f"{math.degrees(ROTATION_TOL):.3g} deg"
        return f"  {checks}, {findings}; tolerance of poses: {position} and {rotation}"


_MARKS = {"agree": "ok", "disagree": "WRONG", "unchecked": "?"}


def worst(checks: Sequence[Check]) -> list[Check]:
    """Return the worst check of each kind. Checks that differ only in clip, file and counts are of the same kind."""
    kinds: dict[str, Check] = {}
    for check in checks:
        kind = re.sub(r"clip '[^']*': | against [^,]*|, \d.*|\d+", "", check.check)
        first = kinds.setdefault(kind, check)
        if _severity_of_check(check) > _severity_of_check(first):
            kinds[kind] = check
    return list(kinds.values())


def _severity_of_check(check: Check) -> tuple[bool, float]:
    """Return what decides which of two checks of a kind is worse: first the verdict, then the deviation."""
    size = check.worst
    if size is None:
        # A disagreement without a number is infinite, or what should be measured is not there.
        size = math.inf if check.verdict == "disagree" else 0.0
    return check.verdict != "agree", size


def _row_of_file(file: JsonMapping) -> tuple[str, ...]:
    """Return a file's row in the table of files; without marked links, the number of its nodes."""
    links = str(file["links"])
    if file["links"] is None:
        links = f"{file['nodes']} nodes"
    clips = []
    for clip in file["clips"]:
        clips.append(f"{clip['name']} ({clip['keys']} keys, {clip['duration_s']:.3f} s)")
    units = str(file.get("units", ""))
    up = str(file.get("up_axis", ""))
    handedness = str(file.get("handedness", ""))
    return file["file"], units, up, handedness, links, ", ".join(clips) or "-"


def _row_of_check(check: Check) -> tuple[str, ...]:
    """Return a check's row in the table of checks."""
    size = _displayed(check.worst, check.unit)
    if format.is_exact(check.worst, check.unit, check.tolerance):
        size = format.EXACT
    tolerance = _displayed(check.tolerance, check.unit)
    return check.check, check.file, size, tolerance, check.where, check.when, _MARKS[check.verdict]


def _displayed(value: float | None, unit: str) -> str:
    """Return a value with three digits and its unit as a table shows it: angles in degrees, "" for None."""
    if value is None:
        return ""
    if unit == "rad":
        return f"{math.degrees(value):.3g} deg"
    if unit == "1":
        unit = ""
    return quantity(value, unit, 3).strip().replace("um", "µm")


def finished(path: str, files: list[JsonObject], ledgers: list[Ledger]) -> AuditReport:
    """Return the report with the checks and findings of all ledgers."""
    checks: list[Check] = []
    findings: list[Finding] = []
    for ledger in ledgers:
        checks += ledger.checks
        findings += ledger.findings
    if verdict(findings) == "agree" and not _has_content(files, checks):  # "agree" would be false
        none = Ledger(path)
        none.add("audit.no_checks", "error", "the files have nothing that can be checked.")
        findings += none.findings
    return AuditReport(path, files, checks, by_severity(findings))


def _has_content(files: list[JsonObject], checks: list[Check]) -> bool:
    """Return whether something was checked, and one of the files, if there are any, has links or nodes."""
    if not checks:
        return False
    if not files:
        return True  # a certificate has no links
    return any(file["links"] or file["nodes"] for file in files)
