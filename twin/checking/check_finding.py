"""A finding of a check, with its place in a file."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterable
from dataclasses import dataclass, replace

from twin.checking.rules import LEVELS, RULES, Level
from twin.core.findings import Finding, Severity
from twin.core.json_types import JsonObject

_LINE = re.compile(r"(:\d+)+\b|\bline \d+(, column \d+)?")
"""Line numbers in messages, which no fingerprint contains."""

_SEVERITY: dict[Level, Severity] = {"note": "info", "warning": "warning", "error": "disagreement"}


@dataclass(frozen=True)
class CheckFinding:
    """One finding.

    Attributes:
        rule: identifier in `RULES`.
        file: path relative to the checked folder, with /.
        subject: the element, such as "joint 'elbow'"; "" for the file.
        message: one sentence with value and limit.
        line: line in the file, from 1; 0 if unknown.
        suggestion: the way out; "" for that of the rule.
        occurrence: number of the finding among those with the same rule, file, subject and message.
        known: whether the baseline has it.
    """

    rule: str
    file: str
    subject: str
    message: str
    line: int = 0
    suggestion: str = ""
    occurrence: int = 0
    known: bool = False

    @property
    def level(self) -> Level:
        """The level of the rule."""
        return RULES[self.rule].level

    @property
    def advice(self) -> str:
        """The way out."""
        return self.suggestion or RULES[self.rule].help

    @property
    def place(self) -> str:
        """File and line."""
        if self.line:
            return f"{self.file}:{self.line}"
        return self.file

    @property
    def fingerprint(self) -> str:
        """Hexadecimal digits that stay the same if lines move; another value in the message changes them."""
        message = _LINE.sub("", self.message)
        parts = (self.rule, self.file, self.subject, message, str(self.occurrence))
        # names of files need not be UTF-8
        data = "\0".join(parts).encode("utf-8", "surrogateescape")
        return hashlib.sha256(data).hexdigest()[:32]

    def as_finding(self) -> Finding:
        """Return the finding in the form of all results."""
        severity = _SEVERITY[self.level]
        if self.rule == "file/unjudged":  # of all results, an error means that a check could not be made
            severity = "error"
        return Finding(f"check.{self.rule}", severity, self.message, where=self.place, suggestion=self.advice)

    def as_dict(self) -> JsonObject:
        """Return the finding as plain data."""
        return {
            "rule": self.rule,
            "level": self.level,
            "file": self.file,
            "line": self.line or None,
            "subject": self.subject,
            "message": self.message,
            "suggestion": self.advice,
            "fingerprint": self.fingerprint,
            "known": self.known,
        }


def readable(text: str) -> str:
    """Return a text for a file in UTF-8: what is not UTF-8 in names of files becomes the sign �."""
    return text.encode("utf-8", "surrogateescape").decode("utf-8", "replace")


def numbered(findings: Iterable[CheckFinding]) -> list[CheckFinding]:
    """Return the findings by file and line, equal ones counted; a finding that is told twice for one line once."""
    counts: dict[tuple[str, str, str, str], int] = {}
    identities: set[tuple[str, str, str, str, int]] = set()
    numbered_findings: list[CheckFinding] = []
    for finding in sorted(findings, key=_order):
        if (finding.rule, finding.file, finding.subject, finding.message, finding.line) in identities:
            continue
        identities.add((finding.rule, finding.file, finding.subject, finding.message, finding.line))
        # as in the fingerprint, so that two findings of one text with different lines have two fingerprints
        key = (finding.rule, finding.file, finding.subject, _LINE.sub("", finding.message))
        count = counts.get(key, 0)
        counts[key] = count + 1
        numbered_findings.append(replace(finding, occurrence=count))
    return numbered_findings


def _order(finding: CheckFinding) -> tuple[str, int, int, str, str, str]:
    rank = -LEVELS.index(finding.level)
    return (finding.file, finding.line, rank, finding.rule, finding.subject, finding.message)
